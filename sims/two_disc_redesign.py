"""Giving up a little of the motion for much less input and twist: redesigned slews of the two-disc rig, in MuJoCo.

The second disc turns by one radian. Exact inversion follows the wanted slew; the redesigned plan minimises the integral of
r u^2 + q_x (th1 - th2)^2 + q_y (th2 - wanted)^2 with the papers' weights r = 1, q_x = 5000, q_y = 1. Both are driven closed-loop,
over a range of slew durations and two profiles, because the papers publish neither; then the weights are varied, a demanding slew
is planned within hard limits, and the papers' experiment is repeated on rigs that differ from their model. Claim tested: Devasia,
"Optimal output-trajectory redesign for invertible systems" (1996), which reports about 10 % of the motion given up, 60 % less input
and 20 % less twist, and in the experiment 50 % less twist.
"""

from __future__ import annotations

from two_disc.durations import report_slews, slews, where_shares_occur
from two_disc.experiment import PUBLISHED_IN_EXPERIMENT, experiment, experiment_cases, report_experiment
from two_disc.figures import papers_figures
from two_disc.limits import draw_limits, limited_slew, report_limits
from two_disc.rig import PUBLISHED, Q_TWIST, Q_Y, SHOWN, Plans, R, rig, run_settings
from two_disc.trade_off import draw_trade_off, report_trade_off, trade_off

import invtrack
from invtrack.figures import comparison_figure, tracking_figure
from invtrack.studies import Case, Setup, Study, StudyOptions


def build(options: StudyOptions) -> Setup:
    plant = rig()
    model = invtrack.linearize(plant)
    gains = invtrack.lqr(model, Q=1.0, R=1.0)
    profile, duration = SHOWN
    shown = vars(Plans.of(model, duration, profile))
    limited = limited_slew(plant, model, gains, options.seed)
    drawn = {"tracking": tracking_figure}
    return Setup(
        [
            *(
                Case(name, plant, invtrack.TrackingController(plan, gains), settings=run_settings(plan), figures=drawn)
                for name, plan in shown.items()
            ),
            *limited.cases,
            *experiment_cases(plant, model, options.seed),
        ],
        sweeps={"durations": slews(plant, model, gains), "experiment": experiment(plant, model, options.seed)},
        sections={
            "weights": {"r": R, "q_x": Q_TWIST, "q_y": Q_Y},
            "published": PUBLISHED,
            "published_at": lambda done: where_shares_occur(model, PUBLISHED),
            "pareto": lambda done: trade_off(model),
            "limits": limited.summary,
            "published_in_experiment": PUBLISHED_IN_EXPERIMENT,
            "published_in_experiment_at": lambda done: where_shares_occur(
                model, {"twist_reduction": PUBLISHED_IN_EXPERIMENT["twist_reduction"]}
            ),
        },
        figures={
            **papers_figures(model),
            "trade_off": lambda done: draw_trade_off(done.section("pareto")),
            "limits": lambda done: draw_limits(limited),
            "comparison": lambda done: comparison_figure(done.among(shown)),
        },
        report=[*report_slews(), report_trade_off(), *report_limits(limited), *report_experiment()],
    )


STUDY = Study("two_disc_redesign", build, description=__doc__, defaults=StudyOptions(timestep=5e-3))

if __name__ == "__main__":
    STUDY.main()
