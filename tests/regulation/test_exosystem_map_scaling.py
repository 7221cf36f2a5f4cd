"""The map does not depend on the units of the exosystem's states, on states that no output shows, or on what rests."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_bvp

from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.exosystem import Exosystem, exosystem, sinusoidal_exosystem, step_exosystem
from invtrack.regulation.exosystem_map import exosystem_map
from invtrack.regulation.francis_map import switched_francis
from tests.cited_plants import cantilever_paper
from tests.linear.random_plants import block

Array = np.ndarray

CANTILEVER = [StateSpace(*cantilever_paper(m)) for m in (0.0, 100.0, 10.0)]
MODEL = SwitchedSystem(CANTILEVER, [1.5, 4.0])


def in_foreign_units(exo: Exosystem, units: Array) -> Exosystem:
    """The same exosystem in other units of its states, entry by entry, so that not even rounding mixes them."""
    A, C = [A_e * units[:, None] / units for A_e in exo.A], [C_e / units for C_e in exo.C]
    return Exosystem(A, C, exo.switch_times)


@pytest.mark.parametrize("endless", [True, False])
def test_states_that_no_output_shows_are_admissible_and_change_nothing(endless: bool) -> None:
    span = {} if endless else {"start": 0.0, "end": 2 * np.pi}
    shown = sinusoidal_exosystem([1.0], **span)  # type: ignore[arg-type]
    A_e = scipy.linalg.block_diag(block(0.0, 1j), block(0.5, 2j))
    A_e[3:, :3] = np.random.default_rng(2).normal(size=(3, 3)) * 1e6  # driven by what shows, but driving nothing
    hidden = exosystem(A_e, [[1.0, 1.0, 0.0, 0.0, 0.0, 0.0]], **span)  # type: ignore[arg-type]
    alone, together = exosystem_map(MODEL, shown), exosystem_map(MODEL, hidden)
    t = np.linspace(-20.0, 30.0, 301)
    assert not np.any(together.x_map(t)[:, :, 3:])
    assert together.x_map(t)[:, :, :3] == pytest.approx(alone.x_map(t), abs=1e-11)
    assert together.admissible.shape == (6, alone.admissible.shape[1] + 3)
    assert {state.name for state in together.inadmissible} <= {"x_e1", "x_e2", "x_e3"}
    assert together.inadmissible_share([0.0, 0.0, 0.0, 1.0, -2.0, 3.0]) < 1e-12


def test_a_state_whose_effect_cancels_counts_as_one_that_does_not_show() -> None:
    """y_d = a - b, and the third state moves a and b alike: the column of G is rounding, and so are its jumps."""
    exo = exosystem(np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.1], [0.0, 0.0, 0.0]]) / 3, [[0.7, -0.7, 0.0]])
    regulation = exosystem_map(MODEL, exo)
    assert regulation.inadmissible == ()
    assert np.abs(regulation.x_map([-1.0, 2.0, 5.0])[:, :, 2]).max() < 1e-12


@pytest.mark.parametrize("outside", ["for ever", "zero", "held"])
def test_held_outputs_of_a_mechanism(outside: str) -> None:
    """A plant at rest has velocities that are rounding alone: no errors. At rest base and tip are in one place."""
    span = {} if outside == "for ever" else {"start": 0.0, "end": 6.0, "outside": outside}
    regulation = exosystem_map(MODEL, step_exosystem(**span))  # type: ignore[arg-type]
    assert regulation.certificate.dynamics_residual < 1e-11
    if outside == "zero":  # a step cannot be followed
        assert regulation.admissible.shape == (1, 0)
    else:
        at_rest = [[1.0], [1.0], [0.0], [0.0], [0.0], [0.0]]
        for t in (-200.0, 200.0) if outside == "held" else (-1.0, 2.0, 5.0):
            assert regulation.x_map(t)[0] == pytest.approx(np.array(at_rest), abs=1e-12)
        assert regulation.inadmissible == ()
    assert switched_francis(MODEL, step_exosystem()).certificate.continuity < 1e-10


@pytest.mark.parametrize("seed", range(3))
def test_units_of_the_exosystems_states(seed: int) -> None:
    """Chains and sinusoids in units that differ by up to 1e12; the same states are admissible, and as far from it."""
    rng = np.random.default_rng(seed)
    A_e = scipy.linalg.block_diag(np.eye(3, k=1) - 0.3 * np.eye(3), block(1j))
    C_e = np.array([[1.0, 0.0, 0.0, 1.0, 0.0]])
    plain = exosystem(A_e, C_e, start=0.0, end=2 * np.pi)
    units = 10.0 ** rng.choice([-6, -3, 0, 3, 6], size=5)
    regulation, foreign = exosystem_map(MODEL, plain), exosystem_map(MODEL, in_foreign_units(plain, units))
    t = np.linspace(-15.0, 20.0, 101)
    assert foreign.x_map(t) * units == pytest.approx(regulation.x_map(t), abs=1e-10)
    assert foreign.u_map(t) * units == pytest.approx(regulation.u_map(t), abs=1e-8)
    assert foreign.admissible.shape == regulation.admissible.shape
    x_e = regulation.admissible @ rng.normal(size=regulation.admissible.shape[1])
    assert foreign.inadmissible_share(units * x_e) < 1e-11
    wrong = x_e + 1e-3 * np.eye(5)[1]  # must not drown beside a state in small units
    assert foreign.inadmissible_share(units * wrong) == pytest.approx(regulation.inadmissible_share(wrong), rel=1.0)


def test_an_endless_exosystem_may_grow() -> None:
    plan = exosystem_map(CANTILEVER[0], exosystem([[0.9]], [[1.0]])).plan([1.0])
    assert plan.states(2.0)[0] == pytest.approx(np.exp(1.8) * plan.states(0.0)[0], rel=1e-9)
    moved = SwitchedSystem(CANTILEVER[:2], [0.0])
    plan = exosystem_map(moved, exosystem([[0.9]], [[1.0]])).plan([1.0])
    assert np.all(np.isfinite(plan.states([-50.0, 50.0])))
    assert plan.certificate.rest_residual > 1.0


def test_scipys_boundary_value_solver_finds_the_same_map() -> None:
    """Zeros -0.6 and 0.9 and one jump, all columns by collocation on x' of both intervals at once, over normalized time."""

    def system(gain: float) -> StateSpace:
        # y' = u + gain (eta_1 - eta_2), eta_1' = -0.6 eta_1 + y, eta_2' = 0.9 eta_2 + gain y
        return StateSpace([[0.0, gain, -gain], [1.0, -0.6, 0.0], [gain, 0.0, 0.9]], [[1.0], [0.0], [0.0]], [[1.0, 0.0, 0.0]])

    gains, edges = (1.0, 2.5), (0.0, 2.0, 5.0)
    exo = exosystem(block(0.4, 1.5j), [[1.0, 0.3, -0.8]], start=edges[0], end=edges[2])
    regulation = exosystem_map(SwitchedSystem([system(g) for g in gains], [edges[1]]), exo)
    A_e, C_e = exo.A[1], exo.C[1][0]

    def slope(s: Array, z: Array) -> Array:
        parts = []
        for gain, start, end, part in zip(gains, edges[:-1], edges[1:], np.split(z.reshape(4, 3, -1), 2), strict=True):
            carried = np.einsum("ijm,jk->ikm", part, A_e)
            own = np.array([-0.6, 0.9])[:, None, None] * part + np.array([1.0, gain])[:, None, None] * C_e[:, None]
            parts.append((end - start) * (own - carried))
        return np.concatenate(parts).reshape(12, -1)

    def conditions(start: Array, end: Array) -> Array:
        first, last = start.reshape(2, 2, 3), end.reshape(2, 2, 3)
        return np.concatenate([first[0, 0], last[1, 1], (last[0] - first[1]).ravel()])

    mesh = np.linspace(0.0, 1.0, 201)
    found = solve_bvp(slope, conditions, mesh, np.zeros((12, len(mesh))), tol=1e-9, max_nodes=20000)
    assert found.success
    s = np.linspace(0.02, 0.98, 25)
    for start, end, part in zip(edges[:-1], edges[1:], np.split(found.sol(s).reshape(4, 3, -1), 2), strict=True):
        assert regulation.x_map(start + s * (end - start))[:, 1:] == pytest.approx(part.transpose(2, 0, 1), abs=1e-7)
