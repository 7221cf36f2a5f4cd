"""The error that no input can beat: what a linear program over all inputs finds, and what plans reach, lies above it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
import scipy.optimize
import scipy.sparse

from invtrack.errors import InversionError, TrajectoryError
from invtrack.inversion.modified.error_bound import error_bound
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.profiles import autonomous, constant, raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal, stack
from tests.inversion.modified_cases import HE3, HE3_POLES, HOVER, PASSIVE_TWO_DISC, TWO_DISC, moved_pair
from tests.inversion.test_repeated_zeros import hovering
from tests.linear.random_plants import block, plant_with, rotation

MOTION = rest_to_rest(0.0, 1.0, 2.0, smoothness=3)
REAL = StateSpace([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], [[1.0, -1.0]])  # (1 - s) / ((s + 1)(s + 2))
PAIR = StateSpace([[0.0, 1, 0], [0, 0, 1], [-6, -11, -6]], [[0.0], [0], [1]], [[5.0, -2, 1]])  # zeros 1 +- 2j, poles -1, -2, -3


def least_by_linear_program(plant: StateSpace, reference: PiecewiseSignal, start: float, end: float, steps: int) -> float:
    """Least largest error at the grid's points over all held inputs that begin at rest and end at some equilibrium."""
    n, p, h = plant.n_states, plant.n_outputs, (end - start) / steps
    held = scipy.linalg.expm(np.block([[plant.A, plant.B], [np.zeros((p, n + p))]]) * h)
    eye = scipy.sparse.identity(steps, format="csr")
    here = scipy.sparse.hstack([eye, scipy.sparse.csr_matrix((steps, 1))])
    there = scipy.sparse.hstack([scipy.sparse.csr_matrix((steps, 1)), eye])
    step = scipy.sparse.kron(there, np.eye(n)) - scipy.sparse.kron(here, held[:n, :n])
    dynamics = scipy.sparse.hstack([step, -scipy.sparse.kron(eye, held[:n, n:]), scipy.sparse.csr_matrix((steps * n, 1))])
    ends = np.zeros((2 * n, (steps + 1) * n + steps * p + 1))
    ends[:n, :n] = np.eye(n)
    ends[n:, steps * n : (steps + 1) * n], ends[n:, -1 - p : -1] = plant.A, plant.B
    output = scipy.sparse.hstack(
        [scipy.sparse.kron(scipy.sparse.identity(steps + 1), plant.C), np.zeros(((steps + 1) * p, steps * p))]
    )
    one, wanted = -np.ones(((steps + 1) * p, 1)), reference(start + h * np.arange(steps + 1)).ravel()
    cost = np.zeros(ends.shape[1])
    cost[-1] = 1.0
    found = scipy.optimize.linprog(
        cost,
        A_ub=scipy.sparse.vstack([scipy.sparse.hstack([output, one]), scipy.sparse.hstack([-output, one])]).tocsr(),
        b_ub=np.concatenate([wanted, -wanted]),
        A_eq=scipy.sparse.vstack([dynamics, ends]).tocsr(),
        b_eq=np.zeros(steps * n + 2 * n),
        bounds=[(None, None)] * (len(cost) - 1) + [(0, None)],
        method="highs",
    )
    assert found.status == 0
    return float(found.fun)


@pytest.mark.parametrize("plant", [REAL, PAIR])
@pytest.mark.parametrize("start", [0.0, -1.0])
def test_the_best_of_all_inputs_comes_as_near_as_its_steps_allow(plant: StateSpace, start: float) -> None:
    bound = error_bound(plant, MOTION, start=start)
    assert bound is not None
    excess = [least_by_linear_program(plant, MOTION, start, 12.0, steps) - bound for steps in (100, 200, 400)]
    assert np.all(np.array(excess) > 0)
    ratios = np.array(excess[1:]) / excess[:-1]
    assert np.all((ratios > 0.3) & (ratios < 0.7))  # of first order in the step
    assert excess[-1] < 0.03 * bound


def test_a_real_zero_by_quadrature() -> None:
    t = np.linspace(-0.5, 40.0, 200_001)
    transform = scipy.integrate.simpson(MOTION(t)[:, 0] * np.exp(-(t + 0.5)), x=t)
    assert error_bound(REAL, MOTION, start=-0.5) == pytest.approx(transform, rel=1e-8)


def test_a_pair_by_quadrature_over_all_phases() -> None:
    t = np.linspace(0.0, 25.0, 40_001)
    weight = np.exp(-(1 + 2j) * t)
    values = [
        abs(scipy.integrate.simpson(MOTION(t)[:, 0] * (turn * weight).real, x=t))
        / scipy.integrate.simpson(np.abs((turn * weight).real), x=t)
        for turn in np.exp(1j * np.linspace(0.0, np.pi, 400))
    ]
    assert error_bound(PAIR, MOTION, start=0.0) == pytest.approx(max(values), rel=1e-4)


@pytest.mark.parametrize("seed", range(12))
def test_no_plan_lies_below_it(seed: int) -> None:
    """Zeros moved to the left: plans that do not act ahead, so that the bound bites; and to the right, with their own window."""
    rng = np.random.default_rng(seed)
    degrees = [(1,), (2,), (1, 2), (2, 1, 1)][seed % 4]
    zero = [0.8, 0.5 + 2j, 1.5 + 0.5j][seed % 3]
    plant = plant_with(rng, degrees, block(zero, -0.7))
    p = len(degrees)
    reference = rest_to_rest(np.zeros(p), rng.normal(size=p), 2.0, smoothness=3)
    for real_part in (-1.5, 3.0):
        target = complex(real_part, np.imag(zero))
        plan = modified_inversion(plant, reference, move={zero: target}, error_poles=-1.0 - np.arange(sum(degrees)) / 2)
        bound = plan.error_bound
        assert bound is not None
        assert plan.relative_error >= bound > (1e-4 if real_part < 0 else 0.0)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_repeated_zeros_of_a_vehicle(turn: float) -> None:
    """Two zeros at 14 rad/s: each axis of the ground has one of its own, whatever the axes of the outputs."""
    c, s = np.cos(turn), np.sin(turn)
    reference = rest_to_rest([0.0, 0.0], [1.0, 0.0], 0.5, smoothness=3).scaled([[c, s], [-s, c]])
    found = error_bound(hovering(turn), reference, start=0.0)
    assert found is not None
    t = np.linspace(0.0, 4.0, 100_001)
    z = np.sqrt(9.81 / 0.05)
    along = z * scipy.integrate.simpson(rest_to_rest(0.0, 1.0, 0.5, smoothness=3)(t)[:, 0] * np.exp(-z * t), x=t)
    assert found >= along * max(c, s) * (1 - 1e-6)  # output 1 alone has to carry this much of it
    assert found <= along * (1 + 1e-6)


def test_published_plants() -> None:
    _, move = moved_pair(2.0)
    plan = modified_inversion(HE3, HOVER, move=move, error_poles=HE3_POLES)
    assert plan.error_bound is not None
    assert 0 < plan.error_bound < plan.relative_error
    for start in (0.0, -1.0, -5.0):
        bounds = [error_bound(TWO_DISC, MOTION, start=t) for t in (start, start - 1.0)]
        assert bounds[0] is not None
        assert bounds[1] is not None
        assert bounds[1] / bounds[0] == pytest.approx(np.exp(-0.21998), rel=0.2)  # a second more, at the rate of the zero


def test_units_shifts_and_sums() -> None:
    rng = np.random.default_rng(3)
    plant = plant_with(rng, (1, 2), block(0.6 + 1j, 0.9, -1.0))
    reference = stack([MOTION, 0.5 * MOTION.shifted(0.3)])
    plain = error_bound(plant, reference, start=-0.4, output_scale=[1.0, 0.5])
    outputs, inputs, d = np.array([1e3, 1e-4]), np.array([1e-5, 1e2]), 10 ** rng.uniform(-4, 4, plant.n_states)
    turned = plant.transformed(rotation(rng, plant.n_states))
    scaled = StateSpace(turned.A * d / d[:, None], turned.B / inputs / d[:, None], outputs[:, None] * turned.C * d)
    moved = error_bound(scaled, reference.scaled(outputs).shifted(7.0), start=6.6, output_scale=[1e3, 0.5e-4])
    assert moved == pytest.approx(plain, rel=1e-6)
    held = error_bound(plant, reference + constant([3.0, -1.0]), start=-0.4, output_scale=[1.0, 0.5])
    assert held == pytest.approx(plain, rel=1e-9)  # what counts is the departure from where the plant rests
    double = error_bound(plant, 2 * reference, start=-0.4, output_scale=[1.0, 0.5])
    assert plain is not None
    assert double == pytest.approx(2 * plain, rel=1e-12)


def test_without_zeros_to_the_right_there_is_nothing_to_pay() -> None:
    for plant in (PASSIVE_TWO_DISC, plant_with(np.random.default_rng(0), (2,), block(-1.0))):
        assert error_bound(plant, MOTION, start=0.0) == 0.0


def test_a_mode_that_no_input_moves_asks_for_nothing() -> None:
    A = np.block([[REAL.A, np.ones((2, 1))], [np.zeros((1, 2)), np.array([[5.0]])]])
    plant = StateSpace(A, np.vstack([REAL.B, [[0.0]]]), np.hstack([REAL.C, [[0.3]]]))
    assert error_bound(plant, MOTION, start=0.0) == pytest.approx(error_bound(REAL, MOTION, start=0.0), rel=1e-9)


def test_what_has_no_bound() -> None:
    assert error_bound(SwitchedSystem([REAL, REAL], [1.0]), MOTION, start=0.0) is None
    growing = autonomous([[2.0]], [[1.0]], [1.0], start=0.0, end=1.0)
    endless = PiecewiseSignal(np.zeros(1), growing.generators, np.array([0, 1]), np.ones((2, 1)))
    assert error_bound(REAL, endless, start=0.0) is None
    moving = PiecewiseSignal(np.zeros(1), growing.generators, np.array([1, 0]), np.ones((2, 1)))
    assert error_bound(REAL, moving, start=0.0) is None
    with pytest.raises(InversionError, match=r"no later than the manoeuvre's, 0 s, got 0.5"):
        error_bound(REAL, MOTION, start=0.5)
    with pytest.raises(TrajectoryError, match="the reference has 2 channels"):
        error_bound(REAL, stack([MOTION, MOTION]), start=0.0)


def test_whole_cosines() -> None:
    """(1 - cos w t) / 2 over a period, by the transform that stands in every table."""
    w, z = 2 * np.pi / 3.0, 1.0
    transform = (w**2 / (2 * z * (z**2 + w**2))) * (1 - np.exp(-3.0 * z))
    assert error_bound(REAL, raised_cosine(1.0, period=3.0), start=0.0) == pytest.approx(z * transform, rel=1e-12)
