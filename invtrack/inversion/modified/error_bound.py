"""What no input can beat: the least error of any plan that starts from rest no earlier than a given time."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # loads scipy.optimize at its first use
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array, ComplexArray, finite_number, real_numbers, shown
from invtrack.errors import InversionError
from invtrack.linear.internal_dynamics import internal_dynamics, on_axis
from invtrack.linear.pole_placement import repeated
from invtrack.linear.propagation import Propagator
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import as_switched
from invtrack.plans.problem import deviation_reference, require_reference
from invtrack.references.profiles import constant
from invtrack.references.signal import PiecewiseSignal

DIRECTION_TOLERANCE = 1e-7
"""Singular values of the system matrix below this share of the largest belong to directions of the zero."""

EQUILIBRATIONS = 6
"""Rounds in which rows and columns of the system matrix are brought to unit size."""

PHASES = 180
"""Phases of a complex zero's condition at which the best is looked for before it is refined."""


def error_bound(model: Any, reference: PiecewiseSignal, *, start: float, output_scale: ArrayLike = 1.0) -> float | None:
    """The share of `output_scale` that max |y - y_d| / output_scale cannot get below, whatever the input from `start` on.

    A zero z with Re z > 0 has a direction, [psi' phi'] [A - z I, B; C, D] = 0. With y, x and u as deviations from where the plant
    rests until t_0 = `start`, d/dt (psi' x exp(-z t)) = -phi' y exp(-z t), and so, the state being bounded,

        integral from t_0 on of phi' y(t) exp(-z t) dt = 0                     (Freudenberg, Looze 1985; Middleton 1991)

    for every input, however long it acts. The error e = y - y_d therefore meets phi' E(z) = -phi' Y_d(z), for their transforms with
    times counted from t_0. Its real part at any phase theta bounds the error, with Y = phi' Y_d(z) and z = sigma + j omega:

        max_i |e_i| / s_i >= |Re(exp(j theta) Y)| / sum_i s_i |phi_i| int_0^inf exp(-sigma t) |cos(omega t - theta - arg phi_i)| dt

    and for a real zero z |Y| / sum_i s_i |phi_i|. The largest over theta and over all such zeros is taken. For a
    single zero (one output, or one direction) an error attains it: s_i times the sign of what stands under the integral. Integrals
    are in closed form, those of y_d through the exponentials of its generators.

    model: StateSpace, or anything with A, B, C, D. reference, output_scale: as for `modified_inversion`; start [s].

    Returns None where this gives no bound: for plants that switch, references that move before `start`, and references that grow
    faster than a zero. Raises ModelError, RelativeDegreeError, TrajectoryError for a reference with another number of channels,
    InversionError for a start that is no time before the manoeuvre.
    """
    plant = as_switched(model)
    require_reference(plant, reference)
    begins = reference.manoeuvre[0]
    start = finite_number("start", start, unit="s", error=InversionError)
    if start > begins:
        raise InversionError(f"start must be a time no later than the manoeuvre's, {begins:g} s, got {start}")
    scale = positive_sizes(output_scale, plant.n_outputs)
    if len(plant) > 1:
        return None
    return _least_error(plant.systems[0], deviation_reference(plant, reference), start, scale)


def positive_sizes(output_scale: ArrayLike, count: int) -> Array:
    """Sizes (count,) at which errors of the outputs count alike; raises InversionError for what is not positive and finite."""
    sizes = real_numbers("output_scale", output_scale, error=InversionError)
    if sizes.shape not in ((), (1,), (count,)) or not np.all(np.isfinite(sizes) & (sizes > 0)):
        raise InversionError(
            f"output_scale must be positive, one number or one for each of {count} outputs, got {shown(output_scale)}"
        )
    return np.broadcast_to(sizes, (count,)).copy()


def _least_error(system: StateSpace, deviation: PiecewiseSignal, start: float, scale: Array) -> float | None:
    first = deviation.generators[deviation.kind[0]]
    w = deviation.anchors[0, : len(first.S)]
    if np.any(np.abs(first.S @ w) > 1e-12 * np.abs(first.S) @ np.abs(w)):
        return None
    edge = float(deviation.breakpoints[0])
    motion = deviation + constant(-deviation(edge - 1.0), at=edge)
    internal = internal_dynamics(system)
    zeros = internal.zeros[~on_axis(internal) & (internal.zeros.real > 0) & (internal.zeros.imag >= 0)]
    best = 0.0
    for equal in repeated(zeros):
        zero = complex(np.mean(zeros[equal]))
        transform = _transform(motion, zero, start)
        if transform is None:
            return None
        best = max(best, *(_bound(zero, phi, complex(phi @ transform), scale) for phi in _directions(system, zero)), 0.0)
    return best


def _bound(zero: complex, phi: ComplexArray, Y: complex, scale: Array) -> float:
    """The bound by one zero and one direction phi (p,), for Y = phi' Y_d(z) from the start on."""
    weights, arguments = scale * np.abs(phi), np.angle(phi)

    def at(theta: float) -> float:
        size = float(weights @ _decaying_cosine(zero, -theta - arguments))
        return abs(float((np.exp(1j * theta) * Y).real)) / size

    if zero.imag == 0:
        return abs(Y) * zero.real / float(np.sum(weights))
    grid = np.linspace(0.0, np.pi, PHASES, endpoint=False)
    theta = float(grid[np.argmax([at(t) for t in grid])])
    step = np.pi / PHASES
    found = scipy.optimize.minimize_scalar(lambda t: -at(t), bounds=(theta - step, theta + step), method="bounded")
    return max(at(theta), -float(found.fun))


def _decaying_cosine(zero: complex, phases: Array) -> Array:
    """Integral of exp(-sigma t) |cos(omega t + phase)| dt over t > 0, for each phase (p,): half periods form a geometric series."""
    sigma, omega = zero.real, zero.imag
    half = np.pi / omega
    change = np.mod(np.pi / 2 - phases, np.pi) / omega  # the one change of sign in the first half period

    def antiderivative(t: Array | float) -> Array:
        turned = omega * np.asarray(t) + phases
        return np.asarray(np.exp(-sigma * np.asarray(t)) * (omega * np.sin(turned) - sigma * np.cos(turned)) / abs(zero) ** 2)

    start, middle, end = antiderivative(0.0), antiderivative(change), antiderivative(half)
    return np.asarray((np.abs(middle - start) + np.abs(end - middle)) / -np.expm1(-sigma * half))


def _directions(system: StateSpace, zero: complex) -> list[ComplexArray]:
    """Output directions phi (p,) of a zero; of several independent ones, those that as few outputs as possible take part in."""
    n, p = system.n_states, system.n_outputs
    matrix = np.block([[system.A - zero * np.eye(n), system.B], [system.C, system.D]])
    rows, columns = np.ones(n + p), np.ones(n + p)
    for _ in range(EQUILIBRATIONS):  # units of states, inputs, outputs and time do not matter
        for sizes, axis in ((rows, 1), (columns, 0)):
            largest = np.max(np.abs(rows[:, None] * matrix * columns), axis=axis)
            sizes /= np.sqrt(np.where(largest > 0, largest, 1.0))
    U, singular, _ = np.linalg.svd(rows[:, None] * matrix * columns)
    count = max(1, int(np.sum(singular <= DIRECTION_TOLERANCE * singular[0])))
    left = U[:, n + p - count :].conj()
    seen = np.linalg.norm(left[n:], axis=0) > DIRECTION_TOLERANCE  # a mode that no input moves has no part in the outputs
    phi = (rows[:, None] * left)[n:, seen].T
    if len(phi) > 1:
        _, _, order = scipy.linalg.qr(phi, pivoting=True)
        phi = np.linalg.solve(phi[:, order[: len(phi)]], phi)
    return [np.real_if_close(direction).astype(complex) for direction in phi]


def _transform(motion: PiecewiseSignal, zero: complex, start: float) -> ComplexArray | None:
    """Integral of motion(t) exp(-zero (t - start)) over all t from the first breakpoint on (p,); None where there is none."""
    sigma, omega, p = zero.real, zero.imag, motion.n_channels
    edges, total = motion.breakpoints, np.zeros(p, dtype=complex)
    ahead = np.exp(-zero * (edges - start))
    for number, generator in enumerate(motion.generators):
        q = len(generator.S)
        chosen = np.flatnonzero(motion.kind[1:-1] == number)
        if chosen.size:
            # v = exp(-zero t) w, v' = (S - zero I) v, and its integral, in real and imaginary parts.
            decaying, turning, none = generator.S - sigma * np.eye(q), omega * np.eye(q), np.zeros((q, p))
            R, nothing = generator.R, np.zeros((p, q))
            M = np.block(
                [
                    [decaying, turning, none, none],
                    [-turning, decaying, none, none],
                    [R, nothing, np.zeros((p, 2 * p))],
                    [nothing, R, np.zeros((p, 2 * p))],
                ]
            )
            v = np.hstack([motion.anchors[chosen + 1, :q], np.zeros((len(chosen), q + 2 * p))])
            found = Propagator(M).states(v, np.diff(edges)[chosen])[:, 2 * q :]
            total += ahead[chosen] @ (found[:, :p] + 1j * found[:, p:])
    last = motion.generators[motion.kind[-1]]
    w = motion.anchors[-1, : len(last.S)]
    if not np.any(w):
        return total
    if np.max(np.linalg.eigvals(last.S).real) >= sigma:
        return None
    return np.asarray(total + ahead[-1] * (last.R @ np.linalg.solve(zero * np.eye(len(w)) - last.S, w)))
