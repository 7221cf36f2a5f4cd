"""A small MuJoCo run, made by stepping a mechanism by hand, and a reader of recordings that knows nothing of invtrack."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

from invtrack.channels import Channels
from invtrack.results.result import Event, RunResult, Signal

MJCF = """
<mujoco>
  <option timestep="0.004" gravity="0 0 0"><flag contact="disable"/></option>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" pos="0 0 -1"/>
    <geom name="hidden" type="sphere" size="1" rgba="1 0 0 0"/>
    <geom name="collision_only" type="sphere" size="1" group="3"/>
    <site name="wall" pos="-1 0 0"/>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom name="box" type="box" size="0.3 0.2 0.1" rgba="0.1 0.2 0.3 1"/>
      <geom name="ellipsoid" type="ellipsoid" size="0.3 0.2 0.1"/>
      <geom name="cylinder" type="cylinder" size="0.05 0.4"/>
      <site name="hook" pos="0 0 0.5"/>
      <body name="arm" pos="0 0 0.5">
        <joint name="hinge" type="hinge" axis="0 1 0"/>
        <geom name="rod" type="capsule" fromto="0.1 0 0 0.1 0.3 0.4" size="0.02"/>
        <body name="tip" pos="0 0 1">
          <geom name="payload" type="sphere" size="0.2" mass="1" rgba="0.8 0.2 0.1 1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="rope" width="0.01"><site site="wall"/><site site="hook"/></spatial>
    <spatial name="hoist">
      <site site="wall"/><site site="hook"/><pulley divisor="2"/><site site="hook"/><site site="wall"/>
    </spatial>
    <spatial name="unseen" rgba="0 0 0 0"><site site="wall"/><site site="hook"/></spatial>
  </tendon>
</mujoco>
"""

MASSES = (0.0, 8.0, 1.0)
"""Tip masses [kg] in force from the steps CHANGES on."""

CHANGES = (0, 100, 200)


def mechanism_run(name: str = "inversion", steps: int = 300) -> RunResult:
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qvel[:] = 0.3, -0.7
    qpos, state = np.empty((steps + 1, 2)), np.empty((steps + 1, 4))
    for step in range(steps + 1):
        qpos[step], state[step] = data.qpos, np.concatenate([data.qpos, data.qvel])
        mujoco.mj_step(model, data)
    time = -0.4 + 0.004 * np.arange(steps + 1)
    masses = np.array(MASSES)[np.searchsorted(CHANGES, np.arange(steps), side="right") - 1]
    output = Signal(qpos[:, :1].copy(), Channels(("tip_position",), ("m",)))
    force = Signal(np.sin(7 * time[:-1, np.newaxis]), Channels(("base_force",), ("N",)))
    wanted = np.full((steps + 1, 4), np.nan)
    wanted[:, 0] = time
    states = Channels(("slide", "hinge", "slide velocity", "hinge velocity"), ("m", "rad", "m/s", "rad/s"))
    binary = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    return RunResult(
        name=name,
        model="cart with arm",
        time=time,
        state=Signal(state, states),
        state_reference=Signal(wanted, states),
        output=output,
        reference=Signal(np.where(time > 0, time, 0.0)[:, np.newaxis], output.channels),
        planned_output=Signal(np.full((steps + 1, 1), np.nan), output.channels),
        commanded=force,
        applied=Signal(np.clip(force.values, -0.5, 0.5), force.channels),
        parameters=Signal(np.column_stack([masses, np.full(steps, 0.25)]), Channels(("tip_mass", "damping"), ("kg", "N s/m"))),
        manoeuvre=(0.0, 0.6),
        rest_inputs=np.array([[0.0], [0.1 + 0.2]]),
        timestep=0.004,
        evaluate="held",
        integrator="RK4",
        vibration_period=float("nan"),
        events=[
            Event(0.0, "manoeuvre", "start"),
            Event(0.1 + 0.2, "parameter", 'tip_mass "8" -> 1 kg, β'),
            Event(0.8, "end", "end of the run"),
        ],
        remarks=['the run ends at t = 0.8 s, "early"', "β"],
        parameter_bodies={"tip_mass": "tip", "damping": "arm"},
        qpos=qpos,
        message="nothing to say",
        mjb=binary.tobytes(),
    )


@pytest.fixture(scope="session")
def run() -> RunResult:
    return mechanism_run()


class Recorded:
    """The contents of a file as Rerun's own reader gives them."""

    def __init__(self, path: Path, *, blueprint: bool = False) -> None:
        reader = RrdReader(path)
        store = reader.blueprints()[0] if blueprint else reader.recordings()[0]
        self.batches: dict[str, list[Any]] = defaultdict(list)
        for chunk in reader.stream(store=store):
            self.batches[chunk.entity_path].append(chunk.to_record_batch())

    def column(self, path: str, name: str) -> list[Any]:
        """All values of a component or timeline of an entity, in the order of the file."""
        return [value for batch in self.batches[path] if name in batch.schema.names for value in batch.column(name).to_pylist()]

    def having(self, name: str) -> list[str]:
        """Paths of the entities that have a component."""
        return [path for path, batches in self.batches.items() if any(name in batch.schema.names for batch in batches)]
