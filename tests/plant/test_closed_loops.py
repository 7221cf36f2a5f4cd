"""Equality constraints in linear models: against rollouts, the same mechanism in its own coordinates, and formulas by hand."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
import scipy.optimize
from scipy.linalg import expm

import invtrack
from invtrack.arrays import Array
from invtrack.errors import PlantError

G = 9.81

# A four-bar linkage in the plane y = 0: crank 0.3 with a spring, coupler (0.6, 0.2) to the pin, rocker 0.5 on a pivot at x = 0.6.
FOUR_BAR = """
<mujoco model="four-bar">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="crank">
      <joint name="crank" axis="0 -1 0" damping="0.02" stiffness="10"/>
      <inertial pos="0 0 0.15" mass="0.5" diaginertia="0.004 0.004 0.004"/>
      <body name="coupler" pos="0 0 0.3">
        <joint name="knee" axis="0 -1 0" damping="0.01"/>
        <inertial pos="0.3 0 0.1" mass="0.8" diaginertia="0.02 0.02 0.02"/>
        <site name="coupler" pos="0.6 0 0.2"/>
      </body>
    </body>
    <body name="rocker" pos="0.6 0 0">
      <joint name="rocker" axis="0 -1 0" damping="0.03"/>
      <inertial pos="0 0 0.25" mass="0.6" diaginertia="0.01 0.01 0.01"/>
      <site name="rocker" pos="0 0 0.5"/>
    </body>
  </worldbody>
  <equality>{equality}</equality>
  <actuator><motor name="torque" joint="crank"/></actuator>
</mujoco>"""
BY_BODIES = '<connect name="pin" body1="coupler" body2="rocker" anchor="0.6 0 0.2" solref="{} 1"/>'
BY_SITES = '<connect name="pin" site1="coupler" site2="rocker" solref="{} 1"/>'


def four_bar(time_constant: float = 0.02, *, equality: str = BY_BODIES) -> invtrack.Plant:
    """At rest with the crank upright."""
    text = FOUR_BAR.format(equality=equality.format(time_constant))
    plant = invtrack.Plant.from_xml(text, inputs=["torque"], outputs=["joint:rocker"])
    return invtrack.trim(plant, positions={"crank": 0.0}).plant


def turned(angle: float, x: float, z: float) -> Array:
    """(x, z) turned by a hinge about -y."""
    return np.array([np.cos(angle) * x - np.sin(angle) * z, np.sin(angle) * x + np.cos(angle) * z])


def closed(crank: float) -> Array:
    """All three angles with the loop closed exactly."""

    def gap(angles: Array) -> Array:
        knee, rocker = angles
        pin = turned(crank, 0, 0.3) + turned(crank + knee, 0.6, 0.2)
        return np.asarray(pin - (np.array([0.6, 0]) + turned(rocker, 0, 0.5)))

    return np.array([crank, *scipy.optimize.root(gap, np.zeros(2), tol=1e-14).x])


def derivative(function: Callable[[float], Array], at: float, step: float = 1e-3) -> Array:
    """By central differences of fourth order."""
    near, far = (function(at + k * step) - function(at - k * step) for k in (1, 2))
    return np.asarray((8 * near - far) / (12 * step))


def centres(crank: float) -> Array:
    """Places of the three centres of mass (3, 2)."""
    a, knee, rocker = closed(crank)
    return np.array(
        [turned(a, 0, 0.15), turned(a, 0, 0.3) + turned(a + knee, 0.3, 0.1), np.array([0.6, 0]) + turned(rocker, 0, 0.25)]
    )


def rigid_eigenvalues() -> Array:
    """Of the linkage with its loop closed rigidly, in the crank's angle alone: m q'' + c q' + k q = 0 where it is held."""
    masses, inertias, dampings = np.array([0.5, 0.8, 0.6]), np.array([0.004, 0.02, 0.01]), np.array([0.02, 0.01, 0.03])
    speeds, rates = derivative(centres, 0.0), derivative(closed, 0.0)
    turns = np.array([rates[0], rates[0] + rates[1], rates[2]])
    m = np.sum(masses * np.sum(speeds**2, axis=1)) + np.sum(inertias * turns**2)
    c = np.sum(dampings * rates**2)

    def weight(crank: float) -> Array:
        return np.asarray(masses @ centres(crank)[:, 1] * G)

    k = 10 + derivative(lambda crank: derivative(weight, crank, 1e-2), 0.0, 1e-2)
    return np.roots([m, c, k])


@pytest.mark.parametrize("equality", [BY_BODIES, BY_SITES])
def test_slow_modes_are_those_of_the_rigid_loop_and_fast_ones_of_the_constraint(equality: str) -> None:
    """They differ as the square of the constraint's time constant; its own modes are as fast as that and well damped."""
    expected, differences = np.sort_complex(rigid_eigenvalues()), []
    for time_constant in (0.01, 0.005, 0.0025):
        modes = np.linalg.eigvals(invtrack.linearize(four_bar(time_constant, equality=equality)).A)
        slow, fast = np.split(modes[np.argsort(np.abs(modes))], [2])
        differences.append(np.max(np.abs(np.sort_complex(slow) - expected)))
        assert len(fast) == 4
        assert np.all(fast.real < -0.5 / time_constant)
        assert np.all(np.abs(fast.imag) < np.abs(fast.real))
    assert differences[-1] < 1e-4 * np.abs(expected[0])
    np.testing.assert_allclose(np.log2(np.divide(differences[:-1], differences[1:])), 2.0, atol=0.2)


def test_rollouts_follow_the_linear_model_to_second_order() -> None:
    """From any small deviation, also one that opens the loop, over 40 time constants of the constraint's fastest mode."""
    plant = four_bar()
    model, linear = plant.model_with(), invtrack.linearize(plant)
    model.opt.timestep = 1e-4
    size = np.array([1, 1, 1, 5, 5, 5])
    direction, flow = size * np.random.default_rng(3).standard_normal(6), expm(linear.A * 1e-3)
    differences = []
    for amplitude in (1e-4, 1e-5):
        data = plant.new_data(model)
        data.qpos[:] += amplitude * direction[:3]
        data.qvel[:] += amplitude * direction[3:]
        x, away = amplitude * direction, []
        for _ in range(600):
            mujoco.mj_step(model, data, 10)
            x = flow @ x
            away.append(np.max(np.abs(plant.state(data) - x) / size))
        differences.append(max(away))
    assert differences[1] < 1e-2 * 1e-5 * np.max(np.abs(direction))
    assert np.log10(differences[0] / differences[1]) == pytest.approx(2, abs=0.05)


@pytest.mark.parametrize("step", [1e-2, 1e-4, 1e-6])
def test_any_step_resolves_the_constraints_softness(step: float) -> None:
    plant = four_bar()
    finest = invtrack.linearize(plant, step=1e-6)
    found = invtrack.linearize(plant, step=step)
    assert np.max(np.abs(found.A - finest.A)) < 1e-7 * np.max(np.abs(finest.A))


# Two wheels of 0.2 and 0.05 kg m^2, coupled so that a = 2 b + 0.1; by the joints themselves or by a tendon.
GEARS = """
<mujoco model="gears">
  <option integrator="RK4" jacobian="sparse"/>
  <worldbody>
    <body><joint name="a" axis="0 1 0" damping="0.1"/><inertial pos="0 0 0" mass="1" diaginertia="0.2 0.2 0.2"/></body>
    <body><joint name="b" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="0.05 0.05 0.05"/></body>
  </worldbody>
  <tendon><fixed name="belt"><joint joint="a" coef="1"/><joint joint="b" coef="-2"/></fixed></tendon>
  <equality>{equality}</equality>
  <actuator><motor name="torque" joint="a"/></actuator>
</mujoco>"""
SOFTNESS = 'solref="0.03 0.7" solimp="0.9 0.95 0.001 0.5 2"'


@pytest.mark.parametrize(
    ("equality", "J", "weight"),
    [
        (f'<joint joint1="a" joint2="b" polycoef="0 2 0 0 0" {SOFTNESS}/>', [1.0, -2.0], 1 / 0.2 + 1 / 0.05),
        (f'<tendon tendon1="belt" {SOFTNESS}/>', [1.0, -2.0], 1 / 0.2 + 4 / 0.05),
    ],
)
def test_gears_by_hand(equality: str, J: list[float], weight: float) -> None:
    """MuJoCo's documented softness: J q'' = -b J q' - k d J q - R f, R = (1 - d) / d w, M q'' = tau - c q' + J' f.

    d = 0.9, b = 2 / (0.95 * 0.03), k = 1 / (0.95^2 * 0.03^2 * 0.7^2); w is the inverse weight of the constraint: that of a joint
    coupling is the sum of its joints', that of a tendon its own.
    """
    plant = invtrack.Plant.from_xml(GEARS.format(equality=equality), inputs=["torque"], outputs=["joint:b"])
    found = invtrack.linearize(plant)
    row, inverse = np.array([J]), np.diag([1 / 0.2, 1 / 0.05])
    d, b, k = 0.9, 2 / (0.95 * 0.03), 1 / (0.95**2 * 0.03**2 * 0.7**2)
    share = inverse @ row.T / (row @ inverse @ row.T + (1 - d) / d * weight)
    damping = np.diag([0.1, 0.0])
    free = np.eye(2) - share @ row
    expected_A = np.block([[np.zeros((2, 2)), np.eye(2)], [-k * d * share @ row, -free @ inverse @ damping - b * share @ row]])
    np.testing.assert_allclose(found.A, expected_A, atol=1e-8 * np.max(np.abs(expected_A)))
    np.testing.assert_allclose(found.B[2:], free @ inverse[:, :1], atol=1e-9)


def test_a_weld_leaves_the_mode_of_the_whole() -> None:
    """Two blocks of 1 and 3 kg, the first on a spring of 100 N/m, welded: sqrt(100 / 4) rad/s."""
    text = """
    <mujoco><option gravity="0 0 0"/><worldbody>
      <body name="left"><joint name="l" type="slide" axis="1 0 0" stiffness="100"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
      <body name="right" pos="1 0 0"><joint name="r" type="slide" axis="1 0 0"/>
        <inertial pos="0 0 0" mass="3" diaginertia="1 1 1"/></body>
    </worldbody><equality><weld body1="left" body2="right" solref="0.002 1"/></equality>
    <actuator><motor name="push" joint="l"/></actuator></mujoco>"""
    plant = invtrack.Plant.from_xml(text, inputs=["push"], outputs=["joint:r"])
    modes = np.linalg.eigvals(invtrack.linearize(plant).A)
    slow = modes[np.argsort(np.abs(modes))[:2]]
    np.testing.assert_allclose(np.sort_complex(slow), [-5j, 5j], atol=1e-2)


def test_a_plan_through_the_loop_is_followed_to_second_order() -> None:
    plant = four_bar()
    model = invtrack.linearize(plant)
    rest, gains, errors = model.operating_point.y0, invtrack.lqr(model, Q=100.0, R=1.0), []
    for amplitude in (0.02, 0.01):
        plan = invtrack.invert(model, invtrack.rest_to_rest(rest, rest + amplitude, duration=1.0, smoothness=4))
        controller = invtrack.TrackingController(plan, gains)
        errors.append(invtrack.max_error(invtrack.simulate(plant, controller, timestep=1e-3, evaluate="stages")))
    assert errors[1] < 0.02 * 0.01
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)


# A parallelogram that lies flat at 0, where it can fold as well as turn; to be held at any angle.
PARALLELOGRAM = """
<mujoco model="parallelogram">
  <option gravity="0 0 0" integrator="RK4"/>
  <worldbody>
    <body name="crank">
      <joint name="crank" axis="0 -1 0"/><inertial pos="0.15 0 0" mass="0.5" diaginertia="0.004 0.004 0.004"/>
      <body name="coupler" pos="0.3 0 0">
        <joint name="knee" axis="0 -1 0"/><inertial pos="0.3 0 0" mass="0.8" diaginertia="0.02 0.02 0.02"/>
      </body>
    </body>
    <body name="rocker" pos="0.6 0 0">
      <joint name="rocker" axis="0 -1 0"/><inertial pos="0.15 0 0" mass="0.5" diaginertia="0.004 0.004 0.004"/>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="coupler" body2="rocker" anchor="0.6 0 0"/></equality>
  <actuator><motor name="torque" joint="crank"/></actuator>
</mujoco>"""


@pytest.mark.parametrize("angle", [0.0, 1e-4, np.pi])
def test_where_the_loop_can_branch_there_is_no_linear_model(angle: float) -> None:
    plant = invtrack.Plant.from_xml(PARALLELOGRAM, inputs=["torque"], outputs=["joint:rocker"])
    with pytest.raises(PlantError, match=r"constraints pin depend on each other at the operating point, but not 0\.1 rad away"):
        invtrack.linearize(plant.at(qpos=[angle, -angle, angle]))


@pytest.mark.parametrize("angle", [0.05, 0.5, -1.5])
def test_clear_of_that_there_is_one(angle: float) -> None:
    """It turns freely: two eigenvalues at 0, and stable ones."""
    plant = invtrack.Plant.from_xml(PARALLELOGRAM, inputs=["torque"], outputs=["joint:rocker"])
    modes = np.linalg.eigvals(invtrack.linearize(plant.at(qpos=[angle, -angle, angle])).A)
    free = np.abs(modes) < 1e-3
    assert np.count_nonzero(free) == 2
    assert np.all(modes[~free].real < -5)


def test_constraints_that_repeat_each_other_everywhere_pass() -> None:
    """A second pin at the same place adds stiffness, no motion."""
    twice = BY_BODIES + BY_SITES.replace('name="pin"', 'name="again"').replace("{}", "0.02")
    modes = np.linalg.eigvals(invtrack.linearize(four_bar(equality=twice)).A)
    slow = np.sort_complex(modes[np.argsort(np.abs(modes))[:2]])
    np.testing.assert_allclose(slow, np.sort_complex(rigid_eigenvalues()), rtol=1e-3)


def test_a_disabled_equality_does_not_act() -> None:
    plant = invtrack.Plant.from_xml(
        GEARS.format(equality='<joint joint1="a" joint2="b" active="false"/>'), inputs=["torque"], outputs=["joint:a"]
    )
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(invtrack.linearize(plant).A).real), [-0.5, 0, 0, 0], atol=1e-12)
