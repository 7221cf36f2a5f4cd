"""What the feasibility report says, against `invert` and against the lemmas worked out in another way.

The two-state plants are those of test_jumps: with the output at y, eta' = (a - c) eta + y, and zeta = y - c eta is continuous.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from invtrack.errors import InvtrackError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility import feasibility
from invtrack.inversion.feasibility_report import FeasibilityReport
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.generator import Generator
from invtrack.references.profiles import constant, piecewise_polynomial, raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.cited_plants import CANTILEVER_TIP_MASSES, cantilever_paper
from tests.linear.random_plants import Array, block, plant_with, rotation

MOTION = rest_to_rest(0.0, 1.0, 2.0)
RAMP = piecewise_polynomial([0.0, 1.0], [[0.0, 0.0, 3.0, -2.0]])
DOUBLING = piecewise_polynomial([0.0, 1.0, 1.5, 2.5], [[0.0, 0.0, 3.0, -2.0], [1.0], [2.0, 0.0, -6.0, 4.0]])
BUMP = Polynomial([0.0, 1.0]) ** 3 * Polynomial([1.0, -1.0]) ** 3
FITTING = piecewise_polynomial([0.0, 1.0], [(BUMP + BUMP.deriv()).coef])  # eta' = -eta + y gives eta = BUMP, at rest from 1 on
KINK = piecewise_polynomial([0.0, 1.0, 2.0], [[0.0, 0.0, 3.0, -2.0], [1.0, 0.5, -0.5]])
GROWING = PiecewiseSignal(
    np.zeros(1), (Generator(np.eye(1), np.eye(1)), Generator(np.zeros((1, 1)), np.eye(1))), np.array([0, 1]), np.ones((2, 1))
)  # e^t before 0, 1 afterwards

CANTILEVER = SwitchedSystem([StateSpace(*cantilever_paper(m)) for m in CANTILEVER_TIP_MASSES], [np.pi / 2, 3 * np.pi / 2])
CHAIN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.7]])
POSITION, MIXED = (StateSpace(CHAIN, [[0.0], [1.0], [0.0]], [[1.0, velocity, 0.0]]) for velocity in (0.0, 0.5))
ALL_PASS = StateSpace([[-2.0]], [[1.0]], [[-3.0]], [[1.0]])  # (s - 1)/(s + 2)


def system(a: float, c: float = 0.0, gain: float = 1.0) -> StateSpace:
    return StateSpace([[0.0, 0.0], [1.0, a]], [[1.0], [0.0]], [[gain, gain * c]])


def jumping(*systems: StateSpace, at: Any = (1.0,)) -> SwitchedSystem:
    return SwitchedSystem(systems, at)


def accepted(model: Any, reference: PiecewiseSignal) -> bool:
    try:
        invert(model, reference)
    except InvtrackError:
        return False
    return True


# name: (model, reference, failing condition or "", free directions or None)
PROBLEMS: dict[str, tuple[Any, PiecewiseSignal, str, int | None]] = {
    "no jump": (system(1.0), MOTION, "", 0),
    "cantilever": (CANTILEVER, raised_cosine(2.0), "", 0),
    "more unstable after": (jumping(system(-1.0), system(1.0)), MOTION, "boundedness", 0),
    "more unstable after, consistent": (jumping(system(-1.0), system(1.0)), FITTING, "", 0),
    "more unstable before": (jumping(system(1.0), system(-1.0)), MOTION, "", 1),
    "unstable in between": (jumping(system(-1.0), system(50.0), system(-1.0), at=[1.0, 11.0]), MOTION, "boundedness", None),
    "unstable in between, for a while": (jumping(system(-1.0), system(1.0), system(-1.0), at=[0.5, 1.5]), MOTION, "", 0),
    "output makes it unique": (jumping(system(1.0), system(-2.0, c=1.0)), MOTION, "", 0),
    "output asks too much": (jumping(system(1.0), system(2.0, c=1.0)), MOTION, "boundedness", 0),
    "nothing left to choose": (jumping(system(-1.0), system(-2.0, c=1.0)), MOTION, "compatibility", 0),
    "new gain, unfitting": (jumping(system(1.0), system(1.0, gain=2.0), at=[1.5]), RAMP, "compatibility", 0),
    "new gain, fitting": (jumping(system(1.0), system(1.0, gain=2.0), at=[1.5]), DOUBLING, "", 0),
    "relative degree changes at rest": (jumping(POSITION, MIXED, at=[3.0]), MOTION, "", 0),
    "relative degree changes in motion": (jumping(POSITION, MIXED), MOTION, "compatibility", 0),
    "zero on the axis": (jumping(system(1.0), system(0.0)), MOTION, "rest in the zeros on the imaginary axis", None),
    "axis in between": (jumping(system(1.0), system(0.0), system(1.0), at=[0.5, 1.0]), MOTION, "", 0),
    "no inverse": (
        StateSpace(np.zeros((2, 2)), np.ones((2, 2)), np.eye(2)),
        rest_to_rest([0, 0], [1, 1], 1.0),
        "an inverse",
        None,
    ),
    "kink": (CANTILEVER, KINK, "smoothness", 0),
    "endless mode at a zero": (ALL_PASS, GROWING, "a bounded response to the reference's endless modes", None),
    "endless mode elsewhere": (StateSpace([[-2.0]], [[1.0]], [[3.0]], [[1.0]]), GROWING, "", 0),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_verdict_is_that_of_the_inversion(name: str) -> None:
    model, reference, failed, freedom = PROBLEMS[name]
    report = feasibility(model, reference)
    assert report.solvable == accepted(model, reference) == (failed == "")
    assert report.failed.startswith(failed)
    if freedom is not None:
        assert report.boundary is not None
        assert report.boundary.freedom == freedom
        assert report.unique == (report.solvable and freedom == 0)
    text = str(report)
    assert text.startswith("Exact output tracking: " + ("solvable" if report.solvable else "not solvable"))
    assert report.message in text
    assert (report.message == "") == report.solvable


@settings(deadline=None, max_examples=40, derandomize=True)
@given(
    st.lists(st.integers(1, 2), min_size=1, max_size=2),
    st.integers(1, 3),
    st.lists(st.booleans(), min_size=1, max_size=3),
    st.integers(0, 10**6),
)
def test_the_verdict_is_that_of_the_inversion_for_random_plants(
    degrees: list[int], n_z: int, same_outputs: list[bool], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    systems = [plant_with(rng, degrees, rng.normal(size=(n_z, n_z)), mixed=False)]
    n = systems[0].n_states
    for same in same_outputs:
        mixing = np.eye(n) if same else rotation(rng, n)
        systems.append(plant_with(rng, degrees, rng.normal(size=(n_z, n_z)), mixed=False).transformed(mixing))
    p = len(degrees)
    model = SwitchedSystem(systems, np.sort(rng.uniform(-0.5, 2.5, len(same_outputs))))
    reference = rest_to_rest(np.zeros(p), rng.normal(size=p), 2.0)
    report = feasibility(model, reference)
    assert report.solvable == accepted(model, reference)
    assert report.assumption_4 == all(same_outputs)
    assert all(jump.fixed_miss is not None and jump.fixed_miss < 1e-9 for jump in report.jumps if jump.same_outputs)
    b = report.boundary
    assert b is not None
    if b.dependent == 0 and all(jump.fixed_miss is not None and jump.fixed_miss < 1e-9 for jump in report.jumps):
        assert report.solvable  # Lemma 4, and its like where C* changes
    assert str(report)


def test_the_cantilever_has_the_same_stable_and_antistable_subspaces_at_all_tip_masses() -> None:
    report = feasibility(CANTILEVER, raised_cosine(2.0))
    assert report.unique
    assert report.assumption_4
    assert report.invariant
    assert [interval.counts for interval in report.intervals] == [(2, 2, 0)] * 3
    assert [jump.compatibility_rows for jump in report.jumps] == [0, 0]
    b = report.boundary
    assert b is not None
    assert (b.unknowns, b.end_conditions, b.generic, b.lemma_4_rank, b.dependent) == (2, 2, "square", 4, 0)
    # Held at y = 0, the tip mass does not move: the internal dynamics do not know it.
    bases = [np.linalg.eig(closed_at_rest(cantilever_paper(m)[0], cantilever_paper(m)[1])) for m in CANTILEVER_TIP_MASSES]
    for rates, vectors in bases:
        growing = vectors[:, rates.real > 0.1]
        assert scipy.linalg.subspace_angles(growing, bases[0].eigenvectors[:, bases[0].eigenvalues.real > 0.1]).max() < 1e-9


def closed_at_rest(A: Array, B: Array) -> Array:
    """The cantilever with the input that keeps x2'' at zero."""
    return A - B @ A[[4]] / B[4, 0]


def test_angles_do_not_depend_on_units() -> None:
    model = jumping(*(plant_with(np.random.default_rng(s), (2,), block(0.8, -0.5) + 0.3, mixed=False) for s in (1, 2)))
    scaled = jumping(*(m.transformed(2.0 ** np.array([9, -9, 12, -5]) * np.eye(4)) for m in model.systems))
    ours, theirs = (feasibility(m, MOTION).jumps[0] for m in (model, scaled))
    assert theirs.same_outputs
    assert ours.subspace_angle == pytest.approx(theirs.subspace_angle, abs=1e-12)
    assert ours.stable_angle == pytest.approx(theirs.stable_angle, rel=0.5, abs=1e-12)


def internal_rank(internals: list[Array], lengths: list[float]) -> tuple[int, int, int]:
    """rank [S_N L_s,N] for eta' = Q_k eta over `lengths`, by transition matrices; n_u,0 and n_s,N."""
    rates, vectors = np.linalg.eig(internals[0])
    S = vectors[:, rates.real > 0]
    for Q, length in zip(internals, lengths, strict=True):
        S = scipy.linalg.expm(Q * length) @ S
    rates, vectors = np.linalg.eig(internals[-1])
    L = vectors[:, rates.real < 0]
    return int(np.linalg.matrix_rank(np.hstack([S, L]), tol=1e-8)), S.shape[1], L.shape[1]


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.integers(1, 4), st.integers(1, 3), st.booleans(), st.integers(0, 10**6))
def test_lemma_4_against_transition_matrices(n_z: int, jumps: int, aligned: bool, seed: int) -> None:
    """`aligned`: internal dynamics that are diagonal in the same coordinates, so that antistable directions become stable ones."""
    rng = np.random.default_rng(seed)
    frame = rotation(rng, n_z)
    internals = []
    for _ in range(jumps + 1):
        rates = rng.uniform(0.3, 1.5, n_z) * rng.choice([-1.0, 1.0], n_z)
        turned = frame if aligned else rotation(rng, n_z) @ np.diag(rng.uniform(0.5, 2.0, n_z))
        internals.append(turned @ np.diag(rates) @ np.linalg.inv(turned))
    model = SwitchedSystem([plant_with(rng, (2,), Q, mixed=False) for Q in internals], np.linspace(0.4, 1.6, jumps))
    report = feasibility(model, MOTION)
    edges = np.array([0.0, *model.switch_times, 2.0])
    rank, n_u, n_s = internal_rank(internals, np.diff(edges).tolist())
    b = report.boundary
    assert b is not None
    assert (b.unknowns, b.stable_after, b.lemma_4_rank) == (n_u, n_s, rank)
    assert (b.dependent == 0) == (rank == n_z)
    if rank == n_z:
        assert report.solvable
        assert report.unique == (n_u + n_s == n_z)
    assert report.invariant == all(np.allclose(subspace(Q, 1), subspace(internals[0], 1)) for Q in internals) or not aligned


def subspace(Q: Array, sign: int) -> Array:
    """Orthogonal projector on the invariant subspace of eigenvalues of that sign."""
    rates, vectors = np.linalg.eig(Q)
    basis = scipy.linalg.orth(vectors[:, sign * rates.real > 0])
    return np.asarray(basis @ basis.T)


def test_as_many_unknowns_as_conditions_need_not_suffice() -> None:
    """One antistable direction before and one after, but the first flows into the stable one: Lemma 4's rank is one short."""
    rng = np.random.default_rng(0)
    model = jumping(*(plant_with(rng, (2,), np.diag(rates), mixed=False) for rates in ([1.0, -1.0], [-1.0, 1.0])))
    report = feasibility(model, MOTION)
    b = report.boundary
    assert b is not None
    assert (b.generic, b.lemma_4_rank, b.dependent, b.freedom) == ("square", 1, 1, 1)
    assert not report.solvable
    assert "Lemma 4: rank [S_N L_s,N] falls 1 short of n_z" in str(report)


def test_misses_are_the_sizes_by_which_conditions_fail() -> None:
    """y = zeta, then 2 zeta, with the reference at 1 and not at 2: it misses by 1 of the 3 that its terms add up to."""
    jump = feasibility(*PROBLEMS["new gain, unfitting"][:2]).jumps[0]
    assert not jump.same_outputs
    assert jump.compatibility_rows == 0
    assert jump.fixed_miss == pytest.approx(1 / 3)
    report = feasibility(*PROBLEMS["more unstable after"][:2])
    assert report.boundary is not None
    assert (report.boundary.generic, report.jumps[0].miss) == ("overdetermined", 0.0)
    assert report.boundary.final_miss > 0.1


def test_a_zero_on_the_axis_is_reported_like_any_other() -> None:
    """The last interval's internal state x_2' = y drifts where y is held at 1, and is at rest where y comes back to 0."""
    model = jumping(system(1.0), system(1.0), system(0.0), at=[0.5, 1.0])
    report = feasibility(model, MOTION)
    assert [interval.counts for interval in report.intervals] == [(0, 1, 0), (0, 1, 0), (0, 0, 1)]
    assert [jump.same_outputs for jump in report.jumps] == [True, True]
    assert report.rests
    assert "unobservable mode" in report.message
    back = feasibility(model, raised_cosine(1.0, period=3.0))
    assert back.solvable
    assert back.solvable == accepted(model, raised_cosine(1.0, period=3.0))


def test_an_operating_point_is_taken_into_account() -> None:
    """About y = 5 the motion that fits about 0 has to be moved up by 5."""
    point = OperatingPoint(np.zeros(2), np.zeros(1), np.array([5.0]))
    models = [StateSpace(*(getattr(system(a), name) for name in "ABC"), operating_point=point) for a in (-1.0, 1.0)]
    for reference, fits in ((FITTING + constant(5.0), True), (FITTING, False)):
        assert feasibility(jumping(*models), reference).solvable == accepted(jumping(*models), reference) == fits


def test_wrong_number_of_channels_is_malformed() -> None:
    with pytest.raises(TrajectoryError, match=r"the reference has 2 channels, the plant 1 outputs \['y1'\]"):
        feasibility(system(1.0), rest_to_rest([0, 0], [1, 1], 1.0))


def test_many_jumps_are_cut_short_in_the_text_only() -> None:
    report: FeasibilityReport = feasibility(jumping(*[system(1.0)] * 51, at=np.linspace(0.0, 2.0, 50)), MOTION)
    assert len(report.jumps) == 50
    assert report.unique
    assert "... 30 more" in str(report)
