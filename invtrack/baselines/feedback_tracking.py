"""Following by feedback around the steady state of each commanded output, and of its first derivatives."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, whole_number
from invtrack.control.gains import GainSchedule
from invtrack.errors import ControlError, InversionError, PlanError
from invtrack.inversion.inverse_system import require_square
from invtrack.inversion.no_preactuation import quasi_static
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import two_sided_problem
from invtrack.references.generator import Generator
from invtrack.references.signal import PiecewiseSignal

MOST_DERIVATIVES = 4
"""Derivatives of the command that a law uses at most; a further one is known in practice only to those who plan."""

DECAYS = 1e-12
"""A pole counts as stable where it is further left of the axis than this share of the fastest."""


def feedback_tracking(
    model: Any,
    reference: PiecewiseSignal,
    *,
    gains: GainSchedule | ArrayLike,
    command: PiecewiseSignal | None = None,
    derivatives: int = 0,
    tolerance: float = 1e-10,
    max_postactuation: float | None = None,
) -> Plan:
    """What the feedback u = u_c(t) - K (x - x_c(t)) makes of a command c: of the reference itself, or of a shaped one.

    x_c = sum of X_i c^(i) and u_c = sum of U_i c^(i), i = 0 ... `derivatives`, are the state and input of a slow motion of the
    output along c. With `derivatives` = 0 they are the steady state of each wanted output, A X_0 + B U_0 = 0 and C X_0 + D U_0 = 1:
    the law is then u = -K x + N c with a static gain N, which is LQR without preview where K = lqr(model), and a profile under
    feedback alone where K is a servo's. With 1 the velocity is fed forward, with 2 the acceleration: u_c is then what would move
    the mechanism if it were rigid.

    The plan is the motion x, u, y of the linear model under this law, from rest and not a moment before the command. A
    TrackingController with the same gains around it is this law, on any plant, since u_ff + K x_ref is u_c + K x_c. It is not
    exact: `certificate.output_error` says by how much its y misses the reference, whatever the command was.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D, with as many inputs as outputs.
        reference: the wanted output, absolute, in the units of the outputs.
        gains: as `lqr`, `place` and `base_servo` make them, or one gain K (m, n); their switch times may differ from the model's.
        command: what the law is told to follow, such as `shaper(kind, modes).shaped(reference)`; the reference unless stated.
        derivatives: of the command that are fed forward, from 0 to 4. A jump of c, or of a derivative, makes the input jump.
        tolerance, max_postactuation: as for `invert`.

    Raises PlanError where the loop is not stable before or after the manoeuvre, ControlError for gains or derivatives that do not
    fit, RelativeDegreeError for inputs left over, InversionError where an output cannot be held, TrajectoryError for a reference or
    a command with a wrong number of channels.
    """
    count = whole_number("derivatives", derivatives, highest=MOST_DERIVATIVES, error=ControlError)
    plant, schedule = _together(as_switched(model), gains)
    wanted = PlanningProblem.of(plant, reference, tolerance=tolerance, max_postactuation=max_postactuation)
    told = wanted if command is None else PlanningProblem.of(plant, command, tolerance=tolerance)
    require_square(plant, "feedback_tracking")
    loops = _loops(plant, schedule, count)
    for loop in (loops[0], loops[-1]):
        loop.require_stable()
    try:
        trajectory = two_sided_problem(told, loops, shifts=plant.shifts).solve().trajectory()
    except InversionError as error:
        raise PlanError(
            "the command runs on for ever with a mode that is a pole of the loop, so that the response grows; change the mode or "
            "the gains, or hold the output before and after the manoeuvre"
        ) from error
    plan: Plan = wanted.plan("feedback tracking", trajectory, exact=False)
    return replace(plan, remarks=(inexact(plan), *plan.remarks))


def inexact(plan: Plan) -> str:
    """The remark that says how far a plan's output is off the reference by design."""
    return f"not exact: the planned output misses the reference by up to {plan.certificate.output_error:.2g} of its motion"


def _together(plant: SwitchedSystem, gains: GainSchedule | ArrayLike) -> tuple[SwitchedSystem, list[Array]]:
    """The plant with the switch times of the gains among its own, and the gain of each of its intervals."""
    if not isinstance(gains, GainSchedule):
        gains = GainSchedule([gains])
    shape = (plant.n_inputs, plant.n_states)
    if gains.gains[0].shape != shape:
        raise ControlError(f"gains have shape {gains.gains[0].shape}, expected {shape} for this plant's inputs and states")
    times = np.union1d(plant.switch_times, gains.switch_times)
    if len(times) > len(plant.switch_times):
        systems = [plant.systems[0], *(plant.systems[k] for k in plant.interval(times))]
        plant = SwitchedSystem(systems, times)
    return plant, [gains.gains[0], *(gains.gains[k] for k in gains.interval(times))]


def _loops(plant: SwitchedSystem, gains: list[Array], derivatives: int) -> list[_Loop]:
    """The loop of each interval; intervals that share model and gain share it, too."""
    known: dict[tuple[int, bytes], _Loop] = {}
    keys = [(id(system), K.tobytes()) for system, K in zip(plant.systems, gains, strict=True)]
    for key, system, K in zip(keys, plant.systems, gains, strict=True):
        if key not in known:
            known[key] = _Loop(system, K, derivatives)
    return [known[key] for key in keys]


class _Loop:
    """x' = (A - B K) x + B v, u = -K x + v, v = sum of V_i c^(i): a two-sided system with a forward part alone, z = x / units."""

    def __init__(self, plant: StateSpace, K: Array, derivatives: int) -> None:
        n, self.units = plant.n_states, plant_units(plant)
        self.plant = plant
        self.V = [term[n:] + K @ term[:n] for term in quasi_static(plant, derivatives + 1)]
        rows = np.vstack([np.eye(n), -K, plant.C - plant.D @ K])
        A = (plant.A - plant.B @ K) * self.units / self.units[:, np.newaxis]
        forward = Part(A, rows * self.units, np.diag(self.units))
        self.system = TwoSidedSystem(forward, Part.empty(len(rows), n), np.diag(1 / self.units))

    def driven(self, generator: Generator) -> DrivenSystem:
        """The loop for commands c = R w, w' = S w."""
        v = np.sum([V @ generator.derivative(order) for order, V in enumerate(self.V)], axis=0)
        n, q = self.plant.n_states, len(generator.S)
        return DrivenSystem(
            system=self.system,
            S=generator.S,
            D_f=self.plant.B @ v / self.units[:, np.newaxis],
            D_b=np.zeros((0, q)),
            X_w=np.vstack([np.zeros((n, q)), v, self.plant.D @ v]),
            J_w=np.zeros((n, q)),
        )

    def require_stable(self) -> None:
        """Raises PlanError where the loop has poles on or right of the imaginary axis."""
        poles = np.linalg.eigvals(self.system.forward.A).astype(complex)
        fastest = float(np.max(np.abs(poles)))
        growing = poles[poles.real >= -DECAYS * fastest]
        if len(growing):
            raise PlanError(
                f"these gains do not stabilize the plant: the loop has poles at {format_zeros(growing, fastest)}; choose others, "
                "for instance invtrack.lqr(model, Q=1.0, R=1.0)"
            )
