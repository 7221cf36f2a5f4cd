"""Exact inversion through jumps that move the equilibrium: the state is continuous, and so is the output."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import CompatibilityError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility import feasibility
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.inversion.no_preactuation import causal_inverse
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.plans.problem import steps
from invtrack.redesign.cost import cost
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.cited_plants import cantilever_paper
from tests.equilibria import CANTILEVERS, EQUILIBRIA, JUMPS, TIP_MASSES, absolute_motion, at_rest_in, cantilever
from tests.inversion.test_redesign_instead import called
from tests.linear.random_plants import block, plant_with

MOTION = raised_cosine(2.0) + 0.5
G = 9.81


def check(plan: Plan, plant: SwitchedSystem, x0: np.ndarray, reference: PiecewiseSignal, *, start: float, end: float) -> None:
    """The plan against an integration of the plant in absolute coordinates; x0: of the first interval."""
    times = np.linspace(start, end, 200)
    models = [(s, (x0 + s.rest, s.operating_point.u0, s.operating_point.y0)) for s in plant.systems]
    first = plan(times[:1])
    X, y = absolute_motion(models, plant.switch_times, plan, x0 + first.x[0], times)
    size = np.max(np.abs(X), axis=0)
    assert np.max(np.abs(X - x0 - plan.states(times)) / size) < 1e-7
    assert np.max(np.abs(y - reference(times))) < 1e-7 * np.max(np.abs(y))


def test_the_plan_is_a_motion_of_the_plant_in_absolute_coordinates() -> None:
    plan = invert(cantilever(), MOTION)
    assert plan.certificate.worst(exact=True) < 1e-10
    check(plan, cantilever(), np.asarray(EQUILIBRIA[0][0]), MOTION, start=-6.0, end=12.0)
    sides = [plan(np.array(JUMPS), inside=np.array(JUMPS) + side) for side in (-0.1, 0.1)]
    assert sides[0].x == pytest.approx(sides[1].x, abs=1e-11)
    assert sides[0].y == pytest.approx(sides[1].y, abs=1e-11)


def test_it_comes_from_the_first_equilibrium_and_goes_to_the_last() -> None:
    plan, model = invert(cantilever(), MOTION), cantilever()
    ends = plan([plan.start - 100.0, plan.end + 1000.0])
    assert ends.u.ravel() == pytest.approx([3.0, -1.0], abs=1e-6)
    assert ends.x[0] == pytest.approx(np.zeros(6), abs=1e-8)
    # It holds y = 0.5 at the end, 0.1 below the output at rest: a cantilever on a free base is shifted as a whole.
    assert ends.x[1] == pytest.approx(model.rest_states[2] - 0.1 * np.array([1, 1, 0, 0, 0, 0.0]), abs=1e-6)


def test_nothing_of_the_plan_depends_on_where_the_origin_is() -> None:
    """x0, u0, y0 and the reference shifted by the same in all intervals: a plan shifted by as much."""
    x, u, y = np.array([2.0, -1.0, 0.5, 0.0, 0.3, 0.0]), 40.0, -1.0
    moved = [
        at_rest_in(system, (np.asarray(e[0]) + x, np.asarray(e[1]) + u, np.asarray(e[2]) + y))
        for system, e in zip(CANTILEVERS, EQUILIBRIA, strict=True)
    ]
    plain, other = invert(cantilever(), MOTION), invert(SwitchedSystem(moved, JUMPS), MOTION + y)
    times = np.linspace(-10.0, 20.0, 301)
    assert other(times).x == pytest.approx(plain(times).x, abs=1e-9)  # measured from the first x0
    assert other(times).u == pytest.approx(plain(times).u + u, abs=1e-9 * 300)
    assert other(times).y == pytest.approx(plain(times).y + y, abs=1e-11)
    assert other.preactuation == pytest.approx(plain.preactuation, rel=1e-6)


def test_equal_equilibria_change_nothing() -> None:
    systems = [StateSpace(*cantilever_paper(mass)) for mass in TIP_MASSES]
    same = [at_rest_in(system, (np.ones(6), [2.0], [0.0])) for system in systems]
    times = np.linspace(-10.0, 20.0, 301)
    plain, other = (
        invert(SwitchedSystem(systems, JUMPS), raised_cosine(2.0)),
        invert(SwitchedSystem(same, JUMPS), raised_cosine(2.0)),
    )
    assert np.array_equal(plain(times).x, other(times).x)
    assert np.array_equal(plain(times).u + 2.0, other(times).u)
    assert plain.certificate == other.certificate


def test_superposition_of_a_motion_and_of_the_jumps_at_rest() -> None:
    """What the jumps of the equilibrium do, with the output held still, adds to what a motion does without them."""
    at_rest = [StateSpace(*cantilever_paper(mass)) for mass in TIP_MASSES]
    times = np.concatenate([np.linspace(-10.0, 20.0, 300)])
    held = invert(cantilever(), MOTION * 0.0 + 0.5)(times)
    moved = invert(SwitchedSystem(at_rest, JUMPS), raised_cosine(2.0))(times)
    both = invert(cantilever(), MOTION)(times)
    assert both.x == pytest.approx(held.x + moved.x, abs=1e-9)
    assert both.u == pytest.approx(held.u + moved.u, abs=1e-9 * np.max(np.abs(moved.u)))


@pytest.mark.parametrize("seed", range(4))
def test_random_plants(seed: int) -> None:
    """Two channels of relative degrees 1 and 2, stable and antistable zeros; what jumps are the internal dynamics and the rest."""
    rng = np.random.default_rng(seed)
    first = plant_with(rng, (1, 2), block(0.7, -1.0 + 2j), mixed=False)
    A = first.A + np.pad(0.3 * rng.normal(size=(3, 3)), ((3, 0), (3, 0)))
    rows = np.vstack([first.C, first.C[1] @ first.A])  # of outputs and derivatives that the inverse prescribes
    null = np.linalg.svd(rows)[2][3:].T
    x0 = null @ rng.normal(size=3) + np.linalg.pinv(rows) @ [0.4, -0.3, 0.0]
    second = at_rest_in(StateSpace(A, first.B, first.C), (x0, rng.normal(size=2), [0.4, -0.3]))
    plant, reference = SwitchedSystem([first, second], [1.0]), rest_to_rest([0.0, 0.0], [1.0, -0.5], 2.0, smoothness=3)
    plan = invert(plant, reference)
    assert plan.certificate.worst(exact=True) < 1e-10
    check(plan, plant, np.zeros(6), reference, start=-2.0, end=3.0)


def rigid_hoist(mass: float) -> StateSpace:
    """A load that a winch holds against gravity, some drag."""
    return at_rest_in(
        StateSpace([[0.0, 1.0], [0.0, -0.4 / mass]], [[0.0], [1 / mass]], [[1.0, 0.0]]), ([0.0, 0.0], [mass * G], [0.0])
    )


def test_a_load_picked_up_against_gravity() -> None:
    """m z'' = u - m g - 0.4 z': at the jump the input rises by what twice the load's weight and inertia take."""
    lift = rest_to_rest(0.0, 1.0, 2.4, smoothness=3)
    plan = invert(SwitchedSystem([rigid_hoist(1.0), rigid_hoist(3.0)], [1.0]), lift)
    times, mass = np.array([0.5, 1.0, 1.0, 2.0, 3.0]), np.array([1.0, 1.0, 3.0, 3.0, 3.0])
    wanted = mass * (lift(times, derivative=2)[:, 0] + G) + 0.4 * lift(times, derivative=1)[:, 0]
    assert plan.inputs(times, inside=[0.5, 0.9, 1.1, 2.0, 3.0])[:, 0] == pytest.approx(wanted, rel=1e-12)


def test_a_load_picked_up_at_rest_needs_nothing_but_another_input() -> None:
    plan = invert(SwitchedSystem([rigid_hoist(1.0), rigid_hoist(3.0)], [1.0]), rest_to_rest(0.0, 0.0, 2.0))
    assert plan.inputs([0.0, 1.0, 1.0, 5.0], inside=[0.0, 0.9, 1.1, 5.0])[:, 0] == pytest.approx([G, G, 3 * G, 3 * G])
    assert plan.certificate.continuity == 0.0


def elastic_hoist(mass: float, damping: float) -> StateSpace:
    """A drum of 5 kg that a force moves against the load's pull, a rope of 50 N/m that the load stretches by m g / k."""
    k, c, drum = 50.0, damping, 5.0
    A = np.array(
        [[0.0, 1, 0, 0], [-k / drum, -c / drum, k / drum, c / drum], [0, 0, 0, 1], [k / mass, c / mass, -k / mass, -c / mass]]
    )
    system = StateSpace(A, [[0.0], [1 / drum], [0.0], [0.0]], [[0.0, 0.0, 1.0, 0.0]], outputs=["load"])
    return at_rest_in(system, ([mass * G / k, 0.0, 0.0, 0.0], [(drum + mass) * G], [0.0]))


@pytest.mark.parametrize("damping", [0.0, 0.4])
def test_a_rope_that_takes_a_load_against_gravity(damping: float) -> None:
    """y'' = k (drum - y) / m - g: the rope's force stays, so the load falls with (m1 / m2) (y'' + g) - g."""
    lift = rest_to_rest(0.0, 1.0, 2.4, smoothness=5)
    model = SwitchedSystem([elastic_hoist(1.0, damping), elastic_hoist(3.0, damping)], [1.0])
    before = lift(1.0, derivative=2)[0]
    after = (before + G) / 3 - G
    with pytest.raises(
        CompatibilityError,
        match=rf"the second derivative of output 'load' would jump from {before:.4g} to {after:.4g}, .* asks for {before:.4g} ",
    ) as caught:
        invert(model, lift)
    plan = called(str(caught.value), model, lift)
    assert plan.certificate.dynamics_residual < 1e-8
    report = feasibility(model, lift)
    assert (report.solvable, report.failed) == (False, "compatibility at the jumps")


def test_an_output_that_would_jump_is_stated_in_absolute_units() -> None:
    """After the jump the model says y = 2 + (x - 0.5) where it said y = x before: at x = 0.5 it would jump from 0.5 to 2."""
    first = StateSpace([[-1.0]], [[1.0]], [[1.0]])
    second = at_rest_in(StateSpace([[-2.0]], [[1.0]], [[1.0]]), ([0.5], [0.0], [2.0]))
    slew = rest_to_rest(0.0, 1.0, 2.0)
    with pytest.raises(CompatibilityError, match=r"output 'y1' would jump from 0.5 to 2, .* asks for 0.5"):
        invert(SwitchedSystem([first, second], [1.0]), slew)


def test_a_reference_that_jumps_itself_is_still_refused() -> None:
    model = SwitchedSystem([rigid_hoist(1.0), rigid_hoist(3.0)], [1.0])
    jump = steps(np.array([1.0]), np.array([[0.0], [0.1]]))
    with pytest.raises(TrajectoryError, match="derivative of order 0 jumps at t = 1 s"):
        invert(model, rest_to_rest(0.0, 1.0, 2.0, smoothness=3) + jump)


def test_a_hundred_loads_picked_up() -> None:
    times = np.linspace(0.1, 9.9, 99)
    loads = [rigid_hoist(mass) for mass in (1.0, 3.0, 0.5)]
    plan = invert(SwitchedSystem([loads[k % 3] for k in range(100)], times), rest_to_rest(0.0, 1.0, 10.0, smoothness=3))
    assert plan.certificate.worst(exact=True) < 1e-12
    assert plan(12.0).u[0] == pytest.approx(1.0 * G)


def test_the_causal_inverse_and_moved_zeros_go_through_the_same_jumps() -> None:
    """Stable zeros alone: all three are one and the same plan."""
    rng = np.random.default_rng(5)
    first = plant_with(rng, (2,), block(-0.6, -1.0 + 2j), mixed=False)
    null = np.linalg.svd(np.vstack([first.C, first.C @ first.A]))[2][2:].T
    second = at_rest_in(StateSpace(first.A, first.B, first.C), (null @ [0.3, -0.2, 0.5], [1.5], [0.0]))
    plant, reference = SwitchedSystem([first, second], [1.0]), rest_to_rest(0.0, 1.0, 2.0, smoothness=4)
    exact, causal = invert(plant, reference), causal_inverse(plant, reference)
    modified = modified_inversion(plant, reference, move={})
    times = np.linspace(-1.0, 6.0, 141)
    for plan in (causal, modified):
        assert plan(times).x == pytest.approx(exact(times).x, abs=1e-8)
        assert plan(times).u == pytest.approx(exact(times).u, abs=1e-7)


def test_more_inputs_than_outputs() -> None:
    """Of all inputs the cheapest about the rest of the interval in force: through the jump, too, and by the same integration."""
    A = np.array([[0.0, 1.0, 0.0], [-2.0, -0.3, 0.5], [0.4, 0.0, -1.0]])
    first = at_rest_in(StateSpace(A, [[0.0, 0.0], [1.0, 0.4], [0.0, 1.0]], [[1.0, 0.0, 0.0]]), ([0.0] * 3, [2.0, 1.0], [0.0]))
    second = at_rest_in(StateSpace(A, first.B, first.C), ([0.0, 0.0, 0.6], [5.0, -1.0], [0.0]))
    plant, reference = SwitchedSystem([first, second], [1.0]), rest_to_rest(0.0, 1.0, 2.0, smoothness=3)
    plan = invert(plant, reference, R=1.0)
    assert plan.certificate.worst(exact=True) < 1e-10
    check(plan, plant, np.zeros(3), reference, start=-2.0, end=4.0)
    # With the output held still the cost is that of quadratic redesign for cheaper and cheaper inputs, off by R^(1/4).
    still = reference * 0.0
    costs = [cost(quadratic_redesign(plant, still, R=R, Q_y=1.0), R=1.0, Q_y=0.0) for R in (1e-8, 1e-10)]
    least = costs[1] + (costs[1] - costs[0]) / (100**0.25 - 1)
    assert cost(invert(plant, still, R=1.0), R=1.0, Q_y=0.0) == pytest.approx(least, rel=1e-4)
