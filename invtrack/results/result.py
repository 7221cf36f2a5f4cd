"""What one simulated run leaves behind, as plain arrays with names and units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from invtrack.arguments import instance
from invtrack.arrays import Array
from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.frames import data_frame


@dataclass(frozen=True, eq=False)
class Signal:
    """Channels over a run: values (samples, channels), in the units of the channels.

    Raises InvtrackError where the numbers of columns and channels differ.
    """

    values: Array
    channels: Channels

    def __post_init__(self) -> None:
        if self.values.ndim != 2 or self.values.shape[1] != len(self.channels):
            raise InvtrackError(
                f"expected values (samples, {len(self.channels)}) of {self.channels}, got shape {self.values.shape}"
            )

    @classmethod
    def without_channels(cls) -> Signal:
        """The signal of something that a run does not have."""
        return cls(np.zeros((0, 0)), Channels())

    def __getitem__(self, name: str) -> Array:
        """The samples of one channel, by name. Raises ChannelError, with the names there are, where there is none."""
        return self.values[:, self.channels.index(name)]

    def equals(self, other: Signal) -> bool:
        """Bit-for-bit equality of values (NaNs alike), names and units."""
        return self.channels == other.channels and np.array_equal(self.values, other.values, equal_nan=True)


@dataclass(frozen=True)
class Event:
    """Something that happened at a known time [s]: a parameter change, the start or end of the manoeuvre, the end of a run.

    A limit that acts ("limit") or a contact ("contact") is one event for as long as it lasts: from `time` until `until` [s], the
    last time of the run where it lasted to its end. What happens at an instant has no `until`.
    """

    time: float
    kind: Literal["parameter", "manoeuvre", "limit", "contact", "end"]
    text: str
    until: float | None = None


@dataclass(frozen=True, eq=False, repr=False)
class RunResult:
    """One closed-loop run on the grid of N steps between N + 1 times.

    States, outputs and references stand at the N + 1 times; inputs and parameters hold over the N steps that follow them. At a
    breakpoint the sample belongs to both sides: states and outputs are continuous there.

    Args:
        name: of the case.
        model: name of the plant's model.
        time: (N + 1,) [s], on the clock of the reference.
        state: deviations from the operating point.
        state_reference: the state that the controller wants (NaN where it wants none).
        output, reference: actual and wanted output.
        planned_output: what the controller plans to deliver (equal to the reference for exact inversion; not for redesign).
        commanded, applied: the controller's input, and what is left of it after the actuators' limits: the control that would give
            the force that acts, where limits on forces (forcerange, actuatorfrcrange) clamp it; with evaluate="stages" the values
            at mid-step.
        parameters: the named physical parameters in force.
        manoeuvre: (T_i, T_f) [s].
        rest_inputs: inputs (2, p) with which the plan rests before and after the manoeuvre; NaN where it does not.
        timestep: the largest step asked for [s].
        evaluate: "held" or "stages", see `invtrack.simulate`.
        integrator: MuJoCo's name for it, or "exact" for a linear plant.
        vibration_period: of the slowest flexible mode of the plan's model in its last interval [s], NaN where it has none.
        measured, estimate: what the sensors showed at the latest update, and the state estimated from it; without channels for
            controllers that know the state.
        events: what happened, in the order of time.
        remarks: what a user should know about the run (that its plan knows nothing of dry friction; that it ends before the plan).
        parameter_bodies: for parameters that belong to one body, its name.
        qpos: generalized positions (N + 1, nq); empty for plants without geometry.
        status, message: "completed", or "diverged" and the reason.
        mjb: the compiled MuJoCo model (binary), for the 3-D scene.
    """

    name: str
    model: str
    time: Array
    state: Signal
    state_reference: Signal
    output: Signal
    reference: Signal
    planned_output: Signal
    commanded: Signal
    applied: Signal
    parameters: Signal
    manoeuvre: tuple[float, float]
    rest_inputs: Array
    timestep: float
    evaluate: str
    integrator: str
    vibration_period: float
    measured: Signal = field(default_factory=Signal.without_channels)
    estimate: Signal = field(default_factory=Signal.without_channels)
    events: Sequence[Event] = ()
    remarks: Sequence[str] = ()
    parameter_bodies: Mapping[str, str] = field(default_factory=dict)
    qpos: Array = field(default_factory=lambda: np.zeros((0, 0)))
    status: Literal["completed", "diverged"] = "completed"
    message: str = ""
    mjb: bytes = b""

    def __repr__(self) -> str:
        """What it is, without its arrays."""
        span = f"{self.time[0]:.6g} to {self.time[-1]:.6g} s in {len(self.time) - 1} steps" if len(self.time) else "no samples"
        return f"<RunResult {self.name!r} of {self.model!r}: {self.status}, {span}, outputs {list(self.output.channels.names)}>"

    @property
    def error(self) -> Array:
        """Tracking error y - y_d at the N + 1 times, (N + 1, p)."""
        return self.output.values - self.reference.values

    def to_pandas(self) -> Any:
        """A pandas.DataFrame of everything that was recorded, over the N + 1 times: "y.tip [m]", "y_d.tip [m]" and so on.

        y, y_d and y_planned are outputs, u and u_commanded inputs, x and x_ref states, p parameters, measured and x_estimate what
        the sensors showed and the estimate from it. Inputs and parameters of a row hold until the next row; the last row has none.
        Raises InvtrackError where pandas is not installed.
        """
        signals = {
            "y": self.output,
            "y_d": self.reference,
            "y_planned": self.planned_output,
            "u": self.applied,
            "u_commanded": self.commanded,
            "x": self.state,
            "x_ref": self.state_reference,
            "p": self.parameters,
            "measured": self.measured,
            "x_estimate": self.estimate,
        }
        columns: dict[str, Array] = {}
        for kind, signal in signals.items():
            for label, values in zip(signal.channels.labels, signal.values.T, strict=True):
                columns[f"{kind}.{label}"] = np.append(values, np.full(len(self.time) - len(values), np.nan))
        return data_frame(columns, index=self.time, index_name="time [s]")

    def equals(self, other: RunResult) -> bool:
        """Bit-for-bit equality of everything the run holds."""
        for name in self.__dataclass_fields__:
            mine, theirs = getattr(self, name), getattr(other, name)
            if isinstance(mine, Signal):
                same = mine.equals(theirs)
            elif isinstance(mine, np.ndarray):
                same = np.array_equal(mine, theirs, equal_nan=True)
            elif isinstance(mine, float):
                same = mine == theirs or (np.isnan(mine) and np.isnan(theirs))
            elif name in ("events", "remarks"):
                same = tuple(mine) == tuple(theirs)
            else:
                same = mine == theirs
            if not same:
                return False
        return True


def require_run(value: object) -> None:
    """Raises InvtrackError for what is no result of a run."""
    instance("result", value, RunResult, expected="the result of a run, as invtrack.simulate returns it", error=InvtrackError)
