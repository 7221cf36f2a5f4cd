"""Accelerations where dry friction meets equality constraints, against a least-squares problem of its own."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import scipy.optimize

import invtrack
from invtrack.arrays import Array

BLOCK = '<geom type="box" size="0.05 0.03 0.02" pos="0.05 0 0" mass="1" contype="0" conaffinity="0"/>'
# A tree of seven hinges with dry friction, three couplings between them; with a sparse Jacobian MuJoCo 4.0.0 is wrong here.
TREE = f"""
<mujoco model="tree">
  <option jacobian="sparse" gravity="0 0 -9.81"/>
  <default><joint frictionloss="0.3"/></default>
  <worldbody>
    <body pos="0.1 0.05 0"><joint name="j0" axis="1 0 0"/>{BLOCK}
      <body pos="0.1 0.05 0"><joint name="j1" axis="0 1 0"/>{BLOCK}
        <body pos="0.1 0.05 0"><joint name="j3" axis="1 0 0"/>{BLOCK}</body>
        <body pos="0.1 0.05 0"><joint name="j4" axis="0 1 0"/>{BLOCK}</body>
      </body>
      <body pos="0.1 0.05 0"><joint name="j5" axis="0 0 1"/>{BLOCK}</body>
    </body>
    <body pos="0.1 0.05 0"><joint name="j2" axis="0 0 1"/>{BLOCK}
      <body pos="0.1 0.05 0"><joint name="j6" axis="1 0 0"/>{BLOCK}</body>
    </body>
  </worldbody>
  <equality><joint joint1="j5" joint2="j0"/><joint joint1="j3" joint2="j5"/><joint joint1="j0" joint2="j6"/></equality>
  <actuator><motor name="torque" joint="j0"/></actuator>
</mujoco>"""


def exact_accelerations(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """M q'' = tau + J' f, f the least of 1/2 f' (J M^-1 J' + R) f - f' (aref - J q''_free) with |f| <= loss for dry friction."""
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    J, free = np.array(data.efc_J).reshape(data.nefc, model.nv), np.linalg.solve(M, data.qfrc_smooth)
    L = np.linalg.cholesky(J @ np.linalg.solve(M, J.T) + np.diag(data.efc_R))
    dry = data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
    bound = np.where(dry, data.efc_frictionloss, np.inf)
    f = scipy.optimize.lsq_linear(L.T, np.linalg.solve(L, data.efc_aref - J @ free), bounds=(-bound, bound), tol=1e-14).x
    return np.asarray(free + np.linalg.solve(M, J.T @ f))


@pytest.mark.parametrize("source", ["text", "specification", "model"])
def test_friction_and_couplings_together(source: str) -> None:
    sources = {
        "text": lambda: TREE,
        "specification": lambda: mujoco.MjSpec.from_string(TREE),
        "model": lambda: mujoco.MjModel.from_xml_string(TREE),
    }
    plant = invtrack.Plant.from_xml(sources[source](), inputs=["torque"], outputs=["joint:j0"])
    rng = np.random.default_rng(1)
    moving = plant.at(qpos=0.1 * rng.standard_normal(7), qvel=0.3 * rng.standard_normal(7))
    data = moving.new_data()
    expected = exact_accelerations(moving.model, data)
    np.testing.assert_allclose(data.qacc, expected, atol=1e-10 * np.max(np.abs(expected)))


def test_a_fresh_compilation_has_it_too() -> None:
    plant = invtrack.Plant.from_xml(TREE, inputs=["torque"], outputs=["joint:j0"], parameters={"loss": "joint:j3:frictionloss"})
    assert plant.compiled_with({"loss": 0.1}).opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE
