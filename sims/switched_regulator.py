"""Regulation through parameter jumps in feedback form, beside Francis regulators that are switched, in MuJoCo.

The tip of a flexible cantilever follows an exosystem, y_d = 1 - cos t on [0, 2 pi], while its tip mass jumps. With the exact map
u = F(t) x_e - K (x - G(t) x_e) keeps the output exact through the jumps and where the exosystem starts and stops; Francis
regulators that are exchanged at the jumps, the usual practice, leave a transient at each of them: more feedback shortens it, at the
price of more input. Then the cycle goes on for many exchanges of the payload, with all states known, and with none. Claim tested:
Devasia, Paden, Rossi, "Exact-output tracking theory for systems with parameter jumps" (1996), sections 3 to 5.
"""

from __future__ import annotations

from pathlib import Path

from regulator import long_run, manoeuvre, published
from regulator.figures import draw, draw_decay
from regulator.rig import POLES, cantilever, rig

import invtrack
from invtrack.studies.folder import RunFolder
from invtrack.studies.options import SimOptions, run_sim


def main(options: SimOptions) -> None:
    folder = RunFolder(options.out)
    plant = cantilever()
    paper = rig(plant, manoeuvre.MASSES, manoeuvre.JUMPS, end=manoeuvre.END)
    G_0 = published.published(paper.model, paper.maps["exact_map"].exosystem)
    published.report(G_0)
    runs, cases = manoeuvre.manoeuvre(paper, options.timestep)
    times, errors = manoeuvre.estimate_errors(paper, options.timestep)
    decay = manoeuvre.decay_rates(times, errors)
    manoeuvre.report(cases, paper.plan.start, decay)
    many = long_run.long_rig(plant)
    long_runs, long_cases = long_run.long_run(many, options.timestep)
    rate = long_run.rate_through_jumps(many)
    long_run.report(long_cases, len(many.plan.schedule), rate)
    for run in (*runs, *long_runs):
        invtrack.save_recording(run.thinned(options.record_every), folder.file(f"{run.name}.rrd"))
    if options.figures:
        draw(runs, long_runs, folder)
        draw_decay((times, errors, decay["designed"]), long_runs[-1], rate, folder)
    folder.write_summary(
        sim="switched_regulator",
        model=plant.name,
        timestep=options.timestep,
        cases={**cases, **long_cases},
        **G_0,
        estimate_decay=decay,
        closed_loop_poles=[[pole.real, pole.imag] for pole in POLES],
        start=paper.plan.start,
        long_run={"cycles": long_run.CYCLES, "jumps": len(many.plan.schedule), "rate_through_jumps": rate},
    )
    print(
        f"written to {folder.path}: summary.json, a recording (.rrd) of each case" + (", figures (.png)" if options.figures else "")
    )


if __name__ == "__main__":
    defaults = SimOptions(out=Path("runs/switched_regulator"), timestep=1e-3, record_every=20)
    run_sim(main, defaults=defaults, description=__doc__ or "")
