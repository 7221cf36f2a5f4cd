"""Any curves: over time in panels above each other, over a swept parameter, decaying, or over frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Any

import numpy as np

from invtrack.arguments import by_name, flag, instance, items, require_text, texts
from invtrack.arrays import Array, ComplexArray, complex_numbers, finite_number, real_vector
from invtrack.errors import InvtrackError
from invtrack.figures.panels import line_of, panels_of, values_of, window_of
from invtrack.figures.style import (
    FAINT,
    REFERENCE,
    draw_line,
    draw_magnitudes,
    legend_below,
    line_looks,
    new_figure,
    shared_style,
    within,
)
from invtrack.plans.plan import Plan, Samples, require_plan

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Line = tuple[Array, Array]
"""Times (m,) [s] and values (m,)."""

INCHES_PER_PANEL = 2.0
PHASE_TICKS = 7
PLAN_POINTS = 3000  # over all of a plan that is shown


def overlay_figure(
    title: str,
    *,
    panels: Sequence[tuple[str, Mapping[str, Line]]],
    wanted: str | None = None,
    window: tuple[float, float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> Figure:
    """Panels above each other over time, each with curves of one quantity; a curve has the same look in every panel.

    Args:
        title: of the figure.
        panels: (label with unit, {curve: (times (m,) [s], values (m,))}) of each.
        wanted: name of the curve that the others are to follow, drawn dashed and on top.
        window: (start, end) [s] that is shown; all unless given.
        limits: (lowest, highest) value that a panel's quantity may take, by the panel's label; drawn as dotted lines.

    Raises InvtrackError for a panel without curves, a curve whose times and values differ in number, limits of an unknown panel.
    """
    panels = [(quantity, _lines(quantity, curves)) for quantity, curves in panels_of(panels)]
    if not panels:
        raise InvtrackError("expected at least one panel, got none")
    bounds = by_name(
        "limits", {} if limits is None else limits, expected="(lowest, highest) by the labels of panels", error=InvtrackError
    )
    unknown = set(bounds) - {quantity for quantity, _ in panels}
    if unknown:
        raise InvtrackError(f"expected limits of the panels {[quantity for quantity, _ in panels]}, got {sorted(unknown)}")
    limits = {quantity: _pair(f"limits of {quantity!r}", pair) for quantity, pair in bounds.items()}
    window = None if window is None else window_of(window)
    require_text("title", title, error=InvtrackError)
    if wanted is not None:
        require_text("wanted", wanted, error=InvtrackError)
    names = list(dict.fromkeys(name for _, curves in panels for name in curves))
    others = [name for name in names if name != wanted]
    looks: dict[str, dict[str, Any]] = {name: {**look} for name, look in zip(others, line_looks(len(others)), strict=True)}
    if wanted is not None:
        looks[wanted] = {**REFERENCE, "zorder": 3}
    with shared_style():
        figure = new_figure(title, width=8.0, height=1.1 + INCHES_PER_PANEL * len(panels))
        all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        handles: dict[str, Artist] = {}
        for axes, (quantity, curves) in zip(all_axes, panels, strict=True):
            for name, (time, values) in curves.items():
                shown = slice(None) if window is None else within(time, window)
                draw_line(axes, time[shown], values[shown], label=name, **looks[name])
            for level in limits.get(quantity, ()):
                axes.axhline(level, color=FAINT, linewidth=0.9, linestyle=(0, (1, 2)), label="limit")
            axes.set_ylabel(quantity)
            axes.margins(x=0.0, y=0.1)
            for handle, text in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(text, handle)
        all_axes[-1].set_xlabel("time [s]")
        figure.align_ylabels()
        if len(handles) > 1:
            legend_below(figure, list(handles.values()), list(handles), columns=5)
    return figure


def _lines(quantity: str, curves: Mapping[str, Any]) -> dict[str, Line]:
    if not curves:
        raise InvtrackError(f"panel {quantity!r} has no curve; give it at least one, or leave it out")
    return {name: line_of(f"curve {name!r} of {quantity}", line) for name, line in curves.items()}


def _pair(name: str, value: object) -> tuple[float, float]:
    low, high = real_vector(name, value, ["lowest", "highest"], error=InvtrackError)  # type: ignore[arg-type]
    return float(low), float(high)


def plan_figure(
    plans: Plan | Mapping[str, Plan], *, states: Sequence[str] = (), window: tuple[float, float] | None = None
) -> Figure:
    """One plan, or several by the names that their lines get: every output with the wanted one, every input, and chosen states.

    Args:
        plans: of one and the same plant and reference.
        states: names of the states that are drawn too, as deviations from the operating point.
        window: (start, end) [s] that is shown; the manoeuvre with its own length before and after it unless given, as far as the
            plans go.

    Raises InvtrackError for no plan, plans of different channels, and names of states that do not exist.
    """
    expected = "plans by the names that their lines get"
    named = {plans.method: plans} if isinstance(plans, Plan) else by_name("plans", plans, expected=expected, error=InvtrackError)
    if not named:
        raise InvtrackError("expected at least one plan to draw, got none")
    for plan in named.values():
        require_plan(plan, error=InvtrackError)
    states = texts("states", states, expected="a list of names of states", error=InvtrackError)
    window = None if window is None else window_of(window)
    model = next(iter(named.values())).model
    for name, plan in named.items():
        if (plan.model.outputs, plan.model.inputs) != (model.outputs, model.inputs):
            found, expected = (f"{each.inputs} to {each.outputs}" for each in (plan.model, model))
            raise InvtrackError(f"plan {name!r} leads from {found}, the first one from {expected}; draw plans of one plant")
    values = {name: _sampled(plan, window) for name, plan in named.items()}
    time, wanted = (getattr(next(iter(values.values())), field) for field in ("time", "y_d"))
    panels: list[tuple[str, Mapping[str, Line]]] = []
    for i, text in enumerate(model.outputs.labels):
        panels.append((text, {**{name: (at.time, at.y[:, i]) for name, at in values.items()}, "wanted": (time, wanted[:, i])}))
    for i, text in enumerate(model.inputs.labels):
        panels.append((text, {name: (at.time, at.u[:, i]) for name, at in values.items()}))
    for i, text in zip(map(model.states.index, states), model.states.subset(states).labels, strict=True):
        panels.append((text, {name: (at.time, at.x[:, i]) for name, at in values.items()}))
    return overlay_figure("Planned motion", panels=panels, wanted="wanted")


def _sampled(plan: Plan, window: tuple[float, float] | None) -> Samples:
    """The plan over the window, both sides of its breakpoints included."""
    (T_i, T_f), length = plan.manoeuvre, max(plan.manoeuvre[1] - plan.manoeuvre[0], np.finfo(float).tiny)
    start, end = (max(plan.start, T_i - length), min(plan.end, T_f + length)) if window is None else window
    inner = plan.breakpoints[(plan.breakpoints > start) & (plan.breakpoints < end)]
    edges = np.concatenate([[start], inner, [end]])
    share = np.linspace(0.0, 1.0, max(3, PLAN_POINTS // (len(edges) - 1)))
    times = edges[:-1, None] + np.diff(edges)[:, None] * share
    return plan(times.ravel(), inside=np.repeat((edges[:-1] + edges[1:]) / 2, len(share)))


def sweep_figure(
    title: str,
    *,
    label: str,
    values: Sequence[float],
    predicted: Mapping[str, Sequence[float]],
    measured: Mapping[str, Sequence[float]],
    quantity: str,
    logarithmic: bool = False,
) -> Figure:
    """Lines for what is predicted, markers for what is measured, one colour per curve; what was only measured is joined up.

    Args:
        title: of the figure.
        label: of the swept parameter, with its unit.
        values: of the swept parameter (m,).
        predicted, measured: curves by name, one number per value (m,).
        quantity: label of the vertical axis, with its unit.
        logarithmic: whether both axes are.

    Raises InvtrackError where lengths differ.
    """
    points = values_of("values", values)
    lines, dots = _numbers("predicted", predicted), _numbers("measured", measured)
    for name, words in (("title", title), ("label", label), ("quantity", quantity)):
        require_text(name, words, error=InvtrackError)
    for name, curve in (*lines.items(), *dots.items()):
        if len(curve) != len(points):
            raise InvtrackError(f"curve {name!r} has {len(curve)} points for {len(points)} values of {label}")
    with shared_style():
        figure = new_figure(title, width=8.0, height=4.0)
        axes = figure.add_subplot()
        names = list(dict.fromkeys([*lines, *dots]))
        for name, look in zip(names, line_looks(len(names)), strict=True):
            if name in lines:
                axes.plot(points, lines[name], label=f"{name}, predicted", color=look["color"], linestyle=look["linestyle"])
            if name in dots:
                joined = "none" if name in lines else look["linestyle"]
                markers = {"linestyle": joined, "marker": "o", "markersize": 4.0}
                axes.plot(points, dots[name], label=f"{name}, measured", color=look["color"], **markers)  # type: ignore[arg-type]
        if flag("logarithmic", logarithmic, error=InvtrackError):
            axes.set_xscale("log")
            axes.set_yscale("log")
        axes.set_xlabel(label)
        axes.set_ylabel(quantity)
        axes.legend(loc="best", frameon=True, framealpha=0.75, edgecolor="none")
    return figure


def _numbers(name: str, curves: object) -> dict[str, Array]:
    given = by_name(name, curves, expected="curves by their names", error=InvtrackError)
    return {key: values_of(f"curve {key!r}", curve) for key, curve in given.items()}


@dataclass(frozen=True, eq=False)
class Decay:
    """An error over time: values (m,) at times (m,) [s], named with its unit, and the rate [1/s] at which it should fall.

    Raises InvtrackError for fewer than two samples, or unequal numbers of times and values.
    """

    label: str
    time: Array
    values: Array
    rate: float

    def __post_init__(self) -> None:
        time, values = line_of(f"error {require_text('label', self.label, error=InvtrackError)!r}", (self.time, self.values))
        if len(time) < 2:
            raise InvtrackError(f"error {self.label!r} has {len(time)} times and values, expected two or more")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)
        finite_number("rate", self.rate, unit="1/s", error=InvtrackError)

    def expected(self) -> Array:
        """The exponential of this rate that touches the error from above in the second half of the time, (m,)."""
        since = self.time - self.time[0]
        late = since >= since[-1] / 2
        height = np.max(np.abs(self.values[late]) * np.exp(self.rate * (since[late] - since[-1])))
        return np.asarray(height * np.exp(self.rate * (since[-1] - since)))


def decay_figure(title: str, decays: Sequence[Decay]) -> Figure:
    """Magnitudes on logarithmic axes, one panel each, with the exponential of the stated rate dashed.

    Raises InvtrackError for no decays.
    """
    decays = items("decays", decays, expected="a list of Decay", error=InvtrackError)
    if not decays:
        raise InvtrackError("expected at least one error to show, got none")
    for decay in decays:
        instance("a decay", decay, Decay, expected="an invtrack.figures.Decay", error=InvtrackError)
    require_text("title", title, error=InvtrackError)
    with shared_style():
        figure = new_figure(title, width=8.0, height=0.9 + INCHES_PER_PANEL * len(decays))
        panels = figure.subplots(len(decays), 1, squeeze=False)[:, 0]
        for axes, decay in zip(panels, decays, strict=True):
            look = line_looks(1)[0]
            draw_magnitudes(axes, [(decay.time, decay.values, {**look, "label": "error"})])
            low, high = axes.get_ylim()
            draw_line(axes, decay.time, decay.expected(), label=f"exp(-{decay.rate:.3g} t)", **REFERENCE)
            axes.set_ylim(low, high)
            axes.set_xlim(decay.time[0], decay.time[-1])
            axes.set_ylabel(decay.label)
            axes.set_xlabel("time [s]")
            axes.legend(loc="upper right")
        figure.align_ylabels()
    return figure


def frequency_response_figure(
    title: str, *, w: Array, curves: Mapping[str, ComplexArray], magnitude: str, phase: bool = True
) -> Figure:
    """Magnitude on logarithmic axes and, below it, the continuous phase of each curve.

    The phase starts between -270 and 90 degrees: a double integrator's at -180.

    Args:
        title: of the figure.
        w: frequencies (m,) [rad/s], positive and increasing.
        curves: {name: response (m,)}.
        magnitude: label of the upper axis, with its unit.
        phase: whether the phase is shown.

    Raises InvtrackError where frequencies are not positive or not in order, and where lengths differ.
    """
    flag("phase", phase, error=InvtrackError)
    for name, words in (("title", title), ("magnitude", magnitude)):
        require_text(name, words, error=InvtrackError)
    w = values_of("frequencies w [rad/s]", w)
    given = by_name("curves", curves, expected="responses by the names of curves", error=InvtrackError)
    curves = {name: complex_numbers(f"curve {name!r}", curve, error=InvtrackError) for name, curve in given.items()}
    if not curves or len(w) < 2 or not w[0] > 0 or not np.all(np.diff(w) > 0) or not np.isfinite(w[-1]):
        raise InvtrackError("expected at least one curve over two or more positive frequencies that increase")
    for name, curve in curves.items():
        if np.shape(curve) != np.shape(w):
            raise InvtrackError(f"curve {name!r} has shape {np.shape(curve)}, expected one value for each of {len(w)} frequencies")
    with shared_style():
        figure = new_figure(title, width=8.0, height=4.8 if phase else 3.4)
        all_axes = figure.subplots(2 if phase else 1, 1, sharex=True, squeeze=False, height_ratios=[1.5, 1.0] if phase else [1.0])[
            :, 0
        ]
        for (name, curve), look in zip(curves.items(), line_looks(len(curves)), strict=True):
            all_axes[0].loglog(w, np.abs(curve), label=name, **look)
            if phase:
                all_axes[1].semilogx(w, _phase(curve), **look)
        all_axes[0].set_ylabel(magnitude)
        if phase:
            from matplotlib.ticker import MultipleLocator

            all_axes[1].set_ylabel("phase [degrees]")
            all_axes[1].yaxis.set_major_locator(MultipleLocator(_phase_step(all_axes[1])))
        all_axes[-1].set_xlabel("frequency [rad/s]")
        all_axes[0].margins(x=0.0)
        figure.align_ylabels()
        if len(curves) > 1:
            legend_below(figure, *all_axes[0].get_legend_handles_labels())
    return figure


def _phase_step(axes: Axes) -> float:
    """Degrees between ticks: the least part or multiple of a quarter turn that gives no more than PHASE_TICKS of them."""
    low, high = axes.get_ylim()
    return next(step for step in (math.ldexp(45.0, k) for k in count()) if high - low <= PHASE_TICKS * step)


def _phase(curve: ComplexArray) -> Array:
    """Continuous phase [degrees]; a lead of more than a quarter turn at the lowest frequency counts as a lag."""
    phase = np.degrees(np.unwrap(np.angle(curve)))
    return np.asarray(phase - 360.0 if phase[0] > 90.0 + 1e-6 else phase)
