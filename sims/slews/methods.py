"""Ways to command one motion of a beam's tip through one and the same base servo, each as a plan of a given total time.

The tip goes out and comes back; on the way out the payload is halved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

import invtrack
from invtrack import baselines, linear, plans, references
from invtrack.mechanisms import Beam

BEAM = Beam(segments=6)  # its first mode is 0.6 % off that of a beam without segments; the methods know these six
WAY = 0.3  # of the tip [m]
MASSES = (0.5, 0.25)  # payload before and after it is halved [kg]
SHARE = 0.4  # of the total time, when it is halved: while the tip slows down on its way out
SERVO = {"position": "base", "frequency": 10.0, "damping": 0.7}
BAND = 20.0  # [rad/s], of the motion
WEIGHTS = {"R": 1e-6, "Q_y": 1.0}  # of the redesigns [1 / (N^2 s)], [1 / (m^2 s)]
CUT_OFF = 0.01  # share of the inverse's input at which its time begins and ends
ACCELERATION = 5.5  # of an S-curve, in units of WAY / duration^2: 4 is bang-bang, 8 has no time of constant acceleration
SLOWEST = 3  # modes of the loop for which "all modes" are shaped, the servo's own pair among them
UNCERTAIN = (-0.1, 0.1)  # errors of payload, and of stiffness, that the robust plan is made for
ROBUST_R = 1e-7  # of the servo's input, which is its stiffness times the command [1 / (N^2 s)]
ZPETC_HOLD = 0.02  # [s]

FEEDBACK, PROFILE, S_CURVE = "feedback alone", "profile", "S-curve"
KINDS = ("ZV", "ZVD", "ZVDD", "EI", "two-hump EI")
ALL_MODES = {f"{kind}, all modes": kind for kind in ("ZV", "ZVD", "EI")}
INVERSE, REDESIGN, ROBUST, ZPETC = "inverse", "redesign", "robust redesign", "ZPETC"
METHODS = (FEEDBACK, PROFILE, S_CURVE, *KINDS, *ALL_MODES, ZPETC, INVERSE, REDESIGN, ROBUST)


@cache
def mechanism(stiffness: float = 1.0) -> invtrack.Plant:
    """The beam as a plant, its hinges so many times as stiff as they should be; all else is as it was."""
    spec = BEAM.spec()
    for joint in spec.joints:
        joint.stiffness = stiffness * np.asarray(joint.stiffness)
    outputs, parameters = [BEAM.tip_output], {"payload": "body:payload:mass"}
    return invtrack.Plant.from_xml(spec, inputs=["force"], outputs=outputs, parameters=parameters)


@cache
def _with_payload(mass: float, stiffness: float) -> invtrack.StateSpace:
    return invtrack.linearize(mechanism(stiffness), payload=mass)


def switched(masses: Sequence[float], instant: float, *, stiffness: float = 1.0) -> invtrack.SwitchedSystem:
    """The beam with these payloads [kg] before and after the instant [s], and so many times its stiffness."""
    return invtrack.SwitchedSystem([_with_payload(mass, stiffness) for mass in masses], [instant])


@dataclass(frozen=True, eq=False)
class Slew:
    """The slew as the planners see it.

    masses: payloads before and after its change [kg]. total: time from rest to rest [s].
    """

    masses: tuple[float, float]
    total: float

    @property
    def instant(self) -> float:
        """When the payload changes [s]."""
        return SHARE * self.total

    @cached_property
    def model(self) -> invtrack.SwitchedSystem:
        """What is planned for."""
        return switched(self.masses, self.instant)

    @cached_property
    def servo(self) -> invtrack.GainSchedule:
        """The base servo that every way shares, made for the payload that it begins with."""
        servo = baselines.base_servo(self.model, **SERVO)  # type: ignore[arg-type]
        return invtrack.GainSchedule(servo.gains[:1])

    @cached_property
    def modes(self) -> tuple[baselines.Mode, ...]:
        """Of the loop with the payload that it ends with, the servo's own among them, slowest first: what is left to move."""
        return baselines.flexible_modes(self.model, gains=self.servo, interval=1, most_damping=0.99)

    @property
    def flexible(self) -> tuple[baselines.Mode, ...]:
        """Those of them that are little damped."""
        return tuple(mode for mode in self.modes if mode.damping < 0.5)

    @cached_property
    def reduction(self) -> linear.Reduction:
        """The model of few states that the inverse is made on."""
        return linear.balanced_truncation(self.model, band=BAND, accuracy=0.03)

    @cached_property
    def within(self) -> invtrack.PiecewiseSignal:
        """The motion for those who need time before and after it: as long as the inverse's input takes to grow and to die out."""
        rates = [abs(zero.value.real) for report in self.reduction.zeros_after for zero in report.zeros]
        tail = -np.log(CUT_OFF) / min(rates)
        motion = _there_and_back(
            lambda a, b, T, t: invtrack.rest_to_rest(a, b, duration=T, start_time=t, smoothness=4), self.total - 2 * tail
        )
        return motion.shifted(tail)

    def controller(self, method: str) -> invtrack.TrackingController:
        """The plan of a method, with the servo around it; it starts at t = 0 and has had its say at `total`."""
        period = ZPETC_HOLD if method == ZPETC else None
        return invtrack.TrackingController(self.plan(method), self.servo, period=period)

    def plan(self, method: str) -> invtrack.Plan:
        """The plan of a method."""
        makers: dict[str, Callable[[], invtrack.Plan]] = {
            FEEDBACK: lambda: self._commanded(_profile(self.total), derivatives=0),
            PROFILE: lambda: self._commanded(_profile(self.total)),
            S_CURVE: lambda: self._commanded(_s_curve(self.total)),
            **{kind: partial(self._shaped, kind) for kind in KINDS},
            **{name: partial(self._shaped_for_all, kind) for name, kind in ALL_MODES.items()},
            ZPETC: self._zpetc,
            INVERSE: self._inverse,
            REDESIGN: lambda: invtrack.quadratic_redesign(self.model, self.within, tolerance=1e-6, **WEIGHTS),
            ROBUST: self._robust,
        }
        return makers[method]()

    def _commanded(self, command: invtrack.PiecewiseSignal, derivatives: int = 2) -> invtrack.Plan:
        """What the servo makes of a command, velocity and acceleration fed forward."""
        return baselines.feedback_tracking(
            self.model, _profile(self.total), gains=self.servo, command=command, derivatives=derivatives, tolerance=1e-6
        )

    def _shaped(self, kind: str) -> invtrack.Plan:
        """For the slowest flexible mode."""
        return self._with(baselines.shaper(kind, self.flexible[:1]))  # type: ignore[arg-type]

    def _shaped_for_all(self, kind: str) -> invtrack.Plan:
        """For the slowest modes; the servo's own, strongly damped pair by ZV, as there is no EI shaper for it."""
        flexible = [mode for mode in self.modes[:SLOWEST] if mode in self.flexible]
        own = [mode for mode in self.modes[:SLOWEST] if mode not in flexible]
        shaper = baselines.shaper(kind, flexible)  # type: ignore[arg-type]
        return self._with(baselines.shaper("ZV", own).after(shaper) if own else shaper)

    def _with(self, shaper: baselines.Shaper) -> invtrack.Plan:
        left = self.total - shaper.duration
        if left <= 0:
            raise invtrack.InvtrackError(f"the {shaper.kind} shaper takes {shaper.duration:.3g} s of {self.total:.3g} s")
        return self._commanded(shaper.shaped(_profile(left)))

    def _zpetc(self) -> invtrack.Plan:
        """For the payload that it ends with, on the slowest modes of it."""
        reduction = linear.modal_truncation(self.model.systems[1], band=BAND)
        plan = baselines.approximate_inverse(reduction.reduced, self.within, kind="ZPETC", hold=ZPETC_HOLD)
        return plans.lifted(plan, reduction)

    def _inverse(self) -> invtrack.Plan:
        plan = invtrack.invert(self.reduction.reduced, self.within, tolerance=1e-6)
        return plans.lifted(plan, self.reduction)

    def _robust(self) -> invtrack.Plan:
        """One command for several combinations of payload and stiffness: the servo's input v = u + K x is what all of them get."""
        (K,) = self.servo.gains
        off = [(0.0, 0.0), *((a, 0.0) for a in UNCERTAIN), *((0.0, b) for b in UNCERTAIN)]
        loops = []
        for a, b in off:
            plant = switched([(1 + a) * mass for mass in self.masses], self.instant, stiffness=1 + b)
            closed = plant.map(lambda system: replace(system, A=system.A - system.B @ K))
            loops.append(invtrack.SwitchedSystem(closed, plant.switch_times))
        plan = invtrack.quadratic_redesign(loops, self.within, R=ROBUST_R, Q_y=WEIGHTS["Q_y"], tolerance=1e-6)
        n = self.model.n_states
        to_force = np.eye(n + 2)
        to_force[n, :n] = -K  # u = v - K x, the model as it is without the servo
        return replace(plan, model=self.model, trajectory=plan.trajectory.mapped(to_force))


def _there_and_back(
    leg: Callable[[float, float, float, float], invtrack.PiecewiseSignal], duration: float
) -> invtrack.PiecewiseSignal:
    """Two legs (start value, end value, duration, start time), one after the other."""
    return leg(0.0, WAY, duration / 2, 0.0) + leg(0.0, -WAY, duration / 2, duration / 2)


def _profile(duration: float) -> invtrack.PiecewiseSignal:
    """The command that people give a servo: minimum jerk."""
    return _there_and_back(lambda a, b, T, t: invtrack.rest_to_rest(a, b, duration=T, start_time=t), duration)


def _s_curve(duration: float) -> invtrack.PiecewiseSignal:
    def leg(start: float, end: float, T: float, t: float) -> invtrack.PiecewiseSignal:
        return references.s_curve(start, end, duration=T, max_acceleration=ACCELERATION * WAY / T**2, start_time=t)

    return _there_and_back(leg, duration)
