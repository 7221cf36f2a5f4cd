"""Redesigns of the motion of a nonlinear mechanism: the optimum, within limits, and what else one might drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from motions.ways import Motion

import invtrack
from invtrack.figures import trade_off_figure
from invtrack.inversion import steady_state_feedforward
from invtrack.redesign import ConstrainedMotion, OptimalMotion, cost
from invtrack.references import stack
from invtrack.studies import Case, Column, Rows, Session, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MARGIN = 1e-3  # share of the limit that the plan leaves to the feedback
DISTURBED = 3  # random changes of the wanted motion, each with both signs
DISTURBANCE = 0.02  # of the motion
SEED = 1996
TRADED = (1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)  # of the weight of the input

COLUMNS = (
    Column("planned cost"),
    Column("cost"),
    Column("cost / optimum's", key="cost_share"),
    Column("max error", "of motion", key="error_share"),
    Column("peak input", "above rest", key="peak_departure"),
    Column("clamped", "steps"),
    Column("planned in", "iterations", key="iterations"),
)


@dataclass(frozen=True)
class Redesign:
    """Redesigns of one motion, and their alternatives.

    Args:
        motion: of the mechanism.
        R, Q_y: weights of all inputs and outputs.
        low, high: of each input, for the limited plan.
        seed: of the disturbed motions.
    """

    motion: Motion
    R: float
    Q_y: float
    low: Sequence[float]
    high: Sequence[float]
    seed: int

    @property
    def optimum(self) -> str:
        """The name of the optimum's case."""
        return self._named("redesigned")

    @property
    def shown(self) -> tuple[str, ...]:
        """The cases that a figure compares: the optimum, the limited one and exact inversion."""
        return (self.optimum, self._named("limited"), self._named("exact"))

    def cases(self) -> list[Case]:
        """The optimum, its alternatives, and the limited one through an actuator that has its limits; all with gains along them."""
        motion = self.motion
        ways: dict[str, Callable[[], invtrack.Plan]] = {
            "redesigned": lambda: self._redesigned(motion.plant, motion.reference),
            "exact": lambda: invtrack.invert(motion.plant, motion.reference, schedule=motion.schedule),
            "half_input_weight": lambda: self._redesigned(motion.plant, motion.reference, self.R / 2),
            "double_input_weight": lambda: self._redesigned(motion.plant, motion.reference, 2 * self.R),
        }
        for number, bump in enumerate(self._disturbances(), start=1):
            for sign, word in ((1.0, "plus"), (-1.0, "minus")):
                ways[f"disturbed_{word}_{number}"] = lambda bump=bump, sign=sign: self._redesigned(
                    motion.plant, motion.reference + bump.scaled(sign)
                )
        cases = [self._case(way, motion.plant, make) for way, make in ways.items()]
        return [*cases, self._case("limited", self._actuated, self._limited)]

    def section(self) -> dict[str, Any]:
        """Weights and limits, for the summary."""
        return {"r": self.R, "q_y": self.Q_y, "low": list(self.low), "high": list(self.high)}

    @property
    def trade_off(self) -> str:
        """The name of the sweep over the weight of the input."""
        return self._named("trade_off")

    def points(self) -> dict[str, Callable[[Session], dict[str, Any]]]:
        """The points of that sweep."""
        return {f"r = {factor * self.R:g}": partial(self._point, factor * self.R) for factor in TRADED}

    def figure(self, done: Session) -> Figure:
        """Peak input over output error, the weight of the input varied."""
        rows = done.section(self.trade_off)
        return trade_off_figure(
            f"{self.motion.plant.name}: peak input against the motion given up, r varied (q_y = {self.Q_y:g})",
            horizontal=("largest output error [share of the motion]", [row["error_share"] for row in rows]),
            panels=[
                (f"peak {name}\nabove rest [{unit or '1'}]", {"redesigned": [row["peaks"][i] for row in rows]})
                for i, (name, unit) in enumerate(zip(self.motion.plant.inputs.names, self.motion.plant.inputs.units, strict=True))
            ],
            notes=[f"r = {row['r']:g}" for row in rows],
            horizontal_log=True,
        )

    def table(self) -> Table:
        """Costs, planned and measured."""
        return Table(
            f"Redesign {self.motion.name}: integral of {self.R:g} |u - u_rest|^2 + {self.Q_y:g} |y - y_d|^2", COLUMNS, self._rows
        )

    def _named(self, way: str) -> str:
        return f"{self.motion.name}_{way}"

    def _redesigned(self, plant: invtrack.Plant, reference: invtrack.PiecewiseSignal, R: float | None = None) -> OptimalMotion:
        weight = self.R if R is None else R
        plan = invtrack.quadratic_redesign(plant, reference, R=weight, Q_y=self.Q_y, schedule=self.motion.schedule)
        assert isinstance(plan, OptimalMotion)
        return plan

    def _limited(self) -> invtrack.Plan:
        low, high = np.array(self.low), np.array(self.high)
        inside = MARGIN * (high - low)
        return invtrack.constrained_redesign(
            self.motion.plant,
            self.motion.reference,
            R=self.R,
            Q_y=self.Q_y,
            schedule=self.motion.schedule,
            limits=invtrack.Limits(input=(low + inside, high - inside)),
        )

    @property
    def _actuated(self) -> invtrack.Plant:
        """The plant with actuators that have the limits."""
        names = self.motion.plant.inputs.names
        ranges = {name: (a, b) for name, a, b in zip(names, self.low, self.high, strict=True)}
        return invtrack.plant.with_input_limits(self.motion.plant, ranges)

    def _disturbances(self) -> list[invtrack.PiecewiseSignal]:
        """Smooth bumps at random times: wanted motions whose plans are feasible, and not optimal for this one."""
        random, (begin, end) = np.random.default_rng(SEED + self.seed), self.motion.reference.manoeuvre
        size, found = DISTURBANCE * self.motion.size, []
        for _ in range(DISTURBED):
            period = random.uniform(0.3, 0.6) * (end - begin)
            at = begin + random.uniform(0.0, 1.0) * (end - begin - period)
            amounts = size * random.uniform(-1.0, 1.0, size=len(self.motion.plant.outputs))
            found.append(stack([invtrack.raised_cosine(float(each), period=period, start_time=at) for each in amounts]))
        return found

    @cached_property
    def _steady(self) -> invtrack.Plan:
        return steady_state_feedforward(self.motion.plant, self.motion.reference, schedule=self.motion.schedule)

    def _rest(self, times: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        """Inputs that hold the wanted outputs (k, m)."""
        return self._steady.inputs(times)

    def _case(self, way: str, plant: invtrack.Plant | None, make: Callable[[], invtrack.Plan]) -> Case:
        kept: list[invtrack.Plan] = []

        def planned() -> invtrack.TrackingController:
            kept.append(make())
            return invtrack.TrackingController(kept[-1], invtrack.lqr(kept[-1], Q=self.motion.Q, R=self.motion.R))

        settings = {"schedule": self.motion.schedule, "vibration_period": self.motion.period}
        return Case(
            self._named(way),
            plant,
            planned,
            settings=settings,
            numbers=lambda run: self._numbers(run, kept[-1]),
            recorded=way in ("redesigned", "limited"),
        )

    def _numbers(self, run: invtrack.RunResult, plan: invtrack.Plan) -> dict[str, Any]:
        """Metrics of a run, and what it cost for the motion that is wanted, whatever its plan was made for."""
        wanted, middles = self.motion.reference(run.time), (run.time[1:] + run.time[:-1]) / 2
        rest, kind = self._rest(middles), (OptimalMotion, ConstrainedMotion)
        planned = cost(plan, R=self.R, Q_y=self.Q_y) if isinstance(plan, kind) and plan.reference is self.motion.reference else None
        return {
            **invtrack.metrics(run),
            "planned_cost": planned,
            "cost": invtrack.results.run_cost(run, R=self.R, Q_y=self.Q_y, u_0=rest, wanted=wanted),
            "error_share": float(np.max(np.abs(run.output.values - wanted))) / self.motion.size,
            "peak_departure": float(np.max(np.abs(run.applied.values - rest))),
            "clamped": int(np.sum(np.any(run.applied.values != run.commanded.values, axis=1))),
            "iterations": len(plan.iterations) if isinstance(plan, kind) else None,
        }

    def _rows(self, done: Session) -> Rows:
        rows = done.rows([case.name for case in self.cases()])
        optimum = rows.get(self.optimum)
        if optimum is None:
            return rows
        return {name: row and {**row, "cost_share": row["cost"] / optimum["cost"]} for name, row in rows.items()}

    def _point(self, R: float, done: Session) -> dict[str, Any]:
        """Largest output error and peak inputs above rest of the optimum for a weight of the input."""
        plan = self._redesigned(self.motion.plant, self.motion.reference, R)
        times = np.linspace(plan.start, plan.end, 4001)
        at = plan(times)
        return {
            "r": R,
            "error_share": float(np.max(np.abs(at.y - at.y_d))) / self.motion.size,
            "peaks": np.max(np.abs(at.u - self._rest(times)), axis=0).tolist(),
            "cost": plan.cost,
            "optimality_gap": plan.optimality_gap,
        }
