"""What `advise` recommends against a denser sweep over method, smoothness, duration and weights, on mechanisms in MuJoCo.

    python benchmarks/advice.py [crane] [cart_pole] [dm_cart_pole] [flexible_arm] [slung_load]

dm_cart_pole is the cart-pole of dm_control's suite, of the extra `gallery`.

Every plan of the sweep is driven on the plant under the feedback of the recommendation; of those that keep to the error the one
with the least peak input is what there was to find. The last column is to be at most 1.5.
"""

from __future__ import annotations

import importlib.metadata
import itertools
import sys
import time
import warnings
from collections.abc import Callable, Iterator

import numpy as np

import invtrack
from invtrack.advice import Advice

ERROR, TIMESTEP = 0.01, 2e-3
DURATIONS, SMOOTHNESSES, DECADES = (1.0, 0.9, 0.8, 0.7), (1, 2, 3, 4, 5), np.arange(-7.0, -0.99, 0.5)

CRANE = """<mujoco model="crane"><option integrator="RK4"/>
<worldbody>
  <body name="trolley">
    <joint name="x" type="slide" axis="1 0 0" damping="1"/>
    <geom type="box" size=".2 .1 .05" mass="5"/>
    <body name="rope">
      <joint name="swing" type="hinge" axis="0 1 0" damping=".02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -1.5" size=".01" mass=".1"/>
      <body name="load" pos="0 0 -1.5"><geom type="sphere" size=".1" mass="2"/><site name="load"/></body>
    </body>
  </body>
</worldbody>
<actuator><motor name="drive" joint="x" ctrlrange="-60 60" ctrllimited="true"/></actuator></mujoco>"""

ARM = """<mujoco model="flexible_arm"><option integrator="RK4" gravity="0 0 0"/>
<worldbody>
  <body name="rotor">
    <joint name="motor" type="hinge" axis="0 0 1" damping="0.05"/>
    <inertial pos="0 0 0" mass="0.1" diaginertia="0.02 0.02 0.02"/>
    <body name="link">
      <joint name="spring" type="hinge" axis="0 0 1" stiffness="40" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.02" mass="1"/>
      <site name="tip" pos="0.5 0 0"/>
    </body>
  </body>
</worldbody>
<actuator><motor name="torque" joint="motor" ctrlrange="-20 20" ctrllimited="true"/></actuator></mujoco>"""


def crane() -> tuple[invtrack.Plant, invtrack.Move]:
    return invtrack.Plant.from_xml(CRANE, inputs=["drive"], outputs=["site:load:x"]), invtrack.Move(1.0, 3.0)


def flexible_arm() -> tuple[invtrack.Plant, invtrack.Move]:
    return invtrack.Plant.from_xml(ARM, inputs=["torque"], outputs=["site:tip:yaw"]), invtrack.Move(0.8, 1.0)


def cart_pole() -> tuple[invtrack.Plant, invtrack.Move]:
    path = invtrack.model_path("cart_pole")
    return invtrack.Plant.from_xml(path, inputs=["force"], outputs=["joint:cart"]), invtrack.Move(1.0, 2.0)


def dm_cart_pole() -> tuple[invtrack.Plant, invtrack.Move]:
    suite = importlib.metadata.distribution("dm-control").locate_file("dm_control/suite/cartpole.xml")
    return invtrack.Plant.from_xml(str(suite), inputs=["slide"], outputs=["joint:slider"]), invtrack.Move(0.5, 2.0)


def slung_load() -> tuple[invtrack.Plant, invtrack.Move]:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("slung_load"),
        inputs=["front_left", "front_right", "rear_left", "rear_right"],
        outputs=["body:load:x", "body:load:y", "body:load:z", "body:vehicle:yaw"],
        keyframe="hover",
    )
    return plant, invtrack.Move([1.0, 0.0, 0.0, 0.0], 2.0)


MECHANISMS: dict[str, Callable[[], tuple[invtrack.Plant, invtrack.Move]]] = {
    "crane": crane,
    "flexible_arm": flexible_arm,
    "cart_pole": cart_pole,
    "dm_cart_pole": dm_cart_pole,
    "slung_load": slung_load,
}


def plans(model: invtrack.StateSpace, move: invtrack.Move, R_0: np.ndarray) -> Iterator[invtrack.Plan]:
    """Of the sweep, those that can be made; R_0 (m, m) makes an input as large as the motion takes as dear as an error as large."""
    start = model.operating_point.y0
    size = float(np.max(np.abs(move.by)))
    for share, smoothness in itertools.product(DURATIONS, SMOOTHNESSES):
        reference = invtrack.rest_to_rest(start, start + move.by, duration=share * move.duration, smoothness=smoothness)
        calls = [lambda reference=reference: invtrack.invert(model, reference)]
        calls += [
            lambda reference=reference, decade=decade: invtrack.quadratic_redesign(
                model, reference, R=10**decade * R_0, Q_y=1 / size**2
            )
            for decade in DECADES
        ]
        for call in calls:
            try:
                yield call()
            except invtrack.InvtrackError:
                continue


def least_of_sweep(plant: invtrack.Plant, move: invtrack.Move, advice: Advice) -> tuple[float, int]:
    """Least peak input of the plans that keep to the error on the plant, and how many plans there were."""
    best = advice.recommended
    assert best is not None
    model = invtrack.linearize(plant)
    size = float(np.max(np.abs(move.by)))
    moved = np.where(move.by != 0, np.abs(move.by), size)
    inputs = np.maximum(np.max(np.abs(best.run.applied.values - best.run.rest_inputs[0]), axis=0), 1e-9)
    gains = best.settings["controller"].gains.gains[0]
    least, count = np.inf, 0
    for plan in plans(model, move, np.diag(inputs**-2.0)):
        count += 1
        low, high = plan.input_range
        peak = float(np.max(np.maximum(np.abs(low), np.abs(high))))
        times = np.linspace(-move.duration, 2 * move.duration, 601)
        if peak >= least or np.max(np.abs(plan(times).y - plan(times).y_d) / moved) > ERROR:
            continue
        start = max(plan.start, -3 * move.duration)
        run = invtrack.simulate(
            plant, invtrack.TrackingController(plan, gains), start=start, end=3 * move.duration, timestep=TIMESTEP
        )
        limits = plant.input_limits
        kept = np.all((run.commanded.values >= limits[:, 0]) & (run.commanded.values <= limits[:, 1]))
        if run.status == "completed" and kept and np.max(np.abs(run.error) / moved) <= ERROR:
            least = min(least, float(np.max(np.abs(run.applied.values))))
    return least, count


def main(names: list[str]) -> None:
    print("mechanism     recommended                          peak input  least of sweep (plans)  ratio  advise [s]")
    for name in names or MECHANISMS:
        plant, move = MECHANISMS[name]()
        began = time.perf_counter()
        advice = invtrack.advise(plant, move, error=ERROR, timestep=TIMESTEP)
        took = time.perf_counter() - began
        best = advice.recommended
        if best is None:
            print(f"{name:12}  {advice.reason}")
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            least, count = least_of_sweep(plant, move, advice)
        what = f"{best.method}, {best.duration:.3g} s, smoothness {best.smoothness}"
        print(
            f"{name:12}  {what:36} {best.peak_input:10.4g}  {least:10.4g} ({count:3d})  {best.peak_input / least:8.3f}  {took:9.1f}"
        )


if __name__ == "__main__":
    main(sys.argv[1:])
