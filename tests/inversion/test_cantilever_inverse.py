"""The cantilever whose tip mass jumps twice, against the paper's numbers and an independent integrator.

S. Devasia, B. Paden, C. Rossi, "Exact-output tracking theory for systems with parameter jumps", Int. J. Control, accepted 1996.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.references.profiles import constant, raised_cosine
from tests.cited_plants import CANTILEVER_TIP_MASSES, cantilever_paper
from tests.linear_motion import states

SWITCHES = [np.pi / 2, 3 * np.pi / 2]
SYSTEMS = [StateSpace(*cantilever_paper(m)) for m in CANTILEVER_TIP_MASSES]
ZEROS = {"slow": 0.234538, "fast": 1.76534}


@pytest.fixture(scope="module")
def plan() -> Plan:
    return invert(SwitchedSystem(SYSTEMS, SWITCHES), raised_cosine(2.0))


def projection(system: StateSpace, zero: float) -> np.ndarray:
    """Row w with (w x)' = zero (w x) wherever the output is zero: left null vector of [A - z I, B; C, 0]."""
    n, p = system.B.shape
    pencil, mass = np.block([[system.A, system.B], [system.C, system.D]]), np.zeros((n + p, n + p))
    mass[:n, :n] = np.eye(n)
    values, left = scipy.linalg.eig(pencil, mass, left=True, right=False)
    values = np.where(np.isfinite(values), values, 1e30)
    row = left[:n, np.argmin(np.abs(values - zero))].conj()
    row = (row / row[np.argmax(np.abs(row))]).real
    return np.asarray(row / np.linalg.norm(row))


def test_start_is_the_one_the_paper_prints(plan: Plan) -> None:
    """x(0) = G(0) (0, 1, 0, 0): second printed column, good to 0.013."""
    assert plan(0.0).x[0] == pytest.approx([-3.3239, 0, 2.6672, -1.4710, 0, -0.8211], abs=0.013)


def test_boundary_conditions(plan: Plan) -> None:
    """z_s(T_i) = 0 and z_u(T_f) = 0, with projections found from the pencil alone."""
    start, end = plan(0.0).x[0], plan(2 * np.pi).x[0]
    for zero in ZEROS.values():
        assert abs(projection(SYSTEMS[0], -zero) @ start) < 1e-10
        assert abs(projection(SYSTEMS[-1], zero) @ end) < 1e-10
        assert abs(projection(SYSTEMS[0], zero) @ start) > 1e-3  # what is left is the unstable manifold


@pytest.mark.parametrize(
    "interval", [(-12.0, 0.0), (0.0, np.pi / 2), (np.pi / 2, 3 * np.pi / 2), (3 * np.pi / 2, 2 * np.pi), (2 * np.pi, 20.0)]
)
def test_dynamics_between_breakpoints_by_an_independent_integrator(plan: Plan, interval: tuple[float, float]) -> None:
    start, end = interval
    middle = (start + end) / 2
    system = plan.model.systems[int(plan.model.interval(middle))]

    def forces(t: np.ndarray) -> np.ndarray:
        return np.asarray(plan.inputs(t, inside=np.full(len(t), middle)) @ system.B.T)

    times = np.linspace(start, end, 7)
    x_start = plan(start, inside=middle).x[0]
    found = states(system.A, x_start, forces, times, longest=0.05)
    assert found == pytest.approx(plan(times, inside=middle).x, abs=2e-9)
    assert found[:, 1] == pytest.approx(plan(times).y_d[:, 0], abs=2e-9)


def test_state_is_continuous_and_output_exact_through_the_jumps(plan: Plan) -> None:
    for t in plan.breakpoints:
        assert plan(t, inside=t - 1e-3).x == pytest.approx(plan(t, inside=t + 1e-3).x, abs=1e-12)
    t = np.linspace(-100.0, 110.0, 5001)
    assert plan(t).y == pytest.approx(raised_cosine(2.0)(t), abs=1e-12)
    certificate = plan.certificate
    assert max(certificate.dynamics_residual, certificate.output_error, certificate.continuity) < 1e-12


def test_the_base_rings_down_on_the_stable_manifold(plan: Plan) -> None:
    """The output rests from 2 pi on, the base does not: -3.2, decaying with the slow stable zero."""
    assert plan(2 * np.pi).x[0, 0] == pytest.approx(-3.2, abs=0.05)
    late = plan([30.0, 40.0]).x[:, 0]
    assert np.log(late[0] / late[1]) / 10 == pytest.approx(ZEROS["slow"], abs=2e-6)


def test_preactuation_decays_backward_with_the_slowest_antistable_zero(plan: Plan) -> None:
    early = np.abs(plan([-40.0, -30.0]).u[:, 0])
    assert np.log(early[1] / early[0]) / 10 == pytest.approx(ZEROS["slow"], abs=2e-6)
    assert plan.preactuation == pytest.approx(np.log(1e10) / ZEROS["slow"], rel=0.1)


def test_peak_input(plan: Plan) -> None:
    assert np.max(np.abs(plan(np.linspace(-5.0, 12.0, 20001)).u)) == pytest.approx(268, abs=0.5)


def test_limited_preactuation_says_what_it_leaves_out() -> None:
    plan = invert(SwitchedSystem(SYSTEMS, SWITCHES), raised_cosine(2.0), max_preactuation=10.0)
    assert plan.start == pytest.approx(-10.0)
    assert any("preactuation limited to 10.0 s" in remark for remark in plan.remarks)
    peak = np.max(np.abs(plan(np.linspace(0, 2 * np.pi, 2001)).x), axis=0)
    left = np.max(np.abs(plan(-10.0).x[0]) / peak)
    assert plan.certificate.rest_residual == pytest.approx(left, rel=0.3)
    assert invert(SwitchedSystem(SYSTEMS, SWITCHES), raised_cosine(2.0), max_preactuation=1e3).remarks == ()


@pytest.mark.parametrize("jump", [np.pi, 2.0, 2 * np.pi, np.nextafter(2 * np.pi, 10), np.nextafter(2 * np.pi, 0), -1.0, 0.0, 9.0])
def test_jumps_anywhere(jump: float) -> None:
    """Where the wanted velocity is zero, at the ends of the motion or one rounding beside them, before it and after it."""
    plan = invert(SwitchedSystem(SYSTEMS[:2], [jump]), raised_cosine(2.0))
    certificate = plan.certificate
    assert max(certificate.dynamics_residual, certificate.output_error, certificate.continuity) < 1e-11
    assert certificate.rest_residual < 2e-10
    assert plan.manoeuvre == pytest.approx((min(0.0, jump), max(2 * np.pi, jump)))
    start, end = plan(plan.manoeuvre[0]).x[0], plan(plan.manoeuvre[1]).x[0]
    for zero in ZEROS.values():
        assert abs(projection(SYSTEMS[0], -zero) @ start) < 1e-10
        assert abs(projection(SYSTEMS[1], zero) @ end) < 1e-10


def test_a_jump_while_the_motion_passes_through_zero() -> None:
    """y_d = 0 at the jump: what rounding leaves of it must not be taken for a missed condition."""
    reference = raised_cosine(2.0) + raised_cosine(2.0, start_time=np.pi).scaled(-1.0)
    crossing = 1.5 * np.pi
    assert abs(reference(crossing)[0]) < 1e-14
    assert invert(SwitchedSystem(SYSTEMS[:2], [crossing]), reference).certificate.dynamics_residual < 1e-12


def test_a_jump_long_after_the_motion_does_not_matter() -> None:
    t = np.linspace(-30.0, 30.0, 200)
    with_jump = invert(SwitchedSystem(SYSTEMS[:2], [300.0]), raised_cosine(2.0))
    assert with_jump(t).x == pytest.approx(invert(SYSTEMS[0], raised_cosine(2.0))(t).x, abs=1e-11)
    assert with_jump.manoeuvre == pytest.approx((0.0, 300.0))


def test_a_tip_held_elsewhere_through_the_jumps_needs_no_force() -> None:
    """All but base and tip is rounding then, which is not to be taken for a failure."""
    plan = invert(SwitchedSystem([StateSpace(*cantilever_paper(m)) for m in CANTILEVER_TIP_MASSES], [2.0, 5.0]), constant(1.0))
    at = plan(np.array([0.0, 2.0, 3.5, 5.0, 8.0]))
    assert at.x[:, :2] == pytest.approx(1.0, abs=1e-10)
    assert at.u == pytest.approx(0.0, abs=1e-9)
    assert plan.certificate.dynamics_residual < 1e-8
