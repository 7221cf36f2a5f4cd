"""The map G(t) of the cantilever whose tip mass jumps twice, against the paper's numbers and independent integration.

S. Devasia, B. Paden, C. Rossi, "Exact-output tracking theory for systems with parameter jumps", Int. J. Control, accepted 1996,
sections 3 and 5.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_ivp

from invtrack.errors import InversionError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.exosystem import exosystem
from invtrack.references.profiles import raised_cosine
from invtrack.regulation.exosystem_map import exosystem_map
from invtrack.regulation.francis_map import switched_francis
from invtrack.regulation.regulation_map import RegulationMap
from tests.cited_plants import CANTILEVER_TIP_MASSES, cantilever_paper

Array = np.ndarray

SWITCHES = [np.pi / 2, 3 * np.pi / 2]
SYSTEMS = [StateSpace(*cantilever_paper(m)) for m in CANTILEVER_TIP_MASSES]
MODEL = SwitchedSystem(SYSTEMS, SWITCHES)
A_E = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
C_E = np.array([[0.0, 0.0, 0.0, 1.0]])
PRINTED = np.array([[-4.6715, 0, 6.9406, -0.5935, 0, 2.6851], [-3.3239, 0, 2.6672, -1.4710, 0, -0.8211]]).T
INTERNAL = [0, 2, 3, 5]  # eta = (x1, x3, x1', x3'), what is left of x beside y = x2 and its derivative


@pytest.fixture(scope="module")
def regulation() -> RegulationMap:
    return exosystem_map(MODEL, exosystem(A_E, C_E, start=0.0, end=2 * np.pi))


def closed(system: StateSpace) -> tuple[Array, Array, Array, Array]:
    """A_y = A - B (C A B)^-1 C A^2, F_k, G_k and C_e* of relative degree 2, written out."""
    F_k = -system.C @ system.A @ system.A / (system.C @ system.A @ system.B)
    G_k = 1 / (system.C @ system.A @ system.B)
    return system.A + system.B @ F_k, F_k, G_k, C_E @ A_E @ A_E


def internal_rows(system: StateSpace) -> tuple[Array, Array]:
    """Rows that give the stable and the antistable part of eta: the left eigenvectors of the internal dynamics."""
    A_eta = closed(system)[0][np.ix_(INTERNAL, INTERNAL)]
    values, left = scipy.linalg.eig(A_eta, left=True, right=False)
    return left[:, values.real < 0].T.real, left[:, values.real > 0].T.real


def test_first_two_columns_are_those_that_the_paper_prints(regulation: RegulationMap) -> None:
    """G(0), good to 0.013 as printed."""
    G_0 = regulation.x_map(0.0, inside=1.0)[0]
    assert G_0[:, :2] == pytest.approx(PRINTED, abs=0.013)
    assert G_0[[1, 4]] == pytest.approx(np.array([[0, 0, 0, 1], [0, 0, 1, 0]]), abs=1e-12)


def test_all_columns_meet_the_boundary_conditions(regulation: RegulationMap) -> None:
    """z_s(T_i) = 0 and z_u(T_f) = 0 with eigenvectors of the internal dynamics written out by hand; z_u(T_i) is not zero."""
    start, end = regulation.x_map(0.0, inside=1.0)[0, INTERNAL], regulation.x_map(2 * np.pi, inside=6.0)[0, INTERNAL]
    assert np.max(np.abs(internal_rows(SYSTEMS[0])[0] @ start)) < 1e-10
    assert np.max(np.abs(internal_rows(SYSTEMS[-1])[1] @ end)) < 1e-10
    assert np.min(np.max(np.abs(internal_rows(SYSTEMS[0])[1] @ start), axis=0)) > 1e-2


def test_columns_follow_from_each_other_by_an_independent_integration(regulation: RegulationMap) -> None:
    """X = G(t) Phi(t) by DOP853 through both jumps from G(0), backward where the antistable part would blow up errors."""
    edges = [0.0, *SWITCHES, 2 * np.pi]
    for start, end, system in zip(edges[:-1], edges[1:], SYSTEMS, strict=True):
        A_y, _, G_k, C_star = closed(system)
        middle = (start + end) / 2

        def slope(t: float, g: Array, A_y: Array = A_y, drive: Array = system.B @ G_k @ C_star) -> Array:
            G = g.reshape(6, 4)
            return (A_y @ G - G @ A_E + drive).ravel()

        G = regulation.x_map(start, inside=middle)[0]
        found = solve_ivp(slope, (start, end), G.ravel(), "DOP853", rtol=1e-12, atol=1e-12).y[:, -1].reshape(6, 4)
        assert found == pytest.approx(regulation.x_map(end, inside=middle)[0], abs=1e-8)


def test_the_input_is_that_of_the_tracking_law(regulation: RegulationMap) -> None:
    """F = F_k G + G_k C_e*."""
    for t, system in zip([0.7, 3.0, 5.5], SYSTEMS, strict=True):
        _, F_k, G_k, C_star = closed(system)
        F = F_k @ regulation.x_map(t)[0] + G_k * C_star
        assert regulation.u_map(t)[0] == pytest.approx(F, abs=1e-10 * np.abs(F).max())


def test_the_map_is_continuous_through_the_jumps_for_every_column(regulation: RegulationMap) -> None:
    for t in SWITCHES:
        assert regulation.x_map(t, inside=t - 0.1) == pytest.approx(regulation.x_map(t, inside=t + 0.1), abs=1e-12)


def test_column_two_is_the_inverse_of_its_output(regulation: RegulationMap) -> None:
    plan, t = invert(MODEL, raised_cosine(2.0)), np.linspace(-90.0, 60.0, 1501)
    inside = regulation.x_map(0.0, inside=1.0)[0, :, 1]
    assert inside == pytest.approx(plan.states(0.0)[0], abs=1e-12)
    mapped = regulation.plan([0, 1, 0, 0])
    assert mapped.states(t) == pytest.approx(plan.states(t), abs=1e-11)
    assert mapped.inputs(t) == pytest.approx(plan.inputs(t), abs=1e-10)
    x_e = regulation.exosystem.states([0, 1, 0, 0], 0.0, t)
    assert np.einsum("mij,mj->mi", regulation.x_map(t), x_e) == pytest.approx(plan.states(t), abs=1e-11)
    assert np.einsum("mij,mj->mi", regulation.u_map(t), x_e) == pytest.approx(plan.inputs(t), abs=1e-9)
    assert mapped.certificate.dynamics_residual < 1e-13
    assert mapped.preactuation == pytest.approx(plan.preactuation)


def test_which_states_are_admissible_and_why_the_others_are_not(regulation: RegulationMap) -> None:
    """Only 1 - cos t begins and ends at rest; sin t - t is at -2 pi at T_f."""
    assert np.abs(regulation.admissible[:, 0]) == pytest.approx([0, 1, 0, 0], abs=1e-10)
    reasons = {state.name: state for state in regulation.inadmissible}
    assert set(reasons) == {"x_e1", "x_e3", "x_e4"}
    assert (reasons["x_e1"].time, reasons["x_e1"].jump) == pytest.approx((2 * np.pi, 2 * np.pi))
    assert (reasons["x_e1"].output, reasons["x_e1"].derivative) == ("y1", 0)
    assert (reasons["x_e4"].time, reasons["x_e4"].jump) == pytest.approx((0.0, 1.0))
    with pytest.raises(InversionError, match=r"not admissible .* x_e1: at t = 6.28319 s derivative 0 of output 'y1' jumps by 6.28"):
        regulation.plan([1.0, 0, 0, 0])
    with pytest.raises(TrajectoryError, match="state of 4 finite entries"):
        regulation.plan([1.0])


def test_a_held_output_makes_more_states_admissible() -> None:
    """A motion that ends at rest anywhere is followed to the equilibrium there: sin t - t stops at -2 pi with y' = 0."""
    held = exosystem_map(MODEL, exosystem(A_E, C_E, start=0.0, end=2 * np.pi, outside="held"))
    assert held.admissible.shape == (4, 3)
    assert [state.name for state in held.inadmissible] == ["x_e3"]
    x_e = np.array([1.0, 1.0, 0.0, 3.0])
    plan, t = invert(MODEL, held.exosystem.reference(x_e)), np.linspace(-50.0, 60.0, 801)
    assert held.plan(x_e).states(t) == pytest.approx(plan.states(t), abs=1e-11)
    at_rest = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # base and tip in the same place, no rotation
    ends = held.plan(x_e).states([-150.0, 160.0])
    assert ends == pytest.approx(np.outer([3.0, 3.0 - 2 * np.pi], at_rest), abs=1e-9)


def test_further_breakpoints_do_not_move_ten_digits(regulation: RegulationMap) -> None:
    """The same plant and exosystem, cut into more intervals."""
    times = np.sort(np.concatenate([np.linspace(0.2, 6.1, 9), SWITCHES]))
    cut = SwitchedSystem([SYSTEMS[k] for k in MODEL.interval(np.concatenate([[-1.0], times]))], times)
    refined = exosystem_map(cut, regulation.exosystem)
    t = np.linspace(-20.0, 30.0, 301)
    assert refined.x_map(t) == pytest.approx(regulation.x_map(t), abs=1e-10)


def test_certificate_and_preactuation(regulation: RegulationMap) -> None:
    certificate = regulation.certificate
    worst = max(certificate.dynamics_residual, certificate.output_error, certificate.boundary_residual, certificate.continuity)
    assert worst < 1e-12
    assert regulation.breakpoints == pytest.approx([0.0, *SWITCHES, 2 * np.pi])
    peak = np.max(np.abs(regulation.x_map(np.linspace(-10.0, 2 * np.pi, 2000))), axis=0)
    early = np.abs(regulation.x_map(regulation.start)[0]) / np.where(peak > 0, peak, 1.0)
    assert np.max(early) < 1.01 * regulation.tolerance
    assert np.max(np.abs(regulation.x_map(regulation.start + 30.0)[0]) / np.where(peak > 0, peak, 1.0)) > regulation.tolerance


def test_switched_francis_differs_where_the_exosystem_starts_stops_and_the_mass_jumps(regulation: RegulationMap) -> None:
    usual = switched_francis(MODEL, regulation.exosystem)
    assert usual.certificate.continuity > 0.5
    assert np.max(np.abs(usual.x_map(1.0) - regulation.x_map(1.0))) > 0.1
