"""The layout of views with which a recording opens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from invtrack.arrays import Array
from invtrack.recording.scene import Scene
from invtrack.recording.series import channels_by_unit, entity_path, unit_path
from invtrack.recording.shapes import visible_geoms
from invtrack.recording.stream import SHOWN
from invtrack.results.result import RunResult, Signal

VIEWING_DISTANCE = 1.5
"""Distance of the eye relative to the width of what it is to see; the viewer's field of view is about 55 degrees."""

SKY = (176, 190, 204)

BESIDE = 0.35
"""Share of the shown interval that plots leave free on their right, where the legend stands."""


def make_blueprint(
    runs: Sequence[RunResult], scenes: Sequence[Scene | None], interval: tuple[float, float], *, shared: bool = False
) -> rrb.Blueprint:
    """3-D scene, parameters, events, metrics on the left; output, error, input and states on the right, all cases in one plot each.

    interval: the time [s] that the plots show at first. shared: the layout is also that of other recordings, so it has places for
    what their cases may have and these do not.
    """
    shares: dict[float, list[rrb.Container | rrb.View]] = {
        3.0: _scenes(runs, scenes, shared=shared),
        1.3: _parameters(runs, interval),
        1.0: [_tabs([_events(runs), *_numbers(runs)])],
    }
    left = rrb.Vertical(
        *(view for views in shares.values() for view in views), row_shares=[share for share, views in shares.items() if views]
    )
    right = [
        _side_by_side(_outputs(runs, interval, shared=shared)),
        _tabs([*_errors(runs, interval, "log10_error"), *_errors(runs, interval, "error")]),
        _side_by_side(_inputs(runs, interval, shared=shared)),
        _tabs([view for run in runs for view in _states(run, interval, several=len(runs) > 1, shared=shared)]),
    ]
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*right), column_shares=[2, 3] if shared or any(scenes) else [1, 3]),
        _time_panel(interval),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def _scenes(runs: Sequence[RunResult], scenes: Sequence[Scene | None], *, shared: bool) -> list[rrb.Container | rrb.View]:
    views = [
        _scene(run, scene, several=len(runs) > 1) for run, scene in zip(runs, scenes, strict=True) if shared or scene is not None
    ]
    return [_tabs(views)] if views else []


def _scene(run: RunResult, scene: Scene | None, *, several: bool) -> rrb.View:
    position, target = (None, None) if scene is None else eye(scene)
    return rrb.Spatial3DView(
        origin=entity_path(run.name, "scene"),
        name=f"{run.name}: {run.model}" if several else run.model,
        eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=[0.0, 0.0, 1.0]),
        line_grid=False,
        background=SKY,
    )


def eye(scene: Scene) -> tuple[Array, Array]:
    """Where the eye stands and what it looks at: along +y and slightly down, far enough to see every moving geom at all times."""
    model = scene.model
    low, high = [np.array(model.stat.center)], [np.array(model.stat.center)]
    for body in (body for body in range(model.nbody) if model.body_weldid[body] != 0):
        for geom in visible_geoms(model, body):
            reach = np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom]  # about the body's origin, in every direction
            low.append(scene.positions[:, body].min(axis=0) - reach)
            high.append(scene.positions[:, body].max(axis=0) + reach)
    lower, upper = np.min(low, axis=0), np.max(high, axis=0)
    distance = VIEWING_DISTANCE * max(float(np.max(upper - lower)), 0.2 * model.stat.extent)
    return (lower + upper) / 2 + distance * np.array([0.0, -1.0, 0.2]), (lower + upper) / 2


def _outputs(runs: Sequence[RunResult], interval: tuple[float, float], *, shared: bool) -> list[rrb.View]:
    """Output and reference; the planned output where a case plans another one; a reference that cases share is shown once."""
    views = []
    for unit in _units(runs, "output"):
        paths = []
        for number, run in enumerate(runs):
            paths.append(unit_path(run.name, "output", unit))
            if not any(_same_reference(run, earlier) for earlier in runs[:number]):
                paths.append(unit_path(run.name, "reference", unit))
            if shared or not _same(run.planned_output, run.reference):
                paths.append(unit_path(run.name, "planned_output", unit))
            if shared or unit in run.measured.channels.units:
                paths.append(unit_path(run.name, "measured", unit))
        paths += _event_lines(runs[0], "output", unit)
        views.append(_plot(f"Output and reference [{unit}]", paths, interval))
    return views


def _errors(runs: Sequence[RunResult], interval: tuple[float, float], name: str) -> list[rrb.View]:
    views = []
    for unit in _units(runs, "output"):
        paths = [unit_path(run.name, name, unit) for run in runs]
        paths += _event_lines(runs[0], name, unit)
        title = f"log10 |error| [log10 {unit}]" if name == "log10_error" else f"Error [{unit}]"
        views.append(_plot(title, paths, interval))
    return views


def _inputs(runs: Sequence[RunResult], interval: tuple[float, float], *, shared: bool) -> list[rrb.View]:
    """Applied input; the commanded one where the actuator's limits changed it."""
    views = []
    for unit in _units(runs, "applied"):
        paths = [unit_path(run.name, "applied", unit) for run in runs]
        paths += [unit_path(run.name, "commanded", unit) for run in runs if shared or not _same(run.commanded, run.applied)]
        paths += _event_lines(runs[0], "applied", unit)
        views.append(_plot(f"Input [{unit}]", paths, interval))
    return views


def _states(run: RunResult, interval: tuple[float, float], *, several: bool, shared: bool) -> list[rrb.View]:
    """States and, where the controller wants any, their references, one plot per unit."""
    title = f"{run.name}: states" if several else "States and references"
    views = []
    for unit, channels in channels_by_unit(run.state).items():
        wanted = run.state_reference.values[:, channels]
        names = ["state", "state_reference"] if shared or np.any(np.isfinite(wanted)) else ["state"]
        names += ["estimate"] if shared or run.estimate.channels else []
        views.append(_plot(f"{title} [{unit}]", [unit_path(run.name, name, unit) for name in names], interval))
    return views


def _parameters(runs: Sequence[RunResult], interval: tuple[float, float]) -> list[rrb.Container | rrb.View]:
    views = [
        _plot(f"Parameters [{unit}]", [unit_path(run.name, "parameters", unit) for run in runs], interval)
        for unit in _units(runs, "parameters")
    ]
    return [_tabs(views)] if views else []


def _events(runs: Sequence[RunResult]) -> rrb.View:
    return rrb.TextLogView(
        origin="/",
        contents=[entity_path(run.name, "events") for run in runs],
        name="Events",
        columns=rrb.TextLogColumns(text_log_columns=["Body"]),
    )


def _numbers(runs: Sequence[RunResult]) -> list[rrb.View]:
    """The metrics of each run."""
    titles = ["Metrics"] if len(runs) == 1 else [f"{run.name}: metrics" for run in runs]
    return [
        rrb.TextDocumentView(origin=entity_path(run.name, "metrics"), name=title) for run, title in zip(runs, titles, strict=True)
    ]


def _plot(name: str, paths: list[str], interval: tuple[float, float]) -> rrb.View:
    begin, until = interval
    start, end = (rr.TimeRangeBoundary.absolute(seconds=time) for time in (begin, until + BESIDE * (until - begin)))
    return rrb.TimeSeriesView(
        origin="/",
        contents=paths,
        name=name,
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def _time_panel(interval: tuple[float, float]) -> rrb.TimePanel:
    """It plays the interval [s] again and again, on the timeline that starts there: no layout can say at which time to start."""
    begin, end = (round(1e9 * time) for time in interval)
    repeated = rrb.components.AbsoluteTimeRange(begin, end)
    return rrb.TimePanel(timeline=SHOWN, state="collapsed", play_state="playing", loop_mode="selection", time_selection=repeated)


def _event_lines(run: RunResult, signal: str, unit: str) -> list[str]:
    return [entity_path(run.name, "event_lines", signal, f"[{unit}]")] if run.events else []


def _units(runs: Sequence[RunResult], signal: str) -> list[str]:
    return list(dict.fromkeys(unit for run in runs for unit in getattr(run, signal).channels.units))


def _same(one: Signal, other: Signal) -> bool:
    """Whether two signals differ by no more than rounding, so that a plot of both would show one line."""
    size = np.max(np.abs(other.values), axis=0, initial=0.0, where=np.isfinite(other.values))
    return bool(np.all(np.isclose(one.values, other.values, rtol=0.0, atol=1e-9 * size, equal_nan=True)))


def _same_reference(one: RunResult, other: RunResult) -> bool:
    return one.reference.equals(other.reference) and np.array_equal(one.time, other.time)


def _side_by_side(views: list[rrb.View]) -> rrb.Container | rrb.View:
    return views[0] if len(views) == 1 else rrb.Horizontal(*views)


def _tabs(views: list[rrb.View]) -> rrb.Container | rrb.View:
    return views[0] if len(views) == 1 else rrb.Tabs(*views, active_tab=0)
