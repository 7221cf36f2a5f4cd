"""The layout of views with which a recording opens."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from invtrack.recording.camera import Camera
from invtrack.recording.scene import Scene
from invtrack.recording.series import channels_by_unit, entity_path, tracking_error, unit_path
from invtrack.recording.stream import SHOWN
from invtrack.results.result import RunResult, Signal

DECADES, FEWEST = 6.0, 3.0
"""Of errors, shown at first, and of those of each case."""

SKY = (176, 190, 204)

LONGEST = 12.0
"""Seconds that the shown interval takes to be played, at the most: longer ones are played faster."""

SIX = 6
"""Scenes up to which two stand in a row; two stand above each other, as wide as they are high or wider."""

BESIDE = 0.35
"""Share of the shown interval that plots leave free on their right, where the legend stands."""


def make_blueprint(
    runs: Sequence[RunResult],
    scenes: Sequence[Scene | None],
    interval: tuple[float, float],
    camera: Camera | None,
    *,
    shared: bool = False,
) -> rrb.Blueprint:
    """3-D scene, parameters, events, metrics on the left; output, error, input and states on the right, all cases in one plot each.

    Args:
        runs, scenes: the cases.
        interval: the time [s] that the plots show at first.
        camera: from where the scenes are looked at, all from the same place; None where there is no scene.
        shared: the layout is also that of other recordings, so it has places for what their cases may have and these do not.
    """
    shares: dict[float, list[rrb.Container | rrb.View]] = {
        3.0: _scenes(runs, scenes, camera, shared=shared),
        1.3: _parameters(runs, interval),
        1.0: [_tabs([_events(runs), *_numbers(runs)])],
    }
    left = rrb.Vertical(
        *(view for views in shares.values() for view in views), row_shares=[share for share, views in shares.items() if views]
    )
    # The legends of several cases are wide.
    arranged = _side_by_side if len(runs) == 1 else _tabs
    right = [
        arranged(_outputs(runs, interval, shared=shared)),
        _tabs([*_errors(runs, interval, "log10_error"), *_errors(runs, interval, "error")]),
        arranged(_inputs(runs, interval, shared=shared)),
        _tabs([view for run in runs for view in _states(run, interval, several=len(runs) > 1, shared=shared)]),
    ]
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*right), column_shares=_shares(len(runs), seen=shared or any(scenes))),
        _time_panel(interval),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )


def scene_aspect(cases: int) -> float:
    """Width of a scene's view over its height where so many cases are shown, about."""
    return 1.0 if cases == 1 else 2.2 if cases == 2 else 1.3


def _shares(cases: int, *, seen: bool) -> list[int]:
    """Of the width: what is on the left, scenes among it if they are seen, and the plots."""
    if not seen:
        return [1, 3]
    return [2, 3] if cases == 1 else [1, 1]


def _scenes(
    runs: Sequence[RunResult], scenes: Sequence[Scene | None], camera: Camera | None, *, shared: bool
) -> list[rrb.Container | rrb.View]:
    """The cases side by side."""
    shown = [run for run, scene in zip(runs, scenes, strict=True) if shared or scene is not None]
    views = [_scene(run, camera, several=len(runs) > 1) for run in shown]
    if len(views) < 2:
        return list(views)
    return [rrb.Grid(*views, grid_columns=1 if len(views) == 2 else 2 if len(views) <= SIX else 3)]


def _scene(run: RunResult, camera: Camera | None, *, several: bool) -> rrb.View:
    eye = None if camera is None else rrb.EyeControls3D(position=camera.position, look_target=camera.target, eye_up=camera.up)
    return rrb.Spatial3DView(
        origin=entity_path(run.name, "scene"),
        name=run.name if several else run.model,
        eye_controls=eye,
        line_grid=False,
        background=SKY,
    )


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
        views.append(_plot(_titled("Output and reference", unit), paths, interval, beside=_beside(runs, "output")))
    return views


def _errors(runs: Sequence[RunResult], interval: tuple[float, float], name: str) -> list[rrb.View]:
    views = []
    for unit in _units(runs, "output"):
        paths = [unit_path(run.name, name, unit) for run in runs]
        paths += _event_lines(runs[0], name, unit)
        title = _titled("log10 |error|", f"log10 {unit}" if unit else "") if name == "log10_error" else _titled("Error", unit)
        views.append(_plot(title, paths, interval, _decades(runs, unit, interval) if name == "log10_error" else None))
    return views


def _inputs(runs: Sequence[RunResult], interval: tuple[float, float], *, shared: bool) -> list[rrb.View]:
    """Applied input; the commanded one where the actuator's limits changed it."""
    views = []
    for unit in _units(runs, "applied"):
        paths = [unit_path(run.name, "applied", unit) for run in runs]
        paths += [unit_path(run.name, "commanded", unit) for run in runs if shared or not _same(run.commanded, run.applied)]
        paths += _event_lines(runs[0], "applied", unit)
        views.append(_plot(_titled("Input", unit), paths, interval, beside=_beside(runs, "applied")))
    return views


def _states(run: RunResult, interval: tuple[float, float], *, several: bool, shared: bool) -> list[rrb.View]:
    """States and, where the controller wants any, their references, one plot per unit."""
    title = f"{run.name}: states" if several else "States and references"
    views = []
    for unit, channels in channels_by_unit(run.state).items():
        wanted = run.state_reference.values[:, channels]
        names = ["state", "state_reference"] if shared or np.any(np.isfinite(wanted)) else ["state"]
        names += ["estimate"] if shared or run.estimate.channels else []
        views.append(_plot(_titled(title, unit), [unit_path(run.name, name, unit) for name in names], interval))
    return views


def _parameters(runs: Sequence[RunResult], interval: tuple[float, float]) -> list[rrb.Container | rrb.View]:
    views = [
        _plot(_titled("Parameters", unit), [unit_path(run.name, "parameters", unit) for run in runs], interval)
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


def _decades(runs: Sequence[RunResult], unit: str, interval: tuple[float, float]) -> tuple[float, float] | None:
    """What is shown of the logarithms of errors at first: `DECADES` below the largest of all, `FEWEST` below that of every case."""
    largest = []
    for run in runs:
        during = (run.time >= interval[0]) & (run.time <= interval[1])
        columns = [i for i, its_unit in enumerate(run.output.channels.units) if its_unit == unit]
        sizes = np.abs(tracking_error(run)[during][:, columns])
        largest.append(float(np.max(sizes, initial=0.0, where=np.isfinite(sizes))))
    tops = [float(np.ceil(np.log10(size))) for size in largest if size > 0]
    return (min(max(tops) - DECADES, min(tops) - FEWEST), max(tops) + 0.2) if tops else None


def _titled(text: str, unit: str) -> str:
    return f"{text} [{unit}]" if unit else text


def _beside(runs: Sequence[RunResult], name: str) -> float:
    """BESIDE, more of it where two plots or more of one run share the width."""
    return BESIDE * min(len(_units(runs, name)), 2) if len(runs) == 1 else BESIDE


def _plot(
    name: str,
    paths: list[str],
    interval: tuple[float, float],
    values: tuple[float, float] | None = None,
    *,
    beside: float = BESIDE,
) -> rrb.View:
    """Lines over time.

    Args:
        name, paths: title, and what is drawn.
        interval: what is shown of the time [s].
        values: what is shown of the values at first; all unless given.
        beside: share of the interval that is left free on the right.
    """
    begin, until = interval
    start, end = (rr.TimeRangeBoundary.absolute(seconds=time) for time in (begin, until + beside * (until - begin)))
    return rrb.TimeSeriesView(
        origin="/",
        contents=paths,
        name=name,
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        axis_y=None if values is None else rrb.ScalarAxis(range=values),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def _time_panel(interval: tuple[float, float]) -> rrb.TimePanel:
    """It plays the interval [s] again and again, on the timeline that starts there: no layout can say at which time to start."""
    begin, end = (round(1e9 * time) for time in interval)
    speed = max(1.0, (interval[1] - interval[0]) / LONGEST)
    repeated = rrb.components.AbsoluteTimeRange(begin, end)
    return rrb.TimePanel(
        timeline=SHOWN,
        state="collapsed",
        play_state="playing",
        playback_speed=speed,
        loop_mode="selection",
        time_selection=repeated,
    )


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
