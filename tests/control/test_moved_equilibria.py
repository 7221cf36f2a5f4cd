"""Controllers through jumps that move the equilibrium, on the linear plant: they act on states of one frame."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import invtrack
from invtrack.linear.state_space import Measurement
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.exosystem import sinusoidal_exosystem
from invtrack.references.profiles import raised_cosine
from tests.equilibria import CANTILEVERS, JUMPS

OBSERVER_POLES = (-2 + 2j, -2 - 2j, -1.5 + 1j, -1.5 - 1j, -1 + 0.5j, -1 - 0.5j)
SEEN = np.eye(6)[:2]


def measuring(system: invtrack.StateSpace) -> invtrack.StateSpace:
    """Base and tip position, in absolute units."""
    y0 = SEEN @ (system.operating_point.x0) + [10.0, 20.0]
    return replace(system, measurement=Measurement(SEEN, np.zeros((2, 1)), ("base", "tip"), y0))


MODEL = SwitchedSystem([measuring(system) for system in CANTILEVERS], JUMPS)
MOTION = raised_cosine(2.0) + 0.5
# The same plants about one equilibrium.
STILL = SwitchedSystem(
    [invtrack.StateSpace(s.A, s.B, s.C, measurement=replace(s.measurement, y0=np.zeros(2))) for s in MODEL.systems], JUMPS
)
GAINS = invtrack.lqr(MODEL, Q=100.0, R=0.01)


@pytest.fixture(scope="module")
def plan() -> invtrack.Plan:
    return invtrack.invert(MODEL, MOTION)


@pytest.fixture(scope="module")
def still() -> invtrack.Plan:
    return invtrack.invert(STILL, raised_cosine(2.0))


def run(controller: Any, *, off: float = 0.0, timestep: float = 0.01, **options: Any) -> invtrack.RunResult:
    start, model = -5.0, controller.plan.model
    initial = controller.plan(start).x[0] + off * np.array([0.1, -0.2, 0.05, 0.0, 0.1, 0.0])
    return invtrack.simulate(
        invtrack.LinearPlant(model), controller, start=start, end=12.0, timestep=timestep, initial_state=initial, **options
    )


def errors(result: invtrack.RunResult) -> np.ndarray:
    return np.abs(result.output.values - result.reference.values).max(axis=1)


def test_feedforward_alone_follows_through_the_jumps(plan: invtrack.Plan) -> None:
    exact = run(invtrack.TrackingController(plan), evaluate="stages", timestep=2e-3)
    assert np.max(errors(exact)) < 1e-8
    assert np.max(np.abs(exact.state.values - exact.state_reference.values)) < 1e-8


def test_held_inputs_cost_an_error_of_the_order_of_the_hold_squared(plan: invtrack.Plan) -> None:
    largest = [np.max(errors(run(invtrack.TrackingController(plan), timestep=h))) for h in (0.02, 0.01)]
    assert np.log2(largest[0] / largest[1]) == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize(("observed", "period"), [(False, None), (True, 0.05)])
def test_a_disturbance_goes_as_it_does_about_one_equilibrium(
    plan: invtrack.Plan, still: invtrack.Plan, observed: bool, period: float | None
) -> None:
    """The equations of the deviation from the plan know no equilibrium: also for an estimate, and with jumps within a hold."""

    def left_by(of: invtrack.Plan) -> np.ndarray:
        """What a disturbance of the start does to the state."""
        if observed:
            observer = invtrack.LuenbergerObserver(OBSERVER_POLES)
            controller: Any = invtrack.OutputFeedbackController(of, GAINS, observer, period=period)
        else:
            controller = invtrack.TrackingController(of, GAINS, period=period)
        disturbed, undisturbed = (run(controller, off=off) for off in (1.0, 0.0))
        return np.asarray(disturbed.state.values - undisturbed.state.values)

    moved, plain = left_by(plan), left_by(still)
    assert np.max(np.abs(plain)) > 0.1
    assert moved == pytest.approx(plain, abs=1e-9 * np.max(np.abs(plain)))


@pytest.mark.parametrize("timestep", [0.05, 0.013])
def test_an_observer_costs_nothing_where_nothing_disturbs(plan: invtrack.Plan, timestep: float) -> None:
    """Jumps of the equilibrium within a hold included: where it goes then is known."""
    state = run(invtrack.TrackingController(plan, GAINS, period=0.05), timestep=timestep)
    observer = invtrack.LuenbergerObserver(OBSERVER_POLES)
    seen = run(invtrack.OutputFeedbackController(plan, GAINS, observer, period=0.05), timestep=timestep)
    assert np.max(np.abs(seen.output.values - state.output.values)) < 1e-8
    assert np.max(np.abs(seen.commanded.values - state.commanded.values)) < 1e-7 * np.max(np.abs(state.commanded.values))
    expected = SEEN @ (plan(-5.0).x[0] + CANTILEVERS[0].operating_point.x0) + [10.0, 20.0]
    assert seen.measured is not None
    assert seen.measured.values[0] == pytest.approx(expected)


@pytest.mark.parametrize("observed", [False, True])
def test_regulation_in_feedback_form(observed: bool) -> None:
    sway, x_e = sinusoidal_exosystem([1.3]), np.array([0.1, 0.3, -0.2])
    regulation = invtrack.exosystem_map(MODEL, sway)
    options = {"state_observer": invtrack.LuenbergerObserver(OBSERVER_POLES)} if observed else {}
    controller = invtrack.ExosystemController(regulation, GAINS, exosystem_state=x_e, **options)  # type: ignore[arg-type]
    held, tracking = run(controller), run(invtrack.TrackingController(regulation.plan(x_e), GAINS))
    np.testing.assert_allclose(held.output.values, tracking.output.values, atol=1e-6)
    assert np.max(errors(held)) < 5e-3


def test_a_plant_that_is_at_rest_elsewhere_is_refused(plan: invtrack.Plan) -> None:
    moved = SwitchedSystem([replace(system, rest=np.full(6, 0.1)) for system in MODEL.systems], JUMPS)
    with pytest.raises(invtrack.errors.SimulationError, match="another operating point than the plant's"):
        invtrack.simulate(invtrack.LinearPlant(moved), invtrack.TrackingController(plan), start=-1.0, end=1.0)
