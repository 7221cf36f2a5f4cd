"""Logs of hardware as results of runs: the same metrics, figures and recordings, and the same comparison with the plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from invtrack.arguments import by_name, file_path, instance, require_text
from invtrack.arrays import Array, finite_number
from invtrack.channels import Channels
from invtrack.errors import FileError
from invtrack.files import Header, read_table
from invtrack.linear.oscillation import slowest_flexible_period
from invtrack.plans.plan import Plan
from invtrack.references.columns import column_factor, named_column, time_column
from invtrack.references.unit_conversion import Factor
from invtrack.results.result import Event, RunResult, Signal

PREFIXES = {"outputs": "y.", "inputs": "u.", "states": "x."}
"""What may stand before a channel's name, so that an output and a state of one name may be two columns."""


@dataclass(frozen=True, eq=False)
class _Along:
    """What was to happen, by a plan, or by a run that was driven along one.

    Args:
        kind: "plan" or "run", for messages.
        channels: outputs, inputs and states.
        span: the first and the last time [s] at which it is known.
        wanted: from times (m,) to planned states (m, n), wanted outputs and planned outputs (m, p).
        manoeuvre, rest_inputs, vibration_period: as in `RunResult`.
    """

    kind: str
    channels: Mapping[str, Channels]
    span: tuple[float, float]
    wanted: Callable[[Array], tuple[Array, Array, Array]]
    manoeuvre: tuple[float, float]
    rest_inputs: Array
    vibration_period: float

    @classmethod
    def of(cls, along: Plan | RunResult) -> _Along:
        expected = "the plan that the hardware was driven along, or a run along it"
        instance("along", along, (Plan, RunResult), expected=expected, error=FileError)
        if isinstance(along, Plan):
            model = along.model

            def planned(t: Array) -> tuple[Array, Array, Array]:
                values = along(t)
                return values.x, values.y_d, values.y

            channels = {"outputs": model.outputs, "inputs": model.inputs, "states": model.states}
            period = slowest_flexible_period(model.systems[-1])
            return cls("plan", channels, (along.start, along.end), planned, along.manoeuvre, along.rest_inputs, period)
        signals = along.state_reference, along.reference, along.planned_output
        channels = {"outputs": along.output.channels, "inputs": along.commanded.channels, "states": along.state.channels}

        def recorded(t: Array) -> tuple[Array, Array, Array]:
            x, y_d, y = (
                np.column_stack([np.interp(t, along.time, column, left=np.nan, right=np.nan) for column in signal.values.T])
                for signal in signals
            )
            return x, y_d, y

        span = float(along.time[0]), float(along.time[-1])
        return cls("run", channels, span, recorded, along.manoeuvre, along.rest_inputs, along.vibration_period)


def read_log(
    path: str | Path,
    along: Plan | RunResult,
    *,
    columns: Mapping[str, str] | None = None,
    time: str | None = None,
    zero: float = 0.0,
    name: str | None = None,
) -> RunResult:
    """A log of hardware that was driven along a plan, from a CSV file with named columns, as the result of a run.

    What the plan calls its outputs has to be there; inputs and states are taken where they are. A column is named by its
    whole header text or by what stands there before its unit, by itself or behind "y.", "u." or "x."; values are converted from
    the units in the header, "mm" to "m". What the log does not say is NaN: metrics of it are None, figures leave it out. The input
    of a row holds until the next row, that of the last row is left out. Cells are separated as `load_reference` says.

    Args:
        path: the file.
        along: the plan that the hardware was driven along, or a run of it in simulation, between whose samples wanted and planned
            values are interpolated; rows before it starts and after it ends are left out.
        columns: by the name of a channel the column that it is in, where that has another name.
        time: the column of times; None: the one called "time" or "t".
        zero: what the log's clock shows when the plan's shows 0 [s].
        name: of the run; the file's unless given.

    Raises FileError, naming file and line, as `load_reference` does: where outputs are not there, times do not increase, a cell is
    not a finite number; and where the log has no time in common with the plan.
    """
    path = file_path(path)
    plan = _Along.of(along)
    zero = finite_number("zero [s]", zero, error=FileError)
    time = None if time is None else require_text("time", time, error=FileError)
    given = by_name("columns", {} if columns is None else columns, expected="columns by the names of channels", error=FileError)
    groups = plan.channels
    unknown = set(given) - {channel for channels in groups.values() for channel in channels.names}
    if unknown:
        raise FileError(f"columns names {sorted(unknown)}, which are no channels of the {plan.kind}; there are: {_listed(groups)}")
    place: dict[str, list[int | None]] = {}
    factors: list[Factor] = []

    def choose(header: Header) -> list[int]:
        if not header.stated:
            raise FileError(f"{path} has no header row; expected one with the names of its columns")
        chosen = [time_column(path, header, time)]
        factors.append(column_factor(path, header, chosen[0], "s"))
        for kind, channels in groups.items():
            place[kind] = []
            for channel, unit in zip(channels.names, channels.units, strict=True):
                required = kind == "outputs" or channel in given
                column = _column(path, header, str(given.get(channel, channel)), PREFIXES[kind], required=required)
                place[kind].append(None if column is None else len(chosen))
                if column is not None:
                    chosen.append(column)
                    factors.append(column_factor(path, header, column, unit))
        return chosen

    table = read_table(path, choose)
    values = np.column_stack([factor.applied(column) for factor, column in zip(factors, table.values.T, strict=True)])
    t = values[:, 0] - zero
    late = np.flatnonzero(np.diff(t) <= 0)
    if late.size:
        after = late[0] + 1
        raise FileError(f"{path}, line {table.lines[after]}: expected times that increase, got {values[after, 0]:.17g} s")
    start, end = plan.span
    if len(t) < 2 or t[-1] < start or t[0] > end:
        raise FileError(
            f"{path}: its {len(t)} rows from {t[0]:.6g} to {t[-1]:.6g} s on the plan's clock have nothing in common with the "
            f"{plan.kind}, which lasts from {start:.6g} to {end:.6g} s; say with zero=... what its clock shows at the plan's 0"
        )
    known = np.ones(len(t), dtype=bool) if isinstance(along, Plan) else (start <= t) & (t <= end)
    if np.sum(known) < 2:
        raise FileError(f"{path}: only {np.sum(known)} of its rows lies within the run, from {start:.6g} to {end:.6g} s")
    t, values = t[known], values[known]
    found = {kind: Signal(_values(values, place[kind]), channels) for kind, channels in groups.items()}
    return _result(plan, t, found, path.stem if name is None else require_text("name", name, error=FileError))


def _column(path: Path, header: Header, name: str, prefix: str, *, required: bool) -> int | None:
    try:
        return named_column(path, header, name, prefix=prefix)
    except FileError:
        if required:
            raise
        return None


def _values(table: Array, columns: list[int | None]) -> Array:
    """The chosen columns (m, k), NaN for those that are not there."""
    missing = np.full(len(table), np.nan)
    return np.column_stack([missing if column is None else table[:, column] for column in columns])


def _result(plan: _Along, t: Array, found: Mapping[str, Signal], name: str) -> RunResult:
    (x, y_d, y), channels, (T_i, T_f) = plan.wanted(t), plan.channels, plan.manoeuvre
    u = Signal(found["inputs"].values[:-1], channels["inputs"])
    events = [Event(T_i, "manoeuvre", "starts"), Event(T_f, "manoeuvre", "ends")]
    absent = [
        channel
        for signal in found.values()
        for channel, column in zip(signal.channels.names, signal.values.T, strict=True)
        if np.all(np.isnan(column))
    ]
    return RunResult(
        name=name,
        model="log",
        time=t,
        state=found["states"],
        state_reference=Signal(x, channels["states"]),
        output=found["outputs"],
        reference=Signal(y_d, channels["outputs"]),
        planned_output=Signal(y, channels["outputs"]),
        commanded=u,
        applied=u,
        parameters=Signal(np.zeros((len(t) - 1, 0)), Channels()),
        manoeuvre=(T_i, T_f),
        rest_inputs=plan.rest_inputs,
        timestep=float(np.max(np.diff(t))),
        evaluate="held",
        integrator="log",
        vibration_period=plan.vibration_period,
        events=tuple(event for event in events if t[0] <= event.time <= t[-1]),
        remarks=(f"a log, which does not hold {', '.join(absent)}",) if absent else (),
        qpos=np.zeros((len(t), 0)),
    )


def _listed(groups: Mapping[str, Channels]) -> str:
    return "; ".join(f"{kind} {', '.join(channels.names)}" for kind, channels in groups.items())
