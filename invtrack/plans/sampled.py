"""Plans as rows of samples in a CSV file, with their origin, and back: polynomials from row to row."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array
from invtrack.channels import Channels
from invtrack.errors import FileError, PlanError, TrajectoryError
from invtrack.files import read_table, write_table
from invtrack.frames import data_frame
from invtrack.linear.state_space import Measurement, OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.certificate import Certificate
from invtrack.plans.dynamics import Mechanism
from invtrack.plans.plan import Plan, intervals_of_pieces
from invtrack.plans.rates import LinearRates, MotionRates, Rates
from invtrack.plans.ringing import Ringing
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import PolynomialSegments, Trajectory
from invtrack.references.profiles import piecewise_polynomial
from invtrack.references.samples import sampled_reference
from invtrack.references.signal import PiecewiseSignal

TIME = "time [s]"

ORIGIN = "origin: "
"""Begins the comment in a CSV file that holds the origin."""

ARRAYS = ("u_ff", "x_ref", "y_d", "y")

FEWEST_SAMPLES = 4
"""Of fewer rows the wanted output is taken as linear between them."""


@dataclass(frozen=True, eq=False)
class SampledPlan:
    """A planned trajectory at m instants.

    Args:
        time: the instants (m,) [s].
        u_ff: feedforward (m, p) for the time after each instant, absolute; `notes` says which value of that time it is.
        x_ref: states (m, n), as deviations from the operating point before all jumps.
        y_d, y: wanted and planned outputs (m, p), absolute.
        names: per array its channels, with [unit] where known.
        notes: comments for people who read the file.
        origin: what the rows do not say of the plan that they come from, its linear model included, as JSON.

    Raises TrajectoryError where shapes do not fit.
    """

    time: Array
    u_ff: Array
    x_ref: Array
    y_d: Array
    y: Array
    names: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...] = field(default=())
    origin: str = ""

    def __post_init__(self) -> None:
        if self.time.ndim != 1 or set(self.names) != set(ARRAYS):
            raise TrajectoryError(
                f"expected times (m,) and names for {', '.join(ARRAYS)}, got {self.time.shape} and {list(self.names)}"
            )
        for array in ARRAYS:
            expected, shape = (len(self.time), len(self.names[array])), getattr(self, array).shape
            if shape != expected:
                raise TrajectoryError(f"{array} has shape {shape}, expected {expected} for its times and names")

    def to_pandas(self) -> Any:
        """A pandas.DataFrame of the columns that `export_plan` writes, over the instants. Raises InvtrackError without pandas."""
        columns = {
            f"{array}.{name}": values
            for array in ARRAYS
            for name, values in zip(self.names[array], getattr(self, array).T, strict=True)
        }
        return data_frame(columns, index=self.time, index_name=TIME)


def write_samples(samples: SampledPlan, path: str | Path) -> Path:
    """Write the rows in one piece: the path shows the old file or all of the new one.

    A header row ("time [s]", "u_ff.<name>", "x_ref.<name>", "y_d.<name>", "y.<name>"), the notes and the origin as comments behind
    #, rows with 17 significant digits, from which the same bits are read back.

    Raises FileError for a suffix other than .csv, or where the file cannot be written.
    """
    path = _csv(path)
    columns = [TIME, *(f"{array}.{name}" for array in ARRAYS for name in samples.names[array])]
    values = np.column_stack([samples.time, *(getattr(samples, array) for array in ARRAYS)])
    write_table(path, columns, values, (*samples.notes, *([ORIGIN + samples.origin] if samples.origin else [])))
    return path


def read_samples(path: str | Path) -> SampledPlan:
    """The rows that `export_plan` wrote, bit for bit. Raises FileError where the file cannot be read or holds no plan."""
    table = read_table(_csv(path), lambda header: range(len(header.texts)))
    owners = [column.partition(".")[0] for column in table.columns]
    expected = [TIME, *sorted(owners[1:], key=lambda owner: (*ARRAYS, owner).index(owner))]
    if owners != expected or set(owners[1:]) != set(ARRAYS):
        raise FileError(
            f"{path} is not a plan file: expected columns time, {', '.join(ARRAYS)} as export_plan writes them, got: "
            f"{', '.join(table.columns)}"
        )
    groups = {array: [i for i, owner in enumerate(owners) if owner == array] for array in ARRAYS}
    return SampledPlan(
        time=table.values[:, 0],
        **{array: table.values[:, columns] for array, columns in groups.items()},
        names={array: tuple(table.columns[i].partition(".")[2] for i in columns) for array, columns in groups.items()},
        notes=tuple(text for text in table.comments if not text.startswith(ORIGIN)),
        origin=next((text.removeprefix(ORIGIN) for text in table.comments if text.startswith(ORIGIN)), ""),
    )


def _csv(path: str | Path) -> Path:
    path = Path(path)
    if path.suffix.lower() != ".csv":
        raise FileError(f"expected a plan file that ends in .csv, got {path.name!r}")
    return path


def origin_of(plan: Plan, *, inputs: str, end: float) -> str:
    """What rows of samples do not say of their plan, as JSON; inputs: the kind of u_ff, end [s]: where the last row's hold ends."""
    return json.dumps(
        {
            "method": plan.method,
            "manoeuvre": plan.manoeuvre,
            "preactuation": plan.preactuation,
            "postactuation": plan.postactuation,
            "tolerance": plan.tolerance,
            "certificate": asdict(plan.certificate),
            "remarks": plan.remarks,
            "ringing": None if plan.ringing is None else asdict(plan.ringing),
            "inputs": inputs,
            "end": end,
            "nonlinear": plan.linearizations is not None or plan.difference is not None,
            "model": _model_as_json(plan.model),
        }
    )


def plan_from(samples: SampledPlan, moving: Mechanism | None = None) -> Plan:
    """The plan that goes through the rows; moving: the mechanism whose motion it was planned on, if it was planned on one.

    Raises KeyError, TypeError or ValueError where the origin does not fit the rows, PlanError for a mechanism that does not fit
    them, or where they need one and there is none.
    """
    origin = json.loads(samples.origin)
    model = _model_from(origin["model"])
    edges, held = np.append(samples.time, origin["end"]), origin["inputs"] != "sample"
    motion = None if moving is None else MotionRates(moving, model)
    if not origin["nonlinear"]:
        motion = None
    elif motion is None:
        raise PlanError(
            f"the plan is for the motion of a mechanism with the states {list(model.states.names)}, which says how they go on from "
            "row to row and how they differ; read it with the plant that it was made for, invtrack.read_plan(path, plant=plant)"
        )
    trajectory = _trajectory(model, edges, samples, motion or LinearRates(model), held=held)
    plan = Plan(
        method=str(origin["method"]),
        model=model,
        reference=_wanted(samples.time, samples.y_d),
        trajectory=trajectory,
        manoeuvre=(float(origin["manoeuvre"][0]), float(origin["manoeuvre"][1])),
        preactuation=float(origin["preactuation"]),
        postactuation=float(origin["postactuation"]),
        tolerance=float(origin["tolerance"]),
        certificate=Certificate(**origin["certificate"]),
        ringing=None if origin["ringing"] is None else Ringing(**origin["ringing"]),
        remarks=(*origin["remarks"], f"read from {len(samples.time)} samples; the certificate is that of the plan they come from"),
    )
    if moving is None or motion is None:
        return plan
    middles = (edges[:-1] + edges[1:]) / 2
    along = motion.along(edges, model.interval(middles), plan.states(middles), plan.inputs(middles))
    return replace(plan, difference=moving.state_difference if moving.turns else None, linearizations=along)


def _wanted(time: Array, y_d: Array) -> PiecewiseSignal:
    if len(time) >= FEWEST_SAMPLES:
        return sampled_reference(time, y_d, degree=3, smoothness=0)
    if len(time) == 1:
        time, y_d = np.array([time[0], time[0] + 1.0]), np.repeat(y_d, 2, axis=0)
    pieces = [np.column_stack([a, (b - a) / h]) for a, b, h in zip(y_d[:-1], y_d[1:], np.diff(time), strict=True)]
    return piecewise_polynomial(time, pieces)


def _trajectory(model: SwitchedSystem, edges: Array, samples: SampledPlan, rates: Rates, *, held: bool) -> Trajectory:
    """Segments between the edges (m + 1,), m rows: Hermite cubics in x and y, constants or lines in u.

    Args:
        model: from the rest of whose intervals values are measured.
        edges, samples: times [s], and what is known at all but the last.
        rates: of states and outputs there.
        held: whether inputs are constant in between.
    """
    h, n, m = np.diff(edges)[:, None], model.n_states, model.n_inputs
    pieces = intervals_of_pieces(model, edges)
    rest = np.hstack([model.rest_states, model.rest_inputs, model.rest_outputs])[pieces]
    interval = pieces[1:-1]
    # A row goes on as the interval says in which its middle lies, also where it ends.
    x, u, y = samples.x_ref, samples.u_ff, samples.y
    u_end = u if held else np.vstack([u[1:], u[-1:]])
    u_rate = (u_end - u) / h
    x_rate, _, y_rate = rates(interval, x, u, u_rate)
    # The last row has no next one: there the state goes on as it moves.
    x_end = np.vstack([x[1:], x[-1:] + h[-1:] * x_rate[-1:]])
    x_rate_end, y_there, y_rate_end = rates(interval, x_end, u_end, u_rate)
    y_end = np.vstack([y[1:], y_there[-1:]])
    x_0, u_0, y_0 = np.split(rest[1:-1], [n, n + m], axis=1)
    coefficients = np.zeros((len(x), 4, n + m + model.n_outputs))
    coefficients[:, :, :n] = _hermite(x - x_0, x_end - x_0, h * x_rate, h * x_rate_end)
    coefficients[:, 0, n : n + m], coefficients[:, 1, n : n + m] = u - u_0, u_end - u
    coefficients[:, :, n + m :] = _hermite(y - y_0, y_end - y_0, h * y_rate, h * y_rate_end)
    first = np.concatenate([x[0], u[0], y[0]]) - rest[0]
    last = np.concatenate([x_end[-1], u_end[-1], y_end[-1]]) - rest[-1]
    return Trajectory(
        breakpoints=edges,
        groups=(PolynomialSegments(coefficients, h[:, 0]),),
        group=np.zeros(len(x), dtype=np.intp),
        number=np.arange(len(x)),
        before=Tail.holding(-1, first),
        after=Tail.holding(1, last),
    )


def _hermite(start: Array, end: Array, slope_start: Array, slope_end: Array) -> Array:
    """Coefficients (k, 4, c) of the cubics on [0, 1] with these values and slopes (k, c) at its ends."""
    rise = end - start
    return np.stack([start, slope_start, 3 * rise - 2 * slope_start - slope_end, slope_start + slope_end - 2 * rise], axis=1)


def _model_as_json(model: SwitchedSystem) -> dict[str, Any]:
    return {
        "states": asdict(model.states),
        "inputs": asdict(model.inputs),
        "outputs": asdict(model.outputs),
        "measurements": asdict(model.measurements),
        "systems": [_system_as_json(system) for system in model.distinct],
        "numbers": model.numbers.tolist(),
        "switch_times": model.switch_times.tolist(),
    }


def _system_as_json(system: StateSpace) -> dict[str, Any]:
    matrices = {name: getattr(system, name).tolist() for name in "ABCD"}
    measurement = {name: getattr(system.measurement, name).tolist() for name in ("C", "D", "y0")}
    errors = {name: value.tolist() for name, value in system.error_estimates.items()}
    limits = [[float(limit) if math.isfinite(limit) else None for limit in pair] for pair in system.input_limits]
    return {
        **matrices,
        "operating_point": {name: value.tolist() for name, value in asdict(system.operating_point).items()},
        "rest": system.rest.tolist(),
        "input_limits": limits,
        "measurement": measurement,
        "parameters": dict(system.parameters),
        "error_estimates": errors,
        "left_out": list(system.left_out),
    }


def _model_from(data: dict[str, Any]) -> SwitchedSystem:
    channels = {name: Channels(**data[name]) for name in ("states", "inputs", "outputs")}
    names = Channels(**data["measurements"])

    def system(entry: dict[str, Any]) -> StateSpace:
        C, D, y_0 = (_array(entry["measurement"][name]) for name in ("C", "D", "y0"))
        shape = (len(names), len(channels["states"])), (len(names), len(channels["inputs"]))
        return StateSpace(
            entry["A"],
            entry["B"],
            entry["C"],
            entry["D"],
            states=channels["states"],
            inputs=channels["inputs"],
            outputs=channels["outputs"],
            operating_point=OperatingPoint(**{name: _array(value) for name, value in entry["operating_point"].items()}),
            rest=entry["rest"],
            input_limits=[_range(pair) for pair in entry["input_limits"]],
            measurement=Measurement(C.reshape(shape[0]), D.reshape(shape[1]), names, y_0),
            parameters=entry["parameters"],
            error_estimates=entry["error_estimates"],
            left_out=entry["left_out"],
        )

    distinct = [system(entry) for entry in data["systems"]]
    return SwitchedSystem([distinct[number] for number in data["numbers"]], data["switch_times"])


def _range(pair: list[float | None]) -> list[float]:
    low, high = pair
    return [-math.inf if low is None else low, math.inf if high is None else high]


def _array(value: ArrayLike) -> Array:
    return np.asarray(value, dtype=float)
