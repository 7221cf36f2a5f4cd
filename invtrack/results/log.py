"""Logs of hardware as results of runs: the same metrics, figures and recordings, and the same comparison with the plan."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from invtrack.arguments import by_name, file_path, require_text
from invtrack.arrays import Array, finite_number
from invtrack.channels import Channels
from invtrack.errors import FileError
from invtrack.files import Header, read_table
from invtrack.linear.oscillation import slowest_flexible_period
from invtrack.plans.plan import Plan, require_plan
from invtrack.references.columns import column_factor, named_column, time_column
from invtrack.references.unit_conversion import Factor
from invtrack.results.result import Event, RunResult, Signal

PREFIXES = {"outputs": "y.", "inputs": "u.", "states": "x."}
"""What may stand before a channel's name, so that an output and a state of one name may be two columns."""


def read_log(
    path: str | Path,
    plan: Plan,
    *,
    columns: Mapping[str, str] | None = None,
    time: str | None = None,
    zero: float = 0.0,
    name: str | None = None,
) -> RunResult:
    """A log of hardware that was driven along a plan, from a CSV file with named columns, as the result of a run.

    What the plan's model calls its outputs has to be there; inputs and states are taken where they are. A column is named by its
    whole header text or by what stands there before its unit, by itself or behind "y.", "u." or "x."; values are converted from
    the units in the header, "mm" to "m". What the log does not say is NaN: metrics of it are None, figures leave it out. The input
    of a row holds until the next row, that of the last row is left out. Cells are separated as `load_reference` says.

    Args:
        path: the file.
        plan: what the hardware was driven along; wanted and planned values are its own.
        columns: by the name of a channel the column that it is in, where that has another name.
        time: the column of times; None: the one called "time" or "t".
        zero: what the log's clock shows when the plan's shows 0 [s].
        name: of the run; the file's unless given.

    Raises FileError, naming file and line, as `load_reference` does: where outputs are not there, times do not increase, a cell is
    not a finite number; and where the log has no time in common with the plan.
    """
    path = file_path(path)
    require_plan(plan, error=FileError)
    zero = finite_number("zero [s]", zero, error=FileError)
    time = None if time is None else require_text("time", time, error=FileError)
    given = by_name("columns", {} if columns is None else columns, expected="columns by the names of channels", error=FileError)
    model = plan.model
    groups = {"outputs": model.outputs, "inputs": model.inputs, "states": model.states}
    unknown = set(given) - {channel for channels in groups.values() for channel in channels.names}
    if unknown:
        raise FileError(f"columns names {sorted(unknown)}, which are no channels of the plan; there are: {_listed(groups)}")
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
    if len(t) < 2 or t[-1] < plan.start or t[0] > plan.end:
        raise FileError(
            f"{path}: its {len(t)} rows from {t[0]:.6g} to {t[-1]:.6g} s on the plan's clock have nothing in common with the plan, "
            f"which lasts from {plan.start:.6g} to {plan.end:.6g} s; say with zero=... what its clock shows at the plan's 0"
        )
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


def _result(plan: Plan, t: Array, found: Mapping[str, Signal], name: str) -> RunResult:
    planned, model, (T_i, T_f) = plan(t), plan.model, plan.manoeuvre
    u = Signal(found["inputs"].values[:-1], model.inputs)
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
        state_reference=Signal(planned.x, model.states),
        output=found["outputs"],
        reference=Signal(planned.y_d, model.outputs),
        planned_output=Signal(planned.y, model.outputs),
        commanded=u,
        applied=u,
        parameters=Signal(np.zeros((len(t) - 1, 0)), Channels()),
        manoeuvre=(T_i, T_f),
        rest_inputs=plan.rest_inputs,
        timestep=float(np.max(np.diff(t))),
        evaluate="held",
        integrator="log",
        vibration_period=slowest_flexible_period(model.systems[-1]),
        events=tuple(event for event in events if t[0] <= event.time <= t[-1]),
        remarks=(f"a log, which does not hold {', '.join(absent)}",) if absent else (),
        qpos=np.zeros((len(t), 0)),
    )


def _listed(groups: Mapping[str, Channels]) -> str:
    return "; ".join(f"{kind} {', '.join(channels.names)}" for kind, channels in groups.items())
