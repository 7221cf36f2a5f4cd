"""Regulation in feedback form against the planned trajectory, direct evaluation, and the decay that the poles promise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg

from invtrack.control.exosystem_controller import ExosystemController
from invtrack.control.gains import GainSchedule, place
from invtrack.control.observer import KalmanFilter, LuenbergerObserver
from invtrack.control.protocol import Instants
from invtrack.control.tracking_controller import TrackingController
from invtrack.errors import ControlError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import Measurement, OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.references.exosystem import exosystem
from invtrack.references.profiles import raised_cosine
from invtrack.regulation.exosystem_map import exosystem_map
from invtrack.regulation.francis_map import switched_francis
from invtrack.regulation.regulation_map import RegulationMap
from invtrack.results import max_error
from invtrack.results.result import RunResult
from invtrack.simulation.closed_loop import simulate
from invtrack.simulation.linear_plant import LinearPlant
from tests.cited_plants import CANTILEVER_TIP_MASSES, cantilever_paper

A_E = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])
C_E = np.array([[0.0, 0, 0, 1]])
X_E = np.array([0.0, 1, 0, 0])
JUMPS = (np.pi / 2, 3 * np.pi / 2)
POLES = (-0.4 + 2j, -0.4 - 2j, -0.3 + 0.3j, -0.3 - 0.3j, -0.12 + 0.08j, -0.12 - 0.08j)
OBSERVER_POLES = (-3.0, -4.0, -5.0, -6.0)


def cantilever(tip_mass: float, point: OperatingPoint | None = None) -> StateSpace:
    """The printed plant that measures base and tip position."""
    seen = Measurement(np.eye(6)[:2], np.zeros((2, 1)), ("base", "tip"), np.array([0.5, -0.5]))
    return StateSpace(*cantilever_paper(tip_mass), operating_point=point, measurement=seen)


MODEL = SwitchedSystem([cantilever(m) for m in CANTILEVER_TIP_MASSES], JUMPS)
WANTED = exosystem(A_E, C_E, start=0.0, end=2 * np.pi)
GAINS = place(MODEL, POLES)


@pytest.fixture(scope="module")
def exact() -> RegulationMap:
    return exosystem_map(MODEL, WANTED)


@pytest.fixture(scope="module")
def plan(exact: RegulationMap) -> Plan:
    return exact.plan(X_E)


def controller(regulation: RegulationMap, **options: Any) -> ExosystemController:
    return ExosystemController(regulation, GAINS, exosystem_state=X_E, **options)


def drive(law: Any, *, start: float = 0.0, end: float = 9.0, timestep: float = 0.01, **options: Any) -> RunResult:
    options.setdefault("initial_state", law.plan(start).x[0])
    return simulate(LinearPlant(MODEL), law, start=start, end=end, timestep=timestep, **options)


def straddling() -> Instants:
    """Holds with a jump of the plant in one, the end of the exosystem in another, and none in the rest."""
    time = np.array([-1.0, 0.0, 1.5, 3.0, 6.2, 7.0])
    first = np.array([0, 1, 2, 4, 5, 7])
    lengths = np.array([0.1, 0.1, JUMPS[0] - 1.5, 1.6 - JUMPS[0], 0.1, 2 * np.pi - 6.2, 6.3 - 2 * np.pi, 0.1])
    starts = np.array([-1.0, 0.0, 1.5, JUMPS[0], 3.0, 6.2, 2 * np.pi, 7.0])
    middle = starts + lengths / 2
    return Instants(time, np.full(6, 0.1), middle[first], first, middle, middle, lengths / 0.1)


def test_with_the_exosystem_known_it_is_tracking_of_the_plan(exact: RegulationMap, plan: Plan) -> None:
    asked, rng = straddling(), np.random.default_rng(0)
    law, tracking = controller(exact).begin(asked), TrackingController(plan, GAINS).begin(asked)
    for i in range(len(asked.time)):
        x = rng.normal(size=6)
        assert law.update(i, x) == pytest.approx(tracking.update(i, x), rel=1e-9)


def test_a_whole_run_is_that_of_tracking_the_inverse(exact: RegulationMap) -> None:
    """The inverse of the same reference, found without any map; also with the law evaluated at every stage."""
    tracking = TrackingController(invert(MODEL, raised_cosine(2.0)), GAINS)
    for evaluate in ("held", "stages"):
        ours = drive(controller(exact), start=-5.0, evaluate=evaluate, timestep=0.02)
        theirs = drive(tracking, start=-5.0, evaluate=evaluate, timestep=0.02)
        np.testing.assert_allclose(
            ours.commanded.values, theirs.commanded.values, atol=1e-6 * np.abs(theirs.commanded.values).max()
        )
        np.testing.assert_allclose(ours.output.values, theirs.output.values, atol=1e-8)


def test_against_direct_evaluation_with_an_estimate(exact: RegulationMap) -> None:
    """u = mean of F(t) exp(A_e (t - t_i)) x_hat_e over the hold - K (x - G x_hat_e), parts of the hold by the midpoint rule."""
    asked, guess = straddling(), np.array([0.2, 0.7, -0.1, 0.3])
    estimated = controller(exact, exosystem_observer=LuenbergerObserver(OBSERVER_POLES), initial_estimate=guess)
    x_e, law = estimated.exosystem_states(asked), estimated.begin(asked)
    assert np.abs(x_e[0] - WANTED.states(X_E, 0.0, [-1.0])[0]).max() > 0.1
    rng = np.random.default_rng(1)
    for i, t in enumerate(asked.time):
        x, u = rng.normal(size=6), np.zeros(1)
        for j in np.flatnonzero(asked.part_owner == i):
            at = asked.part_middle[j]
            u += asked.part_share[j] * (exact.u_map([at])[0] @ WANTED.transition(t, at) @ x_e[i])
        K = GAINS.gains[int(GAINS.interval(asked.inside[i]))]
        u -= K @ (x - exact.x_map([t], inside=[asked.inside[i]])[0] @ x_e[i])
        assert law.update(i, x) == pytest.approx(u, rel=1e-9, abs=1e-9)


def test_input_is_absolute_and_state_a_deviation(exact: RegulationMap) -> None:
    point = OperatingPoint(x0=np.zeros(6), u0=np.array([7.0]), y0=np.array([3.0]))
    lifted = exosystem_map(SwitchedSystem([cantilever(m, point) for m in CANTILEVER_TIP_MASSES], JUMPS), WANTED)
    asked, x = straddling(), np.arange(6.0)
    for options in ({}, {"exosystem_observer": LuenbergerObserver(OBSERVER_POLES)}):
        high, low = controller(lifted, **options).begin(asked), controller(exact, **options).begin(asked)
        assert [high.update(i, x)[0] - 7.0 for i in range(6)] == pytest.approx([low.update(i, x)[0] for i in range(6)], rel=1e-6)


def test_closed_loop_poles_are_the_same_in_every_interval() -> None:
    for system, K in zip(MODEL.systems, GAINS.gains, strict=True):
        poles = np.linalg.eigvals(system.A - system.B @ K)
        assert np.sort_complex(poles) == pytest.approx(np.sort_complex(np.array(POLES)), rel=1e-5)


def test_plant_and_estimate_are_a_cascade() -> None:
    """Nothing switches, so G is constant: the error of x lies in the span of the sampled loop's and the estimator's modes."""
    system, h = MODEL.systems[0], 0.01
    constant = switched_francis(system, exosystem(A_E, C_E, start=0.0, end=30.0))
    law = ExosystemController(constant, GAINS.gains[0], exosystem_state=X_E, exosystem_observer=LuenbergerObserver(OBSERVER_POLES))
    run = simulate(LinearPlant(system), law, start=0.0, end=10.0, timestep=h, initial_state=np.full(6, 0.1))
    block = scipy.linalg.expm(np.block([[system.A, system.B], [np.zeros((1, 7))]]) * h)[:6]
    closed = np.linalg.eigvals(block[:, :6] - block[:, 6:] @ GAINS.gains[0])
    count = np.arange(len(run.time))
    decaying = np.column_stack([pole**count for pole in (*closed, *np.exp(h * np.array(OBSERVER_POLES)))])
    held = np.column_stack([np.ones(len(count)), run.time, np.cos(run.time), np.sin(run.time)])  # what sampling leaves, with x_e
    error = run.state.values - run.state_reference.values
    modes = np.hstack([decaying, held])
    fitted, *_ = np.linalg.lstsq(modes, error.astype(complex), rcond=None)
    np.testing.assert_allclose(modes @ fitted, error, atol=1e-7 * np.abs(error).max())
    np.testing.assert_allclose(held @ fitted[-4:], 0, atol=1e-3 * np.abs(error).max())
    assert np.abs(error).max() > 1.0


def test_a_right_first_estimate_costs_nothing(exact: RegulationMap) -> None:
    known = drive(controller(exact), start=-5.0)
    options = {"exosystem_observer": LuenbergerObserver(OBSERVER_POLES), "initial_estimate": X_E}
    estimated = drive(controller(exact, **options), start=-5.0)
    np.testing.assert_allclose(estimated.commanded.values, known.commanded.values, atol=1e-6 * np.abs(known.commanded.values).max())


@pytest.mark.parametrize("observers", [{}, {"exosystem_observer": LuenbergerObserver(OBSERVER_POLES), "initial_estimate": X_E}])
def test_sampling_costs_second_order(exact: RegulationMap, observers: dict[str, Any]) -> None:
    """Without a forecast of x_hat_e over the hold it would be first order."""
    errors = [max_error(drive(controller(exact, **observers), timestep=step)) for step in (0.04, 0.01)]
    assert np.log(errors[0] / errors[1]) / np.log(4) == pytest.approx(2.0, abs=0.2)


def test_unknown_before_the_start_means_no_preactuation(exact: RegulationMap) -> None:
    run = drive(controller(exact, exosystem_observer=LuenbergerObserver(OBSERVER_POLES)), start=-3.0, initial_state=np.zeros(6))
    before = run.time < 0
    assert np.all(run.state.values[before] == 0)
    assert max_error(run) > 0.1


def test_switched_francis_is_exact_until_the_first_jump(exact: RegulationMap, plan: Plan) -> None:
    francis = switched_francis(MODEL, WANTED)
    x_0 = francis.x_map([0.0], inside=[0.1])[0] @ X_E
    run = drive(controller(francis, plan=plan), initial_state=x_0, timestep=2e-3)
    error = np.abs(run.error[:, 0])
    before, after = run.time < JUMPS[0], run.time > JUMPS[0]
    assert error[before].max() < 1e-6
    assert error[after].max() > 1.0
    assert max_error(drive(controller(exact), timestep=2e-3)) < 1e-5


@pytest.mark.parametrize("observers", [{}, {"exosystem_observer": LuenbergerObserver(OBSERVER_POLES)}])
@pytest.mark.parametrize("period", [None, 0.05])
def test_a_state_estimated_without_error_is_as_good_as_measured(
    exact: RegulationMap, observers: dict[str, Any], period: float | None
) -> None:
    """Separation: a start in G x_hat_e is where the estimator starts too, and then no correction of x_hat_e misleads it."""
    sensed = controller(exact, state_observer=KalmanFilter(0.02, 1e-3), period=period, **observers)
    rest = np.zeros(6) if observers else exact.plan(X_E)(-2.0).x[0]
    measured = drive(controller(exact, period=period, **observers), start=-2.0, initial_state=rest)
    estimated = drive(sensed, start=-2.0, initial_state=rest)
    np.testing.assert_allclose(
        estimated.commanded.values, measured.commanded.values, atol=1e-7 * np.abs(measured.commanded.values).max()
    )
    if period is None:
        np.testing.assert_allclose(estimated.estimate.values, estimated.state.values[:-1], atol=1e-7)


def test_noise_of_the_reference_is_drawn_with_its_seed(exact: RegulationMap) -> None:
    def estimates(**options: Any) -> np.ndarray:
        time = np.linspace(0.0, 6.0, 600, endpoint=False)
        asked = Instants.undivided(time, np.full(600, 0.01), time + 0.005)
        law = controller(exact, exosystem_observer=LuenbergerObserver(OBSERVER_POLES), **options)
        assert np.array_equal(law.exosystem_states(asked), law.exosystem_states(asked))
        return law.exosystem_states(asked)

    clean, noisy, again = estimates(), estimates(reference_noise=1e-3), estimates(reference_noise=1e-3, seed=1)
    late = slice(400, None)
    assert 1e-4 < np.std((noisy - clean)[late]) < 1e-1
    assert not np.array_equal(noisy, again)
    np.testing.assert_allclose(estimates(reference_noise=2e-3) - clean, 2 * (noisy - clean), atol=1e-12)


def test_an_exosystem_that_runs_for_ever_is_followed_through_the_jumps() -> None:
    """Its state may be stated at any time, here one at which nothing switches."""
    forever = exosystem_map(MODEL, exosystem(A_E, C_E))
    known = ExosystemController(forever, GAINS, exosystem_state=X_E, at=0.25)
    estimated = ExosystemController(
        forever, GAINS, exosystem_state=X_E, at=0.25, exosystem_observer=LuenbergerObserver(OBSERVER_POLES)
    )
    run = drive(known, start=-10.0, end=20.0)
    np.testing.assert_allclose(run.reference["y1"], 1 - np.cos(run.time - 0.25), atol=1e-9)
    assert max_error(run) < 1e-4
    late = drive(estimated, start=-100.0, end=20.0)
    assert np.abs(late.error[late.time > -20]).max() < 1e-3


def test_what_the_loop_is_told(exact: RegulationMap) -> None:
    plain = controller(exact)
    assert (plain.measures, plain.stateless) == ("state", True)
    assert (controller(exact, state_observer=KalmanFilter(1.0, 1.0)).measures) == "sensors"
    assert not controller(exact, exosystem_observer=LuenbergerObserver(OBSERVER_POLES)).stateless
    later = GainSchedule((GAINS.gains[0], GAINS.gains[1]), np.array([1.25]))
    assert ExosystemController(exact, later, exosystem_state=X_E).breakpoints == pytest.approx([0, 1.25, *JUMPS, 2 * np.pi])


def test_what_does_not_fit_is_refused(exact: RegulationMap) -> None:
    with pytest.raises(ControlError, match=r"expected a RegulationMap, such as exosystem_map\(...\), got Plan"):
        ExosystemController(exact.plan(X_E), GAINS, exosystem_state=X_E)  # type: ignore[arg-type]
    with pytest.raises(ControlError, match=r"wanted output is 1 away .* make `plan` for"):
        controller(exact, plan=exact.plan(1.5 * X_E))
    with pytest.raises(ControlError, match="give an exosystem_observer"):
        controller(exact, initial_estimate=X_E)
    with pytest.raises(ControlError, match="give an exosystem_observer"):
        controller(exact, reference_noise=0.1)
    with pytest.raises(ControlError, match="reference_noise must be finite and not negative"):
        controller(exact, exosystem_observer=LuenbergerObserver(OBSERVER_POLES), reference_noise=-1.0)
    with pytest.raises(ControlError, match=r"initial_estimate must be finite, one number for each of \['x_e1', "):
        controller(exact, exosystem_observer=LuenbergerObserver(OBSERVER_POLES), initial_estimate=[1.0, 2.0])
    named = [StateSpace(s.A, s.B, s.C, states=list("abcdef")) for s in MODEL.systems]
    with pytest.raises(ControlError, match=r"the map has the states x1, x2, .*the plan has a, b, "):
        controller(exact, plan=invert(SwitchedSystem(named, JUMPS), raised_cosine(2.0)))


def test_an_exosystem_that_hides_a_state_cannot_be_estimated() -> None:
    more = exosystem(scipy.linalg.block_diag(A_E, -0.5), np.append(C_E, [[0.0]], axis=1), start=0.0, end=2 * np.pi)
    x_e = [*X_E, 0.0]
    regulation = exosystem_map(MODEL, more)
    assert ExosystemController(regulation, GAINS, exosystem_state=x_e).stateless
    with pytest.raises(ControlError, match=r"in interval 1 .* does not show its mode\(s\) with eigenvalue\(s\) -0.5,"):
        ExosystemController(regulation, GAINS, exosystem_state=x_e, exosystem_observer=LuenbergerObserver((*OBSERVER_POLES, -7.0)))
