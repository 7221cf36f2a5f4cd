"""Inverses of plants whose outputs must be combined before the inputs can be found: checked by integrating what they ask for."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.errors import NonHyperbolicError, RelativeDegreeError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility import feasibility
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.linear import normal_form
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.linear.random_plants import block, pencil_zeros, plant_with
from tests.linear.test_structure import plant_without_relative_degree
from tests.linear_motion import states

NODES = np.linspace(-0.5, 3.0, 15)


def mismatch(plant: StateSpace, plan: Plan, reference: PiecewiseSignal, nodes: np.ndarray = NODES) -> float:
    """Largest share of the peaks by which the plan's input, integrated between nodes, misses its states and the wanted outputs."""
    u0 = plant.operating_point.u0
    planned, outputs = plan(nodes).x, []
    worst = 0.0
    for k, (start, end) in enumerate(itertools.pairwise(nodes)):
        middle = (start + end) / 2

        def inputs(t: np.ndarray, middle: float = middle) -> np.ndarray:
            return plan.inputs(t, inside=np.full(len(t), middle)) - u0

        x = states(plant.A, planned[k], lambda t: inputs(t) @ plant.B.T, nodes[k : k + 2], longest=1 / 32)[-1]
        worst = max(worst, float(np.max(np.abs(x - planned[k + 1])) / max(np.max(np.abs(planned)), 1e-3)))
        outputs.append(plant.C @ x + plant.D @ inputs(nodes[k + 1 : k + 2])[0] - reference(end, inside=np.array([middle])))
    return max(worst, float(np.max(np.abs(outputs))))


def test_an_input_that_acts_one_integration_later() -> None:
    """x1' = x3 + u1, x2' = u1, x3' = u2 with y = (x1, x2): u1 = y2', u2 = y1'' - y2''."""
    A = np.zeros((3, 3))
    A[0, 2] = 1.0
    plant = StateSpace(A, [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], np.eye(3)[:2])
    reference = rest_to_rest([0.0, 0.0], [1.0, -2.0], 2.0, smoothness=3)
    plan, t = invert(plant, reference), np.linspace(0.01, 1.99, 50)
    first, second = reference(t, derivative=1), reference(t, derivative=2)
    assert plan.inputs(t) == pytest.approx(np.column_stack([first[:, 1], second[:, 0] - second[:, 1]]), abs=1e-11)


@settings(deadline=None, max_examples=12, derandomize=True)
@given(st.integers(0, 10**6))
def test_any_plant_with_an_inverse(seed: int) -> None:
    plant = plant_without_relative_degree(seed)
    p, rng = plant.n_outputs, np.random.default_rng(seed)
    needed = max(normal_form(plant).derivatives)
    reference = rest_to_rest(np.zeros(p), rng.normal(size=p), 2.5, smoothness=needed)
    try:
        plan = invert(plant, reference)
    except NonHyperbolicError:
        zeros = pencil_zeros(plant.A, plant.B, plant.C, plant.D)
        assert np.min(np.abs(zeros.real) / np.abs(zeros)) < 1e-6
        return
    assert mismatch(plant, plan, reference) < 1e-10
    assert plan.certificate.rest_residual <= 1e-8


def test_a_feedthrough_of_rank_one() -> None:
    """Of two outputs with a feedthrough of their sum the difference has relative degree one."""
    plant = StateSpace([[-1.0, 0.5], [0.2, -2.0]], np.eye(2), [[1.0, 0.0], [0.0, 2.0]], [[1.0, 1.0], [1.0, 1.0]])
    reference = rest_to_rest([0.0, 0.0], [1.0, 0.3], 2.0, smoothness=2)
    assert mismatch(plant, invert(plant, reference), reference) < 1e-12


def test_smoothness_is_asked_of_what_the_inverse_takes() -> None:
    plant = plant_without_relative_degree(3)  # an input behind an integrator
    p = plant.n_outputs
    needed = max(normal_form(plant).derivatives)
    message = rf"derivative of order \d jumps at t = 0 s.*without relative degree, needs \d; .* smoothness={needed}"
    with pytest.raises(TrajectoryError, match=message):
        invert(plant, rest_to_rest(np.zeros(p), np.ones(p), 2.5, smoothness=0))


def jumping_pair(seed: int) -> SwitchedSystem:
    """The same outputs, leading gains of rank one, and dynamics that change behind them."""
    rng = np.random.default_rng(seed)
    B, C = rng.normal(size=(5, 2)), rng.normal(size=(2, 5))
    B -= np.linalg.pinv(C) @ (C @ B - np.outer(rng.normal(size=2), rng.normal(size=2)))
    A = rng.normal(size=(5, 5))
    hidden = np.linalg.svd(np.vstack([C, C @ A]))[2][4:].T  # what acts on this is in no output or first derivative
    return SwitchedSystem([StateSpace(A, B, C), StateSpace(A + hidden @ rng.normal(size=(1, 5)), B, C)], [1.1])


@pytest.mark.parametrize("seed", range(6))
def test_a_jump_behind_the_outputs(seed: int) -> None:
    plant = jumping_pair(seed)
    reference = rest_to_rest([0.0, 0.0], [1.0, -0.5], 2.0, smoothness=2)
    report = feasibility(plant, reference)
    if not report.solvable:
        assert report.failed in ("boundedness before and after the manoeuvre", "compatibility at the jumps")
        return
    plan = invert(plant, reference)
    assert mismatch(plant.systems[0], plan, reference, np.array([-0.5, 0.0, 0.4, 0.8, 1.1])) < 1e-10
    assert mismatch(plant.systems[1], plan, reference, np.array([1.1, 1.4, 1.7, 2.0, 2.5])) < 1e-10


def test_moving_zeros_needs_a_relative_degree() -> None:
    plant = StateSpace([[-1.0, 0.5], [0.2, 2.0]], np.eye(2), [[1.0, 0.0], [0.0, 2.0]], [[1.0, 1.0], [1.0, 1.0]])
    reference = rest_to_rest([0.0, 0.0], [1.0, 0.3], 2.0, smoothness=2)
    with pytest.raises(RelativeDegreeError, match=r"moving zeros needs.*invtrack.quadratic_redesign"):
        modified_inversion(plant, reference, axis_distance=5.0, real_part=6.0, error_poles=[-1.0])


def test_a_plant_with_a_relative_degree_is_inverted_as_ever() -> None:
    plant = plant_with(np.random.default_rng(4), (1, 3), block(0.7, -1.0))
    reference = rest_to_rest([0.0, 0.0], [1.0, 0.3], 2.0, smoothness=3)
    assert mismatch(plant, invert(plant, reference), reference) < 1e-12
