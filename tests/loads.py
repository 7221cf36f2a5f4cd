"""Mechanisms that pick up a load, in MJCF."""

from __future__ import annotations

import invtrack

G = 9.81

# A load on a rigid rope: one mass, which a winch pulls up, with some drag.
RIGID_HOIST = """
<mujoco model="rigid hoist">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="load">
      <joint name="lift" type="slide" axis="0 0 1" damping="0.4"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
    </body>
  </worldbody>
  <actuator><motor name="winch" joint="lift"/></actuator>
  <sensor><jointpos name="height" joint="lift"/></sensor>
  <keyframe><key name="held" ctrl="9.81"/></keyframe>
</mujoco>"""

# A trolley of 5 kg that a force moves up, and a load on an elastic rope below it: 50 N/m and 0.4 N s/m.
ELASTIC_HOIST = """
<mujoco model="elastic hoist">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="trolley">
      <joint name="trolley" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/>
    </body>
    <body name="load" pos="0 0 -1">
      <joint name="load" type="slide" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
    </body>
  </worldbody>
  <tendon>
    <fixed name="rope" stiffness="50" damping="0.4" springlength="0">
      <joint joint="trolley" coef="1"/><joint joint="load" coef="-1"/>
    </fixed>
  </tendon>
  <actuator><motor name="winch" joint="trolley"/></actuator>
  <sensor><jointpos name="height" joint="load"/></sensor>
</mujoco>"""

# A quadrotor of 1 kg, rotors 0.2 m from its middle, inputs the four thrusts (each with its drag torque); its load is a point mass
# at its centre of mass, so that a heavier one changes no inertia.
QUADROTOR = """
<mujoco model="quadrotor">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="frame" pos="0 0 1">
      <freejoint name="pose"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.02"/>
      <site name="middle"/>
      <site name="front" pos="0.2 0 0"/><site name="left" pos="0 0.2 0"/>
      <site name="back" pos="-0.2 0 0"/><site name="right" pos="0 -0.2 0"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="front" site="front" gear="0 0 1 0 0 0.02"/><motor name="left" site="left" gear="0 0 1 0 0 -0.02"/>
    <motor name="back" site="back" gear="0 0 1 0 0 0.02"/><motor name="right" site="right" gear="0 0 1 0 0 -0.02"/>
  </actuator>
  <sensor>
    <framepos name="place" objtype="site" objname="middle"/>
    <framequat name="attitude" objtype="site" objname="middle"/>
  </sensor>
  <keyframe><key name="hover" qpos="0 0 1 1 0 0 0" ctrl="2.4525 2.4525 2.4525 2.4525"/></keyframe>
</mujoco>"""

# A servo of 800 N/m and 40 N s/m that carries a load.
SERVO = """
<mujoco model="servo">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="load">
      <joint name="lift" type="slide" axis="0 0 1" damping="40"/>
      <inertial pos="0 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="lift" kp="800"/></actuator>
  <sensor><jointpos name="height" joint="lift"/></sensor>
</mujoco>"""

# An arm of 0.5 m that a servo of 60 N m/rad holds; its load is a point mass at its end.
ARM = """
<mujoco model="arm">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="arm">
      <joint name="elbow" type="hinge" axis="0 -1 0" damping="3"/>
      <inertial pos="0.25 0 0" mass="1" diaginertia="0.02 0.02 0.02"/>
      <body name="load" pos="0.5 0 0">
        <inertial pos="0 0 0" mass="0.2" diaginertia="1e-6 1e-6 1e-6"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="elbow" kp="60"/></actuator>
  <sensor><jointpos name="angle" joint="elbow"/></sensor>
</mujoco>"""


def plant_of(
    mjcf: str, *, inputs: list[str], outputs: list[str], body: str = "load", keyframe: str | None = None
) -> invtrack.Plant:
    """The mechanism with its parameter `load`, the mass of a body."""
    parameters = {"load": f"body:{body}:mass"}
    return invtrack.Plant.from_xml(mjcf, inputs=inputs, outputs=outputs, parameters=parameters, keyframe=keyframe)
