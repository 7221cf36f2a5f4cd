"""Maps for exosystems through jumps that move the equilibrium: x_d = x_rest + G x_e."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import CompatibilityError, InversionError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.exosystem import polynomial_exosystem, sinusoidal_exosystem
from invtrack.references.profiles import constant
from invtrack.regulation.exosystem_map import exosystem_map
from invtrack.regulation.francis import francis
from invtrack.regulation.francis_map import single_francis, switched_francis
from invtrack.regulation.regulation_map import RegulationMap
from tests.cited_plants import cantilever_paper
from tests.equilibria import CANTILEVERS, EQUILIBRIA, JUMPS, TIP_MASSES, at_rest_in, cantilever
from tests.inversion.test_moved_equilibria import elastic_hoist, rigid_hoist

X_E = np.array([0.3, 1.0, -0.5])
SWAY = sinusoidal_exosystem([1.3])
TIMES = np.linspace(-30.0, 40.0, 301)


@pytest.fixture(scope="module")
def regulation() -> RegulationMap:
    return exosystem_map(cantilever(), SWAY)


def test_its_plans_are_those_of_the_inverse(regulation: RegulationMap) -> None:
    """Of an exosystem that runs for ever, whose output is measured from the first output at rest."""
    mapped, plan = regulation.plan(X_E, at=1.0), invert(cantilever(), SWAY.reference(X_E, at=1.0) + 0.5)
    assert mapped.states(TIMES) == pytest.approx(plan.states(TIMES), abs=1e-10)
    assert mapped.inputs(TIMES) == pytest.approx(plan.inputs(TIMES), abs=1e-10 * np.abs(plan.inputs(TIMES)).max())
    assert mapped(TIMES).y_d == pytest.approx(plan(TIMES).y_d, abs=1e-12)
    assert mapped.certificate.worst(exact=True) < 1e-10
    found = regulation.certificate
    assert max(found.dynamics_residual, found.output_error, found.boundary_residual, found.continuity) < 1e-10
    assert regulation.admissible.shape == (3, 3)


def test_the_map_does_not_depend_on_where_the_plant_is_at_rest(regulation: RegulationMap) -> None:
    """G and F are those of the same plants about one equilibrium; the rest alone is what the jumps add."""
    still = exosystem_map(SwitchedSystem([StateSpace(*cantilever_paper(m)) for m in TIP_MASSES], JUMPS), SWAY)
    assert regulation.x_map(TIMES) == pytest.approx(still.x_map(TIMES), abs=1e-10)
    assert regulation.u_map(TIMES) == pytest.approx(still.u_map(TIMES), abs=1e-10 * np.abs(still.u_map(TIMES)).max())
    held = invert(cantilever(), constant(0.5))
    assert regulation.x_rest(TIMES) == pytest.approx(held.states(TIMES), abs=1e-9)
    assert regulation.u_rest(TIMES) == pytest.approx(held.inputs(TIMES), abs=1e-9 * np.abs(held.inputs(TIMES)).max())
    assert still.x_rest(TIMES) == pytest.approx(np.zeros((len(TIMES), 6)))


def test_states_are_joined_at_the_jumps(regulation: RegulationMap) -> None:
    at = np.array(JUMPS)
    for jumping in (regulation.x_map, regulation.x_rest):
        assert jumping(at, inside=at - 0.1) == pytest.approx(jumping(at, inside=at + 0.1), abs=1e-11)


def test_units_of_the_exosystem_do_not_matter(regulation: RegulationMap) -> None:
    scale = np.diag([1e-6, 1e5, 1e3])
    other = exosystem_map(cantilever(), SWAY.transformed(scale))
    assert other.x_rest(TIMES) == pytest.approx(regulation.x_rest(TIMES), abs=1e-9)
    assert other.x_map(TIMES) @ scale == pytest.approx(regulation.x_map(TIMES), abs=1e-9)


def test_a_finite_motion_with_a_load_picked_up_against_gravity() -> None:
    """A cubic from rest: of its states those with y and y' zero at the start and at the end would be admissible without jumps."""
    model = SwitchedSystem([rigid_hoist(1.0), rigid_hoist(3.0)], [1.0])
    wave = sinusoidal_exosystem([np.pi], start=0.0, end=2.0)
    found = exosystem_map(model, wave)
    x_e = found.admissible[:, 0]
    plan = found.plan(x_e)
    assert plan.certificate.worst(exact=True) < 1e-12
    expected = invert(model, wave.reference(x_e))
    times = np.linspace(-1.0, 4.0, 51)
    assert plan.inputs(times) == pytest.approx(expected.inputs(times), rel=1e-11)


def test_a_rope_that_takes_a_load_is_refused_with_the_reason() -> None:
    model = SwitchedSystem([elastic_hoist(1.0, 0.0), elastic_hoist(3.0, 0.0)], [1.0])
    with pytest.raises(CompatibilityError, match=r"jumps at t = 1 s, and no continuous state holds the outputs \['load'\] still"):
        exosystem_map(model, polynomial_exosystem(2))


def test_francis_regulators_are_each_about_their_own_equilibrium() -> None:
    usual = switched_francis(cantilever(), SWAY)
    t = np.array([0.0, 3.0, 6.0])
    for k, (system, (x0, u0, y0)) in enumerate(zip(CANTILEVERS, EQUILIBRIA, strict=True)):
        regulator = francis(system, SWAY.A[0], SWAY.C[0])
        hold = francis(system, np.zeros((1, 1)), np.ones((1, 1)))  # a constant output
        offset = EQUILIBRIA[0][2][0] - y0[0]  # type: ignore[index]
        assert usual.x_map(t[k])[0] == pytest.approx(regulator.Pi, abs=1e-10)
        x = np.asarray(x0) - np.asarray(EQUILIBRIA[0][0]) + hold.Pi[:, 0] * offset
        assert usual.x_rest(t[k])[0] == pytest.approx(x, abs=1e-10)
        assert usual.u_rest(t[k])[0] == pytest.approx(u0 + hold.Gamma[:, 0] * offset, abs=1e-10)
    plan = usual.plan(X_E, at=0.0)
    assert plan(TIMES).y == pytest.approx(plan(TIMES).y_d, abs=1e-11)


def test_the_regulator_of_one_interval_keeps_its_equilibrium_in_all() -> None:
    usual, alone = single_francis(cantilever(), SWAY, interval=1), exosystem_map(CANTILEVERS[1], SWAY)
    frame = np.asarray(EQUILIBRIA[1][0]) - np.asarray(EQUILIBRIA[0][0])
    shift = 0.5 - 0.3  # wanted outputs are measured from the first output at rest
    hold = francis(CANTILEVERS[1], np.zeros((1, 1)), np.ones((1, 1)))
    t = np.array([0.0, 3.0, 6.0])
    assert usual.x_map(t) == pytest.approx(alone.x_map(t), abs=1e-10)
    assert usual.x_rest(t) == pytest.approx(np.tile(frame + hold.Pi[:, 0] * shift, (3, 1)), abs=1e-10)
    assert usual.u_rest(t) == pytest.approx(np.tile(8.0 + hold.Gamma[:, 0] * shift, (3, 1)), abs=1e-10)
    plan = usual.plan(X_E, at=0.0)
    assert plan.states(t) == pytest.approx(usual.x_rest(t) + np.einsum("mij,mj->mi", usual.x_map(t), SWAY.states(X_E, 0.0, t)))


def test_equal_equilibria_change_nothing() -> None:
    plain = exosystem_map(SwitchedSystem([StateSpace(*cantilever_paper(m)) for m in TIP_MASSES], JUMPS), SWAY)
    same = [at_rest_in(StateSpace(*cantilever_paper(m)), (np.ones(6), [2.0], [0.1])) for m in TIP_MASSES]
    other = exosystem_map(SwitchedSystem(same, JUMPS), SWAY)
    assert other.driver is other.exosystem
    assert np.array_equal(plain.x_map(TIMES), other.x_map(TIMES))
    assert np.array_equal(plain.u_map(TIMES), other.u_map(TIMES))
    assert other.u_rest(TIMES) == pytest.approx(np.full((len(TIMES), 1), 2.0))


def test_a_state_that_is_not_admissible_is_still_refused() -> None:
    model = SwitchedSystem([rigid_hoist(1.0), rigid_hoist(3.0)], [1.0])
    found = exosystem_map(model, sinusoidal_exosystem([3.0], start=0.0, end=2.0))
    with pytest.raises(InversionError, match="is not admissible"):
        found.plan([0.0, 1.0, 0.0])
