"""Bryson's rule: weights from the largest deviations that are acceptable."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from invtrack.arguments import by_name
from invtrack.arrays import Array, finite_number
from invtrack.channels import Channels
from invtrack.errors import ControlError
from invtrack.linear.switched import SwitchedSystem, as_switched

LARGEST = 1e150
"""Deviation whose square, and that of its reciprocal, is still a number."""

SAME = 1e-9
"""Entries of C that differ from interval to interval by less than this share, or by their errors, are the same."""


def bryson(
    model: Any,
    *,
    states: Mapping[str, float] | None = None,
    outputs: Mapping[str, float] | None = None,
    inputs: Mapping[str, float] | None = None,
) -> tuple[Array, Array]:
    """Weights Q (n, n), R (m, m) with which largest acceptable deviations all cost alike: the sum of (deviation / largest)^2.

        Q, R = invtrack.bryson(model, outputs={"tip": 0.01}, inputs={"motor": 2.0})
        gains = invtrack.lqr(model, Q=Q, R=R)

    What is not named among states and outputs is not weighed: Q = sum of e_i e_i' / x_i^2 and c_j' c_j / y_j^2 with the rows c_j of
    C, R = diag(1 / u_k^2). So no unit of a state, metre or radian, counts for more than another.

    Args:
        model: a StateSpace or a SwitchedSystem.
        states: largest acceptable deviations by the names of states, in their units.
        outputs: the same of outputs, where they do not depend on the input at once and C is the same in all intervals.
        inputs: the same of inputs; of those not named half the range of `model.input_limits`.

    Raises ControlError for names that there are not, deviations that are not positive, nothing to weigh, and inputs without a
    range. Source: A. Bryson, Y. Ho, Applied Optimal Control, 1975, section 5.2.
    """
    plant = as_switched(model)
    of_states = _deviations("states", states, plant.states)
    of_outputs = _deviations("outputs", outputs, plant.outputs)
    if not of_states and not of_outputs:
        raise ControlError(
            "expected the largest acceptable deviation of at least one state or output, such as outputs={"
            f"{plant.outputs.names[0]!r}: 0.01}}; there are the states {plant.states} and the outputs {plant.outputs}"
        )
    rows = [np.eye(plant.n_states)[i] / largest for i, largest in of_states.items()]
    rows += [_output_row(plant, j) / largest for j, largest in of_outputs.items()]
    scaled = np.array(rows)
    return scaled.T @ scaled, np.diag(_input_sizes(plant, inputs) ** -2.0)


def _deviations(kind: str, given: Mapping[str, float] | None, channels: Channels) -> dict[int, float]:
    """Largest deviations by the numbers of channels."""
    expected = f"largest acceptable deviations by the names of {kind}"
    named = {} if given is None else by_name(kind, given, expected=expected, error=ControlError)
    unknown = [name for name in named if name not in channels]
    if unknown:
        raise ControlError(f"{kind} has no {unknown[0]!r}; expected some of the {kind} {', '.join(channels.names)}")
    found = {}
    for name, value in named.items():
        number = channels.index(name)
        largest = finite_number(f"the largest deviation of {channels.labels[number]}", value, error=ControlError)
        if not 1 / LARGEST <= largest <= LARGEST:
            expected = f"must be positive, from {1 / LARGEST:g} to {LARGEST:g}"
            raise ControlError(f"the largest acceptable deviation of {channels.labels[number]} {expected}, got {largest:g}")
        found[number] = largest
    return found


def _output_row(plant: SwitchedSystem, j: int) -> Array:
    """c_j (n,), where all intervals agree on it."""
    name, first = plant.outputs.names[j], plant.systems[0].C[j]
    if any(np.any(system.D[j]) for system in plant.distinct):
        raise ControlError(f"the output {name!r} depends on the input at once, so Q alone cannot weigh it; weigh states instead")
    size = np.max([np.abs(system.C[j]) for system in plant.distinct], axis=0)
    error = np.max([system.errors("C")[j] for system in plant.distinct], axis=0)
    if any(np.any(np.abs(system.C[j] - first) > SAME * size + error) for system in plant.distinct):
        raise ControlError(
            f"the output {name!r} reads the states differently from interval to interval, so no single Q weighs it; weigh states, "
            "or make gains for each interval from bryson of its own model"
        )
    return np.asarray(first)


def _input_sizes(plant: SwitchedSystem, given: Mapping[str, float] | None) -> Array:
    """Largest deviation of each input (m,)."""
    ranges = plant.input_limits
    half = ranges[:, 1] / 2 - ranges[:, 0] / 2
    for number, largest in _deviations("inputs", given, plant.inputs).items():
        half[number] = largest
    unknown = [label for label, size in zip(plant.inputs.labels, half, strict=True) if not 1 / LARGEST <= size <= LARGEST]
    if unknown:
        raise ControlError(
            f"expected the largest acceptable deviation of the inputs {', '.join(unknown)}, for which the model states no range: "
            "give it with inputs={name: largest}"
        )
    return np.asarray(half)
