"""The plan's trajectory from a motion on a mesh: polynomials for [x; u; y] on each element, and a tail on either side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.shooting import ElementChain, Motion
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.dynamics import Dynamics
from invtrack.plans.plan import intervals_of_pieces
from invtrack.plans.runge_kutta import CLASSICAL, legendre
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import PolynomialSegments, Trajectory

STEPS = 4
"""Steps of integration on a piece, of a method above the fourth order; of that order two for each coefficient of the input."""

ALONG = 2.0**-13
"""Time step [pieces] over which the outputs' rate of change is measured along the motion."""


def trajectory_of(shooting: ElementChain, motion: Motion, model: SwitchedSystem, tails: tuple[Tail, Tail]) -> Trajectory:
    """[x; u; y] as deviations from the rest of the model's interval in which each element lies.

    An element makes pieces of a few steps of integration each. On each, x and y are Hermite's polynomials through values and rates
    at up to five nodes; u is the polynomial of the motion itself.

    Args:
        shooting, motion: the conditions, and the motion that meets them.
        model: whose rests states, inputs and outputs are measured from.
        tails: before and after the motion.
    """
    mesh, scheme, n, m = shooting.mesh, shooting.scheme, model.n_states, model.n_inputs
    steps = STEPS if scheme.method.order > CLASSICAL.order else 2 * scheme.count
    parts = scheme.steps // steps
    pieces = mesh.split(np.full(len(mesh), parts))
    nodes = shooting.nodes(motion)[:, steps * np.arange(parts)[:, None] + np.arange(0, steps + 1, max(1, steps // 4))]
    nodes = nodes.reshape(len(pieces), -1, nodes.shape[3])
    shares = np.linspace(0.0, 1.0, nodes.shape[1])
    u = _on_pieces(motion.coefficients, parts)
    x, x_rate, y, y_rate = _values_and_rates(shooting.dynamics, pieces, nodes, u, shares)
    rest = np.hstack([model.rest_states, model.rest_inputs, model.rest_outputs])[
        intervals_of_pieces(model, pieces.edges)[1:-1], None
    ]
    lengths = pieces.lengths[:, None, None]
    coefficients = np.zeros((len(pieces), 2 * len(shares), n + m + model.n_outputs))
    coefficients[:, :, :n] = _hermite(shares, x - rest[:, :, :n], x_rate * lengths)
    coefficients[:, :, n + m :] = _hermite(shares, y - rest[:, :, n + m :], y_rate * lengths)
    coefficients[:, : scheme.count, n : n + m] = np.linalg.solve(
        np.vander(shares_of(scheme.count), scheme.count, increasing=True), _at(u, shares_of(scheme.count))
    )
    coefficients[:, 0, n : n + m] -= rest[:, 0, n : n + m]
    return Trajectory(
        breakpoints=pieces.edges,
        groups=(PolynomialSegments(coefficients, pieces.lengths),),
        group=np.zeros(len(pieces), dtype=np.intp),
        number=np.arange(len(pieces)),
        before=tails[0],
        after=tails[1],
    )


def _on_pieces(coefficients: Array, parts: int) -> Array:
    """Those of the same polynomials on even parts of their elements (N parts, s, m)."""
    N, count, m = coefficients.shape
    within = (np.arange(parts)[:, None] + shares_of(count)) / parts
    values = _at(coefficients, within.ravel()).reshape(N * parts, count, m)
    return np.asarray(np.linalg.solve(legendre(count, shares_of(count)), values))


def _at(coefficients: Array, shares: Array) -> Array:
    """Values (N, k, m) of polynomials at shares (k,) of their elements."""
    return np.asarray(np.einsum("kim,ji->kjm", coefficients, legendre(coefficients.shape[1], shares)))


def shares_of(count: int) -> Array:
    """As many Gauss points on [0, 1]."""
    return np.asarray((np.polynomial.legendre.leggauss(count)[0] + 1) / 2)


def _values_and_rates(
    dynamics: Sequence[Dynamics], pieces: Mesh, nodes: Array, u: Array, shares: Array
) -> tuple[Array, Array, Array, Array]:
    """States and outputs with their rates at nodes of pieces (N, k, .).

    Args:
        dynamics: of each interval.
        pieces, nodes, u: the pieces, their nodes, and coefficients of the inputs on them (N, s, m).
        shares: of the pieces at which the nodes lie (k,).
    """
    N, k = nodes.shape[:2]
    inputs, step = _at(u, shares), ALONG
    derivative = np.array([_derivative(u.shape[1], share) for share in shares])
    input_rates = np.einsum("kim,ji->kjm", u, derivative)  # per piece
    result = []
    for interval in np.unique(pieces.interval):
        chosen, own = np.flatnonzero(pieces.interval == interval), dynamics[interval]
        points, values = nodes[chosen].reshape(-1, nodes.shape[2]), inputs[chosen].reshape(-1, inputs.shape[2])
        rates, y = own.evaluate(points, values)
        time = np.repeat(step * pieces.lengths[chosen], k)[:, None]
        change = step * input_rates[chosen].reshape(values.shape)
        ahead, back = (own.evaluate(own.retract(points, sign * time * rates), values + sign * change)[1] for sign in (1.0, -1.0))
        y_rate = own.output_difference(ahead, back) / (2 * time)
        result.append((chosen, (own.states(points), own.state_rates(points, rates), y, y_rate)))
    x, x_rate, y, y_rate = (np.empty((N, k, values.shape[1])) for values in result[0][1])
    for chosen, found in result:
        for whole, values in zip((x, x_rate, y, y_rate), found, strict=True):
            whole[chosen] = values.reshape(len(chosen), k, -1)
    return x, x_rate, y, y_rate


def _derivative(count: int, share: float) -> Array:
    """d/dshare of the Legendre polynomials on [0, 1] at one share of it (count,)."""
    values = [np.polynomial.legendre.legval(2 * share - 1, np.polynomial.legendre.legder(row)) for row in np.eye(count)]
    return 2 * np.array(values)


def _hermite(shares: Array, values: Array, rates: Array) -> Array:
    """Coefficients (N, 2 k, c), lowest power first, of the polynomials with values and rates (N, k, c) at shares (k,)."""
    degree = 2 * len(shares)
    V = np.vander(shares, degree, increasing=True)
    dV = np.zeros_like(V)
    dV[:, 1:] = V[:, :-1] * np.arange(1, degree)
    both = np.concatenate([values, rates], axis=1)
    return np.asarray(np.linalg.solve(np.vstack([V, dV]), both))
