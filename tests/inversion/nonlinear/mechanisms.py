"""Mechanisms that turn, hang and fly, and their motions: what linear inverses end at."""

from __future__ import annotations

import numpy as np

import invtrack
from invtrack.references import stack

HEAD = """<option timestep="0.001" integrator="RK4" gravity="{gravity}"><flag contact="disable"/></option>
<compiler angle="radian" autolimits="true"/>"""


def model(name: str, body: str, *, gravity: str = "0 0 -9.81") -> str:
    return f'<mujoco model="{name}">{HEAD.format(gravity=gravity)}{body}</mujoco>'


CART_POLE = model(
    "cart_pole",
    """<worldbody><body><joint name="cart" type="slide" axis="1 0 0" damping="0.1"/><geom type="box" size=".1 .05 .05" mass="1"/>
    <body name="pole"><joint name="pole" type="hinge" axis="0 1 0" damping="0.002"/>
    <geom type="capsule" fromto="0 0 0 0 0 1" size=".02" mass=".1"/></body></body></worldbody>
    <actuator><motor name="force" joint="cart"/></actuator>""",
)

FLEXIBLE_JOINT = model(
    "flexible_joint",
    """<worldbody><body><joint name="motor" type="hinge" axis="0 -1 0" damping="0.05"/>
    <inertial pos="0 0 0" mass="0.5" diaginertia=".02 .02 .02"/>
    <body><joint name="spring" type="hinge" axis="0 -1 0" stiffness="100" damping="0.02"/>
    <geom type="capsule" fromto="0 0 0 0.5 0 0" size=".02" mass="1"/></body></body></worldbody>
    <tendon><fixed name="link"><joint joint="motor" coef="1"/><joint joint="spring" coef="1"/></fixed></tendon>
    <actuator><motor name="torque" joint="motor"/></actuator>""",
)

TWO_FLEXIBLE_JOINTS = model(
    "two_flexible_joints",
    """<worldbody>
    <body pos="0 .3 0"><joint name="m0" type="hinge" axis="0 -1 0" damping=".05"/>
      <inertial pos="0 0 0" mass=".1" diaginertia=".02 .02 .02"/></body>
    <body pos="0 .4 0"><joint name="m1" type="hinge" axis="0 -1 0" damping=".05"/>
      <inertial pos="0 0 0" mass=".1" diaginertia=".01 .01 .01"/></body>
    <body><joint name="q0" type="hinge" axis="0 -1 0" damping=".02"/>
      <geom type="capsule" fromto="0 0 0 .5 0 0" size=".02" mass="1"/>
      <body pos=".5 0 0"><joint name="q1" type="hinge" axis="0 -1 0" damping=".02"/>
        <geom type="capsule" fromto="0 0 0 .4 0 0" size=".02" mass=".7"/></body></body></worldbody>
    <tendon><fixed name="s0" stiffness="100" springlength="0"><joint joint="m0" coef="1"/><joint joint="q0" coef="-1"/></fixed>
      <fixed name="s1" stiffness="60" springlength="0"><joint joint="m1" coef="1"/><joint joint="q1" coef="-1"/></fixed></tendon>
    <actuator><motor name="t0" joint="m0"/><motor name="t1" joint="m1"/></actuator>""",
)

PVTOL = model(
    "pvtol",
    """<worldbody><body><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <joint name="roll" type="hinge" axis="0 -1 0"/><inertial pos="0 0 0" mass="1" diaginertia=".2 .2 .2"/><site name="c"/></body>
    </worldbody><actuator><motor name="thrust" site="c" gear="0 0 1 0 0 0"/><motor name="turn" site="c" gear=".15 0 0 0 -1 0"/>
    </actuator><keyframe><key name="hover" ctrl="9.81 0"/></keyframe>""",
)


SATELLITE = model(
    "satellite",
    """<worldbody><body name="b"><freejoint name="f"/><site name="c"/>
    <inertial pos="0 0 0" mass="1.5" diaginertia=".3 .2 .1"/></body>
    </worldbody><actuator>"""
    + "".join(f'<motor name="u{i}" site="c" gear="{" ".join("01"[i == j] for j in range(6))}"/>' for i in range(6))
    + "</actuator>",
    gravity="0 0 0",
)


def flexible_link(*, gravity: str = "0 0 0") -> str:
    """A rod of four parts on sprung hinges, with a payload at its tip."""
    inertia = " ".join(["3e-4"] * 3)
    rod = f'<body name="tip" pos="0.25 0 0"><inertial pos="0 0 0" mass="0.2" diaginertia="{inertia}"/></body>'
    for i in (3, 2, 1, 0):
        joint = f'<joint name="d{i}" type="hinge" axis="0 0 1" stiffness="30" damping="0.03"/>' if i else ""
        pos = "0.25 0 0" if i else "0 0 0"
        rod = f'<body pos="{pos}">{joint}<geom type="box" pos=".125 0 0" size=".125 .01 .02" mass="0.125"/>{rod}</body>'
    angle = "".join(f'<joint joint="{name}" coef="1"/>' for name in ("hub", "d1", "d2", "d3"))
    return model(
        "flexible_link",
        f"""<worldbody><body><joint name="hub" type="hinge" axis="0 0 1" damping="0.05"/>
        <inertial pos="0 0 0" mass="1" diaginertia=".05 .05 .05"/>{rod}</body></worldbody>
        <tendon><fixed name="tip_angle">{angle}</fixed></tendon><actuator><motor name="torque" joint="hub"/></actuator>""",
        gravity=gravity,
    )


def cart_pole() -> invtrack.Plant:
    return invtrack.Plant.from_xml(CART_POLE, inputs=["force"], outputs=["joint:cart"])


def flexible_joint() -> invtrack.Plant:
    """Held horizontally against gravity by its spring."""
    plant = invtrack.Plant.from_xml(FLEXIBLE_JOINT, inputs=["torque"], outputs=["tendon:link"])
    return invtrack.trim(plant, outputs=[0.0]).plant


def two_flexible_joints() -> invtrack.Plant:
    plant = invtrack.Plant.from_xml(TWO_FLEXIBLE_JOINTS, inputs=["t0", "t1"], outputs=["joint:q0", "joint:q1"])
    return invtrack.trim(plant, outputs=[0.0, 0.0]).plant


def pvtol() -> invtrack.Plant:
    return invtrack.Plant.from_xml(PVTOL, inputs=["thrust", "turn"], outputs=["site:c:x", "site:c:z"], keyframe="hover")


def link(*, hanging: bool = False) -> invtrack.Plant:
    """The flexible link in the horizontal plane; or in the vertical one, 60 degrees below the horizontal."""
    gravity = "0 -9.81 0" if hanging else "0 0 0"
    plant = invtrack.Plant.from_xml(
        flexible_link(gravity=gravity), inputs=["torque"], outputs=["tendon:tip_angle"], parameters={"payload": "body:tip:mass"}
    )
    return invtrack.trim(plant, outputs=[-np.pi / 3]).plant if hanging else plant


def sideways(distance: float) -> invtrack.PiecewiseSignal:
    """For the PVTOL: to the side at constant height."""
    return stack([invtrack.rest_to_rest(0.0, distance, duration=2.0), invtrack.rest_to_rest(0.0, 0.0, duration=2.0)])


def satellite() -> invtrack.Plant:
    """A free body with a force and a torque along each of its own axes."""
    outputs = [f"joint:f:{coordinate}" for coordinate in ("x", "y", "z", "rx", "ry", "rz")]
    return invtrack.Plant.from_xml(SATELLITE, inputs=[f"u{i}" for i in range(6)], outputs=outputs)
