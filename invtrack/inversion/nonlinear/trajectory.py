"""The plan's trajectory from a motion on a mesh: polynomials for [x; u; y] on each element, and a tail on either side."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.nonlinear.elements import legendre
from invtrack.inversion.nonlinear.shooting import Motion, Shooting
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import intervals_of_pieces
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import PolynomialSegments, Trajectory

ALONG = 2.0**-13
"""Time step [elements] over which the outputs' rate of change is measured along the motion."""


def trajectory_of(shooting: Shooting, motion: Motion, model: SwitchedSystem, tails: tuple[Tail, Tail]) -> Trajectory:
    """[x; u; y] as deviations from the rest of the model's interval in which each element lies.

    x and y are Hermite's polynomials through values and rates at an even number of times (two per coefficient of the input, at
    most five); u is the polynomial of the motion itself.

    Args:
        shooting, motion: the conditions, and the motion that meets them.
        model: whose rests states, inputs and outputs are measured from.
        tails: before and after the motion.
    """
    mesh, scheme = shooting.mesh, shooting.scheme
    stride = max(1, scheme.steps // 4)
    nodes = shooting.nodes(motion)[:, ::stride]
    shares = np.linspace(0.0, 1.0, nodes.shape[1])
    inputs = np.einsum("kim,ji->kjm", motion.coefficients, legendre(scheme.count, shares))
    x, x_rate, y, y_rate = _values_and_rates(shooting, motion, nodes, inputs, shares)
    piece = intervals_of_pieces(model, mesh.edges)
    rest = np.hstack([model.rest_states, model.rest_inputs, model.rest_outputs])[piece[1:-1]][:, None]
    n, m = model.n_states, model.n_inputs
    lengths = mesh.lengths[:, None, None]
    degree = 2 * len(shares) - 1
    coefficients = np.zeros((len(mesh), degree + 1, n + m + model.n_outputs))
    coefficients[:, :, :n] = _hermite(shares, x - rest[:, :, :n], x_rate * lengths)
    coefficients[:, :, n + m :] = _hermite(shares, y - rest[:, :, n + m :], y_rate * lengths)
    powers = np.linalg.solve(np.vander(shares_of(scheme.count), scheme.count, increasing=True), _samples(motion, scheme.count))
    coefficients[:, : scheme.count, n : n + m] = powers
    coefficients[:, 0, n : n + m] -= rest[:, 0, n : n + m]
    count = np.arange(len(mesh))
    return Trajectory(
        breakpoints=mesh.edges,
        groups=(PolynomialSegments(coefficients, mesh.lengths),),
        group=np.zeros(len(mesh), dtype=np.intp),
        number=count,
        before=tails[0],
        after=tails[1],
    )


def shares_of(count: int) -> Array:
    """As many Gauss points on [0, 1]."""
    return np.asarray((np.polynomial.legendre.leggauss(count)[0] + 1) / 2)


def _samples(motion: Motion, count: int) -> Array:
    return np.asarray(np.einsum("kim,ji->kjm", motion.coefficients, legendre(count, shares_of(count))))


def _values_and_rates(
    shooting: Shooting, motion: Motion, nodes: Array, inputs: Array, shares: Array
) -> tuple[Array, Array, Array, Array]:
    """States and outputs with their rates at nodes (N, k, .) with inputs (N, k, m).

    Args:
        shooting, motion: of the plan.
        nodes, inputs: where values are wanted.
        shares: of their elements (k,).
    """
    N, k = nodes.shape[:2]
    result = []
    step = ALONG
    derivative = np.array([_derivative(motion.coefficients.shape[1], share) for share in shares])
    input_rates = np.einsum("kim,ji->kjm", motion.coefficients, derivative)  # per element
    for interval in np.unique(shooting.mesh.interval):
        chosen = np.flatnonzero(shooting.mesh.interval == interval)
        dynamics = shooting.dynamics[interval]
        points, u = nodes[chosen].reshape(-1, nodes.shape[2]), inputs[chosen].reshape(-1, inputs.shape[2])
        rates, y = dynamics.evaluate(points, u)
        time = np.repeat(step * shooting.mesh.lengths[chosen], k)[:, None]
        change = step * input_rates[chosen].reshape(u.shape)
        ahead, back = (
            dynamics.evaluate(dynamics.retract(points, sign * time * rates), u + sign * change)[1] for sign in (1.0, -1.0)
        )
        y_rate = dynamics.output_difference(ahead, back) / (2 * time)
        result.append((chosen, (dynamics.states(points), dynamics.state_rates(points, rates), y, y_rate)))
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
