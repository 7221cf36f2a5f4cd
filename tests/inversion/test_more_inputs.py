"""More inputs than outputs: of all inputs that follow the reference exactly, those of least cost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import invtrack
from invtrack.arrays import Array
from invtrack.errors import InversionError, NonHyperbolicError, RelativeDegreeError
from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility import feasibility
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zero_report
from invtrack.plans.plan import Plan
from invtrack.references import constant, rest_to_rest, stack
from invtrack.references.signal import PiecewiseSignal
from tests.inversion.collocation import least_input, unseen

STEP = rest_to_rest(0.0, 1.0, duration=1.0, smoothness=3)
THERE_AND_BACK = STEP + rest_to_rest(0.0, -1.0, duration=1.0, start_time=1.5, smoothness=3)
R = np.diag([1.0, 100.0])


def dual_stage(coarse_mass: float = 1.0, stiffness: float = 400.0, reach: float = 1.0) -> StateSpace:
    """A coarse stage on rollers with a fine one, held by a spring, on it: the output is where the fine one is."""
    A = np.array([[0, 1, 0, 0], [0, -0.5 / coarse_mass, 0, 0], [0, 0, 0, 1], [0, 0, -stiffness, -4.0]])
    B = np.array([[0, 0], [1 / coarse_mass, 0.2], [0, 0], [0, 400.0]])
    return StateSpace(A, B, [[1.0, 0, reach, 0]])


def carts(friction: float, mass: float = 1.0) -> StateSpace:
    """Two carts side by side; the output is the sum of where they are."""
    A = np.array([[0, 1, 0, 0], [0, -friction / mass, 0, 0], [0, 0, 0, 1], [0, 0, 0, -friction]])
    return StateSpace(A, [[0, 0], [1 / mass, 0], [0, 0], [0, 1]], [[1.0, 0, 1, 0]])


def wanted(reference: PiecewiseSignal) -> Any:
    return lambda t, order: reference(t, derivative=order)


def assert_least_input(
    models: list[StateSpace], times: list[float], reference: PiecewiseSignal, window: tuple[float, float], **options: Any
) -> None:
    """The plan's inputs are what collocation tends to, with its second order."""
    plan = invert(SwitchedSystem(models, times), reference, R=R)
    start, last = plan.states([window[0]])[0], plan.states([window[1]])[0]
    rows = options.pop("end", unseen(models[-1], 2))
    errors = []
    for steps in (1000, 2000):
        at, u = least_input(models, times, R, wanted(reference), 2, window, steps, start, (rows, rows @ last), **options)
        errors.append(np.max(np.abs(u - plan.inputs(at))))
    low, high = plan.input_range
    assert errors[1] < 5e-3 * np.max(high - low)
    assert 3.5 < errors[0] / errors[1] < 4.6


def test_least_input() -> None:
    assert_least_input([dual_stage()], [], STEP, (-9.0, 10.0))


@pytest.mark.parametrize(
    "after",
    [dual_stage(coarse_mass=2.0), dual_stage(coarse_mass=1.5, stiffness=300.0), dual_stage(reach=1.3)],
    ids=["heavier", "heavier and softer", "outputs that are other functions of the state"],
)
def test_least_input_through_a_jump(after: StateSpace) -> None:
    assert_least_input([dual_stage(), after], [0.5], STEP, (-9.5, 10.5))


def test_many_jumps_there_and_back() -> None:
    models = [dual_stage(), dual_stage(2.0), dual_stage(2.0, reach=1.2), dual_stage()]
    assert_least_input(models, [0.4, 1.2, 1.9], THERE_AND_BACK, (-9.0, 11.0))


def test_what_may_rest_anywhere_comes_to_rest_where_it_is_cheapest() -> None:
    velocities = np.array([[0, 1.0, 0, 0], [0, 0, 0, 1.0]])[:1]  # the other follows from the outputs, the places are free
    assert_least_input([carts(1.0, mass=2.0)], [], STEP, (-14.0, 15.0), end=velocities)


def test_a_held_output_takes_the_least_input_at_its_ends() -> None:
    """Two springs in parallel, pushed side by side: u = k y, shared so that u'R u is least."""
    plant = StateSpace([[0, 1], [-3.0, -1.0]], [[0, 0], [1.0, 2.0]], [[1.0, 0]])
    plan = invert(plant, STEP, R=R)
    share = np.linalg.solve(R, [1.0, 2.0])
    assert plan.inputs([50.0])[0] == pytest.approx(3.0 * share / (np.array([1.0, 2.0]) @ share), rel=1e-12)
    assert plan.inputs([-50.0])[0] == pytest.approx([0.0, 0.0], abs=1e-14)
    assert plan.preactuation == 0.0


def test_the_cost_is_counted_from_rest() -> None:
    """A fine stage whose spring must be held: what that takes is no cost, what goes beyond it is."""
    held = dual_stage()
    A = np.array(held.A)
    A[1, 0] = -30.0
    plant = StateSpace(A, held.B, held.C)
    N_u = invert(plant, STEP, R=R).inputs([80.0])[0]
    assert_least_input([plant], [], STEP, (-9.0, 10.0), u_rest=lambda t: N_u * STEP(t).ravel()[0])


def test_alike_actuators_that_act_alike_share_the_work() -> None:
    """Column operations on B that leave what acts the same: six rotors in pairs, two outputs."""
    rng = np.random.default_rng(3)
    A, B, C = rng.normal(size=(4, 4)), rng.normal(size=(4, 2)), rng.normal(size=(2, 4))
    mixing = rng.normal(size=(2, 5))
    weight = np.diag(rng.uniform(0.5, 2.0, 5))
    reference = stack([STEP, THERE_AND_BACK])
    square, wide = invert(StateSpace(A, B, C), reference), invert(StateSpace(A, B @ mixing, C), reference, R=weight)
    times = np.linspace(-3.0, 6.0, 50)
    share = np.linalg.solve(weight, mixing.T) @ np.linalg.inv(mixing @ np.linalg.solve(weight, mixing.T))
    assert wide.inputs(times) == pytest.approx(square.inputs(times) @ share.T, rel=1e-7, abs=1e-9)


def test_a_zero_that_no_input_moves_stays_one() -> None:
    """y'' + y' = v, and both inputs act through the same filter v = (s - 1) / (s + 2) b'u: v = b'u - 3 f, f' = -2 f + b'u."""
    b = np.array([1.0, 3.0])
    plant = StateSpace([[0, 1, 0], [0, -1, -3.0], [0, 0, -2.0]], np.vstack([0 * b, b, b]), [[1.0, 0, 0]])
    (zero,) = zero_report(plant).zeros
    assert zero.value == pytest.approx(1.0)
    assert zero.kind == "transmission zero"
    plan = invert(plant, STEP, R=1.0)
    assert plan.preactuation == pytest.approx(np.log(1e10), rel=0.2)
    single = invert(plant.with_inputs(["u1"]), STEP)
    times = np.linspace(-10.0, 5.0, 100)
    assert plan.inputs(times) == pytest.approx(single.inputs(times) @ b[None] / (b @ b), abs=1e-10)


@settings(deadline=None, max_examples=15, derandomize=True)
@given(st.integers(0, 10**6), st.integers(1, 2), st.integers(1, 2), st.integers(0, 4), st.booleans())
def test_any_plant(seed: int, p: int, surplus: int, hidden: int, feedthrough: bool) -> None:
    """Exact, at rest at both ends, and stationary: no change of the inputs left over that keeps the output does work on it."""
    rng = np.random.default_rng(seed)
    m, n = p + surplus, 2 * p + hidden + 1
    D = rng.normal(size=(p, m)) * feedthrough
    plant = StateSpace(rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=(p, n)), D)
    root = rng.normal(size=(m, m))
    weight = root @ root.T + 0.1 * np.eye(m)
    reference = stack([rest_to_rest(0.0, float(value), duration=2.0, smoothness=4) for value in rng.normal(size=p)])
    plan = invert(plant, reference, R=weight)
    assert plan.certificate.worst(exact=True) < 1e-9
    change = output_nulling(plant, rng)
    start, end = min(plan.start, change.start), max(plan.end, change.end)
    assume(end - start < 200.0)
    times, step = np.linspace(start, end, int((end - start) / 4e-3), retstep=True)
    u, moved = plan.inputs(times) - reference(times) @ least_held(plant, weight).T, change.inputs(times)
    work, own, other = (step * np.einsum("ki,ij,kj->", a, weight, b) for a, b in ((u, moved), (u, u), (moved, moved)))
    assert abs(work) < 1e-6 * np.sqrt(own * other)


def least_held(plant: StateSpace, weight: Array) -> Array:
    """N_u (m, p): the least u'R u that holds each output at one, by its optimality conditions."""
    n, m, p = plant.n_states, plant.n_inputs, plant.n_outputs
    M = np.block([[plant.A, plant.B], [plant.C, plant.D]])
    K = np.block([[np.zeros((n, n + m)), M.T[:n]], [np.zeros((m, n)), weight, M.T[n:]], [M, np.zeros((n + p, n + p))]])
    return np.asarray(np.linalg.lstsq(K, np.vstack([np.zeros((2 * n + m, p)), np.eye(p)]), rcond=None)[0][n : n + m])


def output_nulling(plant: StateSpace, rng: np.random.Generator) -> Plan:
    """Inputs from rest to rest that no output shows: what makes a further, fictitious output move."""
    extra = plant.n_inputs - plant.n_outputs
    row, direct = rng.normal(size=(extra, plant.n_states)), rng.normal(size=(extra, plant.n_inputs))
    square = StateSpace(plant.A, plant.B, np.vstack([plant.C, row]), np.vstack([plant.D, direct]))
    pulse = rest_to_rest(0.0, 1.0, duration=1.0, start_time=0.3, smoothness=5)
    return invert(square, stack([constant(0.0)] * plant.n_outputs + [pulse - pulse.shifted(1.0)] * extra), tolerance=1e-8)


@pytest.mark.parametrize("units", [1e-3, 1e4])
def test_units_of_states_and_inputs_do_not_matter(units: float) -> None:
    plant = dual_stage()
    u_units = np.diag([units, 1.0])
    scaled = StateSpace(plant.A, plant.B @ u_units, plant.C).transformed(np.diag([1.0, units, 1 / units, 7.0]))
    times = np.linspace(-4.0, 5.0, 40)
    expected = invert(plant, STEP, R=R).inputs(times)
    assert invert(scaled, STEP, R=u_units @ R @ u_units).inputs(times) @ u_units == pytest.approx(expected, abs=1e-9)


def test_about_an_operating_point() -> None:
    plant = dual_stage()
    point = OperatingPoint(x0=np.zeros(4), u0=np.array([2.0, -3.0]), y0=np.array([5.0]))
    moved = StateSpace(plant.A, plant.B, plant.C, operating_point=point)
    times = np.linspace(-4.0, 5.0, 40)
    plan = invert(moved, STEP + constant(5.0), R=R)
    assert plan.inputs(times) == pytest.approx(invert(plant, STEP, R=R).inputs(times) + point.u0, abs=1e-12)


def test_ranges_are_the_weights_where_none_are_stated() -> None:
    plant = dual_stage()
    limited = StateSpace(plant.A, plant.B, plant.C, input_limits=[[-2.0, 2.0], [0.0, 0.4]])
    times = np.linspace(-4.0, 5.0, 40)
    plan = invert(limited, STEP)
    assert plan.inputs(times) == pytest.approx(invert(plant, STEP, R=R).inputs(times), abs=1e-12)
    assert any("each weighed by its range" in remark for remark in plan.remarks)
    assert any("all weighed alike" in remark for remark in invert(plant, STEP).remarks)


def test_inputs_in_unlike_units_must_be_weighed() -> None:
    plant = dual_stage()
    unlike = StateSpace(plant.A, plant.B, plant.C, inputs=invtrack.Channels(["force", "voltage"], ["N", "V"]))
    with pytest.raises(InversionError, match=r"state what they cost.*R=np.diag\(\[1.0, 1.0\]\)"):
        invert(unlike, STEP)
    assert invert(unlike, STEP, R=np.diag([1.0, 1.0])).certificate.worst(exact=True) < 1e-10


@pytest.mark.parametrize("weight", [np.diag([1.0, 0.0]), np.eye(3), "1", np.diag([1.0, -1.0])])
def test_bad_weights(weight: Any) -> None:
    with pytest.raises(InversionError, match="R"):
        invert(dual_stage(), STEP, R=weight)


def test_what_takes_no_input_is_left_at_rest_or_refused() -> None:
    """y'' = u1 + u2 and w'' = y' + u1 - u2: the least input does not stop w, and no cheapest way to do it exists."""
    A = [[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 1, 0, 0]]
    plant = StateSpace(A, [[0, 0], [1, 1], [0, 0], [1, -1.0]], [[1.0, 0, 0, 0]], states=["y", "y'", "w", "w'"])
    with pytest.raises(NonHyperbolicError, match=r"a motion of w, w' at 0 rad/s changes no output and takes no input"):
        invert(plant, STEP)
    plan = invert(plant, THERE_AND_BACK)
    assert plan.states([9.0])[0, 2] == pytest.approx(1.5)  # it moves while y is away, and stays where that leaves it
    assert any("nothing is asked of the motion of w, w'" in remark for remark in plan.remarks)


def test_jumps_that_change_what_costs_nothing_are_refused() -> None:
    loose = carts(1.0)
    A = np.array(loose.A)
    A[1, 0] = -3.0  # a spring holds the first cart
    with pytest.raises(NonHyperbolicError, match="what the inputs left over can move"):
        invert(SwitchedSystem([loose, StateSpace(A, loose.B, loose.C)], [0.5]), STEP)


def test_zeros_on_the_axis_are_refused() -> None:
    plant = StateSpace([[0, 1.0], [-1, -1]], [[0, 0], [1.0, 2.0]], [[0, 1.0]])  # a velocity
    with pytest.raises(NonHyperbolicError, match="zeros at 0 lie on the imaginary axis"):
        invert(plant, THERE_AND_BACK, R=1.0)


@pytest.mark.parametrize("plant", [dual_stage(), SwitchedSystem([dual_stage(), dual_stage(reach=1.3)], [0.5]), carts(1.0)])
def test_feasibility_agrees(plant: Any) -> None:
    report = feasibility(plant, STEP, R=R)
    assert report.solvable
    assert report.boundary is not None
    assert report.boundary.unknowns == report.boundary.end_conditions
    assert "all conditions hold" in str(report) or "solvable" in str(report)
    assert not feasibility(plant, rest_to_rest(0.0, 1.0, duration=1.0, smoothness=0), R=R).solvable


def test_more_outputs_than_inputs_name_what_serves() -> None:
    base = dual_stage()
    tall = StateSpace(base.A, base.B[:, :1], np.eye(4)[[0, 2]], outputs=["coarse", "fine"])
    both = stack([THERE_AND_BACK, THERE_AND_BACK])
    with pytest.raises(RelativeDegreeError) as refusal:
        invert(tall, both)
    text = str(refusal.value)
    assert "no more than 1 (or as many combinations) can follow trajectories of their own exactly: ['coarse']" in text
    assert invert(tall.with_outputs(["coarse"]), THERE_AND_BACK).certificate.worst(exact=True) < 1e-9
    call = text[text.index("invtrack.quadratic_redesign(model") : text.index(" where an error")]
    plan = eval(call, {"invtrack": invtrack, "model": tall, "reference": both, "np": np})
    assert plan.optimality_gap < 1e-7
    assert np.max(np.abs(plan([1.0]).y[0, 0] - 1.0)) < 1e-2


@pytest.mark.parametrize(
    "method",
    [
        lambda plant: invtrack.modified_inversion(plant, STEP, axis_distance=0.1, real_part=1.0),
        lambda plant: invtrack.causal_inverse(plant, STEP),
        lambda plant: invtrack.inversion.steady_state_feedforward(plant, STEP),
    ],
)
def test_methods_without_a_use_for_further_inputs_say_so(method: Any) -> None:
    with pytest.raises(RelativeDegreeError, match=r"needs as many inputs as outputs, got 2 inputs \['u1', 'u2'\] for 1 output"):
        method(dual_stage())
    invert(dual_stage().with_inputs(["u2"]), STEP)
