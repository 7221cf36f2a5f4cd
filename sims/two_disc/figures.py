"""The papers' figures, drawn from the plans and the runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from two_disc.experiment import DRAWN
from two_disc.rig import PROFILES, Q_TWIST, Q_Y, SHARES, SHOWN, TWIST_WEIGHT, Plans, R, slew, twist

import invtrack
from invtrack.figures import frequency_response_figure, overlay_figure, sweep_figure
from invtrack.studies import Session

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SLEW_TEXT = f"{SHOWN[0]} of {SHOWN[1]:g} s"
EXPERIMENT = ("experiment_exact", "experiment_redesigned")
WINDOW = (-20.0, 50.0)  # [s]


def papers_figures(model: invtrack.StateSpace) -> dict[str, Callable[[Session], Figure]]:
    """Figures by the name of their file; which figure of the papers each stands for is in its title."""
    return {
        "wanted": lambda done: wanted_output(),
        "responses": lambda done: responses(model),
        "prefilter": lambda done: prefilter_response(model),
        "redesign": lambda done: redesign(Plans.of(model, SHOWN[1], SHOWN[0])),
        "experiment": lambda done: experiment_runs(done.among(EXPERIMENT)),
        **{f"durations_{profile}": partial(durations, profile) for profile in PROFILES},
    }


def wanted_output() -> Figure:
    """Figure 2 of the experimental paper."""
    times = np.linspace(*WINDOW, 2001)
    reference = slew(SHOWN[1], SHOWN[0])
    units = ("rad", "rad/s", "rad/s²")
    panels = [
        (f"{name} [{unit}]", {"wanted": (times, reference(times, derivative=order)[:, 0])})
        for order, (name, unit) in enumerate(zip((r"$\theta_2$", r"$\dot\theta_2$", r"$\ddot\theta_2$"), units, strict=True))
    ]
    return overlay_figure(
        f"two_disc: wanted output and its derivatives, {SLEW_TEXT}\n(experimental paper, figure 2)",
        panels=panels,
        manoeuvre=reference.manoeuvre,
    )


def responses(model: invtrack.StateSpace) -> Figure:
    """The identified transfer functions."""
    w = np.geomspace(0.05, 50.0, 2001)
    states = np.linalg.solve(1j * w[:, None, None] * np.eye(model.n_states) - model.A, model.B)[:, :, 0]
    curves = {r"$\theta_1/\tau$": states[:, 0], r"$\theta_2/\tau$ (nonminimum-phase)": states[:, 1]}
    return frequency_response_figure(
        "two_disc: frequency responses of the identified rig (AIAA note, eq. 6)",
        w=w,
        curves=curves,
        magnitude=r"$|\theta/\tau|$ [rad]",
    )


def prefilter_response(model: invtrack.StateSpace) -> Figure:
    """G_f, from wanted to redesigned output."""
    w = np.geomspace(1e-3, 10.0, 2001)
    curves = {}
    for q_x, q_y in ((Q_TWIST, 0.1), (Q_TWIST, Q_Y), (Q_TWIST, 10.0), (0.0, Q_Y)):
        weights = {"R": R, "Q_x": q_x * TWIST_WEIGHT, "Q_y": q_y}
        name = f"q_x = {q_x:g}, q_y = {q_y:g}" + (" (papers)" if (q_x, q_y) == (Q_TWIST, Q_Y) else "")
        curves[name] = invtrack.redesign.prefilter(model, **weights).frequency_response(w).G_f[:, 0, 0]
    return frequency_response_figure(
        "two_disc: prefilter from wanted to redesigned output, of zero phase, r = 1\n(AIAA note, lemma)",
        w=w,
        curves=curves,
        magnitude="$|G_f|$",
        phase=False,
    )


def redesign(plans: Plans) -> Figure:
    """Figure 1 of the AIAA note, figures 3 to 5 of the experimental paper."""
    times = np.linspace(*WINDOW, 4001)
    values = {"exact inversion": plans.exact(times), "redesigned": plans.redesigned(times)}
    panels = [
        (r"$\theta_2$ [rad]", {name: (times, at.y[:, 0]) for name, at in values.items()}),
        ("motor command", {name: (times, at.u[:, 0]) for name, at in values.items()}),
        (r"$\theta_1 - \theta_2$ [rad]", {name: (times, twist(at.x)) for name, at in values.items()}),
    ]
    title = f"two_disc: output, input and twist, {SLEW_TEXT}\n(AIAA note, figure 1; experimental paper, figures 3 to 5)"
    return overlay_figure(title, panels=panels, manoeuvre=plans.exact.manoeuvre)


def experiment_runs(results: Sequence[invtrack.RunResult]) -> Figure:
    """Figures 7 and 8 of the experimental paper, and the input."""
    first = results[0]
    runs = {result.name.replace("_", " "): result for result in results}
    panels = [
        (
            r"$\theta_2$ [rad]",
            {"wanted": (first.time, first.reference.values[:, 0])} | {n: (r.time, r.output.values[:, 0]) for n, r in runs.items()},
        ),
        (r"$\theta_1 - \theta_2$ [rad]", {name: (result.time, twist(result.state.values)) for name, result in runs.items()}),
        ("motor command", {name: (result.time[:-1], result.applied.values[:, 0]) for name, result in runs.items()}),
    ]
    title = f"two_disc, {DRAWN} and noisy sensors: output, twist and input\n(experimental paper, figures 7 and 8)"
    return overlay_figure(title, panels=panels, wanted="wanted", window=WINDOW, manoeuvre=first.manoeuvre)


def durations(profile: str, done: Session) -> Figure:
    """The papers' three shares over the duration of the slew."""
    chosen = [row for row in done.section("durations") if row["profile"] == profile]
    curves = {
        which: {share.replace("_", " "): [row[which][share] for row in chosen] for share in SHARES}
        for which in ("predicted", "measured")
    }
    return sweep_figure(
        f"two_disc: redesign over the duration of the slew, {profile}",
        label="duration of the slew [s]",
        values=[row["duration"] for row in chosen],
        **curves,
        quantity="share",
    )
