"""All that one compiled run works on, as one record of numbers and addresses, and the memory behind them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

AFFINE, ESTIMATING, ASKED = 0, 1, 2
"""Kinds of laws."""

STAGES = 4
"""Stages of a step of RK4."""

_PLANT = """linear model data step forward kinematics tendon differentiate integrate nq nv na n p width
qpos qvel act ctrl inputs x0 kept coordinates placed timestep time"""
_LINEAR = "case transitions sensor_rows rests u0 y0 A B low high together rates"
_SENSING = "n_values values n_early early n_late late note contacts limits watching"
_LAW = """law ask feedforward gains which x u
origins x_ref expected seen_hold none_seen drift corrections prior estimate deviation innovation K M C_m D_m u_low u_high A_d B_d"""
_SENSORS = "from_sensors n_measured columns noise digit delay late_from random y times"
_GRID = "update latest first_step lengths edges interval at_stages index stage"
_RECORDS = "raw seen commanded measured estimates middle stopped"

RUN = np.dtype([(name, np.int64) for part in (_PLANT, _LINEAR, _SENSING, _LAW, _SENSORS, _GRID, _RECORDS) for name in part.split()])
"""The record of a run. A field is a number, a flag, or the address of an array or of a function; 0 where there is none.

Plant (MuJoCo):
    model, data: of this run alone. step, forward, kinematics, tendon, differentiate, integrate: MuJoCo's functions; the latter four
    only where they are needed. nq, nv, na, n, p, width: sizes of MuJoCo's coordinates, of state, input and raw state. qpos, qvel,
    act, ctrl: live. inputs (p,): addresses in ctrl. x0 (width,): operating point. kept (n,): where the states stand among the
    coordinates (2 nv + na,). placed (nq,): room to work. timestep, time: of model and data, live.
Plant (linear, where `linear` is set), one row per distinct case:
    case (intervals,). transitions (., n, n + p), sensor_rows (., k, n + p), rests (., n), u0 (., p), y0 (., k), A, B. low, high
    (p,). together (n + p,), rates (4, n): room to work.
Sensing:
    values (k,): outputs and measurements now. early, late: readings before and after a step. note: called after a step with
    contacts or limits, which counts in mjData tell, or while `watching`.
Law:
    law: 0 affine, 1 with an estimator, 2 a call of `ask`. feedforward (m, p), gains (., p, n), which (m,). x (n,): what it is
    given; u (p,): what it gives. origins (m, width): raw states from which x is measured, in their tangent spaces; 0 where it is
    measured from x0. The others: see `invtrack.control.output_feedback`.
Sensors:
    columns (q,) among the values; noise, digit, delay (q,). late_from (q,): where the search for a late value goes on. random: the
    next normal numbers. y (q,): what the controller sees. times (N + 1,).
Grid:
    update (N,): number of the update in force in each step; `latest` the one that was made last. first_step, lengths, edges: of the
    intervals; `interval` the present one. index, stage: of the step under way, where the law is evaluated at stages.
Records:
    raw (N + 1, width), seen (N + 1, k), commanded (N, p), measured (N, q), estimates (N, n). middle (p,): input in mid-step.
    stopped: set by a call that failed.
"""


class RunMemory:
    """The record of a run, and the arrays that it knows by address."""

    def __init__(self) -> None:
        self.record = np.zeros(1, dtype=RUN)
        self._kept: dict[str, object] = {}

    def put(self, **values: int | NDArray[Any]) -> None:
        """Set fields, to a number or to the address of an array, which is kept alive: int64, float64 or records, contiguous."""
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                known = value.dtype.kind == "V" or value.dtype in (np.float64, np.int64)
                if not (known and value.flags.c_contiguous):  # read as what it is not, memory would be anything
                    raise TypeError(f"{name} must be contiguous, of int64, float64 or records; got {value.dtype}, {value.flags}")
                self._kept[name] = value
                self.record[name] = value.ctypes.data
            else:
                self.record[name] = value

    def copy(self, **values: Any) -> None:
        """Set fields to contiguous copies of arrays of numbers."""
        for name, value in values.items():
            array = np.asarray(value)
            self.put(**{name: np.array(array, dtype=float if array.dtype.kind == "f" else np.int64, order="C")})

    def keep(self, **values: object) -> None:
        """Keep objects alive that something in the record refers to."""
        self._kept.update(values)

    def array(self, name: str) -> NDArray[Any]:
        """The array whose address a field holds."""
        array = self._kept[name]
        assert isinstance(array, np.ndarray)
        return array
