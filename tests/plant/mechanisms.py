"""Small mechanisms in MJCF whose motion is known by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from invtrack.plant.loading import model_path
from invtrack.plant.plant import Plant

# Mass 2 kg on a spring (30 N/m) and damper (0.7 N s/m), driven with gear 3 through a first-order lag of 0.05 s.
LAGGED_SLIDER = """
<mujoco model="lagged slider">
  <option gravity="0 0 0" integrator="RK4"/>
  <worldbody>
    <body name="block">
      <joint name="x" type="slide" axis="1 0 0" stiffness="30" damping="0.7"/>
      <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
      <site name="mark" pos="0 0.5 0"/>
    </body>
  </worldbody>
  <actuator><general name="drive" joint="x" gear="3" dyntype="filter" dynprm="0.05" gainprm="1"/></actuator>
  <sensor>
    <jointpos name="position" joint="x"/>
    <framepos name="place" objtype="site" objname="mark"/>
    <accelerometer name="acceleration" site="mark"/>
  </sensor>
</mujoco>"""

# Bob of 1.5 kg at 0.8 m below a ball joint, principal inertia (0.1, 0.2, 0.3) about its centre; torques about its x and y axes.
BALL_PENDULUM = """
<mujoco model="ball pendulum">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="bob">
      <joint name="ball" type="ball"/>
      <inertial pos="0 0 -0.8" mass="1.5" diaginertia="0.1 0.2 0.3"/>
      <site name="bob" pos="0 0 -0.8"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="torque_x" joint="ball" gear="1 0 0"/>
    <motor name="torque_y" joint="ball" gear="0 1 0"/>
  </actuator>
</mujoco>"""

# Pendulum on a hinge: point mass of 1.2 kg at 0.5 m, damping 0.3 N m s/rad, torque motor.
HINGE_PENDULUM = """
<mujoco model="hinge pendulum">
  <option gravity="0 0 -9.81" integrator="{integrator}" timestep="{timestep}"/>
  <worldbody>
    <body name="arm">
      <joint name="swing" type="hinge" axis="0 1 0" damping="0.3"/>
      <inertial pos="0 0 -0.5" mass="1.2" diaginertia="1e-9 1e-9 1e-9"/>
      <site name="end" pos="0 0 -0.5"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="swing" ctrllimited="true" ctrlrange="-{limit} {limit}"/></actuator>
  <keyframe><key name="tilted" qpos="0.4"/></keyframe>
</mujoco>"""

# A free rigid body of 3 kg without gravity, with a force along its own z axis.
FREE_BODY = """
<mujoco model="free body">
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="craft">
      <freejoint name="craft"/>
      <inertial pos="0 0 0" mass="3" diaginertia="0.4 0.5 0.6"/>
      <site name="centre"/>
    </body>
  </worldbody>
  <actuator><motor name="thrust" site="centre" gear="0 0 1 0 0 0"/></actuator>
</mujoco>"""

# Light slides and hinge on one chain with a payload of any mass, off the hinge's axis.
LIGHT_CARRIER = """
<mujoco model="light carrier">
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="base">
      <joint name="x" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="1e-6" diaginertia="1 1 1"/>
      <body name="carrier" pos="0 0 1">
        <joint name="d" type="slide" axis="1 0 0"/>
        <joint name="r" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0" mass="1e-6" diaginertia="0.1 0.1 0.1"/>
        <body name="payload" pos="0 0 0.5"><inertial pos="0 0 0" mass="0" diaginertia="0 0 0"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="x"/></actuator>
</mujoco>"""

# Joint and tendon springs and dampers, and a body whose mass comes from its geom.
SPRINGS = """
<mujoco model="springs">
  <option gravity="0 0 -9.81" timestep="0.002"/>
  <worldbody>
    <body name="cart">
      <joint name="x" type="slide" axis="1 0 0" stiffness="5" damping="1"/>
      <geom type="box" size="0.2 0.1 0.1" density="700" contype="0" conaffinity="0"/>
      <body name="arm" pos="0 0 0.1">
        <joint name="swing" type="hinge" axis="0 1 0" stiffness="2" damping="0.1" springref="0.3"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 -0.6" size="0.03" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="link" stiffness="4" damping="0.2"><joint joint="x" coef="1"/><joint joint="swing" coef="-0.5"/></fixed>
  </tendon>
  <actuator><motor name="push" joint="x"/></actuator>
</mujoco>"""


def plant_of(folder: Path, mjcf: str, **options: Any) -> Plant:
    """A plant from MJCF text, by way of a file in `folder`."""
    path = folder / "model.xml"
    path.write_text(mjcf)
    return Plant.from_xml(path, **options)


def hinge_pendulum(folder: Path, *, integrator: str = "RK4", timestep: float = 1e-3, limit: float = 10.0, **options: Any) -> Plant:
    """The hinge pendulum with its torque as input and its angle as output."""
    text = HINGE_PENDULUM.format(integrator=integrator, timestep=timestep, limit=limit)
    return plant_of(folder, text, inputs=["torque"], outputs=["joint:swing"], **options)


def cantilever() -> Plant:
    """The shipped cantilever with its tip mass as parameter."""
    return Plant.from_xml(
        model_path("cantilever"), inputs=["base_force"], outputs=["tip_position"], parameters={"tip_mass": "body:tip:mass"}
    )
