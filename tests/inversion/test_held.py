"""Linear plans for a zero-order hold: driven as they are held, outputs are exact once in each hold."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

import invtrack
from invtrack import StateSpace, SwitchedSystem
from invtrack.errors import BoundednessError, NonHyperbolicError, PlanError, RelativeDegreeError, TrajectoryError
from invtrack.inversion import held
from invtrack.linear.state_space import OperatingPoint
from invtrack.linear.switched import as_switched
from invtrack.references import stack
from tests.simulation.rigs import JUMPS, MASSES, cantilever_plant

TWO_DISC = StateSpace(
    [[0, 1, 0, 0], [-3.1555, -0.1640, 3.1555, 0.3845], [0, 0, 0, 1], [2.8956, -0.0899, -2.8956, -0.1124]],
    [[0], [1.8139], [0], [0.27]],
    [[0, 0, 1, 0]],
)
"""The two-disc rig of Devasia 1996: relative degree 2, zeros 0.22 +- 4.75j."""

ODD = StateSpace([[0, 1], [-1, -0.3]], [[0], [1]], [[-1, 0.5]])
"""Relative degree 1, a zero at 2."""

CHAIN = StateSpace([[0, 1, 0], [0, 0, 1], [-1, -2, -3]], [[0], [0], [1]], [[1, 0, 0]])
"""Relative degree 3, no zeros."""

BOTH = StateSpace(
    np.block([[TWO_DISC.A, np.zeros((4, 2))], [0.1 * np.ones((2, 4)), ODD.A]]),
    np.block([[TWO_DISC.B, np.zeros((4, 1))], [np.zeros((2, 1)), ODD.B]]),
    np.block([[TWO_DISC.C, np.zeros((1, 2))], [np.zeros((1, 4)), ODD.C]]),
)
"""Outputs of relative degrees 2 and 1, which are met in the middle and at the end of a hold."""


def slew(smoothness: int = 4) -> invtrack.PiecewiseSignal:
    return invtrack.rest_to_rest(0.0, 1.0, duration=4.0, smoothness=smoothness)


def cantilever() -> SwitchedSystem:
    plant = cantilever_plant()
    return SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)


def errors(model: object, plan: invtrack.Plan, hold: float) -> tuple[np.ndarray, np.ndarray]:
    """Of a run with state feedback, the input held over each step: in the middle of steps, and at their ends (., p)."""
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
    run = invtrack.simulate(invtrack.LinearPlant(model), controller, timestep=hold, vibration_period=1.0)
    plant, middles = as_switched(model), (run.time[:-1] + run.time[1:]) / 2
    reached = np.empty((len(middles), plant.n_outputs))
    for k, t in enumerate(middles):
        system, half = plant.systems[int(plant.interval(t))], (run.time[k + 1] - run.time[k]) / 2
        n, m = system.B.shape
        u = run.applied.values[k] - system.operating_point.u0
        step = scipy.linalg.expm(np.block([[system.A, system.B], [np.zeros((m, n + m))]]) * half)
        x = step[:n] @ np.concatenate([run.state.values[k] - system.rest, u])
        reached[k] = system.operating_point.y0 + system.C @ x + system.D @ u
    return reached - plan.reference(middles), run.output.values - run.reference.values


@pytest.mark.parametrize("hold", [0.02, 0.05])
@pytest.mark.parametrize(
    ("model", "reference", "at_end"),
    [(TWO_DISC, slew(), [False]), (ODD, slew(), [True]), (CHAIN, slew(), [True]), (BOTH, stack([slew(), slew()]), [False, True])],
)
def test_outputs_are_exact_once_in_each_hold(
    model: StateSpace, reference: invtrack.PiecewiseSignal, at_end: list[bool], hold: float
) -> None:
    plan = invtrack.invert(model, reference, hold=hold, tolerance=1e-14)
    middle, end = errors(model, plan, hold)
    for i, last in enumerate(at_end):
        exact, ripple = (end, middle) if last else (middle, end)
        assert np.max(np.abs(exact[:, i])) < 1e-11
        assert np.max(np.abs(ripple[:, i])) <= plan.certificate.output_error + 1e-11
    assert plan.certificate.worst(exact=False) < 1e-10
    assert any(f"zero-order hold of {hold:g} s" in remark for remark in plan.remarks)


def test_without_it_holding_costs_its_square() -> None:
    plan, holds = invtrack.invert(TWO_DISC, slew(), tolerance=1e-12), np.array([0.04, 0.02, 0.01])
    worst = [np.max(np.abs(np.vstack(errors(TWO_DISC, plan, hold)))) for hold in holds]
    np.testing.assert_allclose(np.diff(np.log(worst)) / np.diff(np.log(holds)), 2.0, atol=0.1)


def test_through_jumps_that_lie_no_whole_number_of_holds_apart() -> None:
    """Holds begin at jumps; those of a run fall on the plan's."""
    model, hold = cantilever(), 0.01
    plan = invtrack.invert(model, invtrack.raised_cosine(2.0), hold=hold)
    assert set(JUMPS) <= set(plan.breakpoints)
    assert np.max(np.diff(plan.breakpoints)) <= hold * (1 + 1e-9)
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=100.0, R=0.01))
    run = invtrack.simulate(invtrack.LinearPlant(model), controller, timestep=hold)
    error = np.max(np.abs(run.output.values - run.reference.values))
    assert error <= 2 * 1.1 * plan.certificate.output_error  # of a motion by 2, in between points
    mean = invtrack.TrackingController(invtrack.invert(model, invtrack.raised_cosine(2.0)), controller.gains)
    run = invtrack.simulate(invtrack.LinearPlant(model), mean, timestep=hold)
    assert np.max(np.abs(run.output.values - run.reference.values)) > 1000 * error


def test_equilibria_that_move_with_a_jump() -> None:
    """A mass on a spring that is loaded: the outputs are held where they are by another force."""
    free, loaded = (
        StateSpace(
            [[0, 1], [-2.0, -0.3]],
            [[0], [1 / mass]],
            [[1, 0]],
            operating_point=OperatingPoint(x0=np.zeros(2), u0=np.zeros(1), y0=np.array([rest])),
            rest=[rest, 0.0],
            parameters={"mass": mass},
        )
        for mass, rest in ((1.0, 0.0), (2.0, -0.5))
    )
    model = SwitchedSystem([free, loaded], [1.003])
    plan = invtrack.invert(model, slew(), hold=0.02)
    middle, _ = errors(model, plan, 0.02)
    steady = plan.inputs([50.0])[0, 0]
    assert steady == pytest.approx(2.0 * (2.0 * 1.5), rel=1e-9)
    assert np.max(np.abs(middle)) < 1e-10


def test_rest_is_measured_where_the_plan_ends_beyond_its_holds() -> None:
    plan = invtrack.invert(cantilever().systems[0], slew(), hold=5e-3)  # zeros at +-0.23 and +-1.8 rad/s
    assert 0 < plan.certificate.rest_residual < 1e-8


def test_a_point_of_the_wrong_parity_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    schemes = held.candidate_schemes(1, 1)
    monkeypatch.setattr(held, "candidate_schemes", lambda count, outputs: [schemes[1]])
    with pytest.raises(NonHyperbolicError, match=r"come within \|log \|lambda\|\| = .* circle, .*: sampling adds such modes"):
        invtrack.invert(TWO_DISC, slew(), hold=0.02)


CRANE = StateSpace([[0, 1, 0, 0], [0, -1, 1, 0], [0, 0, 0, 1], [0, 1, -9, 0]], [[0], [1], [0], [-1]], [[1, 0, 0, 0]])
"""A load that swings undamped below what is tracked: zeros on the imaginary axis."""

RIGHT, LEFT = (StateSpace([[0, 1], [-1, -1]], [[0], [1]], [[sign, 1]]) for sign in (-1.0, 1.0))


@pytest.mark.parametrize(
    ("model", "reference", "options", "error", "message"),
    [
        (TWO_DISC, slew(), {"hold": 0.0}, PlanError, "hold must be a positive number of seconds"),
        (TWO_DISC, slew(), {"hold": 0.01, "R": 1.0}, PlanError, "R chooses among inputs that are left over"),
        (TWO_DISC, slew(), {"hold": 1e-6}, PlanError, "holds of 1e-06 s, of which 200000 are planned at most"),
        (
            StateSpace([[0, 1], [0, 0]], [[0, 0], [1, 2]], [[1, 0]]),
            slew(),
            {"hold": 0.01},
            RelativeDegreeError,
            "as many inputs as outputs, got 2 inputs",
        ),
        (TWO_DISC, slew(), {"hold": 0.25}, NonHyperbolicError, "zeros about as fast as the holds do that, and there are 0.22"),
        (TWO_DISC, slew(0), {"hold": 0.01}, TrajectoryError, "not smooth enough"),
        (
            TWO_DISC,
            invtrack.references.sinusoidal_exosystem([2.0]).reference([0.0, 0.0, 1.0], at=0.0),
            {"hold": 0.01},
            TrajectoryError,
            "goes on moving before its breakpoints; a plan for a zero-order hold leads from rest to rest",
        ),
        (CRANE, slew(), {"hold": 0.01}, NonHyperbolicError, "some of it is left in zeros on the imaginary axis"),
        (
            SwitchedSystem([LEFT, RIGHT], [1.0]),
            slew(),
            {"hold": 0.01},
            BoundednessError,
            "before the manoeuvre 0 mode\\(s\\).* after it 1, which gives",
        ),
        (
            StateSpace([[0, 1], [-1, -1]], [[0], [1]], [[0, 1]]),
            slew(),
            {"hold": 0.01},
            NonHyperbolicError,
            "zeros at 0 lie on the imaginary axis .*, and outputs held at \\[1.0\\] after the manoeuvre",
        ),
    ],
)
def test_refusals(model: object, reference: object, options: dict[str, float], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        invtrack.invert(model, reference, **options)  # type: ignore[arg-type]
