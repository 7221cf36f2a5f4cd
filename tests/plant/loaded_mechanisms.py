"""Mechanisms that gravity loads, in MJCF, whose equilibria are known by hand."""

from __future__ import annotations

# A mass of 2 kg on a vertical slide, carried by a position servo of 400 N/m.
HOIST = """
<mujoco model="hoist">
  <worldbody>
    <body name="load"><joint name="z" type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/></body>
  </worldbody>
  <actuator><position name="servo" joint="z" kp="400" kv="40"/></actuator>
</mujoco>"""

# Two point masses, 1.5 kg at the end of 0.4 m and 0.8 kg at the end of 0.3 m, in a vertical plane; servos of 120 and 60 N m/rad.
SERVO_ARM = """
<mujoco model="servo arm">
  <compiler angle="radian"/>
  <option integrator="implicitfast"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" type="hinge" axis="0 -1 0" {shoulder}/>
      <inertial pos="0.4 0 0" mass="1.5" diaginertia="1e-6 1e-6 1e-6"/>
      <body name="fore" pos="0.4 0 0">
        <joint name="elbow" type="hinge" axis="0 -1 0" {elbow}/>
        <inertial pos="0.3 0 0" mass="0.8" diaginertia="1e-6 1e-6 1e-6"/>
        <site name="tip" pos="0.3 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="120" kv="12"/>
    <position name="elbow" joint="elbow" kp="60" kv="6"/>
  </actuator>
</mujoco>"""

# A body of 1.2 kg with four rotors at (+-0.15, +-0.15) that also turn it about its own vertical, above a floor.
QUADROTOR = """
<mujoco model="quadrotor">
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="frame" pos="0 0 {height}">
      <freejoint name="frame"/>
      <geom name="hull" type="box" size="0.1 0.1 0.03" mass="1.2"/>
      <site name="front_left" pos="0.15 0.15 0"/>
      <site name="rear_left" pos="-0.15 0.15 0"/>
      <site name="rear_right" pos="-0.15 -0.15 0"/>
      <site name="front_right" pos="0.15 -0.15 0"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="front_left" site="front_left" gear="0 0 1 0 0 0.05" ctrllimited="true" ctrlrange="0 {thrust}"/>
    <motor name="rear_left" site="rear_left" gear="0 0 1 0 0 -0.05" ctrllimited="true" ctrlrange="0 {thrust}"/>
    <motor name="rear_right" site="rear_right" gear="0 0 1 0 0 0.05" ctrllimited="true" ctrlrange="0 {thrust}"/>
    <motor name="front_right" site="front_right" gear="0 0 1 0 0 -0.05" ctrllimited="true" ctrlrange="0 {thrust}"/>
  </actuator>
  <sensor><framexaxis name="heading" objtype="xbody" objname="frame"/></sensor>
</mujoco>"""
ROTORS = ("front_left", "rear_left", "rear_right", "front_right")

# A cart of 1 kg with a point mass of 0.2 kg at 0.6 m above its hinge.
CART_POLE = """
<mujoco model="cart-pole">
  <worldbody>
    <body name="cart">
      <joint name="x" type="slide" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="pole">
        <joint name="tilt" type="hinge" axis="0 1 0"/>
        <inertial pos="0 0 0.6" mass="0.2" diaginertia="1e-6 1e-6 1e-6"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="x"/></actuator>
</mujoco>"""

# A point mass of 1.2 kg at 0.5 m below a hinge with stops.
STOPPED_PENDULUM = """
<mujoco model="stopped pendulum">
  <compiler angle="radian"/>
  <worldbody>
    <body name="arm">
      <joint name="swing" type="hinge" axis="0 1 0" limited="true" range="{range}" {friction}/>
      <inertial pos="0 0 -0.5" mass="1.2" diaginertia="1e-9 1e-9 1e-9"/>
      <site name="end" pos="0 0 -0.5"/>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>"""

# A cart on a spring carries an arm of two links, the first held by a servo, the second by a spring; all numbers in other units.
ARM_IN_UNITS = """
<mujoco model="arm in units">
  <compiler angle="radian"/>
  <option gravity="0 0 -{acceleration}"/>
  <statistic extent="{length}"/>
  <worldbody>
    <body name="cart">
      <joint name="x" type="slide" axis="1 0 0" stiffness="{stiffness}"/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
      <body name="upper">
        <joint name="a" type="hinge" axis="0 -1 0"/>
        <inertial pos="{upper} 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
        <body name="fore" pos="{upper} 0 0">
          <joint name="b" type="hinge" axis="0 -1 0" stiffness="{torque}"/>
          <inertial pos="{fore} 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
          <site name="tip" pos="{fore} 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="x"/><position name="servo" joint="a" kp="{servo}"/></actuator>
</mujoco>"""

# Two hinges geared one to two by an equality; the second lifts a point mass of 0.5 kg at 0.3 m.
GEARED = """
<mujoco model="geared">
  <worldbody>
    <body name="wheel"><joint name="wheel" type="hinge" axis="0 -1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 0.1 1"/></body>
    <body name="lever" pos="0 1 0">
      <joint name="lever" type="hinge" axis="0 -1 0"/>
      <inertial pos="0.3 0 0" mass="0.5" diaginertia="1e-6 1e-6 1e-6"/>
    </body>
  </worldbody>
  <equality><joint name="gears" joint1="lever" joint2="wheel" polycoef="0 2 0 0 0"/></equality>
  <actuator><motor name="drive" joint="wheel"/></actuator>
</mujoco>"""

# A lever of 1 kg at 0.15 m between two muscles.
MUSCLES = """
<mujoco model="muscles">
  <compiler angle="radian"/>
  <worldbody>
    <body name="lever">
      <joint name="lever" type="hinge" axis="0 -1 0"/>
      <inertial pos="0.15 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
      <site name="upper_end" pos="0.1 0 0.03"/>
      <site name="lower_end" pos="0.1 0 -0.03"/>
    </body>
    <site name="above" pos="-0.2 0 0.1"/>
    <site name="below" pos="-0.2 0 -0.1"/>
  </worldbody>
  <tendon>
    <spatial name="upper"><site site="above"/><site site="upper_end"/></spatial>
    <spatial name="lower"><site site="below"/><site site="lower_end"/></spatial>
  </tendon>
  <actuator><muscle name="flexor" tendon="upper" force="300"/><muscle name="extensor" tendon="lower" force="300"/></actuator>
</mujoco>"""

LIMITED_SERVO = """
<mujoco>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0" {joint}/>
      <geom type="sphere" size="0.02" pos="0.3 0 0" mass="1"/>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="hinge" kp="230" kv="3" {servo}/></actuator>
</mujoco>"""
