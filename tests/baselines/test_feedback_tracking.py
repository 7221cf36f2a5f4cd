"""Following by feedback against independent integration, type of the loop, and what shapers promise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import invtrack
from invtrack.baselines import base_servo, feedback_tracking, flexible_modes, residual_vibration_ratio, shaper
from invtrack.errors import ControlError, InversionError, ModelError, PlanError, RelativeDegreeError, TrajectoryError
from invtrack.linear import OperatingPoint
from invtrack.references import autonomous, constant, rest_to_rest, s_curve
from invtrack.references.generator import Generator
from tests.baselines.plants import carrier, integrated

CARRIER = carrier()
SERVO = base_servo(CARRIER, position="cart", frequency=6.0, damping=1.0)
SLEW = rest_to_rest(0.5, 1.5, 1.2, smoothness=2)


def static(K: Any, model: invtrack.StateSpace = CARRIER) -> float:
    """N of u = -K x + N y_d with y = y_d at rest, from the closed loop's gain at zero frequency."""
    A = model.A - model.B @ K
    return float(1 / (model.C @ np.linalg.solve(-A, model.B))[0, 0])


def test_it_is_feedback_with_a_static_gain_on_the_wanted_output() -> None:
    """LQR without preview: u = -K x + N y_d, from rest at the reference's first value."""
    K = invtrack.lqr(CARRIER, Q=10.0, R=1.0).gains[0]
    plan, N = feedback_tracking(CARRIER, SLEW, gains=K), static(K)
    t = np.linspace(0.0, 4.0, 41)
    expected = integrated(
        CARRIER.A - CARRIER.B @ K,
        lambda s: CARRIER.B[:, 0] * N * SLEW(s)[0],
        np.array([0.5, 0.5, 0.5, 0.0, 0.0, 0.0]),
        [0.0, 1.2, 4.0],
        t,
    )
    at = plan(t)
    assert at.x == pytest.approx(expected, abs=1e-8)
    assert at.u[:, 0] == pytest.approx(-expected @ K[0] + N * SLEW(t)[:, 0], abs=1e-6)
    assert at.y[:, 0] == pytest.approx(expected[:, 1], abs=1e-8)
    assert plan.preactuation == 0
    assert plan.certificate.dynamics_residual < 1e-12
    assert plan.certificate.output_error > 0.05
    assert any("not exact" in remark for remark in plan.remarks)


def test_run_on_another_plant_it_is_the_same_law() -> None:
    """The tracking controller around the plan has no part in it that knows the plant."""
    real = carrier((30.0, 120.0), mass=0.7)
    K = SERVO.gains[0]
    slew = rest_to_rest(0.0, 1.0, 1.2)
    plan, N = feedback_tracking(CARRIER, slew, gains=SERVO), static(K)
    run = invtrack.simulate(
        invtrack.LinearPlant(real), invtrack.TrackingController(plan, SERVO), timestep=0.005, start=0.0, end=3.0, evaluate="stages"
    )
    expected = integrated(
        real.A - real.B @ K,
        lambda s: real.B[:, 0] * N * slew(s)[0],
        np.zeros(6),
        [0.0, 1.2, 3.0],
        run.time,
    )
    assert run.state.values == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_as_many_derivatives_fed_forward_as_a_motion_has_are_enough(derivatives: int) -> None:
    """Of y_d = t^k / k! the error settles to zero where k <= derivatives, to the constant of the next term where k is one more."""
    k = derivatives + 1
    S, damped = np.eye(k + 1, k=1), carrier(damping=1.0)
    for order, follows in ((derivatives, True), (k, False)):
        w_0 = np.zeros(k + 1)
        w_0[order] = 1.0
        motion = autonomous(S, np.eye(1, k + 1), w_0, start=0.0, end=20.0)
        plan = feedback_tracking(damped, motion, gains=SERVO, derivatives=derivatives)
        at = plan([17.0, 20.0], inside=[17.0, 19.9])
        errors = (at.y - at.y_d)[:, 0]
        if follows:
            assert errors == pytest.approx(0.0, abs=1e-6 * 20.0**order)
        else:
            assert errors[1] == pytest.approx(errors[0], rel=1e-3)
            assert abs(errors[1]) > 1e-3


def left_in(plan: invtrack.Plan, modes: Any) -> Any:
    """How far each of these modes of the loop is from rest where the command has ended."""
    end = plan.breakpoints[-1]
    x = plan.states([end], inside=[end + 1.0])[0] - np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    poles, vectors = np.linalg.eig(CARRIER.A - CARRIER.B @ SERVO.gains[0])
    weights = np.abs(np.linalg.solve(vectors, x.astype(complex)))
    return np.array([weights[np.argmin(np.abs(np.abs(poles) - mode.frequency))] for mode in modes])


@pytest.mark.parametrize(("kind", "most"), [("ZV", 1e-9), ("ZVD", 1e-9), ("ZVDD", 1e-9), ("two-hump EI", 1e-9), ("EI", 0.05)])
def test_a_shaper_for_all_modes_of_the_loop_leaves_them_at_rest(kind: Any, most: float) -> None:
    """An EI shaper as much as its tolerance; one for the first mode alone leaves the second."""
    modes = flexible_modes(CARRIER, gains=SERVO)
    reference = s_curve(0.0, 1.0, duration=0.4)
    unshaped = left_in(feedback_tracking(CARRIER, reference, gains=SERVO), modes)
    both, first = (shaper(kind, some) for some in (modes, modes[:1]))
    plan = feedback_tracking(CARRIER, reference, gains=SERVO, command=both.shaped(reference))
    assert np.all(left_in(plan, modes) < most * (1 + 1e-6) * unshaped)
    assert plan.manoeuvre == pytest.approx((0.0, 0.4))
    assert plan.breakpoints[-1] == pytest.approx(0.4 + both.duration)
    assert plan.reference is reference
    alone = left_in(feedback_tracking(CARRIER, reference, gains=SERVO, command=first.shaped(reference)), modes)
    assert alone[0] < most * (1 + 1e-6) * unshaped[0]
    assert alone[1] > 1e-3 * unshaped[1]


@pytest.mark.parametrize("kind", ["ZV", "ZVD", "ZVDD", "EI", "two-hump EI"])
def test_what_a_shaper_for_other_frequencies_leaves_is_its_residual_vibration_ratio(kind: Any) -> None:
    """Of each mode of the loop, whatever the motion: vibration where the command ends, over that where the unshaped one ends."""
    modes = flexible_modes(CARRIER, gains=SERVO)
    made = shaper(kind, [(modes[0].frequency * 1.15, modes[0].damping * 0.5), (modes[1].frequency * 0.9, modes[1].damping)])
    for reference in (s_curve(0.0, 1.0, duration=0.4), rest_to_rest(0.0, 1.0, 0.3, smoothness=1)):
        unshaped, shaped = (
            left_in(feedback_tracking(CARRIER, reference, gains=SERVO, command=command), modes)
            for command in (None, made.shaped(reference))
        )
        assert shaped / unshaped == pytest.approx(residual_vibration_ratio(made, *np.transpose(modes)), rel=1e-6)


def test_inversion_and_shaper_command_the_same_servo() -> None:
    """u + K x of both is the same gain times a command: of the shaper the shaped reference, of the inverse one that is exact."""
    K, made = SERVO.gains[0], shaper("ZVD", flexible_modes(CARRIER, gains=SERVO))
    t = np.linspace(-0.5, 3.0, 50)
    plan = feedback_tracking(CARRIER, SLEW, gains=SERVO, command=made.shaped(SLEW))
    assert plan.inputs_with(K, t) / K[0, 0] == pytest.approx(made.shaped(SLEW)(t), abs=1e-9)
    smooth = rest_to_rest(0.5, 1.5, 1.2, smoothness=4)
    inverse = invtrack.invert(CARRIER, smooth)
    command = inverse.inputs_with(K, [-50.0, 0.6, 200.0])[:, 0] / K[0, 0]
    assert command[[0, 2]] == pytest.approx([0.5, 1.5])
    assert abs(command[1] - smooth(0.6)[0]) > 0.01


def test_through_jumps_with_loads_that_move_the_rest() -> None:
    """Each interval has its own rest; the state is continuous, the law's steady state is not."""
    laden = carrier(mass=0.9)
    laden = invtrack.StateSpace(
        laden.A,
        laden.B,
        laden.C,
        states=laden.states,
        inputs=laden.inputs,
        outputs=laden.outputs,
        rest=[0.02, 0.1, 0.15, 0.0, 0.0, 0.0],
        operating_point=OperatingPoint(x0=np.zeros(6), u0=[1.5], y0=[0.1]),
    )
    model = invtrack.SwitchedSystem([CARRIER, laden], [0.5])
    gains = base_servo(model, position="cart", frequency=6.0)
    plan = feedback_tracking(model, SLEW, gains=gains)
    t = np.linspace(0.0, 3.0, 31)
    K, rest = gains.gains[1], laden.rest
    before = plan.states(t[t < 0.5])
    assert before == pytest.approx(feedback_tracking(CARRIER, SLEW, gains=gains.gains[0]).states(t[t < 0.5]), abs=1e-12)
    x_0 = plan.states([0.5], inside=[0.4])[0]
    N = static(K, laden)
    expected = integrated(
        laden.A - laden.B @ K,
        lambda s: laden.B[:, 0] * N * (SLEW(s)[0] - 0.1),
        x_0 - rest,
        [0.5, 1.2, 3.0],
        t[t > 0.5],
    )
    assert plan.states(t[t > 0.5]) == pytest.approx(expected + rest, abs=1e-8)
    assert plan.certificate.continuity < 1e-12
    assert plan.inputs([200.0])[0, 0] == pytest.approx(1.5)  # its own load, held at the target


def test_gains_may_switch_at_other_times_than_the_plant() -> None:
    soft = base_servo(CARRIER, position="cart", frequency=3.0).gains[0]
    gains = invtrack.GainSchedule([soft, SERVO.gains[0]], [0.3])
    plan = feedback_tracking(CARRIER, SLEW, gains=gains)
    t = np.array([0.1, 0.2])
    assert plan.states(t) == pytest.approx(feedback_tracking(CARRIER, SLEW, gains=soft).states(t), abs=1e-12)
    assert plan.certificate.continuity < 1e-12
    run = invtrack.simulate(
        invtrack.LinearPlant(CARRIER),
        invtrack.TrackingController(plan, gains),
        timestep=0.005,
        start=0.0,
        end=2.0,
        evaluate="stages",
        initial_state=[0.5, 0.5, 0.5, 0.0, 0.0, 0.0],
    )
    assert invtrack.max_error(run, wanted="planned_output") < 1e-7


@pytest.mark.parametrize("exponents", [(6, -6, 3, 0, -3, 5), (-6, 6, 6, -6, 6, 6)])
def test_units_of_states_do_not_matter(exponents: tuple[int, ...]) -> None:
    T = np.diag(10.0 ** np.array(exponents))
    scaled = CARRIER.transformed(T)
    K = SERVO.gains[0]
    plan = feedback_tracking(CARRIER, SLEW, gains=K, derivatives=2)
    found = feedback_tracking(scaled, SLEW, gains=np.linalg.solve(T, K.T).T, derivatives=2)
    t = np.linspace(-0.1, 3.0, 20)
    assert found(t).y == pytest.approx(plan(t).y, abs=1e-9)
    assert found(t).u == pytest.approx(plan(t).u, abs=1e-7)


def test_plants_with_feedthrough() -> None:
    direct = invtrack.StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.5]])  # (s + 3) / (2 (s + 1))
    plan = feedback_tracking(direct, rest_to_rest(0.0, 1.0, 1.0), gains=[[1.0]])
    assert plan.certificate.dynamics_residual < 1e-13
    assert plan([20.0]).y == pytest.approx(1.0)
    assert plan([20.0]).u == pytest.approx(2 / 3)
    assert plan([0.5]).y[0] == pytest.approx(plan([0.5]).x[0] + 0.5 * plan([0.5]).u[0])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"gains": np.zeros((1, 6))}, PlanError, "do not stabilize the plant: the loop has poles at 0"),
        ({"gains": np.zeros((1, 5))}, ControlError, r"gains have shape \(1, 5\), expected \(1, 6\)"),
        ({"gains": SERVO, "derivatives": -1}, ControlError, "derivatives must be a whole number from 0 to 4"),
        ({"gains": SERVO, "command": "ZV"}, TrajectoryError, "expected a reference such as .*got str"),
        ({"gains": SERVO, "tolerance": 2.0}, PlanError, "tolerance must lie between 0 and 1"),
        ({"gains": SERVO, "reference": constant([1.0, 2.0])}, TrajectoryError, "2 channels, the plant 1 outputs"),
    ],
)
def test_refusals(options: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        feedback_tracking(CARRIER, **{"reference": SLEW, **options})


def test_plants_that_no_static_gain_serves_are_refused() -> None:
    washout = invtrack.StateSpace([[-1.0]], [[1.0]], [[-1.0]], [[1.0]])
    with pytest.raises(InversionError, match="cannot be held at constant values"):
        feedback_tracking(washout, constant(1.0), gains=[[0.0]])
    two = invtrack.StateSpace([[-1.0]], [[1.0, 1.0]], [[1.0]])
    with pytest.raises(RelativeDegreeError, match="feedback_tracking needs as many inputs as outputs"):
        feedback_tracking(two, constant(1.0), gains=np.zeros((2, 1)))


def test_a_reference_that_resonates_for_ever_is_refused() -> None:
    model = invtrack.StateSpace([[-1.0]], [[1.0]], [[1.0]])
    decaying = Generator(np.array([[-1.0]]), np.array([[1.0]]))
    resonant = invtrack.PiecewiseSignal(np.array([0.0]), (decaying,), np.zeros(2, dtype=int), np.ones((2, 1)))
    with pytest.raises(PlanError, match="a mode that is a pole of the loop"):
        feedback_tracking(model, resonant, gains=[[0.0]])


def test_a_mechanism_is_to_be_linearized() -> None:
    plant = invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])
    with pytest.raises(ModelError, match=r"Plant has no A, B, C, D \(linearize a Plant with invtrack.linearize"):
        feedback_tracking(plant, SLEW, gains=np.zeros((1, 4)))
