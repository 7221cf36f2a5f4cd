"""Plans for a zero-order hold that is short beside the plant's zeros: as accurate as those for long ones."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack import StateSpace, SwitchedSystem
from invtrack.errors import CompatibilityError, NonHyperbolicError, PlanError
from invtrack.linear import zeros
from invtrack.references import stack
from tests.inversion.test_held import BOTH, CHAIN, TWO_DISC, cantilever, slew
from tests.linear.random_plants import block, plant_with
from tests.simulation.rigs import cantilever_plant

SMALL = 1e-11
"""What plans may miss their equations by: far less than is needed to hand them out, so that a loss of digits shows."""


def missed(model: object, reference: invtrack.PiecewiseSignal, hold: float) -> float:
    """What a plan misses its own equations by."""
    return invtrack.invert(model, reference, hold=hold).certificate.worst(exact=False)


@pytest.mark.parametrize("hold", [1e-2, 2e-3, 1e-3, 2.5e-4])
@pytest.mark.parametrize(
    ("model", "reference"),
    [
        pytest.param(cantilever().systems[0], slew(), id="cantilever"),
        pytest.param(cantilever(), invtrack.raised_cosine(2.0), id="cantilever that jumps"),
        pytest.param(TWO_DISC, slew(), id="two discs"),
        pytest.param(CHAIN, slew(), id="relative degree 3"),
        pytest.param(BOTH, stack([slew(), slew()]), id="two outputs"),
    ],
)
def test_no_digits_are_lost_to_short_holds(model: object, reference: invtrack.PiecewiseSignal, hold: float) -> None:
    assert missed(model, reference, hold) < SMALL


@pytest.mark.parametrize("hold", [1e-3, 2e-3])
@pytest.mark.parametrize("jumps", [False, True])
def test_the_cantilever_follows_in_mujoco_from_rest(jumps: bool, hold: float) -> None:
    model, reference = cantilever(), invtrack.raised_cosine(2.0)
    model = model if jumps else SwitchedSystem(model.systems[:1], [])
    plan = invtrack.invert(model, reference, hold=hold, tolerance=1e-11)
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=100.0, R=0.01))
    run = invtrack.simulate(cantilever_plant(), controller, timestep=hold)
    assert np.max(np.abs(run.output.values - run.reference.values)) < 1e-9  # of a motion by 2


@pytest.mark.parametrize("model", [TWO_DISC, cantilever().systems[0]], ids=["two discs", "cantilever"])
def test_the_continuous_inverse_is_the_limit_which_is_approached_by_the_square_of_the_hold(model: StateSpace) -> None:
    """Before the motion, too, where zeros on the right go on in the tail: what is found there has digits enough for it."""
    continuous, times = invtrack.invert(model, slew()), np.linspace(-3.0, 7.0, 41)
    holds = np.array([4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4])
    for side in (times < 0, times >= 0):
        off = []
        for hold in holds:
            at = np.round(times[side] / hold) * hold  # where holds begin
            off.append(np.max(np.abs(invtrack.invert(model, slew(), hold=hold).states(at) - continuous.states(at))))
        np.testing.assert_allclose(np.diff(np.log(off)) / np.diff(np.log(holds)), 2.0, atol=0.01)


@pytest.mark.parametrize("share", [0.3, 3e-2, 3e-3, 3e-4])
@pytest.mark.parametrize("seed", range(8))
def test_random_plants(seed: int, share: float) -> None:
    """Relative degrees 1 to 3, one output or two, in mixed coordinates, held for a share of the time scale of their zeros."""
    rng = np.random.default_rng([7, seed])
    degrees = [int(degree) for degree in rng.integers(1, 4, int(rng.integers(1, 3)))]
    places = rng.normal(size=int(rng.integers(1, 5)))
    model = plant_with(rng, degrees, block(*(places + np.copysign(0.2, places))))
    reference = invtrack.rest_to_rest(np.zeros(len(degrees)), rng.normal(size=len(degrees)), 2.0, smoothness=max(degrees))
    assert missed(model, reference, share / float(np.exp(np.mean(np.log(np.abs(zeros(model))))))) < SMALL


@pytest.mark.parametrize("zero", [1e-2, -1e-2, 1e-3, -1e-3])
def test_a_zero_that_a_hold_changes_by_rounding_only_keeps_its_rate(zero: float) -> None:
    """Held for 1e-3 s, its multiplier is 1 to within 1e-6; before and after the motion its share decays at its own rate."""
    model = plant_with(np.random.default_rng(2), [2], block(zero, -0.7))
    plan = invtrack.invert(model, slew(), hold=1e-3)
    assert plan.certificate.worst(exact=False) < SMALL
    tail = plan.trajectory.before if zero > 0 else plan.trajectory.after
    slowest = tail.departure.eigenvalues[np.argmin(np.abs(tail.departure.eigenvalues))]
    assert -slowest.real == pytest.approx(abs(zero), rel=1e-6)


def test_a_zero_at_the_origin_rests_where_the_holds_leave_it() -> None:
    """A spring whose speed follows: where it is at rest in the end, and the force that holds it, are not those without holds."""
    spring = StateSpace([[0, 1], [-1, -1]], [[0], [1]], [[0, 1]])
    there_and_back = slew() - slew().shifted(5.0)
    plan = invtrack.invert(spring, there_and_back, hold=1e-2)
    assert plan.certificate.worst(exact=False) < SMALL
    x, u = plan.states([30.0])[0], plan.inputs([30.0])[0]
    np.testing.assert_allclose([x[0], x[1]], [u[0], 0.0], atol=1e-14)
    assert 1e-9 < abs(x[0] - invtrack.invert(spring, there_and_back).states([30.0])[0, 0]) < 1e-4


def test_each_interval_meets_its_outputs_where_its_relative_degree_asks_for_it() -> None:
    """A force that for a while moves the position at once: outputs are met in the middle of holds, and at their ends meanwhile."""
    late, soon = (StateSpace([[0, 1], [-1.0, -0.5]], [[direct], [1.0]], [[1, 0]]) for direct in (0.0, 0.5))
    model, hold = SwitchedSystem([late, soon, late], [1.0, 3.0]), 0.02
    plan = invtrack.invert(model, slew(), hold=hold, tolerance=1e-14)
    assert plan.certificate.worst(exact=False) < SMALL
    starts = plan.breakpoints[:-1]
    meanwhile = (starts > 1.0 - hold / 2) & (starts < 3.0 - hold / 2)
    met = starts + np.where(meanwhile, hold, hold / 2)
    np.testing.assert_allclose(plan.states(met)[:, 0], plan.reference(met)[:, 0], atol=SMALL)


def test_zeros_on_the_axis_are_gone_through_whether_they_are_slow_beside_the_hold_or_not() -> None:
    """A reference that leaves the load of an undamped crane at rest: holds leave almost nothing in it, the shorter they are."""
    crane = StateSpace([[0, 1, 0, 0], [0, -1, 1, 0], [0, 0, 0, 1], [0, 1, -9, 0]], [[0], [1], [0], [-1]], [[1, 0, 0, 0]])
    (swing,) = zeros(crane).imag[zeros(crane).imag > 0]
    twice = 0.5 * (slew() + slew().shifted(np.pi / swing))
    for hold in (1e-3, 2.5e-4):
        assert missed(crane, twice, hold) < 1e-9
    with pytest.raises(NonHyperbolicError, match=rf"held for 0.2 s does not come to rest: .* \(0\+-{swing:.4g}j\)"):
        invtrack.invert(crane, twice, hold=0.2)


@pytest.mark.parametrize("zero", [0.2, 0.5, 0.8])
def test_zeros_that_are_hardly_damped_and_no_longer_slow(zero: float) -> None:
    """Held for 1 s, their multipliers are beside the unit circle, and far from 1; the input is no polynomial within a hold."""
    model = plant_with(np.random.default_rng(4), [2], block(complex(1e-3, zero), complex(-1e-3, zero), -0.5))
    reference = invtrack.rest_to_rest(0.0, 1.0, duration=20.0, smoothness=4)
    assert missed(model, reference, 1.0) < 1e-10


def test_outputs_that_jump_with_the_parameters_are_refused() -> None:
    """The sum of place and half the speed becomes the place: no state is continuous and keeps both, held or not."""
    A, B = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -4.0, -1.0]]), np.array([[0.0], [0.0], [1.0]])
    model = SwitchedSystem([StateSpace(A, B, [[1.0, 0.5, 0.0]]), StateSpace(A, B, [[1.0, 0.0, 0.0]])], [1.0])
    with pytest.raises(CompatibilityError):
        invtrack.invert(model, slew())
    with pytest.raises(PlanError, match=r"miss by .* of their motion in between.*no continuous state"):
        invtrack.invert(model, slew(), hold=1e-2)
