"""How much accuracy is left when masses, instants and sensors are not what the plan assumes: thousands of closed-loop runs.

The manoeuvre of cantilever_jumps.py. The controller, which acts at every step (1 ms), sees the base's and the tip's position
through noisy, late sensors, estimates the rest, and follows one plan. In each run the tip masses, the instants at which they
change, and the sensors are others. Every row is kept as it comes: an interrupted or killed run goes on where it was when it is
started again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

import invtrack
from invtrack.arrays import whole_number
from invtrack.figures import bands_figure, histogram_figure, tornado_figure, tracking_figure
from invtrack.studies import Case, Column, Rows, Session, Setup, Study, StudyOptions, Table
from invtrack.sweeps import Swept, monte_carlo, rank_correlations, sweep

MASSES = (0.0, 100.0, 10.0)  # [kg]
JUMPS = (np.pi / 2, 3 * np.pi / 2)  # [s]
SPAN = (-8.0, 12.0)  # [s], from the plan's own state on
WINDOW = 5.0  # [s], in which residual vibration is counted: five periods of the slowest mode are two minutes
MEASUREMENTS = ("base_position", "tip_position")
KALMAN = invtrack.KalmanFilter(input_noise=0.02, measurement_noise=1e-3)  # [N per root Hz], [m]
ERROR_TIMES = np.linspace(*SPAN, 401)  # [s]

ASSUMED = {"first_mass": MASSES[1], "second_mass": MASSES[2], "first_delay": 0.0, "second_delay": 0.0}
SHOWN = {"max_error": "m", "rms_error": "m", "residual_vibration": "m", "peak_input": "N"}


@dataclass(frozen=True, kw_only=True)
class MonteCarloOptions(StudyOptions):
    runs: int = 2000
    """Number of runs."""

    def __post_init__(self) -> None:
        super().__post_init__()
        whole_number("--runs", self.runs, lowest=3, error=invtrack.InvtrackError)


def uncertain() -> dict[str, Any]:
    """How everything that the plan does not know is distributed."""
    from scipy import stats  # takes a second, for which the options need not wait

    return {
        "first_mass": stats.norm(MASSES[1], 0.01 * MASSES[1]),  # [kg]
        "second_mass": stats.norm(MASSES[2], 0.01 * MASSES[2]),  # [kg]
        "first_delay": stats.uniform(-0.01, 0.02),  # [s], of the instant, known or not
        "second_delay": stats.uniform(-0.01, 0.02),  # [s]
        "sensor_noise": stats.loguniform(1e-4, 1e-2),  # [m], standard deviation of one sample
        "sensor_delay": stats.uniform(0.0, 2e-3),  # [s]
    }


@dataclass(frozen=True, eq=False)
class Rig:
    """What all runs have in common."""

    plant: invtrack.Plant
    plan: invtrack.Plan
    controller: invtrack.OutputFeedbackController


@cache
def rig(timestep: float) -> Rig:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        measurements=MEASUREMENTS,
        parameters={"tip_mass": "body:tip:mass"},
    )
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)
    plan = invtrack.invert(model, invtrack.raised_cosine(2.0), tolerance=1e-8)
    controller = invtrack.OutputFeedbackController(plan, invtrack.lqr(model, Q=100.0, R=0.01), KALMAN, period=timestep)
    return Rig(plant, plan, controller)


def run(point: Mapping[str, Any], seed: int, rig: Rig, *, timestep: float) -> invtrack.RunResult:
    """One run of what the plan does not know."""
    delays, masses = (point["first_delay"], point["second_delay"]), (point["first_mass"], point["second_mass"])
    sensor = invtrack.Sensor(noise=point["sensor_noise"], delay=point["sensor_delay"])
    return invtrack.simulate(
        rig.plant,
        rig.controller,
        schedule=[invtrack.Change(t + delay, tip_mass=mass) for t, delay, mass in zip(JUMPS, delays, masses, strict=True)],
        sensors=dict.fromkeys(MEASUREMENTS, sensor),
        seed=seed,
        timestep=timestep,
        **span(rig),
    )


def span(rig: Rig) -> dict[str, Any]:
    """From when to when a run lasts, and that it starts where the plan is then."""
    start, end = SPAN
    return {"start": start, "end": end, "initial_state": rig.plan(start).x[0]}


def numbers(run: invtrack.RunResult) -> invtrack.results.Metrics:
    """Metrics of a run that is too short for five periods of the slowest mode."""
    return invtrack.metrics(run, duration=WINDOW)


class MonteCarlo:
    """The sweep, and what is made of it."""

    def __init__(self, options: MonteCarloOptions) -> None:
        self._options = options
        self._swept: Any = None

    def numbers(self, done: Session) -> dict[str, Any]:
        """Run it; what the summary says of it."""
        options = self._options
        self._swept = swept = sweep(
            partial(run, timestep=options.timestep),
            monte_carlo(uncertain(), options.runs, seed=options.seed),
            out=options.out / "sweep",
            prepare=partial(rig, options.timestep),
            numbers=numbers,
            error_times=ERROR_TIMES,
            files=[invtrack.model_path("cantilever")],
            progress=done.report,
        )
        return {
            "study_hash": swept.study,
            "rows": f"sweep/{swept.path.relative_to(options.out / 'sweep').as_posix()}",
            "status": swept.counts,
            **{name: _percentiles(swept, name) for name in SHOWN},
            "rank_correlations": {
                name: rank_correlations(swept, name, about=ASSUMED) for name in ("max_error", "residual_vibration")
            },
        }

    def after(self, done: Session) -> Swept:
        """The rows, once the sweep is done."""
        done.section("monte_carlo")
        return self._swept

    def bands(self, done: Session) -> Any:
        return bands_figure(
            "Tracking error of all runs",
            time=ERROR_TIMES,
            values=self.after(done).traces("error_tip_position"),
            quantity="$y - y_d$ [m]",
            manoeuvre=rig(self._options.timestep).plan.manoeuvre,
        )

    def tornado(self, done: Session, metric: str) -> Any:
        correlations = done.section("monte_carlo")["rank_correlations"][metric]
        words = metric.replace("_", " ")
        samples = int(np.count_nonzero(np.isfinite(self.after(done).numbers(metric))))
        return tornado_figure(f"What goes with the {words}", correlations=correlations, samples=samples, quantity=words)

    def histogram(self, done: Session) -> Any:
        values = self.after(done).numbers("residual_vibration")
        return histogram_figure("Residual vibration of all runs", values=values, quantity="residual vibration [m]")

    def text(self, done: Session) -> str:
        swept = self.after(done)
        counts = ", ".join(f"{count} {status}" for status, count in swept.counts.items())
        pace = f", {swept.computed} of them computed now, {swept.runs_per_second:.3g} runs/s" if swept.runs_per_second else ""
        worst = int(np.nanargmax(swept.numbers("max_error")))
        told = ", ".join(f"{name} {value:.4g}" for name, value in swept.rows[worst].point.items())
        return (
            f"{len(swept.rows)} runs of {SPAN[1] - SPAN[0]:g} s: {counts}{pace}.\n"
            f"residual vibration: peak to peak over {WINDOW:g} s after the manoeuvre. In rank correlations masses and instants\n"
            "count by how far they are from what the plan assumes.\n"
            f"largest error: row {worst} ({told})\n"
            f"rows: {swept.path}"
        )


def _percentiles(swept: Swept, name: str) -> dict[str, float]:
    values = swept.numbers(name)
    median, high = np.nanpercentile(values, [50.0, 95.0])
    return {"median": float(median), "95_percent_below": float(high), "largest": float(np.nanmax(values))}


def _rows(done: Session) -> Rows:
    found = done.section("monte_carlo")
    nominal = done.numbers.get("nominal", {})
    return {f"{name.replace('_', ' ')} [{unit}]": {"as_planned": nominal.get(name), **found[name]} for name, unit in SHOWN.items()}


COLUMNS = [
    Column("as planned"),
    Column("median"),
    Column("95 % below", key="95_percent_below"),
    Column("largest"),
]


def build(options: MonteCarloOptions) -> Setup:
    common = rig(options.timestep)
    made = MonteCarlo(options)
    return Setup(
        [
            Case(
                "nominal",
                common.plant,
                common.controller,
                settings=span(common),
                numbers=numbers,
                figures={"tracking": tracking_figure},
            )
        ],
        sections={"monte_carlo": made.numbers},
        figures={
            "error_bands": made.bands,
            "what_matters_for_error": partial(made.tornado, metric="max_error"),
            "what_matters_for_vibration": partial(made.tornado, metric="residual_vibration"),
            "residual_vibration": made.histogram,
        },
        report=[
            Table("Cantilever with uncertain masses, instants and sensors", COLUMNS, _rows, row_header="of all runs"),
            made.text,
        ],
    )


STUDY = Study("cantilever_monte_carlo", build, description=__doc__, defaults=MonteCarloOptions(timestep=1e-3))

if __name__ == "__main__":
    STUDY.main()
