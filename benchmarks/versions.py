"""How fast planning is in this version, against another one, on large plants, through many jumps and samples: in one run, in turns.

python benchmarks/versions.py --against ../older          # a checkout of the other version; about ten minutes with 400 states
python benchmarks/versions.py --against ../older --states 100 --turns 1
python benchmarks/versions.py --against ../older --only jumps samples
"""

from __future__ import annotations

import functools
import json
import operator
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import scipy.linalg
import tyro

import invtrack
from invtrack.inversion.feasibility import feasibility
from invtrack.linear.zeros import zero_report
from invtrack.studies.table import Cell, Column, print_table

Model = invtrack.StateSpace | invtrack.SwitchedSystem
Timed = Callable[[str, Callable[[], Any]], Any]

SAMPLES = 10_000
"""Times at which a plan is evaluated."""

MOTION = 10.0
"""Length of the motion [s]."""


def main(
    against: Path | None = None,
    states: int = 400,
    jumps: int = 1000,
    samples: int = 1_000_000,
    turns: int = 2,
    only: tuple[str, ...] = (),
    worker: str = "",
) -> None:
    """Print processor time of both versions and their ratio: medians over the turns.

    Args:
        against: a checkout of the other version.
        states: of the large plants, at least 12.
        jumps: of the cantilever's tip mass.
        samples: through which a spline is the reference of the two-disc rig.
        turns: how often both are timed.
        only: names of the cases to look at; all unless stated.
        worker: (how the comparison calls itself) the case to time with the version that is imported, as JSON.
    """
    sizes = {**dict.fromkeys(PLANTS, states), "jumps": jumps, "samples": samples}
    if unknown := sorted({*only, *filter(None, [worker])} - set(sizes)):
        sys.exit(f"expected cases from {list(sizes)}, got {unknown}")
    if worker:
        measure(worker, 12)  # once beforehand: what is loaded at its first use
        print(json.dumps({"version": invtrack.__file__, "seconds": measure(worker, sizes[worker])}))
    elif against is None:
        sys.exit("--against: expected the folder of another version's checkout")
    else:
        compare(against.resolve(), {name: size for name, size in sizes.items() if name in only or not only}, turns)


def compare(against: Path, sizes: dict[str, int], turns: int) -> None:
    """The table of all cases, each of its size, and tasks."""
    rows: dict[str, dict[str, Cell]] = {}
    for name, size in sizes.items():
        ours, theirs = [], []
        for _ in range(turns):
            theirs.append(run(against, name, size))
            ours.append(run(Path(__file__).resolve().parents[1], name, size))
        for task in (task for task in ours[0] if task in theirs[0]):
            this, other = ([seconds[task] for seconds in times] for times in (ours, theirs))
            ratio = median(b / a for a, b in zip(this, other, strict=True))
            rows[f"{name} ({size}), {task}"] = {"other": median(other), "this": median(this), "ratio": ratio}
    columns = [Column("other version", "s", "other"), Column("this version", "s", "this"), Column("times as fast", key="ratio")]
    print_table("Planning, one thread", columns=columns, rows=rows, row_header="case (states, jumps or samples), task")


def run(checkout: Path, name: str, size: int) -> dict[str, float]:
    """Seconds of each task of one case, by the version in `checkout`, in a fresh interpreter with one thread."""
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    option = name if name in ("jumps", "samples") else "states"
    command = [sys.executable, __file__, "--worker", name, f"--{option}", str(size)]
    report = json.loads(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment).stdout)
    if checkout not in Path(report["version"]).parents:
        sys.exit(f"expected invtrack from {checkout}, python imports {report['version']}")
    seconds: dict[str, float] = report["seconds"]
    return seconds


def measure(name: str, size: int) -> dict[str, float]:
    """Processor time [s] of each task of one case; those that the version refuses are left out."""
    seconds: dict[str, float] = {}

    def timed(task: str, work: Callable[[], Any]) -> Any:
        begin = time.process_time()
        try:
            result = work()
        except invtrack.InvtrackError:
            return None
        seconds[task] = time.process_time() - begin
        return result

    cases = {"jumps": through_jumps, "samples": through_samples}
    if name in cases:
        cases[name](size, timed)
    else:
        on_large_plant(PLANTS[name](size), timed)
    return seconds


def on_large_plant(model: Model, timed: Timed) -> None:
    """What a user does with a plant of many states."""
    there_and_back = _each_channel(model, [(0.0, 1.0), (1.0, 0.0)])
    first = model.systems[0] if isinstance(model, invtrack.SwitchedSystem) else model
    plan = timed("invert", lambda: invtrack.invert(model, _each_channel(model, [(0.0, 1.0)])))
    if plan is not None:
        timed("evaluate", lambda: plan(np.linspace(plan.start, plan.end, SAMPLES)))
    timed("quadratic_redesign", lambda: invtrack.quadratic_redesign(model, there_and_back, R=1e-4, Q_y=1.0))
    timed("zero_report", lambda: zero_report(first))
    timed("feasibility", lambda: feasibility(model, _each_channel(model, [(0.0, 1.0)])))


def through_jumps(jumps: int, timed: Timed) -> None:
    """The cantilever (Devasia, Paden, Rossi 1996) whose tip mass changes at every so many instants of one motion."""
    stiffness = np.array([[12.0, -12.0, 6.0], [-12.0, 12.0, -6.0], [6.0, -6.0, 4.0]])
    models = []
    for mass in (0.0, 100.0, 10.0):
        inertia = np.array([[156.0, 54.0, -13.0], [54.0, 156.0 + mass, -22.0], [-13.0, -22.0, 4.0]])
        accelerations = np.linalg.solve(inertia, np.column_stack([-stiffness, np.eye(3)[:, 0]]))
        A = np.block([[np.zeros((3, 3)), np.eye(3)], [accelerations[:, :3], np.zeros((3, 3))]])
        models.append(invtrack.StateSpace(A, np.append(np.zeros(3), accelerations[:, 3])[:, None], np.eye(6)[[1]]))
    instants = 2 * np.pi * np.arange(1, jumps + 1) / (jumps + 1)
    plant, reference = invtrack.SwitchedSystem([models[k % 3] for k in range(jumps + 1)], instants), invtrack.raised_cosine(2.0)
    moved: dict[str, Any] = {"axis_distance": 0.5, "real_part": 1.0, "interval": 0, "error_poles": [-1.0, -2.0], "design": "robust"}
    timed("invert", lambda: invtrack.invert(plant, reference))
    timed("modified_inversion", lambda: invtrack.modified_inversion(plant, reference, **moved))
    timed("quadratic_redesign", lambda: invtrack.quadratic_redesign(plant, reference, R=1e-5, Q_y=1.0))


def through_samples(samples: int, timed: Timed) -> None:
    """The two-disc rig (Devasia 1996) on a spline through samples of a slew, evaluated at as many times."""
    A = [[0, 1, 0, 0], [-3.1555, -0.1640, 3.1555, 0.3845], [0, 0, 0, 1], [2.8956, -0.0899, -2.8956, -0.1124]]
    model = invtrack.StateSpace(A, [[0], [1.8139], [0], [0.27]], [[0, 0, 1, 0]])
    times = np.linspace(0.0, MOTION, samples)
    values = invtrack.rest_to_rest(0.0, 1.0, MOTION, smoothness=3)(times)

    def plan() -> None:
        found = invtrack.invert(model, invtrack.sampled_reference(times, values))
        found(np.linspace(found.start, found.end, samples))

    timed("sampled_reference, invert, evaluate", plan)


def _each_channel(model: Model, moves: list[tuple[float, float]]) -> Any:
    """The same moves for every output, one after the other, with six continuous derivatives."""
    length = MOTION / len(moves)
    steps = [
        invtrack.rest_to_rest(0.0, end - start, length, smoothness=6, start_time=k * length) for k, (start, end) in enumerate(moves)
    ]
    motion = functools.reduce(operator.add, steps)  # moves start at 0
    return invtrack.references.stack([motion] * len(model.C))


def chain(states: int, follow: int = 0, last: float = 1.0) -> invtrack.StateSpace:
    """Masses between springs and light dampers, the first one tied to a wall and pushed, one of them followed."""
    n = states // 2
    stiffness = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stiffness[-1, -1] = 1.0
    mass = np.ones((n, 1))
    mass[-1] = last
    damping = 0.02 * stiffness + 0.01 * np.eye(n)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness / mass, -damping / mass]])
    return invtrack.StateSpace(A, np.eye(2 * n)[:, [n]], np.eye(2 * n)[[follow]])


def chain_with_jumps(states: int) -> invtrack.SwitchedSystem:
    """The chain whose last mass trebles and comes back, at three instants."""
    light, heavy = chain(states), chain(states, last=3.0)
    return invtrack.SwitchedSystem([light, heavy, light, heavy], [0.25 * MOTION, 0.5 * MOTION, 0.75 * MOTION])


def dense(states: int) -> invtrack.StateSpace:
    """A stable random plant with two inputs and outputs that has zeros on both sides of the imaginary axis."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(states, states)) / np.sqrt(states) - 1.3 * np.eye(states)
    return invtrack.StateSpace(A, rng.normal(size=(states, 2)), rng.normal(size=(2, states)))


def beam(states: int) -> invtrack.StateSpace:
    """A clamped Euler-Bernoulli beam of unit length, stiffness and mass, pushed and followed at half its length."""
    elements = states // 4
    a = 1 / elements
    unit = np.array([1, a, 1, a])  # of deflection and slope at both ends of an element
    element_stiffness = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]) * np.outer(unit, unit) / a**3
    element_mass = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) * np.outer(unit, unit)
    stiffness, mass = np.zeros((2 * elements + 2,) * 2), np.zeros((2 * elements + 2,) * 2)
    for k in range(elements):
        part = slice(2 * k, 2 * k + 4)
        stiffness[part, part] += element_stiffness
        mass[part, part] += element_mass * a / 420
    stiffness, mass = stiffness[2:, 2:], mass[2:, 2:]  # clamped at one end
    n, middle = 2 * elements, 2 * (elements // 2 - 1)
    damping = 1e-5 * stiffness + 4.0 * mass
    accelerations = scipy.linalg.solve(mass, np.column_stack([-stiffness, -damping, np.eye(n)[:, middle]]), assume_a="pos")
    A = np.vstack([np.eye(2 * n)[n:], accelerations[:, : 2 * n]])
    return invtrack.StateSpace(A, np.append(np.zeros(n), accelerations[:, -1])[:, np.newaxis], np.eye(2 * n)[[middle]])


PLANTS: dict[str, Callable[[int], Model]] = {
    "chain": chain,
    "chain, third mass": lambda states: chain(states, follow=2),
    "chain, 3 jumps": chain_with_jumps,
    "dense": dense,
    "beam": beam,
}


if __name__ == "__main__":
    tyro.cli(main)
