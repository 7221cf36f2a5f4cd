"""models/two_disc.xml against the printed matrices and transfer functions, and its undamped, uncoupled variant."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import scipy.signal

import invtrack
from invtrack.errors import NonHyperbolicError
from tests.cited_plants import (
    NOTE_FROM_MJCF,
    TWO_DISC_A,
    TWO_DISC_B,
    TWO_DISC_C,
    TWO_DISC_DENOMINATOR,
    TWO_DISC_NUMERATORS,
)


def two_disc(name: str = "two_disc", output: str = "disc2_angle", **options: Any) -> invtrack.Plant:
    return invtrack.Plant.from_xml(invtrack.model_path(name), inputs=["motor"], outputs=[output], **options)


@pytest.mark.parametrize("step", [1e-5, 1e-3, 1e-1])
def test_linear_model_is_the_printed_one(step: float) -> None:
    linear = invtrack.linearize(two_disc(), step=step).transformed(NOTE_FROM_MJCF)
    for found, printed in zip((linear.A, linear.B, linear.C), (TWO_DISC_A, TWO_DISC_B, TWO_DISC_C), strict=True):
        assert found == pytest.approx(printed, abs=1e-10)


@pytest.mark.parametrize("output", ["disc1_angle", "disc2_angle"])
def test_transfer_functions_are_the_printed_ones(output: str) -> None:
    linear = invtrack.linearize(two_disc(output=output))
    numerator, denominator = scipy.signal.ss2tf(linear.A, linear.B, linear.C, linear.D)
    assert numerator[0] == pytest.approx(np.r_[0, 0, TWO_DISC_NUMERATORS[output]], abs=3e-4)
    assert denominator == pytest.approx(TWO_DISC_DENOMINATOR, abs=3e-4)


def test_zeros_lie_near_the_imaginary_axis() -> None:
    found = invtrack.linear.zeros(invtrack.linearize(two_disc()))
    assert np.sort_complex(found) == pytest.approx([0.21998 - 4.74976j, 0.21998 + 4.74976j], abs=1e-5)


def test_steady_rotation_twists_the_shaft() -> None:
    """Under a constant motor command the discs turn at one speed, and lag by what the shaft's and the coupling's torques need."""
    # First row of A and B at th1' = th2' = w, th1'' = th2'' = 0: the two rows fix twist and command per unit of w.
    per_speed = np.linalg.solve([[-3.1555, 1.8139], [2.8956, 0.27]], [0.1640 - 0.3845, 0.0899 + 0.1124])
    plant = two_disc()
    model = plant.model_with()
    data = plant.new_data(model)
    data.qpos[0], data.qvel[:], data.ctrl[:] = 2.0 * per_speed[0], 2.0, 2.0 * per_speed[1]
    with plant.forces(model):
        mujoco.mj_forward(model, data)
    assert per_speed[0] == pytest.approx(0.07, abs=1e-3)
    assert data.qacc == pytest.approx(np.zeros(2), abs=1e-14)
    assert data.sensor("twist").data == pytest.approx([0.14], abs=2e-3)


def test_passive_rig_keeps_its_energy() -> None:
    plant = two_disc("two_disc_passive")
    assert plant.couplings == ()
    model = plant.model_with()
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data = plant.new_data(model)
    data.qpos[:], data.qvel[:] = [0.4, -0.2], [0.3, 0.5]
    mujoco.mj_forward(model, data)
    before = float(data.energy.sum())
    mujoco.mj_step(model, data, 2000)
    mujoco.mj_forward(model, data)
    assert before > 1e-3
    assert float(data.energy.sum()) == pytest.approx(before, rel=1e-10)


def test_passive_rig_has_zeros_on_the_axis_and_no_inverse() -> None:
    linear = invtrack.linearize(two_disc("two_disc_passive"))
    assert np.sort_complex(invtrack.linear.zeros(linear)) == pytest.approx([-4.755j, 4.755j], abs=5e-4)
    with pytest.raises(NonHyperbolicError, match="imaginary axis"):
        invtrack.invert(linear, invtrack.rest_to_rest(0.0, 1.0, 10.0))


def test_the_two_rigs_differ_in_the_coupling_alone() -> None:
    coupled, passive = (invtrack.linearize(two_disc(name)) for name in ("two_disc", "two_disc_passive"))
    assert np.array_equal(coupled.B, passive.B)
    assert coupled.A[:, :2] == pytest.approx(passive.A[:, :2], abs=1e-13)
    assert np.max(np.abs(passive.A[2:, 2:])) < 1e-13


@pytest.mark.parametrize(("evaluate", "bound"), [("held", 1e-6), ("stages", 1e-9)])
def test_exact_inversion_tracks_a_slew_in_mujoco(evaluate: Any, bound: float) -> None:
    plant = two_disc(units={"motor": "1"})
    linear = invtrack.linearize(plant)
    plan = invtrack.invert(linear, invtrack.rest_to_rest(0.0, 1.0, 10.0), tolerance=1e-8)
    controller = invtrack.TrackingController(plan, gains=invtrack.lqr(linear, Q=100.0, R=0.01))
    timestep = 1e-3 if evaluate == "held" else 5e-3
    result = invtrack.simulate(plant, controller, timestep=timestep, evaluate=evaluate)
    assert result.status == "completed"
    assert result.output["disc2_angle"][-1] == pytest.approx(1.0, abs=bound)
    assert invtrack.max_error(result) < bound
    assert (mujoco.get_mjcb_control(), mujoco.get_mjcb_passive()) == (None, None)


def test_without_its_coupling_the_run_misses() -> None:
    """The bound of the test above is one that only the coupled physics meets."""
    linear = invtrack.linearize(two_disc())
    plan = invtrack.invert(linear, invtrack.rest_to_rest(0.0, 1.0, 10.0), max_preactuation=10.0)
    controller = invtrack.TrackingController(plan, gains=invtrack.lqr(linear, Q=100.0, R=0.01))
    result = invtrack.simulate(two_disc("two_disc_passive"), controller, timestep=1e-2, end=12.0)
    assert invtrack.max_error(result) > 1e-4


def test_units_of_tendons_over_hinges_are_those_of_rotation() -> None:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"], measurements=["twist"]
    )
    assert (plant.inputs.units, plant.outputs.units, plant.measurements.units) == (("N m",), ("rad",), ("rad",))
