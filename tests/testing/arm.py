"""A cart that carries a load on a spring: a mechanism small enough to be simulated in a moment."""

from __future__ import annotations

from pathlib import Path

import invtrack

ARM = """
<mujoco model="arm">
  <option gravity="0 0 0" integrator="RK4"/>
  <worldbody>
    <body name="cart">
      <joint name="base" type="slide" axis="1 0 0"/>
      <geom size="0.1" mass="1"/>
      <body name="load">
        <joint name="flex" type="slide" axis="1 0 0" stiffness="{stiffness}" damping="0.5"/>
        <geom size="0.1" mass="{mass}"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="force" joint="base"/></actuator>
</mujoco>
"""

REFERENCE = invtrack.rest_to_rest(0.0, 1.0, duration=2.0)


def arm(source: str | Path | None = None, *, mass: float = 0.5) -> invtrack.Plant:
    """The plant; its output is where the load is."""
    source = ARM.format(stiffness=40, mass=mass) if source is None else source
    return invtrack.Plant.from_xml(source, inputs=["force"], outputs=["body:load:x"], parameters={"load": "body:load:mass"})


def written(folder: Path, *, stiffness: float = 40) -> Path:
    """The MJCF in a file of this folder."""
    path = folder / "arm.xml"
    path.write_text(ARM.format(stiffness=stiffness, mass=0.5))
    return path


def design(
    model: invtrack.StateSpace | invtrack.SwitchedSystem, reference: invtrack.PiecewiseSignal, *, effort: float = 1e-3
) -> invtrack.TrackingController:
    """A redesigned plan, and state feedback around it."""
    plan = invtrack.quadratic_redesign(model, reference, R=effort, Q_y=1.0)
    return invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
