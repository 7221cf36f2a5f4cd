"""What planning on a mechanism's nonlinear motion costs: over the number of nodes, and with 20 degrees of freedom.

python benchmarks/motions.py                      # about two minutes
python benchmarks/motions.py --figure nodes.png   # draws the time over the nodes, too
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import matplotlib.pyplot as plt
import tyro

import invtrack
from invtrack.plant.native.motions import Machine
from invtrack.studies.table import Column, print_table

HOLDS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
"""Periods of the hold [s] that the cart-pole's input is planned for."""

LINKS, DURATION, DISTANCE = 19, 8.0, 3.0
"""Of the chain that hangs from a trolley, and of its motion [s], [m]."""


@dataclass(frozen=True)
class Timing:
    """A plan, the processor time of all threads and the time on the clock that it took [s], and the share of the processor time
    that went by outside of the compiled loops round mj_forward: linear algebra, meshes, certificate."""

    plan: invtrack.Plan
    processor: float
    clock: float
    outside: float


def main(turns: int = 3, figure: Path | None = None) -> None:
    """Print the tables.

    Args:
        turns: how often each plan is made; medians count, and a turn before them, in which code is compiled and read, does not.
        figure: file to draw the time over the nodes in.
    """
    over_nodes = {f"{1e3 * hold:g} ms": timed(functools.partial(cart_pole, hold), turns) for hold in HOLDS}
    columns = [Column("nodes"), Column("Newton steps", key="steps"), Column("processor time", "s", "processor")]
    print_table(
        "A cart-pole, 3 m in 2 s, for ever shorter holds",
        columns=[*columns, Column("per node", "us", "per_node")],
        rows={
            name: {**row(timing), "per_node": 1e6 * timing.processor / len(timing.plan.breakpoints)}
            for name, timing in over_nodes.items()
        },
        row_header="hold",
    )
    if figure is not None:
        draw(list(over_nodes.values()), figure)
    chain = timed(trolley, turns)
    print_table(
        f"A trolley with a hanging chain of {LINKS} links, {DISTANCE:g} m in {DURATION:g} s",
        columns=[*columns, Column("clock", "s"), Column("outside mj_forward", key="outside")],
        rows={"20 degrees of freedom": {**row(chain), "clock": chain.clock, "outside": chain.outside}},
        row_header="plan",
    )


def row(timing: Timing) -> dict[str, Any]:
    """What both tables tell of a plan."""
    steps = len(timing.plan.iterations)  # type: ignore[attr-defined]
    return {"nodes": len(timing.plan.breakpoints), "steps": steps, "processor": timing.processor}


def cart_pole(hold: float) -> invtrack.Plan:
    """The plan for 3 m in 2 s, for a hold of that period [s]."""
    plant = invtrack.Plant.from_xml(invtrack.model_path("cart_pole"), inputs=["force"], outputs=["joint:cart"])
    return invtrack.invert(plant, invtrack.rest_to_rest(0.0, 3.0, duration=2.0), hold=hold)


def trolley() -> invtrack.Plan:
    """The plan for a trolley whose chain has no zero in the right half plane, without a hold."""
    rod = ""
    for number in reversed(range(LINKS)):
        place = -0.1 if number else 0.0
        rod = (
            f'<body pos="0 0 {place}"><joint name="link{number}" axis="0 1 0" damping="0.003"/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.01" mass="0.1"/>{rod}</body>'
        )
    text = (
        '<mujoco model="chain"><option timestep="0.001" integrator="RK4" viscosity="0.3"><flag contact="disable"/></option>'
        '<worldbody><body><joint name="trolley" type="slide" axis="1 0 0" damping="1"/>'
        f'<geom type="box" size="0.1 0.05 0.05" mass="1"/>{rod}</body></worldbody>'
        '<actuator><motor name="force" joint="trolley"/></actuator></mujoco>'
    )
    plant = invtrack.Plant.from_xml(text, inputs=["force"], outputs=["joint:trolley"])
    return invtrack.invert(plant, invtrack.rest_to_rest(0.0, DISTANCE, duration=DURATION))


def timed(work: Callable[[], invtrack.Plan], turns: int) -> Timing:
    """The medians over the turns."""
    found: list[Timing] = []
    for _ in range(turns + 1):
        inside: list[float] = []
        kept = {name: getattr(Machine, name) for name in ("integrate", "perturbed", "evaluate")}
        for name, loop in kept.items():
            setattr(Machine, name, counted(loop, inside))
        processor, clock = time.process_time(), time.perf_counter()
        try:
            plan = work()
        finally:
            for name, loop in kept.items():
                setattr(Machine, name, loop)
        processor, clock = time.process_time() - processor, time.perf_counter() - clock
        found.append(Timing(plan, processor, clock, 1 - sum(inside) / processor))
    later = found[1:]
    return Timing(plan, *(median(getattr(timing, name) for timing in later) for name in ("processor", "clock", "outside")))


def counted(loop: Callable[..., None], inside: list[float]) -> Callable[..., None]:
    """The compiled loop, whose calls leave the processor times of their threads [s] in `inside`."""

    @functools.wraps(loop)
    def work(*arguments: Any) -> None:
        begin = time.thread_time()
        loop(*arguments)
        inside.append(time.thread_time() - begin)

    return work


def draw(timings: list[Timing], path: Path) -> None:
    """Time over nodes, beside the straight line through the first and the last of them."""
    nodes = [len(timing.plan.breakpoints) for timing in timings]
    seconds = [timing.processor for timing in timings]
    figure, axes = plt.subplots(figsize=(5.2, 3.2), layout="constrained")
    axes.plot([nodes[0], nodes[-1]], [seconds[0], seconds[-1]], "k--", lw=1, label="straight line")
    axes.plot(nodes, seconds, "o", label="plan of a cart-pole's motion")
    axes.set_xlabel("nodes")
    axes.set_ylabel("processor time [s]")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.grid(visible=True, alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    tyro.cli(main)
