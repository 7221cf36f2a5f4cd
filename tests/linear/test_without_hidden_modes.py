"""Plants without their hidden modes: the same response, exactly the transmission zeros, states that keep their names."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
import scipy.linalg

import invtrack
from invtrack.arrays import Array, ComplexArray
from invtrack.errors import ModelError, NonHyperbolicError
from invtrack.linear import Measurement, OperatingPoint, StateSpace, SwitchedSystem, without_hidden_modes, zero_report
from tests.linear.random_plants import assert_same_set, block, plant_with
from tests.linear.test_hidden_modes import with_hidden_modes

SLEW = invtrack.rest_to_rest(0.0, 1.0, duration=2.0, smoothness=4)

# A motor drives a load through a flexible shaft; what is to follow is the load's speed: no output shows the angle of both together.
STIFFNESS, DAMPING = 50.0, 0.4
SHAFT = StateSpace(
    [[0, 0, 1, 0], [0, 0, 0, 1], [-STIFFNESS, STIFFNESS, -DAMPING, DAMPING], [25.0, -25.0, 0.2, -0.2]],
    [[0.0], [0.0], [1.0], [0.0]],
    [[0.0, 0.0, 0.0, 1.0]],
    states=invtrack.Channels(["motor angle", "load angle", "motor speed", "load speed"], ["rad", "rad", "rad/s", "rad/s"]),
    inputs=invtrack.Channels(["torque"], ["N m"]),
    parameters={"inertia": 2.0},
    operating_point=OperatingPoint(x0=np.arange(5.0), u0=[3.0], y0=[7.0]),
)


def response(system: StateSpace, s: complex) -> ComplexArray:
    """C (s I - A)^-1 B + D."""
    return np.asarray(system.C @ np.linalg.solve(s * np.eye(system.n_states) - system.A, system.B) + system.D)


def in_other_units(system: StateSpace, states: Array, time: float, inputs: Array, outputs: Array) -> StateSpace:
    A, B = time * states[:, None] * system.A / states, time * states[:, None] * system.B * inputs
    return StateSpace(A, B, outputs[:, None] * system.C / states)


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_response_and_zeros_are_those_of_the_part_that_is_moved_and_shown(seed: int, mixed: bool) -> None:
    """Hidden modes with multiplicity, unstable ones and ones on the axis among them, in any units of all."""
    rng = np.random.default_rng(seed)
    proper = [1.5, -2.0, 0.5 + 1j][: seed % 4]
    core = plant_with(rng, [(2,), (1, 2)][seed % 2], block(*proper), mixed=False)
    chain = np.diag(np.ones(2), k=1)
    plant = with_hidden_modes(rng, core, block(-1.0, 2j), chain, block(0.7), mixed=mixed)
    n, p = plant.n_states, plant.n_outputs
    time, inputs, outputs = 10.0 ** rng.uniform(-6, 6), 10.0 ** rng.uniform(-6, 6, p), 10.0 ** rng.uniform(-6, 6, p)
    whole = in_other_units(plant, 10.0 ** rng.uniform(-6, 6, n), time, inputs, outputs)
    left = without_hidden_modes(whole)
    assert left.n_states == core.n_states
    for s in rng.normal(size=4) + 1j * rng.normal(size=4):
        expected = outputs[:, None] * response(core, s) * inputs
        assert np.max(np.abs(response(left, time * s) / expected - 1)) < 1e-10
    report = zero_report(left)
    assert report.hidden == ()
    assert_same_set(np.array([zero.value for zero in report.zeros]) / time, np.linalg.eigvals(block(*proper)), 1e-7)
    assert without_hidden_modes(left) is left
    if not mixed:  # each state is hidden or not as a whole
        assert left.states.names == whole.states.names[: core.n_states]
        assert np.array_equal(left.A, whole.A[: core.n_states, : core.n_states])
        assert np.array_equal(left.C, whole.C[:, : core.n_states])


def test_idle_states_go_and_the_others_stay_as_they_are() -> None:
    rng = np.random.default_rng(0)
    idle, order = block(-0.5, 3j), rng.permutation(7)
    A = scipy.linalg.block_diag(SHAFT.A[1:, 1:] - np.eye(3), np.zeros((1, 1)), idle)
    B, C = np.vstack([SHAFT.B[1:], np.zeros((4, 1))]), np.array([[1.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0]])
    names = ["angle", "motor", "load", "clock", "lag", "belt", "belt speed"]
    errors = {"A": np.arange(49.0).reshape(7, 7) * 1e-14, "D": np.array([[1e-9]])}
    plant = StateSpace(
        A[np.ix_(order, order)],
        B[order],
        C[:, order],
        states=invtrack.Channels([names[i] for i in order], [f"unit {i}" for i in order]),
        error_estimates=errors,
    )
    left = without_hidden_modes(plant)
    kept = [k for k, i in enumerate(order) if i < 3]
    assert left.states == invtrack.Channels([names[order[k]] for k in kept], [f"unit {order[k]}" for k in kept])
    for found, whole in ((left.A, plant.A), (left.errors("A"), errors["A"])):
        assert np.array_equal(found, whole[np.ix_(kept, kept)])
    assert np.array_equal(left.B, plant.B[kept])
    assert np.array_equal(left.C, plant.C[:, kept])
    assert np.array_equal(left.errors("D"), errors["D"])
    assert set(left.error_estimates) == {"A", "D"}


def test_states_of_which_a_combination_is_hidden_leave_the_others_their_names() -> None:
    left = without_hidden_modes(SHAFT)
    assert left.states == invtrack.Channels(["motor speed", "load speed", "z1"], ["rad/s", "rad/s", ""])
    # z1 is a multiple of motor angle - load angle: the shaft's torque is that of the twist.
    assert left.A[:2, :2] == pytest.approx(np.array([[-DAMPING, DAMPING], [0.2, -0.2]]), rel=1e-15)
    assert left.A[2] * left.A[0, 2] == pytest.approx([-STIFFNESS, STIFFNESS, 0.0], rel=1e-14)
    assert left.A[2, 0] > 0
    assert (left.inputs, left.outputs, left.parameters) == (SHAFT.inputs, SHAFT.outputs, SHAFT.parameters)
    assert left.operating_point is SHAFT.operating_point


def test_new_names_are_none_that_are_taken() -> None:
    plant = replace(SHAFT, states=["a", "b", "z2", "z1"])
    assert without_hidden_modes(plant).states.names == ("z2", "z1", "z3")


def test_the_input_of_a_plan_is_the_same() -> None:
    """A plant with hidden modes off the axis, one of them unstable and moved by no input: exact inversion serves both."""
    rng = np.random.default_rng(6)
    core = plant_with(rng, (2,), block(1.0, -2.0))
    plant = with_hidden_modes(rng, core, block(-1.0), block(0.5, -0.7), block(-3.0))
    whole, left = invtrack.invert(plant, SLEW), invtrack.invert(without_hidden_modes(plant), SLEW)
    t = np.linspace(-3.0, 4.0, 300)
    assert left(t).u == pytest.approx(whole(t).u, abs=1e-9 * np.max(np.abs(whole(t).u)))


def test_what_the_refusal_of_a_plan_names_makes_it_possible() -> None:
    """Run at a new speed for ever, the shaft turns for ever: no plan holds its angle. It takes 3 N m at rest."""
    with pytest.raises(NonHyperbolicError, match=r"leave it out of the model \(invtrack.linear.without_hidden_modes\)"):
        invtrack.invert(SHAFT, 7.0 + SLEW)
    plan = invtrack.invert(without_hidden_modes(SHAFT), 7.0 + SLEW)
    assert plan.certificate.output_error < 1e-12
    # Both discs with the shaft rigid: 1 + 2 kg m^2 times the acceleration, which adds up to the impulse 3 N m s.
    t = np.linspace(-0.5, 3.0, 20001)
    assert np.trapezoid(plan(t).u[:, 0] - 3.0, t) == pytest.approx(3.0, rel=1e-6)


def test_modes_hidden_but_for_the_noise_of_a_linearization() -> None:
    rng = np.random.default_rng(3)
    core = plant_with(rng, (2,), block(1.0), mixed=False)
    exact = with_hidden_modes(rng, core, block(-1.0), block(-2.0), block(), mixed=False)
    noisy = exact.A + rng.uniform(-1e-8, 1e-8, exact.A.shape)
    noisy[:1] = exact.A[:1]  # x' = v is exact
    left = without_hidden_modes(StateSpace(noisy, exact.B, exact.C, error_estimates={"A": 1e-8}))
    assert left.states.names == ("x1", "x2", "x3")
    assert np.array_equal(left.A, noisy[:3, :3])
    assert np.array_equal(left.errors("A"), np.full((3, 3), 1e-8))
    plain = StateSpace(noisy, exact.B, exact.C)
    assert without_hidden_modes(plain) is plain


def test_the_measurement_goes_along() -> None:
    """A measured signal may show what no input moves; from rest it shows nothing of it."""
    rng = np.random.default_rng(8)
    plant = with_hidden_modes(rng, plant_with(rng, (2,), block(1.0)), block(), block(-1.0), block())
    rows = Measurement(
        rng.normal(size=(3, 4)), rng.normal(size=(3, 1)), invtrack.Channels(["a", "b", "c"], ["m", "m", "m"]), [1.0, 2.0, 3.0]
    )
    plant = replace(plant, measurement=rows)
    left = without_hidden_modes(plant)
    assert (left.measurement.channels, left.measurement.y0.tolist()) == (rows.channels, [1.0, 2.0, 3.0])
    for s in (0.3 + 1j, -2.0 + 0.5j):
        whole = rows.C @ np.linalg.solve(s * np.eye(4) - plant.A, plant.B)
        assert left.measurement.C @ np.linalg.solve(s * np.eye(3) - left.A, left.B) == pytest.approx(whole, rel=1e-10)


def test_a_measurement_that_shows_more_than_the_outputs_is_refused() -> None:
    rows = Measurement(np.eye(4)[[0, 3]], np.zeros((2, 1)), ["encoder", "tachometer"], [0.0, 7.0])
    plant = replace(SHAFT, measurement=rows)
    with pytest.raises(ModelError, match=r"measured signals \['encoder'\] show modes that the outputs .* do not"):
        without_hidden_modes(plant)
    assert without_hidden_modes(replace(plant, measurement=None)).n_states == 3  # type: ignore[arg-type]


def test_nothing_left_is_refused() -> None:
    with pytest.raises(ModelError, match="nothing is left of the plant but its feedthrough"):
        without_hidden_modes(StateSpace(-np.eye(2), [[1.0], [0.0]], [[0.0, 1.0]], [[2.0]]))


def test_another_librarys_model_will_do() -> None:
    left = without_hidden_modes(control.ss([[-1.0, 0.0], [0.0, -2.0]], [[1.0], [0.0]], [[1.0, 1.0]], [[0.0]]))
    assert (left.A.tolist(), left.C.tolist()) == ([[-1.0]], [[1.0]])
    with pytest.raises(ModelError, match="sampling time"):
        without_hidden_modes(control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1))


def test_of_a_switched_plant_goes_what_is_hidden_throughout() -> None:
    """The shaft stiffens: the angle of both discs together stays hidden, the plan goes on through the jump."""
    A = SHAFT.A.copy()
    A[2:] *= 1.5
    stiff = replace(SHAFT, A=A)
    plant = SwitchedSystem([SHAFT, stiff, SHAFT], [0.6, 1.1])
    left = without_hidden_modes(plant)
    assert left.switch_times.tolist() == [0.6, 1.1]
    assert left.states.names == ("motor speed", "load speed", "z1")
    assert left.systems[0] is left.systems[2]
    for found, whole in zip(left.systems, plant.systems, strict=True):
        assert response(found, 2.0 + 3j) == pytest.approx(response(whole, 2.0 + 3j), rel=1e-12)
    # A given torque turns both to the same speeds, through the jumps.
    x, z, names = np.zeros(4), np.zeros(3), left.systems[0]
    for k, h in enumerate((0.6, 0.5, 0.9)):
        x, z = step(plant.systems[k], x, h), step(left.systems[k], z, h)
    assert z[:2] == pytest.approx(x[2:], rel=1e-10)
    assert names.parameters == SHAFT.parameters
    assert without_hidden_modes(left) is left


def step(system: StateSpace, x: Array, h: float) -> Array:
    """The state after a unit input over h [s]."""
    n = len(x)
    M = scipy.linalg.expm(h * np.block([[system.A, system.B], [np.zeros((1, n + 1))]]))
    return np.asarray(M[:n, :n] @ x + M[:n, n])


def test_a_mode_that_only_some_intervals_hide_is_no_hidden_part() -> None:
    """A clutch: open, no input moves the second disc; closed, it does."""
    open_clutch = StateSpace(np.diag([-1.0, -2.0]), [[1.0], [0.0]], [[1.0, 1.0]])
    closed = StateSpace([[-1.0, 0.0], [1.0, -2.0]], [[1.0], [0.0]], [[1.0, 1.0]])
    with pytest.raises(ModelError, match=r"interval 1 has hidden modes, -2 \(uncontrollable modes\), that cannot go"):
        without_hidden_modes(SwitchedSystem([closed, open_clutch], [1.0]))
    with_idle = [
        StateSpace(scipy.linalg.block_diag(m.A, [[-5.0]]), np.vstack([m.B, [[0.0]]]), np.hstack([m.C, [[1.0]]]))
        for m in (closed, open_clutch)
    ]
    with pytest.raises(ModelError, match=r"interval 1 has hidden modes, -2 "):
        without_hidden_modes(SwitchedSystem(with_idle, [1.0]))
    assert without_hidden_modes(SwitchedSystem([with_idle[0]])).n_states == 2


def test_a_switched_plant_without_hidden_modes_is_itself() -> None:
    rng = np.random.default_rng(1)
    core = plant_with(rng, (2,), block(1.0))
    plant = SwitchedSystem([core, replace(core, A=1.5 * core.A)], [1.0])
    assert without_hidden_modes(plant) is plant


def test_the_rest_goes_with_the_states_that_are_left() -> None:
    """x3 shows nowhere: it goes. x2 is an idle mode that the output shows, but no input moves: a rest that jumps along it does."""
    A, B = np.diag([-1.0, -2.0, -3.0]), np.array([[1.0], [0.0], [1.0]])
    unseen = StateSpace(A[[0, 2]][:, [0, 2]], B[[0, 2]], [[1.0, 0.0]], states=["x1", "x3"], rest=[0.5, 0.7])
    left = without_hidden_modes(SwitchedSystem([replace(unseen, rest=[0.0, 0.0]), unseen], [1.0]))
    assert left.states.names == ("x1",)
    assert left.rest_states.tolist() == [[0.0], [0.5]]
    shown = StateSpace(A[:2, :2], B[:2], [[1.0, 1.0]])
    assert without_hidden_modes(SwitchedSystem([shown, replace(shown, rest=[0.3, 0.0])], [1.0])).states.names == ("x1",)
    with pytest.raises(ModelError, match="at t = 1 s the equilibrium jumps along modes that no input moves"):
        without_hidden_modes(SwitchedSystem([shown, replace(shown, rest=[0.3, 0.2])], [1.0]))
