"""Regulation through parameter jumps in feedback form, beside Francis regulators that are switched, in MuJoCo.

The tip of a flexible cantilever follows an exosystem, y_d = 1 - cos t on [0, 2 pi], while its tip mass jumps. With the exact map
u = F(t) x_e - K (x - G(t) x_e) keeps the output exact through the jumps and where the exosystem starts and stops; Francis
regulators that are exchanged at the jumps, the usual practice, leave a transient at each of them: more feedback shortens it, at the
price of more input. Then the cycle goes on for many exchanges of the payload, with all states known, and with none. Claim tested:
Devasia, Paden, Rossi, "Exact-output tracking theory for systems with parameter jumps" (1996), sections 3 to 5.
"""

from __future__ import annotations

from regulator import long_run, manoeuvre, published
from regulator.figures import figures
from regulator.rig import POLES, cantilever, rig

from invtrack.studies import Setup, Study, StudyOptions


def build(options: StudyOptions) -> Setup:
    plant = cantilever()
    paper = rig(plant, manoeuvre.MASSES, manoeuvre.JUMPS, end=manoeuvre.END)
    many = long_run.long_rig(plant)
    G_0 = published.published(paper.model, paper.maps["exact_map"].exosystem)
    estimate = manoeuvre.estimate_errors(paper, options.timestep)
    decay = manoeuvre.decay_rates(*estimate)
    rate = long_run.rate_through_jumps(many)
    return Setup(
        [*manoeuvre.cases(paper), *long_run.cases(many)],
        sections={
            **G_0,
            "estimate_decay": decay,
            "closed_loop_poles": [[pole.real, pole.imag] for pole in POLES],
            "start": paper.plan.start,
            "long_run": {"cycles": long_run.CYCLES, "jumps": len(many.plan.schedule), "rate_through_jumps": rate},
        },
        figures=figures((*estimate, decay["designed"]), rate),
        report=[
            published.report(G_0),
            *manoeuvre.report(paper.plan.start, decay),
            *long_run.report(len(many.plan.schedule), rate),
        ],
    )


STUDY = Study("switched_regulator", build, description=__doc__, defaults=StudyOptions())

if __name__ == "__main__":
    STUDY.main()
