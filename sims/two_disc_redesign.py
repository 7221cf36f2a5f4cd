"""Giving up a little of the motion for much less input and twist: redesigned slews of the two-disc rig, in MuJoCo.

The second disc turns by one radian. Exact inversion follows the wanted slew; the redesigned plan minimises the integral of
r u^2 + q_x (th1 - th2)^2 + q_y (th2 - wanted)^2 with the papers' weights r = 1, q_x = 5000, q_y = 1. Both are driven closed-loop,
over a range of slew durations and two profiles, because the papers publish neither. Claim tested: Devasia, "Optimal
output-trajectory redesign for invertible systems" (1996), which reports about 10 % of the motion given up, 60 % less input and 20 %
less twist.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

import invtrack
from invtrack.figures.comparison import comparison_figure
from invtrack.figures.style import save_figure
from invtrack.figures.sweep import sweep_figure
from invtrack.figures.time_series import tracking_figure
from invtrack.runs.folder import RunFolder
from invtrack.runs.options import SimOptions, run_sim
from invtrack.runs.progress import progress
from invtrack.runs.table import Column, print_table

R, Q_TWIST, Q_Y = 1.0, 5000.0, 1.0
SLEW = 1.0  # [rad]
DURATIONS = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0)  # [s]
PROFILES = {"quintic": 2, "septic": 3}  # derivatives that vanish at both ends
SHOWN = ("quintic", 30.0)  # where about 10 % of the slew is given up
PUBLISHED = {"output_change": 0.10, "input_reduction": 0.60, "twist_reduction": 0.20}
AFTER = 30.0  # [s] simulated after the slew

SHARES = tuple(PUBLISHED)
COLUMNS = tuple(Column(f"{which} {share.replace('_', ' ')}") for share in SHARES for which in ("predicted", "measured"))


@dataclass(frozen=True)
class Plans:
    """Exact inversion and redesign of one slew."""

    exact: invtrack.NominalTrajectory
    redesigned: invtrack.NominalTrajectory

    def shares(self) -> dict[str, float]:
        """What the redesign changes, predicted from the plans alone, as shares of the slew and of the exact plan's peaks."""
        start, end = min(self.exact.start, self.redesigned.start), max(self.exact.end, self.redesigned.end)
        times = np.linspace(start, end, 20_001)
        exact, redesigned = self.exact(times), self.redesigned(times)
        return _shares(redesigned.y - redesigned.y_d, (exact.u, redesigned.u), (_twist(exact.x), _twist(redesigned.x)))


def main(options: SimOptions) -> None:
    folder = RunFolder(options.out)
    plant = invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])
    model = invtrack.linearize(plant)
    gains = invtrack.lqr(model, Q=1.0, R=1.0)
    durations: list[dict[str, Any]] = []
    shown: list[invtrack.RunResult] = []
    with progress("slews") as report:
        for profile, smoothness in PROFILES.items():
            for duration in DURATIONS:
                plans = _plans(model, duration, smoothness)
                runs = [
                    _run(plant, plan, gains, name, options.timestep)
                    for name, plan in (("exact", plans.exact), ("redesigned", plans.redesigned))
                ]
                durations.append(
                    {"profile": profile, "duration": duration, "predicted": plans.shares(), "measured": _measured(*runs)}
                )
                if (profile, duration) == SHOWN:
                    shown = runs
                report(len(durations) / (len(PROFILES) * len(DURATIONS)))
    cases = {run.name: {**invtrack.metrics(run), "status": run.status} for run in shown}
    occurs = _where_published_figures_occur(model)
    _report(durations, occurs)
    for run in shown:
        invtrack.save_recording(run.thinned(options.record_every), folder.file(f"{run.name}.rrd"))
    if options.figures:
        _draw(durations, shown, folder)
    folder.write_summary(
        sim="two_disc_redesign",
        model=plant.name,
        timestep=options.timestep,
        cases=cases,
        weights={"r": R, "q_x": Q_TWIST, "q_y": Q_Y},
        durations=durations,
        published=PUBLISHED,
        published_at=occurs,
    )
    print(f"written to {folder.path}: summary.json, recordings (.rrd)" + (", figures (.png)" if options.figures else ""))


def _plans(model: invtrack.StateSpace, duration: float, smoothness: int) -> Plans:
    reference = invtrack.rest_to_rest(0.0, SLEW, duration, smoothness=smoothness)
    twist = np.array([[1.0, -1.0, 0.0, 0.0]])  # of the states th1, th2, th1 velocity, th2 velocity
    return Plans(
        exact=invtrack.invert(model, reference, tolerance=1e-8),
        redesigned=invtrack.quadratic_redesign(model, reference, R=R, Q_x=Q_TWIST * twist.T @ twist, Q_y=Q_Y, tolerance=1e-8),
    )


def _run(
    plant: invtrack.Plant, plan: invtrack.NominalTrajectory, gains: invtrack.GainSchedule, name: str, timestep: float
) -> invtrack.RunResult:
    controller = invtrack.TrackingController(plan, gains)
    run = invtrack.simulate(plant, controller, timestep=timestep, stop=plan.support[1] + AFTER, name=name)
    if run.status == "diverged":
        raise invtrack.InvtrackError(f"case {name!r} diverged ({run.message}); take a smaller --timestep")
    return run


def _measured(exact: invtrack.RunResult, redesigned: invtrack.RunResult) -> dict[str, float]:
    return _shares(
        redesigned.error,
        (exact.applied.values, redesigned.applied.values),
        (_twist(exact.state.values), _twist(redesigned.state.values)),
    )


def _shares(change: np.ndarray, inputs: tuple[np.ndarray, np.ndarray], twists: tuple[np.ndarray, np.ndarray]) -> dict[str, float]:
    peaks = [[float(np.max(np.abs(values))) for values in pair] for pair in (inputs, twists)]
    return {
        "output_change": float(np.max(np.abs(change))) / SLEW,
        "input_reduction": 1 - peaks[0][1] / peaks[0][0],
        "twist_reduction": 1 - peaks[1][1] / peaks[1][0],
    }


def _twist(x: np.ndarray) -> np.ndarray:
    return np.asarray(x[:, 0] - x[:, 1])


def _where_published_figures_occur(model: invtrack.StateSpace) -> dict[str, dict[str, float]]:
    """For each published share: the quintic's duration [s] at which it occurs, and the other shares there, predicted."""

    def miss(share: str) -> Callable[[float], float]:
        return lambda duration: _plans(model, duration, PROFILES["quintic"]).shares()[share] - PUBLISHED[share]

    result = {}
    for share in SHARES:
        duration = float(brentq(miss(share), 10.0, 60.0, xtol=1e-2))
        result[share] = {"duration": duration, **_plans(model, duration, PROFILES["quintic"]).shares()}
    return result


def _report(durations: list[dict[str, Any]], occurs: dict[str, dict[str, float]]) -> None:
    rows = {
        f"{row['profile']}, {row['duration']:g} s": {
            f"{which}_{share}": row[which][share] for which in ("predicted", "measured") for share in SHARES
        }
        for row in durations
    }
    print_table("Two-disc rig: what redesign changes, as shares", columns=COLUMNS, rows=rows, row_header="slew")
    worst = max(abs(row["predicted"][share] - row["measured"][share]) for row in durations for share in SHARES)
    print(f"largest difference of prediction and MuJoCo: {100 * worst:.3f} percentage points")
    print("the papers report, without profile and duration: 10 % of the slew, 60 % less input, 20 % less twist. For the quintic:")
    for share, there in occurs.items():
        print(
            f"  {share.replace('_', ' ')} of {PUBLISHED[share]:.0%} occurs at {there['duration']:.1f} s: output changed by "
            f"{there['output_change']:.1%}, input -{there['input_reduction']:.1%}, twist -{there['twist_reduction']:.1%}"
        )


def _draw(durations: list[dict[str, Any]], shown: list[invtrack.RunResult], folder: RunFolder) -> None:
    for profile in PROFILES:
        rows = [row for row in durations if row["profile"] == profile]
        curves = {
            which: {share.replace("_", " "): [row[which][share] for row in rows] for share in SHARES}
            for which in ("predicted", "measured")
        }
        figure = sweep_figure(
            f"two_disc: redesign over the duration of the slew, {profile}",
            label="duration of the slew [s]",
            values=[row["duration"] for row in rows],
            predicted=curves["predicted"],
            measured=curves["measured"],
            quantity="share [1]",
        )
        save_figure(figure, folder.file(f"durations_{profile}.png"))
    for run in shown:
        save_figure(tracking_figure(run), folder.file(f"tracking_{run.name}.png"))
    save_figure(comparison_figure(shown), folder.file("comparison.png"))


if __name__ == "__main__":
    run_sim(main, defaults=SimOptions(out=Path("runs/two_disc_redesign"), timestep=5e-3), description=__doc__ or "")
