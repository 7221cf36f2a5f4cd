"""Redesign of the output trajectory across tip-mass jumps, in MuJoCo: the optimum against everything else one might try.

The tip of the flexible cantilever is to move 2 units and back while its tip mass jumps 0 -> 100 -> 10, and the integral of
r u^2 + q_y (y - wanted)^2 is to be small. The redesigned plan knows the jumps and is their optimum. The alternatives are what an
engineer would otherwise run: exact inversion, the same scaled down as far as pays, plans made for one of the masses, optimal
tracking of each interval's plant as if it stayed for ever, plans for other weights, and the optimum disturbed at random. What each
really costs is measured in MuJoCo, against one and the same wanted motion. Claim tested: the optimal output-trajectory redesign of
Devasia (1996), carried over to systems with parameter jumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import invtrack
from invtrack.control import AffineLaw, Instants
from invtrack.figures import comparison_figure, tracking_figure
from invtrack.studies import Case, Column, Rows, Session, Setup, Study, StudyOptions, Table

MASSES = (0.0, 100.0, 10.0)  # [kg]
JUMPS = (np.pi / 2, 3 * np.pi / 2)  # [s]
R, Q_Y = 1e-5, 1.0  # [1 / (N^2 s)], [1 / (m^2 s)]
TOLERANCE = 1e-8
DISTURBED = 6  # random changes of the wanted motion, each with both signs
DISTURBANCE = 0.05  # [m]
SEED = 1996
WINDOW = (-10.0, 20.0)  # [s]
OPTIMUM = "redesigned"
DISTURBED_NAME = "disturbed"
COMPARED = (OPTIMUM, "exact_inversion", "half_input_weight", "double_input_weight")  # all planned for the same wanted motion

COLUMNS = (
    Column("cost", "s"),
    Column("above optimum", "s"),
    Column("max error", "m"),
    Column("peak input", "N"),
    Column("preactuation time", "s"),
)


@dataclass(frozen=True)
class Rig:
    """The plant, its models, and the motion that is wanted."""

    plant: invtrack.Plant
    model: invtrack.SwitchedSystem
    gains: invtrack.GainSchedule
    wanted: invtrack.PiecewiseSignal


class IntervalwiseController(invtrack.TrackingController):
    """In each interval the plan, and the feedback, that would be optimal if that interval's plant were there for ever."""

    def __init__(self, plans: Sequence[invtrack.Plan], gains: invtrack.GainSchedule) -> None:
        super().__init__(plans[0], gains)
        self._laws = [invtrack.TrackingController(plan, gains) for plan in plans]

    def begin(self, instants: Instants) -> AffineLaw:
        """Offset and gain of the plan of the interval that each instant lies in."""
        interval = self.gains.interval(instants.inside)
        laws = [law.begin(instants) for law in self._laws]
        return AffineLaw(np.stack([law.offset for law in laws])[interval, np.arange(len(interval))], self.gains.gains, interval)


def build(options: StudyOptions) -> Setup:
    rig = _rig()
    controllers = _controllers(rig, SEED + options.seed)
    settings = {
        # Also where the plan was made for one mass only.
        "schedule": [invtrack.Change(t, tip_mass=mass) for t, mass in zip(JUMPS, MASSES[1:], strict=True)],
        "vibration_period": invtrack.linear.slowest_flexible_period(rig.model.systems[-1]),
        "start": min(controller.plan.start for controller in controllers.values()),
    }
    cases = [
        Case(
            name,
            rig.plant,
            controller,
            settings=settings,
            numbers=partial(_numbers, rig.wanted),
            figures={"tracking": partial(tracking_figure, window=WINDOW)} if name == OPTIMUM else {},
            recorded=not name.startswith(DISTURBED_NAME),
        )
        for name, controller in controllers.items()
    ]
    predicted = invtrack.redesign.cost(controllers[OPTIMUM].plan, R=R, Q_y=Q_Y)
    return Setup(
        cases,
        sections={"weights": {"r": R, "q_y": Q_Y}, "predicted_cost": predicted, "above_optimum": _above_optimum},
        figures={"comparison": lambda done: comparison_figure(done.among(COMPARED), window=WINDOW)},
        report=[
            Table("Cantilever with tip-mass jumps: what each way costs, measured in MuJoCo", COLUMNS, _rows),
            partial(_text, predicted),
        ],
    )


def _rig() -> Rig:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        parameters={"tip_mass": "body:tip:mass"},
    )
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)
    # The feedback that is optimal for this very cost: no alternative is to lose by its gains.
    C = model.systems[0].C
    return Rig(plant, model, invtrack.lqr(model, Q=Q_Y * C.T @ C, R=R), invtrack.raised_cosine(2.0))


def _controllers(rig: Rig, seed: int) -> dict[str, invtrack.TrackingController]:
    """The optimum first; then all the alternatives."""

    def redesign(model: Any, wanted: invtrack.PiecewiseSignal, r: float = R, q_y: float = Q_Y) -> invtrack.Plan:
        return invtrack.quadratic_redesign(model, wanted, R=r, Q_y=q_y, tolerance=TOLERANCE)

    staying = redesign(rig.model, rig.wanted, q_y=0.0)
    exact = invtrack.invert(rig.model, rig.wanted, tolerance=TOLERANCE)
    single = [redesign(system, rig.wanted) for system in rig.model.systems]
    plans = {
        OPTIMUM: redesign(rig.model, rig.wanted),
        "exact_inversion": exact,
        "scaled_inversion": invtrack.invert(rig.model, rig.wanted.scaled(_best_share(exact, staying)), tolerance=TOLERANCE),
        "not_moving": staying,
        "for_first_mass": single[0],
        "for_second_mass": single[1],
        "for_third_mass": single[2],
        "half_input_weight": redesign(rig.model, rig.wanted, R / 2),
        "double_input_weight": redesign(rig.model, rig.wanted, 2 * R),
    }
    for number, disturbance in enumerate(_disturbances(seed), start=1):
        for sign, word in ((1.0, "plus"), (-1.0, "minus")):
            plans[f"{DISTURBED_NAME}_{word}_{number}"] = redesign(rig.model, rig.wanted + disturbance.scaled(sign))
    controllers = {name: invtrack.TrackingController(plan, rig.gains) for name, plan in plans.items()}
    return {**controllers, "optimal_per_interval": IntervalwiseController(single, rig.gains)}


def _best_share(exact: invtrack.Plan, staying: invtrack.Plan) -> float:
    """The share of the motion at which following it exactly costs least: share^2 effort + (1 - share)^2 price of not moving."""
    effort, price = (invtrack.redesign.cost(plan, R=R, Q_y=Q_Y) for plan in (exact, staying))
    return price / (price + effort)


def _disturbances(seed: int) -> list[invtrack.PiecewiseSignal]:
    """Smooth bumps at random times during the manoeuvre: wanted motions whose plans are feasible, and not optimal for this one."""
    random = np.random.default_rng(seed)
    return [
        invtrack.raised_cosine(DISTURBANCE, period=random.uniform(1.0, 4.0), start_time=random.uniform(0.0, 5.0))
        for _ in range(DISTURBED)
    ]


def _numbers(wanted: invtrack.PiecewiseSignal, run: invtrack.RunResult) -> dict[str, Any]:
    y_d = wanted(run.time)
    return {
        **invtrack.metrics(run),
        "max_error": float(np.max(np.abs(run.output.values - y_d))),  # of the motion wanted, whatever the plan was made for
        "cost": invtrack.results.run_cost(run, R=R, Q_y=Q_Y, wanted=y_d),
    }


def _costs(done: Session) -> dict[str, float]:
    """What each case cost [s]."""
    return {run.name: done.numbers[run.name]["cost"] for run in done.among()}


def _above_optimum(done: Session) -> dict[str, float]:
    """What each case cost more than the optimum [s]."""
    optimum = done.numbers_of(OPTIMUM)["cost"]
    return {name: cost - optimum for name, cost in _costs(done).items()}


def _rows(done: Session) -> Rows:
    above = done.sections.get("above_optimum", {})
    return {name: numbers and {**numbers, "above_optimum": above.get(name)} for name, numbers in done.rows().items()}


def _text(predicted: float, done: Session) -> str:
    costs = _costs(done)
    optimum = done.numbers_of(OPTIMUM)["cost"]
    others = {name: cost for name, cost in costs.items() if name != OPTIMUM}
    nearest = min(others, key=lambda name: others[name], default=None)
    cheapest = f", the cheapest is {nearest}, at {others[nearest]:.6f} s" if nearest else ""
    return (
        f"cost: integral of {R:g} u^2 + {Q_Y:g} (y - wanted)^2 from rest to rest. The optimum's plan predicts {predicted:.6f} s,\n"
        f"MuJoCo gives {optimum:.6f} s. Of the {len(others)} alternatives{cheapest}."
    )


STUDY = Study("cantilever_redesign", build, description=__doc__, defaults=StudyOptions(timestep=2e-3))

if __name__ == "__main__":
    STUDY.main()
