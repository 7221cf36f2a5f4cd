"""What stable inversion refuses, and what it says about it."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
import pytest
import scipy.signal

from invtrack.errors import InversionError, NonHyperbolicError, PlanError, RelativeDegreeError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.generator import Generator
from invtrack.references.profiles import autonomous, piecewise_polynomial, raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.cited_plants import cantilever_paper
from tests.linear.random_plants import block, plant_with

CANTILEVER = StateSpace(*cantilever_paper(0.0), outputs=["tip"])
ALL_PASS = StateSpace([[-2.0]], [[1.0]], [[-3.0]], [[1.0]])  # (s - 1)/(s + 2)


def test_wrong_number_of_channels() -> None:
    with pytest.raises(TrajectoryError, match=r"the reference has 2 channels, the plant 1 outputs \['tip'\]"):
        invert(CANTILEVER, rest_to_rest([0, 0], [1, 1], 1.0))


@pytest.mark.parametrize(
    ("degree", "smoothness", "accepted"), [(1, 0, True), (2, 0, False), (2, 1, True), (4, 2, False), (4, 3, True), (7, 6, True)]
)
def test_a_reference_must_be_as_smooth_as_the_relative_degree(degree: int, smoothness: int, accepted: bool) -> None:
    plant = plant_with(np.random.default_rng(1), (degree,), block(0.5), mixed=False)
    reference = rest_to_rest(0.0, 1.0, 1.0, smoothness=smoothness)
    if accepted:
        assert invert(plant, reference).certificate.dynamics_residual < 1e-9
        return
    message = (
        rf"'y1' is not smooth enough.* t = 0 s, so it has {smoothness + 1} continuous .* relative degree {degree} needs {degree};"
    )
    with pytest.raises(TrajectoryError, match=message):
        invert(plant, reference)


def test_a_kink_inside_the_motion_is_named_by_its_time() -> None:
    kink = piecewise_polynomial([0.0, 1.0, 2.0], [[0.0, 0.0, 3.0, -2.0], [1.0, 0.5, -0.5]])
    with pytest.raises(TrajectoryError, match="derivative of order 1 jumps at t = 1 s"):
        invert(CANTILEVER, kink)


@pytest.mark.parametrize("options", [{"tolerance": 0.0}, {"tolerance": -1e-3}, {"tolerance": 1.0}, {"tolerance": np.nan}])
def test_a_tolerance_must_be_a_share(options: dict[str, float]) -> None:
    with pytest.raises(PlanError, match="tolerance must lie between 0 and 1"):
        invert(CANTILEVER, raised_cosine(2.0), **options)


@pytest.mark.parametrize("limit", [-1.0, np.nan])
def test_preactuation_cannot_be_limited_to_less_than_nothing(limit: float) -> None:
    with pytest.raises(PlanError, match="max_preactuation must not be negative"):
        invert(CANTILEVER, raised_cosine(2.0), max_preactuation=limit)


@pytest.mark.parametrize("internal", [block(4.4j), block(0.0), block(1.0, -1.0, 2j)])
def test_zeros_on_the_axis(internal: np.ndarray) -> None:
    plant = plant_with(np.random.default_rng(0), (2,), internal)
    with pytest.raises(NonHyperbolicError, match="not hyperbolic: zeros at"):
        invert(plant, rest_to_rest(0.0, 1.0, 3.0, smoothness=3))


def test_no_relative_degree() -> None:
    plant = StateSpace(np.zeros((2, 2)), np.ones((2, 2)), np.eye(2))
    with pytest.raises(RelativeDegreeError, match="the inputs are not independent: u1 - u2 acts on nothing, rank"):
        invert(plant, rest_to_rest([0, 0], [1, 1], 1.0))


def test_a_mode_of_the_reference_may_be_a_zero_of_the_plant_where_it_ends() -> None:
    """y_d = e^t on [0, 1] through (s - 1)/(s + 2): u = y_d - 3 e^(t) (1 - t + [what the held value adds])."""
    plan = invert(ALL_PASS, autonomous(1.0, 1.0, 1.0, start=0.0, end=1.0))
    t = np.linspace(0.0, 0.999, 20)
    # u = y_d - 3 int_t^inf e^(t - s) y_d(s) ds with y_d = e^s up to 1, then e.
    assert plan(t).u[:, 0] == pytest.approx(np.exp(t) - 3 * np.exp(t) * (1 - t) - 3 * np.exp(t), abs=1e-12)
    assert plan.certificate.dynamics_residual < 1e-13


def test_but_not_where_it_runs_on_for_ever() -> None:
    decaying = PiecewiseSignal(
        np.zeros(1),
        (Generator(np.array([[1.0]]), np.eye(1)), Generator(np.zeros((1, 1)), np.eye(1))),
        np.array([0, 1]),
        np.ones((2, 1)),
    )
    stable_zero = StateSpace([[-2.0]], [[1.0]], [[3.0]], [[1.0]])  # zero at -5
    assert invert(stable_zero, decaying).certificate.dynamics_residual < 1e-12  # e^t before 0, 1 afterwards
    with pytest.raises(InversionError, match="a mode of the reference coincides with a zero of the plant"):
        invert(ALL_PASS, decaying)


@pytest.mark.parametrize("convert", [control.ss, scipy.signal.StateSpace])
def test_other_libraries_systems_are_taken(convert: Any) -> None:
    A, B, C = cantilever_paper(0.0)
    theirs, ours = invert(convert(A, B, C, [[0.0]]), raised_cosine(2.0)), invert(CANTILEVER, raised_cosine(2.0))
    t = np.linspace(-10.0, 10.0, 30)
    assert theirs(t).u == pytest.approx(ours(t).u)
    assert invert(SwitchedSystem([convert(A, B, C, [[0.0]])]), raised_cosine(2.0))(t).u == pytest.approx(ours(t).u)
