"""Ratios that tell what invtrack costs: each compares two things in one run, in turns, so that they hold on any machine.

python benchmarks/benchmark.py            # all of them, about two minutes
python benchmarks/benchmark.py --quick    # a tenth of the sizes
"""

from __future__ import annotations

import functools
import itertools
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median
from typing import Any

import mujoco
import numpy as np
import scipy.signal
import scipy.stats
import tyro

import invtrack
from invtrack.arrays import Array
from invtrack.plant.configuration import configuration_of
from invtrack.results.result import Signal
from invtrack.studies.table import Cell, Column, print_table

TWO_DISC = (
    [[0, 1, 0, 0], [-3.1555, -0.1640, 3.1555, 0.3845], [0, 0, 0, 1], [2.8956, -0.0899, -2.8956, -0.1124]],
    [[0], [1.8139], [0], [0.27]],
    [[0, 0, 1, 0]],
)
"""The two-disc torsional rig (Devasia 1996, AIAA note) in the state order (th1, th1', th2, th2')."""


@dataclass(frozen=True)
class Timing:
    """Seconds of both, and the median over the turns of the first one's share of the second."""

    first: float
    second: float
    ratio: float


def in_turns(first: Callable[[], object], second: Callable[[], object], turns: int) -> Timing:
    """Run both in turns and compare turn by turn."""
    pairs = []
    for _ in range(turns + 1):
        seconds = []
        for work in (first, second):
            begin = time.perf_counter()
            work()
            seconds.append(time.perf_counter() - begin)
        pairs.append(seconds)
    return compared(pairs)


def compared(pairs: Sequence[Sequence[float]]) -> Timing:
    """Both medians and that of the ratios, without the first pair: it pays for what is read and compiled once."""
    counted = pairs[1:]
    return Timing(
        first=median(pair[0] for pair in counted),
        second=median(pair[1] for pair in counted),
        ratio=median(pair[0] / pair[1] for pair in counted),
    )


def main(quick: bool = False, turns: int = 5) -> None:
    """Print the tables.

    Args:
        quick: a tenth of the sizes.
        turns: how often the two sides of a comparison are timed.
    """
    share = 0.1 if quick else 1.0
    imports(turns)
    with tempfile.TemporaryDirectory() as folder:
        closed_loop(Path(folder), int(100_000 * share), turns)
        sweeping(Path(folder), int(200 * share), min(turns, 3))
        recording(Path(folder), int(500_000 * share), turns)
    inversion_over_samples([int(n * share) for n in (10_000, 100_000, 1_000_000)], turns)
    inversion_over_spline(share, turns)
    methods_over_jumps([1, 10, 100, 1000] if not quick else [1, 10, 100], turns)
    limits_over_steps([0.04, 0.02, 0.01] if not quick else [0.08, 0.04], turns)
    linearization(turns)
    preview_updates(int(2000 * share))


SIMS = Path(__file__).parents[1] / "sims"
STARTED = ("minimal.py", "cantilever_jumps.py", "two_disc_redesign.py")
START = """import contextlib, io, runpy, sys
sys.path.insert(0, {folder!r})
sys.argv[:] = [{script!r}, "--help"]
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    runpy.run_path({script!r}, run_name="__main__")"""


def imports(turns: int) -> None:
    """Importing invtrack and starting sims in a fresh interpreter, against importing the two libraries without which they can do
    nothing. A sim has started when it has read its options: here it is asked for its help, which takes all of that and no work.
    """
    used = "Plant, model_path, linearize, SwitchedSystem, rest_to_rest, invert, TrackingController, lqr, Change, simulate"
    programs = {
        "import invtrack": "import invtrack",
        "the names of README's program": f"from invtrack import {used}",
        "a study's names": "import invtrack.studies, invtrack.figures",
        **{f"start of sims/{name}": START.format(folder=str(SIMS), script=str(SIMS / name)) for name in STARTED},
    }
    rows: dict[str, dict[str, Cell]] = {}
    for name, program in programs.items():
        timing = compared([[seconds_of(program), seconds_of("import mujoco, scipy.linalg")] for _ in range(turns + 1)])
        rows[name] = {"time": timing.first, "libraries": timing.second, "ratio": timing.ratio}
    columns = [Column("time", "s"), Column("mujoco, scipy.linalg", "s", "libraries"), Column("ratio")]
    print_table("Imports in a fresh interpreter", columns=columns, rows=rows, row_header="program")


def seconds_of(program: str) -> float:
    """Processor time of a program in a fresh interpreter, the interpreter's own start not counted."""
    timed = f"import time; begin = time.process_time()\n{program}\nprint(time.process_time() - begin)"
    return float(subprocess.run([sys.executable, "-c", timed], capture_output=True, text=True, check=True).stdout)


def closed_loop(folder: Path, steps: int, turns: int) -> None:
    """The whole of simulate (state feedback on a plan, everything recorded) against mj_step(nstep), in processor time.

    MuJoCo steps the same model without velocity couplings and records nothing. "held" holds the input over each step, "stages"
    evaluates the law at every stage of RK4; "compiled loop" is the stepping alone of "held".
    """
    rows: dict[str, dict[str, Cell]] = {}
    for plant in (cantilever(), two_disc(), hover(), chain(folder, 21)):
        controller = tracking(plant)
        start = controller.plan.manoeuvre[0] - 1.0
        span: dict[str, Any] = {"start": start, "end": start + 1e-3 * steps, "timestep": 1e-3}
        span["initial_state"] = controller.plan.states(start)[0]
        moving = controller.plan.states(np.mean(controller.plan.manoeuvre))[0]
        pairs: dict[str, list[tuple[float, float]]] = {"held": [], "stages": [], "loop": []}
        for _ in range(turns + 1):
            for evaluate in ("held", "stages"):
                bare = stepped(plant, steps, moving)
                marks: list[tuple[float, float]] = []
                begin = time.process_time()
                invtrack.simulate(
                    plant,
                    controller,
                    evaluate=evaluate,  # type: ignore[arg-type]
                    progress=lambda share, marks=marks: marks.append((share, time.process_time())),  # type: ignore[misc]
                    **span,
                )
                pairs[evaluate].append((bare, time.process_time() - begin))
                if evaluate == "held":
                    (first_share, first), (last_share, last) = marks[0], marks[-1]
                    pairs["loop"].append((bare, (last - first) / (last_share - first_share)))
        row: dict[str, Cell] = {"bare": 1e6 * compared(pairs["held"]).first / steps}
        rows[f"{plant.name}, {plant.model.nv} degrees of freedom"] = row
        row.update({name: compared(found).ratio for name, found in pairs.items()})
    columns = [
        Column("mj_step", "us/step", "bare"),
        Column("compiled loop", key="loop"),
        Column("simulate, held", key="held"),
        Column("simulate, stages", key="stages"),
    ]
    print_table(f"Share of MuJoCo's own speed, {steps} steps", columns=columns, rows=rows, row_header="model")


def stepped(plant: invtrack.Plant, steps: int, x: Array) -> float:
    """Processor time of MuJoCo's own loop over so many steps of 1 ms, every second of them from the state x (n,) on: at rest it is
    faster, and what nobody controls moves away.
    """
    model = plant.model_with()
    model.opt.timestep = 1e-3
    data = plant.new_data(model)
    begin = time.process_time()
    for first in range(0, steps, 1000):
        data.qpos[:], data.qvel[:], data.act[:] = configuration_of(model, plant.configuration.x0, plant.coordinates_of(x))
        mujoco.mj_step(model, data, nstep=min(1000, steps - first))
    return time.process_time() - begin


def sweeping(folder: Path, runs: int, turns: int) -> None:
    """Closed-loop runs of the cantilever's manoeuvre (20 s at 1 ms, masses and instants drawn) on one core, on two, and against two
    threads that only call mj_step(nstep) for as many steps. Wall time: the machine must have two idle cores.
    """
    (plant, controller), steps = manoeuvre(), round((MONTE_CARLO_SPAN[1] - MONTE_CARLO_SPAN[0]) / 1e-3)
    moving = controller.plan.states(np.mean(controller.plan.manoeuvre))[0]
    drawn = {"mass": scipy.stats.norm(1.0, 0.01), "delay": scipy.stats.uniform(-0.01, 0.02)}
    design = invtrack.sweeps.monte_carlo(drawn, runs, seed=0)
    number = itertools.count()

    def swept(workers: int) -> None:
        invtrack.sweeps.sweep(
            drawn_run,
            design,
            out=folder / f"sweep{next(number)}",
            prepare=manoeuvre,
            numbers=short_metrics,
            workers=workers,
            progress=lambda share: None,
        )

    def bare() -> None:
        with ThreadPoolExecutor(2) as pool:
            for job in [pool.submit(stepped, plant, steps, moving) for _ in range(runs)]:
                job.result()

    one = in_turns(lambda: swept(1), lambda: swept(2), turns)
    two = in_turns(bare, lambda: swept(2), turns)
    rows: dict[str, dict[str, Cell]] = {
        f"{runs} runs": {"rate": runs / one.second, "gain": one.ratio, "share": two.ratio},
    }
    columns = [
        Column("two cores", "runs/s", "rate"),
        Column("one core's time / two cores'", key="gain"),
        Column("share of mj_step's speed on two", key="share"),
    ]
    print_table("Sweep of the cantilever's manoeuvre", columns=columns, rows=rows)


MASSES = (0.0, 100.0, 10.0)  # [kg]
JUMPS = (np.pi / 2, 3 * np.pi / 2)  # [s]
MONTE_CARLO_SPAN = (-8.0, 12.0)  # [s]


def drawn_run(
    point: Mapping[str, Any], seed: int, prepared: tuple[invtrack.Plant, invtrack.TrackingController]
) -> invtrack.RunResult:
    """One run with masses and instants that the plan does not know."""
    (plant, controller), (start, end) = prepared, MONTE_CARLO_SPAN
    return invtrack.simulate(
        plant,
        controller,
        schedule=[invtrack.Change(t + point["delay"], tip_mass=m * point["mass"]) for t, m in zip(JUMPS, MASSES[1:], strict=True)],
        timestep=1e-3,
        start=start,
        end=end,
        initial_state=controller.plan.states(start)[0],
    )


def short_metrics(run: invtrack.RunResult) -> invtrack.results.Metrics:
    """Metrics of a run that is too short for five periods of the slowest mode."""
    return invtrack.metrics(run, duration=5.0)


@cache
def manoeuvre() -> tuple[invtrack.Plant, invtrack.TrackingController]:
    """The manoeuvre of sims/cantilever_jumps.py."""
    plant = cantilever()
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in MASSES], JUMPS)
    plan = invtrack.invert(model, invtrack.raised_cosine(2.0), tolerance=1e-8)
    return plant, invtrack.TrackingController(plan, invtrack.lqr(model, Q=100.0, R=0.01))


def recording(folder: Path, steps: int, turns: int) -> None:
    """Time to write a recording, against the time of the run itself, and its size on the disk, against that of the run's arrays."""
    plant = cantilever()
    controller = tracking(plant)
    start = controller.plan.manoeuvre[0] - 1.0

    def run() -> invtrack.RunResult:
        return invtrack.simulate(plant, controller, timestep=1e-3, start=start, end=start + 1e-3 * steps)

    result = run()
    path = folder / "run.rrd"
    timing = in_turns(lambda: invtrack.save_recording(result, path), run, turns)
    signals = [value for value in vars(result).values() if isinstance(value, Signal)]
    rows: dict[str, dict[str, Cell]] = {
        f"{steps} steps": {
            "write": timing.first,
            "run": timing.second,
            "ratio": timing.ratio,
            "per_step": 1e6 * timing.first / steps,
            "arrays": (sum(signal.values.nbytes for signal in signals) + result.time.nbytes + result.qpos.nbytes) / steps,
            "parquet": path.with_suffix(".parquet").stat().st_size / steps,
            "rrd": path.stat().st_size / steps,
        }
    }
    columns = [Column("write", "s"), Column("run", "s"), Column("ratio"), Column("write per step", "us", "per_step")]
    sizes = [Column("arrays", "B/step"), Column(".parquet", "B/step", "parquet"), Column(".rrd", "B/step", "rrd")]
    print_table("Writing a recording against the run", columns=[*columns, *sizes], rows=rows)


def inversion_over_samples(sizes: Sequence[int], turns: int) -> None:
    """Plan and evaluate the inverse of the two-disc rig at N times, against one scipy.signal.lsim of its output."""
    A, B, C = (np.array(matrix, dtype=float) for matrix in TWO_DISC)
    model = invtrack.StateSpace(A, B, C)
    reference = invtrack.rest_to_rest(0.0, 1.0, 10.0, smoothness=3)
    rows: dict[str, dict[str, Cell]] = {}
    for size in sizes:
        plan = invtrack.invert(model, reference)
        times = np.linspace(plan.start, plan.end, size)
        u = plan(times).u[:, 0]

        def inverse(times: np.ndarray = times) -> None:
            invtrack.invert(model, reference)(times)

        def simulation(u: np.ndarray = u, times: np.ndarray = times) -> None:
            scipy.signal.lsim((A, B, C, np.zeros((1, 1))), u, times - times[0])

        timing = in_turns(inverse, simulation, turns if size < 500_000 else min(turns, 3))
        rows[str(size)] = {
            "inverse": timing.first,
            "lsim": timing.second,
            "ratio": timing.ratio,
            "per_sample": 1e9 * timing.first / size,
        }
    columns = [Column("inverse", "s"), Column("lsim", "s"), Column("ratio"), Column("per sample", "ns")]
    print_table("Inverse of the two-disc rig against scipy.signal.lsim", columns=columns, rows=rows, row_header="samples")


def inversion_over_spline(share: float, turns: int) -> None:
    """Plan and evaluate the inverse for a reference that is itself a spline through N samples, against the tenth of them."""
    model = invtrack.StateSpace(*(np.array(matrix, dtype=float) for matrix in TWO_DISC))
    exact = invtrack.rest_to_rest(0.0, 1.0, 10.0, smoothness=3)

    def make(size: int) -> None:
        times = np.linspace(0.0, 10.0, size)
        plan = invtrack.invert(model, invtrack.sampled_reference(times, exact(times)))
        plan(np.linspace(plan.start, plan.end, size))

    rows: dict[str, dict[str, Cell]] = {}
    for size in (int(100_000 * share), int(1_000_000 * share)):
        timing = in_turns(lambda size=size: make(size), lambda size=size: make(size // 10), min(turns, 3))  # type: ignore[misc]
        rows[str(size)] = {"time": timing.first, "ratio": timing.ratio, "per_sample": 1e6 * timing.first / size}
    columns = [Column("time", "s"), Column("ratio to a tenth of the samples", key="ratio"), Column("per sample", "us")]
    print_table("Spline through samples: build, plan, evaluate", columns=columns, rows=rows, row_header="samples")


def methods_over_jumps(numbers: Sequence[int], turns: int) -> None:
    """Plan through N jumps of the tip mass, against one jump, by each method that knows jumps."""
    plant = cantilever()
    models = [invtrack.linearize(plant, tip_mass=mass) for mass in (0.0, 100.0, 10.0)]
    duration = 2 * np.pi
    reference = invtrack.raised_cosine(2.0)
    exosystem = invtrack.references.sinusoidal_exosystem([1.0], start=0.0, end=duration)
    methods: dict[str, Callable[[invtrack.SwitchedSystem], object]] = {
        "invert": lambda model: invtrack.invert(model, reference),
        "modified_inversion": lambda model: invtrack.modified_inversion(
            model, reference, axis_distance=0.5, real_part=1.0, interval=0, error_poles=[-1.0, -2.0], design="robust"
        ),
        "quadratic_redesign": lambda model: invtrack.quadratic_redesign(model, reference, R=1e-5, Q_y=1.0),
        "exosystem_map": lambda model: invtrack.exosystem_map(model, exosystem),
    }

    def switched(jumps: int) -> invtrack.SwitchedSystem:
        return invtrack.SwitchedSystem([models[k % 3] for k in range(jumps + 1)], duration * np.arange(1, jumps + 1) / (jumps + 1))

    rows: dict[str, dict[str, Cell]] = {}
    for name, method in methods.items():
        for jumps in numbers:
            timing = in_turns(lambda: method(switched(jumps)), lambda: method(switched(1)), turns)  # noqa: B023 called at once
            rows[f"{name}, {jumps}"] = {"time": timing.first, "ratio": timing.ratio, "per_jump": 1e3 * timing.first / jumps}
    columns = [Column("time", "s"), Column("ratio to one jump", key="ratio"), Column("per jump", "ms")]
    print_table("Planning through parameter jumps on the cantilever", columns=columns, rows=rows, row_header="method, jumps")


def limits_over_steps(steps: Sequence[float], turns: int) -> None:
    """The optimum within hard limits at decreasing steps, against the one without limits, which has none."""
    model = invtrack.StateSpace(*TWO_DISC)
    reference = invtrack.rest_to_rest(0.0, 1.0, duration=10.0)
    limits = invtrack.Limits(input=0.045)
    weights = {"R": 1.0, "Q_y": 10.0}
    rows: dict[str, dict[str, Cell]] = {}
    for step in steps:
        timing = in_turns(
            lambda: invtrack.constrained_redesign(model, reference, **weights, limits=limits, step=step),  # noqa: B023 called at once
            lambda: invtrack.quadratic_redesign(model, reference, **weights),
            turns,
        )
        rows[f"{1e3 * step:g} ms"] = {"time": timing.first, "free": timing.second, "ratio": timing.ratio}
    columns = [Column("within limits", "s", "time"), Column("without", "s", "free"), Column("ratio")]
    print_table("Redesign of a 10 s slew within |u| <= 0.045", columns=columns, rows=rows, row_header="step")


def linearization(turns: int) -> None:
    """linearize, with error estimates and checks, against mjd_transitionFD, which gives the discrete map of an Euler step."""
    plant = cantilever()
    model = plant.model_with()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    data = plant.new_data(model)
    n, p = plant.n_states, len(plant.inputs)
    A, B = np.zeros((n, n)), np.zeros((n, p))
    repeat = 20

    def ours() -> None:
        for _ in range(repeat):
            invtrack.linearize(plant)

    def theirs() -> None:
        for _ in range(repeat):
            mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)

    timing = in_turns(ours, theirs, turns)
    rows: dict[str, dict[str, Cell]] = {
        "cantilever": {"ours": 1e3 * timing.first / repeat, "theirs": 1e3 * timing.second / repeat, "ratio": timing.ratio}
    }
    columns = [Column("linearize", "ms", "ours"), Column("mjd_transitionFD", "ms", "theirs"), Column("ratio")]
    print_table("Linearization", columns=columns, rows=rows, row_header="model")


CONTROL_PERIOD = 0.01  # [s]


def preview_updates(updates: int) -> None:
    """Updates of a planner that looks 20 s ahead, every 10 ms, against planning afresh, in turns, in processor time."""
    beam = cantilever()
    jumping = invtrack.SwitchedSystem(
        [invtrack.linearize(beam, tip_mass=mass) for mass in (0.0, 100.0, 10.0)], [0.5 * np.pi, 1.5 * np.pi]
    )
    weights = {"R": 1e-5, "Q_y": 1.0}
    machines = {
        "two-disc rig": (invtrack.StateSpace(*TWO_DISC), invtrack.rest_to_rest(0.0, 1.0, duration=5.0), {"R": 1.0, "Q_y": 1.0}),
        "cantilever through jumps": (jumping, invtrack.raised_cosine(2.0), weights),
    }
    rows: dict[str, dict[str, Cell]] = {}
    for name, (model, reference, weight) in machines.items():
        for method in ("inversion", "redesign"):
            times = {"preview": 20.0, "period": CONTROL_PERIOD, "start": -20.0}
            if method == "inversion":
                planner = invtrack.preview.inversion_planner(model, **times)
                afresh = functools.partial(invtrack.invert, model, reference)
            else:
                planner = invtrack.preview.redesign_planner(model, **times, **weight)
                afresh = functools.partial(invtrack.quadratic_redesign, model, reference, **weight)
            pairs, done = [], []
            for number in range(updates):
                begin = time.process_time()
                planner.update(reference)
                done.append(time.process_time() - begin)
                if number % (updates // 10) == 0:
                    begin = time.process_time()
                    afresh()
                    pairs.append([done[-1], time.process_time() - begin])
            rows[f"{name}, {method}"] = {
                "update": 1e3 * median(done),
                "slowest": 1e3 * float(np.quantile(done, 0.99)),
                "share": median(done) / CONTROL_PERIOD,
                "ratio": compared(pairs).ratio,
            }
    columns = [Column("update", "ms"), Column("99 of 100 below", "ms", "slowest"), Column("of the period", key="share")]
    print_table(
        f"Updates of a planner that looks 20 s ahead, every {1e3 * CONTROL_PERIOD:g} ms",
        columns=[*columns, Column("ratio to planning afresh", key="ratio")],
        rows=rows,
        row_header="planner",
    )


def cantilever() -> invtrack.Plant:
    return invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        parameters={"tip_mass": "body:tip:mass"},
    )


def two_disc() -> invtrack.Plant:
    return invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])


def hover() -> invtrack.Plant:
    sys.path.insert(0, str(SIMS))
    from hover.aircraft import helicopter

    return helicopter()


def chain(folder: Path, links: int) -> invtrack.Plant:
    """A chain of carts coupled by springs, pushed at the first and followed at the second."""
    bodies, tendons = "", ""
    for k in range(links):
        bodies += (
            f'<body pos="0 {k} 0"><joint name="x{k}" type="slide" axis="1 0 0" damping="0.1"/><geom size="0.2" mass="1"/></body>'
        )
        if k:
            joints = f'<joint joint="x{k}" coef="1"/><joint joint="x{k - 1}" coef="-1"/>'
            tendons += f'<fixed stiffness="50" damping="0.1" springlength="0">{joints}</fixed>'
    path = folder / "chain.xml"
    path.write_text(
        f'<mujoco model="chain"><option gravity="0 0 0" integrator="RK4"><flag contact="disable"/></option>'
        f'<worldbody>{bodies}</worldbody><tendon>{tendons}</tendon><actuator><motor name="push" joint="x0"/></actuator></mujoco>'
    )
    return invtrack.Plant.from_xml(path, inputs=["push"], outputs=["joint:x1"])


def tracking(plant: invtrack.Plant) -> invtrack.TrackingController:
    """Feedforward and feedback for a slow motion of all outputs by a tenth of a unit."""
    model = invtrack.linearize(plant)
    p = model.n_outputs
    plan = invtrack.invert(model, invtrack.rest_to_rest(np.zeros(p), np.full(p, 0.1), 5.0, smoothness=4), tolerance=1e-6)
    return invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))


if __name__ == "__main__":
    tyro.cli(main)
