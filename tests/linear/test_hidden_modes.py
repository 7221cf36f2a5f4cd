"""Zeros that are hidden modes told from transmission zeros, and zeros of published plants."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.errors import ModelError, NonHyperbolicError
from invtrack.linear.internal_dynamics import split_dynamics
from invtrack.linear.state_space import StateSpace
from invtrack.linear.zeros import ZeroReport, zero_report, zeros
from tests.cited_plants import cantilever_paper
from tests.linear.random_plants import Array, assert_same_set, block, pencil_zeros, plant_with, rotation

TRANSMISSION, UNCONTROLLABLE, UNOBSERVABLE = "transmission zero", "uncontrollable mode", "unobservable mode"
BOTH = "uncontrollable and unobservable mode"


def with_hidden_modes(
    rng: np.random.Generator, core: StateSpace, unseen: Array, unreached: Array, both: Array, *, mixed: bool = True
) -> StateSpace:
    """`core` with modes that no output shows, modes that no input moves, and modes that are both, behind each other at random."""
    sizes = [core.n_states, len(unseen), len(unreached), len(both)]
    p, n = core.n_outputs, sum(sizes)
    parts = [slice(sum(sizes[:i]), sum(sizes[: i + 1])) for i in range(4)]
    A, B, C = np.zeros((n, n)), np.zeros((n, p)), np.zeros((p, n))
    for part, matrix in zip(parts, (core.A, unseen, unreached, both), strict=True):
        A[part, part] = matrix
    # What no output shows may be driven by all; what no input moves may drive all that is seen; `both` only drives the unseen.
    for row, column in ((1, 0), (1, 2), (1, 3), (0, 2), (3, 2)):
        A[parts[row], parts[column]] = rng.normal(size=(sizes[row], sizes[column]))
    B[parts[0]], B[parts[1]] = core.B, rng.normal(size=(sizes[1], p))
    C[:, parts[0]], C[:, parts[2]] = core.C, rng.normal(size=(p, sizes[2]))
    system = StateSpace(A, B, C)
    return system.transformed(rotation(rng, n)) if mixed else system


def values(report: ZeroReport, kind: str) -> list[complex]:
    return [zero.value for zero in report.zeros if zero.kind == kind]


def smallest_singular_value(*rows: list[Array]) -> float:
    return float(np.linalg.svd(np.block(list(rows)), compute_uv=False)[-1])


def test_a_diagonal_plant_shows_its_hidden_modes() -> None:
    """A, B and two rows of C of the SLICOT library's example for AB08ND: each mode can be read off its row of B and column of C."""
    A = np.diag([1.0, 1.0, 3.0, -4.0, -1.0, 3.0])
    B = np.array([[0, -1], [-1, 0], [1, -1], [0, 0], [0, 1], [-1, -1]])
    C = np.array([[1, 0, 0, 1, 0, 0], [0, 1, 0, 1, 0, 1]])
    report = zero_report(StateSpace(A, B, C))
    assert_same_set(values(report, UNCONTROLLABLE), [-4.0], 1e-12)  # the fourth row of B is zero
    assert_same_set(values(report, UNOBSERVABLE), [-1.0, 3.0], 1e-12)  # the fifth and the third column of C are zero
    # Of the rest, y1 = -u2/(s - 1) and y2 = -u1/(s - 1) - (u1 + u2)/(s - 3): the determinant's numerator is 2 s - 4.
    assert_same_set(values(report, TRANSMISSION), [2.0], 1e-12)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(
    st.lists(st.integers(1, 3), min_size=1, max_size=2),
    st.tuples(st.integers(0, 3), st.integers(0, 2), st.integers(0, 2), st.integers(0, 2)),
    st.integers(0, 10**6),
)
def test_each_kind_is_found_however_the_states_are_mixed(degrees: list[int], sizes: tuple[int, int, int, int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Eigenvalues well apart, complex pairs among them.
    places = iter(rng.permutation([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0, -2.5 + 2j, 0.5 + 1j, 1.5 + 3j]))
    proper, unseen, unreached, both = ([complex(next(places)) for _ in range(k)] for k in sizes)
    core = plant_with(rng, degrees, block(*proper))
    system = with_hidden_modes(rng, core, block(*unseen), block(*unreached), block(*both))
    report = zero_report(system)
    for kind, expected in ((TRANSMISSION, proper), (UNOBSERVABLE, unseen), (UNCONTROLLABLE, unreached), (BOTH, both)):
        assert_same_set(values(report, kind), np.linalg.eigvals(block(*expected)) if expected else [], 1e-6)
    assert len(report.hidden) == len(report.zeros) - len(values(report, TRANSMISSION))
    n = system.n_states
    for zero in report.zeros:
        shifted = system.A - zero.value * np.eye(n)
        assert (smallest_singular_value([shifted, system.B]) < 1e-7) == (zero.kind in (UNCONTROLLABLE, BOTH))
        assert (smallest_singular_value([shifted], [system.C]) < 1e-7) == (zero.kind in (UNOBSERVABLE, BOTH))


@pytest.mark.parametrize("seed", range(8))
def test_units_do_not_change_the_kinds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    core = plant_with(rng, (2,), block(0.5, -2.0), mixed=False)
    system = with_hidden_modes(rng, core, block(-1.0), block(-3.0), block(2j - 0.1), mixed=False)
    n = system.n_states
    state, time, gain = 10.0 ** rng.integers(-6, 7, size=n), 10.0 ** rng.integers(-6, 7), 10.0 ** rng.integers(-6, 7, size=2)
    A, B = time * state[:, None] * system.A / state, time * state[:, None] * system.B * gain[0]
    report = zero_report(StateSpace(A, B, gain[1] * system.C / state))
    found = {kind: np.array(values(report, kind)) / time for kind in (TRANSMISSION, UNOBSERVABLE, UNCONTROLLABLE, BOTH)}
    assert_same_set(found[TRANSMISSION], [0.5, -2.0], 1e-8)
    assert_same_set(found[UNOBSERVABLE], [-1.0], 1e-8)
    assert_same_set(found[UNCONTROLLABLE], [-3.0], 1e-8)
    assert_same_set(found[BOTH], [2j - 0.1, -2j - 0.1], 1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_equal_zeros_of_different_kinds_are_counted_apart(seed: int) -> None:
    """A transmission zero at 2 that drives an unobservable mode at 2: a Jordan block, split by rounding by about sqrt(eps)."""
    rng = np.random.default_rng(seed)
    core = plant_with(rng, (1,), block(2.0))
    report = zero_report(with_hidden_modes(rng, core, block(2.0), block(), block()))
    assert sorted(zero.kind for zero in report.zeros) == [TRANSMISSION, UNOBSERVABLE]
    assert_same_set([zero.value for zero in report.zeros], [2.0, 2.0], 1e-5)


def test_hidden_jordan_block() -> None:
    """A hidden double integrator stays hidden, and on the axis, as a whole."""
    rng = np.random.default_rng(4)
    core = plant_with(rng, (2,), block(1.0))
    report = zero_report(with_hidden_modes(rng, core, np.array([[0.0, 1.0], [0.0, 0.0]]), block(), block()))
    assert [zero.kind for zero in report.on_axis] == [UNOBSERVABLE, UNOBSERVABLE]
    assert_same_set(values(report, TRANSMISSION), [1.0], 1e-9)


@pytest.mark.parametrize("stiffness", [1.0, 1e8])
@pytest.mark.parametrize(("count", "hidden"), [(5, 4), (9, 8), (8, 0)])
def test_the_middle_of_a_symmetric_structure_does_not_show_its_antisymmetric_modes(
    count: int, hidden: int, stiffness: float
) -> None:
    """A free chain of equal masses, pushed at its end: an odd number has a mass in the middle, a node of every second mode."""
    links = np.diff(np.eye(count), axis=0)
    K, none, one = stiffness * links.T @ links, np.zeros((count, count)), np.eye(count)
    A = np.block([[none, one], [-K, -0.01 / np.sqrt(stiffness) * K]])
    report = zero_report(StateSpace(A, np.eye(2 * count)[:, [count]], np.eye(2 * count)[[count // 2]]))
    assert [zero.kind for zero in report.hidden] == [UNOBSERVABLE] * hidden
    antisymmetric = 2 * np.sqrt(stiffness) * np.sin(np.pi * np.arange(1, count, 2) / (2 * count))
    found = sorted(abs(zero.value) for zero in report.hidden)
    assert found == pytest.approx(np.repeat(antisymmetric, 2) if hidden else [], rel=1e-3)


def test_hidden_modes_are_seen_through_the_noise_of_a_numerical_linearization() -> None:
    rng = np.random.default_rng(3)
    exact = with_hidden_modes(rng, plant_with(rng, (2,), block(1.0), mixed=False), block(-1.0), block(-2.0), block(), mixed=False)
    noisy, error = exact.A + rng.uniform(-1e-8, 1e-8, exact.A.shape), {"A": 1e-8}
    noisy[:1] = exact.A[:1]  # x' = v is exact
    report = zero_report(StateSpace(noisy, exact.B, exact.C, error_estimates=error))
    assert_same_set(values(report, UNOBSERVABLE), [-1.0], 1e-6)
    assert_same_set(values(report, UNCONTROLLABLE), [-2.0], 1e-6)
    assert zero_report(StateSpace(noisy, exact.B, exact.C)).hidden == ()


@pytest.mark.parametrize("error", [0.0, 1e-14, 1e-12])
def test_zeros_of_a_hovering_vehicle_are_transmission_zeros_whatever_the_error_estimate(error: float) -> None:
    """A sensor below the centre of mass; its drag, the only pace of A, is 17 000 times slower than the zeros."""
    gravity, lever, inertia, drag = 9.81, 0.034, 0.02, 1e-3
    A = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [0, gravity, -drag, 0], [0, 0, 0, -drag]])
    B, C = np.array([[0.0], [0.0], [0.0], [1 / inertia]]), np.array([[1.0, -lever, 0.0, 0.0]])
    report = zero_report(StateSpace(A, B, C, error_estimates=dict.fromkeys("ABCD", error)))
    assert [zero.kind for zero in report.zeros] == ["transmission zero"] * 2
    rate = np.sqrt(gravity / lever)
    np.testing.assert_allclose(sorted(zero.value.real for zero in report.zeros), [-rate, rate], rtol=1e-3)
    np.testing.assert_allclose(report.preactuation_time, np.log(100.0) / rate, rtol=1e-3)


def test_a_zero_at_the_origin_does_not_take_the_other_real_zeros_with_it() -> None:
    report = zero_report(plant_with(np.random.default_rng(0), (2,), block(0.0, -4.0, 1.0)))
    assert_same_set([zero.value for zero in report.on_axis], [0.0], 1e-12)
    assert [zero.antistable for zero in report.zeros] == [False, False, True]


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (0, "the zero at 0: an unobservable mode of the plant, no output shows it: choose an output that does"),
        (1, "the zero at 0: an uncontrollable mode of the plant, no input moves it: .* add an actuator"),
        (2, "the zero at 0: an uncontrollable and unobservable mode of the plant, .* leave it out of the model"),
    ],
)
def test_the_refusal_names_hidden_modes(place: int, words: str) -> None:
    hidden = [block(), block(), block()]
    hidden[place] = block(0.0)
    rng = np.random.default_rng(place)
    plant = with_hidden_modes(rng, plant_with(rng, (2,), block(1.0, -1.0)), *hidden)
    with pytest.raises(NonHyperbolicError, match=words):
        split_dynamics(plant)


def test_the_refusal_does_not_call_a_transmission_zero_a_mode() -> None:
    with pytest.raises(NonHyperbolicError, match=r"zeros at 0\+-2j lie on .* track another output$"):
        split_dynamics(plant_with(np.random.default_rng(0), (2,), block(2j, -1.0)))


def test_report_of_the_cantilever() -> None:
    report = zero_report(StateSpace(*cantilever_paper(10.0)))
    assert report.hidden == report.on_axis == report.near_axis == ()
    assert report.slowest is not None
    assert report.slowest.value == pytest.approx(0.234538, abs=5e-6)
    assert np.exp(-report.slowest.value.real * report.preactuation_time) == pytest.approx(0.01)
    assert [zero.frequency for zero in report.zeros] == [0.0] * 4
    assert report.zeros[0].time_constant * 1.76534 == pytest.approx(1.0, abs=1e-5)
    assert "preactuation: the antistable zero nearest the axis, 0.2345, takes 19.6" in str(report)


def test_zeros_near_the_axis_are_reported_not_refused() -> None:
    report = zero_report(plant_with(np.random.default_rng(0), (1,), block(0.05 + 4j, -0.3, 1e-6 + 1j)))
    assert_same_set([zero.value for zero in report.near_axis], [0.05 + 4j, 0.05 - 4j, 1e-6 + 1j, 1e-6 - 1j], 1e-9)
    assert report.preactuation_time == pytest.approx(np.log(100) / 1e-6, rel=1e-3)
    assert "near the imaginary axis (damping ratio below 0.1): 1e-06+-1j, 0.05+-4j" in str(report)


def test_a_mode_that_no_input_moves_costs_no_preactuation() -> None:
    rng = np.random.default_rng(5)
    report = zero_report(with_hidden_modes(rng, plant_with(rng, (1,), block(-2.0)), block(), block(0.1), block()))
    assert report.slowest is None
    assert report.preactuation_time == 0.0
    assert "uncontrollable mode" in str(report)


def test_a_plant_without_zeros() -> None:
    report = zero_report(control.ss([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]]))
    assert (report.zeros, report.relative_degree, report.slowest) == ((), (2,), None)
    assert str(report) == "0 zero(s); relative degree (2), condition number of B_y 1"


def test_a_discrete_time_system_is_refused() -> None:
    with pytest.raises(ModelError, match="sampling time"):
        zero_report(control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1))


@pytest.mark.parametrize("count", [3, 10, 25])
def test_collocated_zeros_of_a_structure_are_its_poles_with_that_point_held(count: int) -> None:
    """A damped chain of masses, free at both ends, pushed and seen at one of them."""
    rng = np.random.default_rng(count)
    links = np.diff(np.eye(count), axis=0)
    stiffness = links.T @ np.diag(rng.uniform(1.0, 3.0, count - 1)) @ links
    mass = rng.uniform(1.0, 2.0, count)
    damping = 0.1 * stiffness + 0.05 * np.diag(mass)

    def first_order(kept: Array) -> Array:
        K, D = (M[np.ix_(kept, kept)] / mass[kept, None] for M in (stiffness, damping))
        return np.block([[np.zeros_like(K), np.eye(len(kept))], [-K, -D]])

    at = count // 2
    force = np.eye(count)[:, [at]] / mass[at]
    system = StateSpace(first_order(np.arange(count)), np.vstack([0 * force, force]), np.eye(2 * count)[[at]])
    held = np.linalg.eigvals(first_order(np.delete(np.arange(count), at)))
    assert_same_set(zeros(system), held, 1e-8)
    assert_same_set(zeros(system), pencil_zeros(system.A, system.B, system.C, system.D, largest=100.0), 1e-6)
