"""What a plan costs: the weights, and the cost by quadrature of a plan's values alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import SEMIDEFINITE_TOLERANCE, Array, ComplexArray, Refusal, real_weight, smallest_eigenvalue
from invtrack.errors import RedesignError
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan, require_plan
from invtrack.references.signal import PiecewiseSignal

Matrices = TypeVar("Matrices", Array, ComplexArray)

FREE_HOLDING = 1e-12
"""Holding an output counts as free where it costs less per second than this share of what not moving there at all would cost."""

ROUNDING = 1e-12
"""A cost per second below this share of the terms that it is the sum of is what is left where they cancel."""

AT_REST = 1e-12
"""A held value this close to the operating point's output, as a share of the reference's size, is off it by rounding only. A cost
per second far outside the plan of no more than this share of its peak is rounding, too, not a cost that goes on for ever."""

CONVERGED = 1e-12
"""A panel is halved until that changes its part of the integral by no more than this share of the whole."""

NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(10)

MOST_PANELS = 2**14
"""Panels that are halved at once, at most, or this many for each of those to begin with: halving further what rounding alone makes
uneven gains nothing."""

PANELS_EACH = 16
"""See MOST_PANELS."""

FARTHEST = 1e150
"""Ratio of weights up to which the equations of an optimum, in which they are multiplied and divided, stay within all floats."""

HELD = 1e305
"""Ratio of weights up to which one unit holds all of them as floats with all their digits."""


@dataclass(frozen=True, eq=False)
class Weights:
    """u'R u + x'Q_x x + (y - y_d)'Q_y (y - y_d): R (p, p), Q_x (n, n), Q_y (p, p), symmetric and positive semidefinite."""

    R: Array
    Q_x: Array
    Q_y: Array

    def rate(self, x: Array, u: Array, error: Array) -> Array:
        """Cost per second (m,) of states (m, n), inputs (m, p) and output errors (m, p), all as deviations."""
        pairs = ((u, self.R), (x, self.Q_x), (error, self.Q_y))
        return np.asarray(sum(np.einsum("mi,ij,mj->m", value, weight, value) for value, weight in pairs))

    def terms(self, x: Array, u: Array, error: Array) -> Array:
        """Sum of the sizes of the terms that `rate` adds up, (m,): what its rounding is measured against."""
        pairs = ((u, self.R), (x, self.Q_x), (error, self.Q_y))
        return np.asarray(sum(np.einsum("mi,ij,mj->m", *map(np.abs, (value, weight, value))) for value, weight in pairs))

    @property
    def size(self) -> float:
        """The largest of their entries."""
        return max(float(np.max(np.abs(weight))) for weight in (self.R, self.Q_x, self.Q_y))

    @property
    def unit(self) -> float:
        """The power of two at or below their size."""
        return float(2.0 ** np.floor(np.log2(self.size)))

    def in_unit(self) -> Weights:
        """The same weights in a power of two of the cost's unit, in which the largest of their entries is about one."""
        return Weights(self.R / self.unit, self.Q_x / self.unit, self.Q_y / self.unit)

    def require_within(self, ratio: float, *, error: Refusal = RedesignError) -> None:
        """Raises `error` for weights that lie farther apart than this ratio."""
        weighed = [(name, np.abs(np.diag(getattr(self, name)))) for name in ("R", "Q_x", "Q_y")]
        entries = sorted((float(entry), name) for name, diagonal in weighed for entry in diagonal if entry > 0)
        if entries and entries[0][0] < entries[-1][0] / ratio:
            (least, small), (most, large) = entries[0], entries[-1]
            apart = math.log10(most) - math.log10(least)
            raise error(
                f"weights must lie within {ratio:g} of each other, the largest, in {large}, is 10^{apart:.0f} times the smallest, "
                f"in {small}; bring them closer to each other, or give no weight at all to what may cost nothing"
            )

    def input_weight(self, D: Array) -> Array:
        """R + D'Q_y D (m, m): everything in the cost that is quadratic in the input itself."""
        return np.asarray(self.R + D.T @ self.Q_y @ D)


def as_weights(plant: SwitchedSystem, *, R: ArrayLike, Q_x: ArrayLike, Q_y: ArrayLike) -> Weights:
    """Weights for the states, inputs and outputs of `plant`; a number stands for that multiple of the identity.

    Raises RedesignError for a weight of the wrong shape, one that is not symmetric or not positive semidefinite, or R + D'Q_y D
    singular.
    """
    n, m, p = plant.n_states, plant.n_inputs, plant.n_outputs
    weights = Weights(
        R=real_weight("R", R, m, meaning=f"inputs {list(plant.inputs.names)}", error=RedesignError),
        Q_x=real_weight("Q_x", Q_x, n, meaning=f"states {list(plant.states.names)}", error=RedesignError),
        Q_y=real_weight("Q_y", Q_y, p, meaning=f"outputs {list(plant.outputs.names)}", error=RedesignError),
    )
    smallest = min(smallest_eigenvalue(weights.input_weight(system.D)) for system in plant.distinct)
    if smallest <= SEMIDEFINITE_TOLERANCE:
        raise RedesignError(
            "R must be positive definite (with a direct feedthrough: R + D'Q_y D), its smallest eigenvalue is "
            f"{smallest:.3g} of its size: an input that costs nothing may be unbounded; weigh every input, or, to follow the "
            "output exactly at whatever input it takes, use invtrack.invert"
        )
    return weights


def without_rounding(held: Array, reference: PiecewiseSignal, y_0: Array) -> Array:
    """Held deviations (..., p) from the operating point's output y_0 (p,), zero where only rounding sets them apart from it.

    A reference that goes there and back, channel by channel, rarely ends exactly where it began.
    """
    return np.where(np.abs(held) <= AT_REST * np.maximum(reference.size(0), np.abs(y_0)), 0.0, held)


def square_root(weight: Matrices) -> Matrices:
    """F (..., k, k) with F*F = weight, of one weight or of several at once, whatever the units of its channels."""
    diagonal = np.abs(np.diagonal(weight, axis1=-2, axis2=-1))
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(weight / (scale[..., :, None] * scale[..., None, :]))
    root: Matrices = np.sqrt(np.maximum(values, 0.0))[..., None] * np.swapaxes(vectors.conj(), -1, -2) * scale[..., None, :]
    return root


def cost(plan: Plan, *, R: ArrayLike, Q_x: ArrayLike = 0.0, Q_y: ArrayLike) -> float:
    """Integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d) from the plan's start to its end.

    u0, and that from which x is measured, are the rest of the interval in force.

    plan: the plan of any method. Weights as in `quadratic_redesign`. Infinite where the plan goes on costing something before
    its start or after its end; otherwise what lies there is below the plan's tolerance, unless its preactuation was limited.

    Raises RedesignError for weights that do not fit the plan's model, and for a cost that is beyond any float.
    """
    require_plan(plan, error=RedesignError)
    stated = as_weights(plan.model, R=R, Q_x=Q_x, Q_y=Q_y)
    weights, unit = stated.in_unit(), stated.unit
    edges = graded_edges(plan.breakpoints, plan.preactuation, plan.postactuation)
    middle = (edges[:-1] + edges[1:]) / 2
    length = edges[-1] - edges[0]
    far = _deviations(plan, np.array([edges[0], edges[-1]]) + np.array([-10.0, 10.0]) * (length + 1.0), None)
    lasting = weights.rate(*far) - ROUNDING * weights.terms(*far)
    if np.max(lasting) > AT_REST * np.max(weights.rate(*_deviations(plan, middle, None))):
        return math.inf
    total = unit * quadrature(lambda times, inside: weights.rate(*_deviations(plan, times, inside)), edges)
    if not math.isfinite(total):
        raise RedesignError(f"the cost is beyond any float, got {total}; state the weights in a unit of cost that is larger")
    return total


def quadrature(rate: Callable[[Array, Array], Array], edges: Array, converged: float = CONVERGED) -> float:
    """Integral of a rate (k,) at times (k,), taken in the pieces that hold the times `inside` (k,), over panels between `edges`.

    Panels are halved until that changes what each adds by no more than the share `converged` of the integral.
    """
    left, right, most = edges[:-1], edges[1:], max(MOST_PANELS, PANELS_EACH * len(edges))
    whole, total = _integrals(rate, left, right), 0.0
    while True:
        centre = (left + right) / 2
        left, right = np.column_stack([left, centre]).ravel(), np.column_stack([centre, right]).ravel()
        halves = _integrals(rate, left, right)
        change = np.abs(halves[::2] + halves[1::2] - whole)
        unsettled = np.repeat(change > converged * (total + float(np.sum(halves))), 2)
        total += float(np.sum(halves[~unsettled]))
        left, right, whole = left[unsettled], right[unsettled], halves[unsettled]
        if len(whole) == 0 or len(whole) > most:
            return total + float(np.sum(whole))


def _integrals(rate: Callable[[Array, Array], Array], left: Array, right: Array) -> Array:
    """What each panel between left and right (m,) adds, by Gauss's rule: (m,)."""
    middle, half = (left + right) / 2, (right - left) / 2
    times = middle[:, None] + half[:, None] * NODES
    return np.asarray(half * (rate(times.ravel(), np.repeat(middle, len(NODES))).reshape(times.shape) @ NODE_WEIGHTS))


def graded_edges(breakpoints: Array, before: float, after: float) -> Array:
    """Breakpoints, and beside them, up to `before` and `after` [s] away, times that lie the closer the nearer to them."""
    shares = 2.0 ** -np.arange(12.0)
    first, last = breakpoints[0], breakpoints[-1]
    return np.unique(np.concatenate([first - before * shares, breakpoints, last + after * shares[::-1]]))


def _deviations(plan: Plan, times: Array, inside: Array | None) -> tuple[Array, Array, Array]:
    """What is weighed: states and inputs from the rest of the interval in force, and output errors."""
    at = plan.departures(times, inside=inside)
    return at.x, at.u, at.y - at.y_d
