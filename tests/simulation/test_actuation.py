"""What is applied of controls in any state, against MuJoCo's forces with and without limits, for every way to transmit a force."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from invtrack.plant.plant import Plant
from invtrack.simulation.actuation import Actuation

ARM = """
<mujoco model="arm">
  <default><geom contype="0" conaffinity="0" size="0.03"/></default>
  <worldbody>
    <site name="anchor" pos="0 0 1"/>
    <body pos="0 0 2"><freejoint/><geom size="0.1"/></body>
    <body>
      <joint name="a" axis="0 1 0" actuatorfrcrange="-3 3" actuatorgravcomp="true"/><geom type="capsule" fromto="0 0 0 .5 0 0"/>
      <body pos="0.5 0 0" gravcomp="1">
        <joint name="b" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 0"/><site name="tip" pos="0.5 0 0"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope"><site site="anchor"/><site site="tip"/></spatial>
    <fixed name="both" actuatorfrcrange="-2 2"><joint joint="a" coef="1"/><joint joint="b" coef="-2"/></fixed>
  </tendon>
  <actuator>{}</actuator>
</mujoco>"""
MECHANISMS = {
    "rotor at a site": '<motor name="u" site="tip" gear="0 0 1 0 0 0" forcerange="-2 2"/><motor name="v" joint="a" gear="2"/>',
    "motor on a rope": '<motor name="u" tendon="rope" forcerange="-2 2"/>'
    '<position name="v" joint="a" kp="9" kv="2" forcerange="-1.5 2"/>',
    "servo on a rope": '<position name="u" tendon="rope" kp="30" forcerange="-2 2"/>'
    '<velocity name="v" joint="b" kv="3" forcerange="-1 4"/>',
    "gain of the state": """<motor name="u" joint="b" ctrlrange="-1 1"/><general name="v" joint="a" gaintype="affine"
        gainprm="3 1 .2" biastype="affine" biasprm="1 -3 -.3" forcerange="-4 4"/>""",
    "damper": '<position name="u" joint="b" kp="30" forcerange="-2 2"/>'
    '<damper name="v" joint="a" kv="2" ctrlrange="0 1" forcerange="-.5 .5"/>',
    "two on a tendon": '<motor name="u" tendon="both" gear="0.5" forcerange="-3 3"/><position name="v" tendon="both" kp="5"/>',
    "two at a joint": '<motor name="u" joint="a" gear="-3" forcerange="-3 3"/><position name="v" joint="a" kp="5" kv="1"/>',
}  # fmt: skip


@pytest.mark.parametrize("actuators", MECHANISMS.values(), ids=MECHANISMS.keys())
@pytest.mark.parametrize("gravity_compensated", [True, False])
def test_without_its_limits_the_model_does_the_same_with_what_is_applied(actuators: str, gravity_compensated: bool) -> None:
    xml = ARM.format(actuators)
    if not gravity_compensated:  # then forces of motors and servos are affine in the state
        xml = xml.replace('actuatorgravcomp="true"', "")
    plant = Plant.from_xml(xml, inputs=["u", "v"], outputs=["joint:a"])
    limited, free = plant.model, plant.model_with()
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    free.actuator_forcelimited[:] = free.jnt_actfrclimited[:] = free.tendon_actfrclimited[:] = False
    random = np.random.default_rng(3)
    raw, u = random.normal(size=(100, limited.nq + limited.nv)), 3 * random.normal(size=(100, 2))
    raw[:, 3:7] /= np.linalg.norm(raw[:, 3:7], axis=1, keepdims=True)
    actuation = Actuation(plant, limited)
    applied, excess = actuation.passed_on(raw, u)

    def forces(model: mujoco.MjModel, controls: np.ndarray) -> np.ndarray:
        data, found = mujoco.MjData(model), []
        for state, control in zip(raw, controls, strict=True):
            data.qpos[:], data.qvel[:], data.ctrl[:] = state[: model.nq], state[model.nq :], control
            mujoco.mj_forward(model, data)
            found.append(data.qfrc_actuator.copy())
        return np.array(found)

    acting, asked = forces(limited, u), forces(free, u)
    # What a clamped joint cuts of forces from elsewhere (a tendon, a site, gravity) is no control's, unless an input is on it.
    at_joint_a = np.isclose(np.abs(acting[:, 6]), 3.0, rtol=1e-14)
    rows = ~at_joint_a if 'joint="a"' not in actuators else np.ones(100, dtype=bool)
    np.testing.assert_allclose(forces(free, applied)[rows], acting[rows], rtol=1e-10, atol=1e-10)
    clamped = np.any(np.abs(acting - asked) > 1e-5, axis=1)
    assert np.sum(clamped) > 10
    assert np.array_equal(np.any(excess > 0, axis=1), clamped)
    assert len(actuation.limits) == excess.shape[1]
