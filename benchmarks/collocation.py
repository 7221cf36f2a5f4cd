"""Planning on the nonlinear motion against direct collocation in Drake with IPOPT: a cart with a pole that stands on it.

python benchmarks/collocation.py    # needs pip install '.[drake]'

Both plan the force with which the cart of models/cart_pole.xml follows the same reference, from rest to rest; both plans are driven
in MuJoCo under the same feedback, in steps of 1 ms. Drake is given the mechanism's numbers as MuJoCo's compiler makes them, and as
many conditions as unknowns: the output at every node, and rest of what is left at the two ends. Times are processor times of
planning alone, of all threads, medians over the turns; the first turn, in which code is compiled and read, does not count.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median

import mujoco
import numpy as np
import tyro
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint, SpatialInertia, UnitInertia
from pydrake.planning import DirectCollocation
from pydrake.solvers import IpoptSolver, SolverOptions
from pydrake.trajectories import PiecewisePolynomial

import invtrack
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import PolynomialSegments, Trajectory
from invtrack.studies.table import Cell, Column, print_table

DURATION, WINDOW = 2.0, 4.0
"""Of the motion, and before and after it [s]."""

DISTANCES, NODES = (3.0, 10.0), (601, 2001)
"""[m], and of Drake's time."""

STEP = 1e-3
"""Of the runs [s]."""

CLOSED = 1e-9
"""Constraints of Drake's program are met to this, in its units."""

OURS: dict[str, dict[str, float]] = {
    "invtrack": {},
    "invtrack, nodes within 0.8 s": {"max_preactuation": 0.8, "max_postactuation": 0.8},
    "invtrack, nodes within 0.4 s": {"max_preactuation": 0.4, "max_postactuation": 0.4},
    "invtrack, for the hold": {"hold": STEP},
    "invtrack, for the hold, within 0.4 s": {"hold": STEP, "max_preactuation": 0.4, "max_postactuation": 0.4},
}
"""Options of `invert`; outside of their nodes plans go on along their tails."""

COLUMNS = (
    Column("window", "s", "window"),
    Column("nodes"),
    Column("processor time", "s", "time"),
    Column("max error", "of motion", "error"),
)


@dataclass(frozen=True)
class Entry:
    """A plan, the processor time [s] that it took, and the window [s] and nodes in which it was found."""

    plan: invtrack.Plan
    time: float
    window: float
    nodes: int


@dataclass(frozen=True, eq=False)
class Collocated:
    """What Drake finds: times (k,) [s], states and their rates (k, 4), forces (k,) [N]."""

    times: np.ndarray
    states: np.ndarray
    slopes: np.ndarray
    forces: np.ndarray


def main(turns: int = 5, distance: tuple[float, ...] = DISTANCES, nodes: tuple[int, ...] = NODES) -> None:
    """Print one table for each distance.

    Args:
        turns: how often each plan is timed.
        distance: of the motion [m].
        nodes: of Drake's time.
    """
    for far in distance:
        rows = rows_for(far, nodes, turns)
        title = f"Cart-pole, {far:g} m in {DURATION:g} s, driven in MuJoCo in steps of 1 ms"
        print_table(title, columns=COLUMNS, rows=rows, row_header="plan")


def rows_for(distance: float, nodes: tuple[int, ...], turns: int) -> dict[str, dict[str, Cell]]:
    """The rows of one table.

    Args:
        distance: of the motion [m].
        nodes: of Drake's time.
        turns: how often each plan is timed.
    """
    plant = invtrack.Plant.from_xml(invtrack.model_path("cart_pole"), inputs=["force"], outputs=["joint:cart"])
    reference = invtrack.rest_to_rest(0.0, distance, duration=DURATION)
    like = invtrack.invert(plant, reference)
    gains = invtrack.lqr(like, Q=1.0, R=1.0)
    entries = {f"Drake, IPOPT, {count} nodes": by_collocation(plant, like, reference, count, turns) for count in nodes}
    for name, options in OURS.items():
        entries[name] = by_inversion(plant, reference, turns, **options)
    return {
        name: {
            "window": entry.window,
            "nodes": entry.nodes,
            "time": entry.time,
            "error": driven(plant, entry.plan, gains) / distance,
        }
        for name, entry in entries.items()
    }


def driven(plant: invtrack.Plant, plan: invtrack.Plan, gains: invtrack.GainSchedule) -> float:
    """Largest error [m] of a plan under feedback, tails included."""
    controller, (start, end) = invtrack.TrackingController(plan, gains), (-2 * WINDOW, DURATION + 2 * WINDOW)
    return invtrack.max_error(invtrack.simulate(plant, controller, timestep=STEP, start=start, end=end, vibration_period=0.1))


def timed(work: Callable[[], object], turns: int) -> float:
    """Median of the processor time [s] that it takes, without the first turn."""
    seconds = []
    for _ in range(turns + 1):
        begin = time.process_time()
        work()
        seconds.append(time.process_time() - begin)
    return median(seconds[1:])


def by_inversion(plant: invtrack.Plant, reference: invtrack.PiecewiseSignal, turns: int, **options: float) -> Entry:
    """The plan of `invert`."""
    plan = invtrack.invert(plant, reference, **options)
    seconds = timed(lambda: invtrack.invert(plant, reference, **options), turns)
    edges = plan.breakpoints
    return Entry(plan, seconds, max(-float(edges[0]), float(edges[-1]) - DURATION), len(edges))


def by_collocation(
    plant: invtrack.Plant, like: invtrack.Plan, reference: invtrack.PiecewiseSignal, nodes: int, turns: int
) -> Entry:
    """The plan of Drake's direct collocation, from the wanted way of the cart with the pole upright as first guess.

    Args:
        plant: whose numbers the mechanism has.
        like: a plan on the same plant, whose model and reference this one shares.
        reference: of the cart.
        nodes: of its time.
        turns: how often it is timed.
    """
    times = np.linspace(-WINDOW, DURATION + WINDOW, nodes)
    found = collocated(mechanism(plant.model), reference, times)
    seconds = timed(lambda: collocated(mechanism(plant.model), reference, times), turns)
    return Entry(as_plan(like, found), seconds, WINDOW, nodes)


def mechanism(model: mujoco.MjModel) -> MultibodyPlant:
    """The cart-pole in Drake, with the masses, inertias, axes and dampings of the compiled model."""
    plant = MultibodyPlant(time_step=0.0)
    parent, bodies = plant.world_frame(), {}
    for name, joint in (("cart", PrismaticJoint), ("pole", RevoluteJoint)):
        body, dof = model.body(name), model.joint(name)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, body.iquat)
        turn = rotation.reshape(3, 3)
        mass, centre = float(body.mass[0]), np.array(body.ipos)
        about_centre = turn @ np.diag(body.inertia) @ turn.T
        about_frame = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        unit = about_frame / mass
        inertia = SpatialInertia(mass, centre, UnitInertia(unit[0, 0], unit[1, 1], unit[2, 2], unit[0, 1], unit[0, 2], unit[1, 2]))
        bodies[name] = plant.AddRigidBody(name, inertia)
        axis, damping = np.array(dof.axis), float(dof.damping[0])
        added = plant.AddJoint(joint(name, parent, bodies[name].body_frame(), axis, damping=damping))
        if name == "cart":
            plant.AddJointActuator("force", added)
        parent = bodies[name].body_frame()
    plant.mutable_gravity_field().set_gravity_vector(model.opt.gravity)
    plant.Finalize()
    return plant


def collocated(plant: MultibodyPlant, reference: invtrack.PiecewiseSignal, times: np.ndarray) -> Collocated:
    """A motion in which the cart is where it is wanted at every one of the times (k,) [s], evenly spaced. Raises RuntimeError."""
    step, wanted = float(times[1] - times[0]), reference(times)[:, 0]
    program = DirectCollocation(
        plant,
        plant.CreateDefaultContext(),
        num_time_samples=len(times),
        minimum_time_step=step,
        maximum_time_step=step,
        input_port_index=plant.get_actuation_input_port().get_index(),
        assume_non_continuous_states_are_fixed=True,
    )
    prog = program.prog()
    for k, place in enumerate(wanted):
        prog.AddBoundingBoxConstraint(place, place, program.state(k)[0])
    for end in (0, len(times) - 1):  # what is left to say: speed of the cart and angle of the pole
        prog.AddBoundingBoxConstraint(0.0, 0.0, program.state(end)[[1, 2]])
    rates = reference(times, derivative=1)[:, 0]
    guess = np.vstack([wanted, np.zeros_like(wanted), rates, np.zeros_like(wanted)])
    since = times - times[0]  # Drake's time begins at 0
    program.SetInitialTrajectory(
        PiecewisePolynomial.FirstOrderHold(since, np.zeros((1, len(since)))), PiecewisePolynomial.FirstOrderHold(since, guess)
    )
    options = SolverOptions()
    options.SetOption(IpoptSolver.id(), "tol", CLOSED)
    options.SetOption(IpoptSolver.id(), "constr_viol_tol", CLOSED)
    result = IpoptSolver().Solve(prog, solver_options=options)
    if not result.is_success():
        raise RuntimeError(f"IPOPT finds no motion: {result.get_solution_result()}")
    path = program.ReconstructStateTrajectory(result)
    states, slopes = (np.array([path.EvalDerivative(time, order)[:, 0] for time in since]) for order in (0, 1))
    forces = np.array([result.GetSolution(program.input(k))[0] for k in range(len(times))])
    return Collocated(times, states, slopes, forces)


def as_plan(like: invtrack.Plan, found: Collocated) -> invtrack.Plan:
    """What Drake found as a plan: cubics in the states, straight lines in the force, rest outside.

    The plan `like` lends model and reference, of both ends of whose motion deviations are those from the same upright pole at rest.
    """
    start, end = found.states[:-1], found.states[1:]
    h = np.diff(found.times)[:, None]
    slope, slope_end, rise = h * found.slopes[:-1], h * found.slopes[1:], end - start
    states = np.stack([start, slope, 3 * rise - 2 * slope - slope_end, slope + slope_end - 2 * rise], axis=1)
    forces = np.zeros((*states.shape[:2], 1))
    forces[:, 0, 0], forces[:, 1, 0] = found.forces[:-1], np.diff(found.forces)
    values = np.concatenate([states, forces, states[:, :, :1]], axis=2)
    model = invtrack.SwitchedSystem([like.model.systems[0]])
    held = [np.concatenate([found.states[k], [0.0], found.states[k, :1]]) for k in (0, -1)]
    trajectory = Trajectory(
        breakpoints=found.times,
        groups=(PolynomialSegments(values, h[:, 0]),),
        group=np.zeros(len(h), dtype=np.intp),
        number=np.arange(len(h)),
        before=Tail.holding(-1, held[0]),
        after=Tail.holding(1, held[1]),
    )
    return replace(like, method="direct collocation", model=model, trajectory=trajectory, preactuation=WINDOW, postactuation=WINDOW)


if __name__ == "__main__":
    tyro.cli(main)
