"""Any curves over time, in panels above each other; and plans before any run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from invtrack.arguments import by_name, require_text, texts
from invtrack.arrays import Array, real_vector
from invtrack.errors import InvtrackError
from invtrack.figures.lines import draw_line
from invtrack.figures.marks import mark_manoeuvre, within
from invtrack.figures.panels import ends_of, line_of, panels_of, window_of
from invtrack.figures.sheet import sheet
from invtrack.figures.style import DOTTED, FAINT, WANTED, line_looks
from invtrack.plans.plan import Plan, Samples, require_plan
from invtrack.results.interval import shown_interval

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven

Line = tuple[Array, Array]
"""Times (m,) [s] and values (m,)."""

INCHES_PER_PANEL = 2.0
PLAN_POINTS = 3000  # over all of a plan that is shown


def overlay_figure(
    title: str,
    *,
    panels: Sequence[tuple[str, Mapping[str, Line]]],
    wanted: str | None = None,
    window: tuple[float, float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    manoeuvre: tuple[float, float] | None = None,
    ax: AxesGiven | None = None,
) -> Figure:
    """Panels above each other over time, each with curves of one quantity; a curve has the same look in every panel.

    Curves that coincide are all to be seen.

    Args:
        title: of the figure.
        panels: (label with unit, {curve: (times (m,) [s], values (m,))}) of each.
        wanted: name of the curve that the others are to follow, wide and pale beneath them.
        window: (start, end) [s] that is shown; all unless given.
        limits: (lowest, highest) value that a panel's quantity may take, by the panel's label; drawn as dotted lines.
        manoeuvre: its start and end [s], marked as T_i and T_f.
        ax: panels to draw on in place of a figure of its own, as many.

    Raises InvtrackError for a panel without curves, a curve whose times and values differ in number, limits of an unknown panel,
    and another number of panels in `ax`.
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
        looks[wanted] = {**WANTED}
    ends = None if manoeuvre is None else ends_of(manoeuvre)
    titles = [quantity for quantity, _ in panels]
    with sheet(title, titles, ax, size=(8.0, 1.1 + INCHES_PER_PANEL * len(panels))) as page:
        handles: dict[str, Artist] = {}
        for number, (axes, (quantity, curves)) in enumerate(zip(page.axes, panels, strict=True)):
            for name in (name for name in looks if name in curves):  # in one order, which lets all be seen
                time, values = curves[name]
                shown = slice(None) if window is None else within(time, window)
                draw_line(axes, time[shown], values[shown], label=name, **looks[name])
            for level in limits.get(quantity, ()):
                axes.axhline(level, color=FAINT, linewidth=0.9, linestyle=DOTTED, label="limit")
            axes.set_ylabel(quantity)
            axes.margins(x=0.0, y=0.1)
            if window is not None:
                axes.set_xlim(*window)
            if ends is not None:
                mark_manoeuvre(axes, ends, axes.get_xlim(), labelled=number == 0)
            for handle, text in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(text, handle)
        if len(handles) > 1:
            page.legend(list(handles.values()), list(handles))
    return page.figure


def _lines(quantity: str, curves: Mapping[str, Any]) -> dict[str, Line]:
    if not curves:
        raise InvtrackError(f"panel {quantity!r} has no curve; give it at least one, or leave it out")
    return {name: line_of(f"curve {name!r} of {quantity}", line) for name, line in curves.items()}


def _pair(name: str, value: object) -> tuple[float, float]:
    low, high = real_vector(name, value, ["lowest", "highest"], error=InvtrackError)  # type: ignore[arg-type]
    return float(low), float(high)


def plan_figure(
    plans: Plan | Mapping[str, Plan],
    *,
    states: Sequence[str] = (),
    window: tuple[float, float] | None = None,
    ax: AxesGiven | None = None,
) -> Figure:
    """One plan, or several by the names that their lines get: every output with the wanted one, every input, and chosen states.

    Args:
        plans: of one and the same plant and reference.
        states: names of the states that are drawn too, as deviations from the operating point.
        window: (start, end) [s] that is shown; unless given the preactuation of all plans, the manoeuvre, and what follows it.
        ax: panels to draw on in place of a figure of its own, one for each output, input and chosen state, in this order.

    Raises InvtrackError for no plan, plans of different channels, names of states that do not exist, and another number of panels
    in `ax`.
    """
    expected = "plans by the names that their lines get"
    named = {plans.method: plans} if isinstance(plans, Plan) else by_name("plans", plans, expected=expected, error=InvtrackError)
    if not named:
        raise InvtrackError("expected at least one plan to draw, got none")
    for plan in named.values():
        require_plan(plan, error=InvtrackError)
    states = texts("states", states, expected="a list of names of states", error=InvtrackError)
    window = _plans_window(list(named.values())) if window is None else window_of(window)
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
    title = f"Planned motion: {', '.join(dict.fromkeys(plan.method for plan in named.values()))}"
    manoeuvre = next(iter(named.values())).manoeuvre
    return overlay_figure(title, panels=panels, wanted="wanted", manoeuvre=manoeuvre, ax=ax)


def _plans_window(plans: list[Plan]) -> tuple[float, float]:
    start, end = shown_interval(plans)
    return (start, end) if start < end else (start - 0.5, end + 0.5)  # a plan that stays at rest


def _sampled(plan: Plan, window: tuple[float, float]) -> Samples:
    """The plan over the window, both sides of its breakpoints included."""
    start, end = window
    inner = plan.breakpoints[(plan.breakpoints > start) & (plan.breakpoints < end)]
    edges = np.concatenate([[start], inner, [end]])
    share = np.linspace(0.0, 1.0, max(3, PLAN_POINTS // (len(edges) - 1)))
    times = edges[:-1, None] + np.diff(edges)[:, None] * share
    return plan(times.ravel(), inside=np.repeat((edges[:-1] + edges[1:]) / 2, len(share)))
