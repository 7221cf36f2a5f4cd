"""The structure algorithm: outputs are differentiated, and combined, until the inputs can be found from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, as_divisor
from invtrack.errors import RelativeDegreeError
from invtrack.linear.invertibility import why_not_invertible
from invtrack.linear.output_derivatives import OutputDerivatives
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units

ROW_TOLERANCE = 1e-11
"""A coefficient counts as zero below this share of |C_i| |A|^k |B|, the largest value that its terms could add up to."""

ROUNDING = 10.0
"""Rounding that the matrices may have come with, in units of n eps times their norms in balanced units."""

NO_MULTIPLE = 1e-13
"""A multiple of another row below this share of what is taken away is rounding."""

DECOUPLING_CONDITION_LIMIT = 1e10
"""Largest condition number of B_y, rows and columns scaled to unit size, with which it still counts as invertible."""


@dataclass(frozen=True, eq=False)
class OutputStructure:
    """C_star x = zeta, rows that no input enters, and A_x x + B_y u = chi with B_y of full row rank, m inputs and p outputs.

    zeta and chi are combinations of the outputs and their derivatives. Row i begins as output i and is differentiated orders[i]
    times; where its inputs' gains depend on those of rows that have all they need, multiples of these are taken away first. Without
    such combinations zeta holds y_i, y_i', ... and chi the derivatives y_i^(r_i) for the vector relative degree r = orders. In
    general the orders are those of the plant's zeros at infinity.

    Args:
        orders: (p,), with the sum rho.
        C_star: (rho, n), the rows of output 1, of output 2, and so on.
        A_x, B_y: (p, n) and (p, m).
        A_x_error: what the errors of the model's entries make of A_x (p, n).
        zeta, chi: rho and p combinations of the outputs' derivatives.
        combined: whether rows were combined, so that there is no vector relative degree.
        decoupling_condition: condition number of B_y with rows and columns scaled to unit size.
    """

    orders: tuple[int, ...]
    C_star: Array
    A_x: Array
    B_y: Array
    A_x_error: Array
    zeta: OutputDerivatives
    chi: OutputDerivatives
    combined: bool
    decoupling_condition: float


@dataclass(eq=False)
class _Row:
    """c x + d u = sum_k h_k y^(k), with the sizes of the terms that c and d are sums of, and what the model's errors make of them.

    Args:
        c, c_size, c_error: (n,).
        d, d_size, d_error: (m,).
        h: (k + 1, p).
        turned: whether c may hold what rounding left of a zero, so that its products are measured against norms, too.
    """

    c: Array
    c_size: Array
    c_error: Array
    d: Array
    d_size: Array
    d_error: Array
    h: Array
    turned: bool = True

    @property
    def d_tolerance(self) -> Array:
        """Below which an entry of d is none (m,)."""
        return ROW_TOLERANCE * self.d_size + self.d_error

    @property
    def vanishes(self) -> bool:
        """Whether nothing is left of the row but rounding."""
        return bool(np.all(np.abs(self.c) <= ROW_TOLERANCE * self.c_size + self.c_error))

    def without(self, multiples: Array, others: Sequence[_Row]) -> _Row:
        """The row less multiples (k,) of others, with the gains that are left."""
        h = np.zeros((max(len(row.h) for row in (self, *others)), self.h.shape[1]))
        h[: len(self.h)] = self.h
        c, c_size, c_error = self.c.copy(), self.c_size.copy(), self.c_error.copy()
        d, d_size, d_error = self.d.copy(), self.d_size.copy(), self.d_error.copy()
        for multiple, other in zip(multiples.tolist(), others, strict=True):
            h[: len(other.h)] -= multiple * other.h
            c -= multiple * other.c
            d -= multiple * other.d
            for total, part in ((c_size, other.c_size), (c_error, other.c_error), (d_size, other.d_size), (d_error, other.d_error)):
                total += abs(multiple) * part
        return _Row(c, c_size, c_error, d, d_size, d_error, h)


def output_structure(system: StateSpace) -> OutputStructure:
    """The structure of a system, which exists where its transfer matrix has full row rank: where it has a right inverse.

    Coefficients are held, one by one, against the terms that they are the sum of and the model's error estimates. Raises
    RelativeDegreeError, with the reason, where the transfer matrix has a lower normal rank than there are outputs, or cannot be
    told from one that has. Source: L. M. Silverman, "Inversion of multivariable linear systems", IEEE Trans. Automatic Control 14,
    1969; with a vector relative degree it is the normal form of Isidori 1989 (Devasia 1996, eq. 5).
    """
    p, n = system.n_outputs, system.n_states
    if p > system.n_inputs:
        raise RelativeDegreeError(why_not_invertible(system))
    state_unit = plant_units(system)
    rows = [_output_row(system, i) for i in range(p)]
    chains: list[list[_Row]] = [[] for _ in range(p)]
    done: list[int] = []
    combined = False
    while True:
        combined |= _settle(rows, done)
        going = [i for i in range(p) if i not in done]
        if not going:
            break
        if sum(map(len, chains)) + len(going) > n or any(rows[i].vanishes for i in going):
            raise RelativeDegreeError(why_not_invertible(system))
        for i in going:
            chains[i].append(rows[i])
            rows[i] = _differentiated(rows[i], system, state_unit)
    orders = tuple(len(chain) for chain in chains)
    flat = [row for chain in chains for row in chain]
    B_y = np.array([row.d for row in rows])
    return OutputStructure(
        orders=orders,
        C_star=np.array([row.c for row in flat]).reshape(-1, n),
        A_x=np.array([row.c for row in rows]),
        B_y=B_y,
        A_x_error=np.array([row.c_error for row in rows]),
        zeta=_stacked([row.h for row in flat], p),
        chi=_stacked([row.h for row in rows], p),
        combined=combined,
        decoupling_condition=_decoupling_condition(system, B_y, orders),
    )


def _output_row(system: StateSpace, i: int) -> _Row:
    c, d = system.C[i].copy(), system.D[i].copy()
    c_error, d_error = system.errors("C")[i], system.errors("D")[i]
    row = _Row(c, np.abs(c), c_error, d, np.abs(d), d_error, np.eye(system.n_outputs)[i : i + 1])
    return _without_rounding(row)


def _differentiated(row: _Row, system: StateSpace, state_unit: Array) -> _Row:
    """The row's time derivative, for a row that no input enters.

    Besides what rounding does here, there is what it did before: in turned coordinates B has entries that would be zero, and where
    a row picks just these, nothing is left to measure them against. The gains of outputs, and of rows made by cancellation, are
    therefore also measured against norms, in the units of the states. Not so those further down a chain: a long one passes on less
    than the rounding of the norms, and yet exactly. What is passed on to them instead is the doubt in the entries that turning the
    coordinates may have left of zeros: in outputs and cancelled rows, in each row of A and in each column of B.
    """
    A, B = system.A, system.B
    rounding = ROUNDING * system.n_states * np.finfo(float).eps
    c_error, d_error = row.c_error, np.zeros(system.n_inputs)
    if row.turned:
        size = float(np.linalg.norm(row.c_size * state_unit))
        c_error = c_error + _doubt(row.c * state_unit, rounding * size) / state_unit
        d_error = rounding * size * np.linalg.norm(B / state_unit[:, None], axis=0)
    A_rows, B_columns = A * state_unit, B / state_unit[:, None]
    A_doubt = _doubt(A_rows, rounding * np.linalg.norm(A_rows, axis=1, keepdims=True)) / state_unit
    B_doubt = _doubt(B_columns, rounding * np.linalg.norm(B_columns, axis=0)) * state_unit[:, None]
    return _without_rounding(
        _Row(
            c=row.c @ A,
            c_size=row.c_size @ np.abs(A),
            c_error=c_error @ np.abs(A) + np.abs(row.c) @ (system.errors("A") + A_doubt),
            d=row.c @ B,
            d_size=row.c_size @ np.abs(B),
            d_error=d_error + c_error @ np.abs(B) + np.abs(row.c) @ (system.errors("B") + B_doubt),
            h=np.vstack([np.zeros_like(row.h[:1]), row.h]),
            turned=False,
        )
    )


def _doubt(entries: Array, rounding: float | Array) -> Array:
    """By how much entries may be wrong that rounding may have left of zeros: by all that they are. The others count as right."""
    sizes = np.abs(entries)
    return np.where(sizes <= rounding, sizes, 0.0)


def _without_rounding(row: _Row) -> _Row:
    """Inputs that only rounding lets in are left out: scaled up to unit size, rounding errors would pass for independent gains."""
    row.d = np.where(np.abs(row.d) <= row.d_tolerance, 0.0, row.d)
    return row


def _settle(rows: list[_Row], done: list[int]) -> bool:
    """Rows with gains independent of those of the rows done are done, too; the others lose their gains. Whether any had some left.

    Of those left, the one comes first whose gains are the least explained by the rows done.
    """
    gains = np.abs([row.d for row in rows])
    largest = np.max(gains / as_divisor(np.max(gains, axis=1, keepdims=True)), axis=0)
    input_unit = 1 / as_divisor(largest)
    while True:
        left = {i: _explained(rows[i], [rows[j] for j in done], input_unit) for i in range(len(rows)) if i not in done}
        independent = {i: share for i, (_, share) in left.items() if share > 0}
        if not independent:
            break
        done.append(max(independent, key=lambda i: independent[i]))
    combined = False
    for i, (multiples, _) in left.items():
        if np.any(rows[i].d):
            rows[i] = rows[i].without(multiples, [rows[j] for j in done])
            rows[i].d = np.zeros_like(rows[i].d)
            combined = True
    return combined


def _explained(row: _Row, others: Sequence[_Row], input_unit: Array) -> tuple[Array, float]:
    """Multiples (k,) of the others' gains that come nearest to the row's, and the share of these left, 0 where it is rounding.

    Nearest with each gain counted by how well it is known: along a long chain rounding can hide one gain while another still
    stands out, and a zero in place of the hidden one would make gains independent that are not.
    """
    gains, size = row.d * input_unit, float(np.linalg.norm(row.d * input_unit))
    if size == 0 or not others:
        return np.zeros(len(others)), float(size > 0)
    basis = np.array([other.d * input_unit for other in others])
    known = np.ones(len(gains))
    for _ in range(2):  # what the others' gains are known by counts as often as they are taken
        weighted = basis * known
        sizes = as_divisor(np.linalg.norm(weighted, axis=1))
        multiples = np.linalg.lstsq((weighted / sizes[:, None]).T, gains * known, rcond=None)[0] / sizes
        multiples = np.where(np.abs(multiples) * np.linalg.norm(basis, axis=1) <= NO_MULTIPLE * size, 0.0, multiples)
        rest = row.without(multiples, others)
        known = 1 / np.maximum(rest.d_tolerance * input_unit / size, ROW_TOLERANCE)
    share = float(np.linalg.norm(rest.d * input_unit)) / size
    return multiples, 0.0 if np.all(np.abs(rest.d) <= rest.d_tolerance) else share


def _stacked(combinations: Sequence[Array], p: int) -> OutputDerivatives:
    """Combinations of different orders, (k + 1, p) each, as one."""
    highest = max((len(h) for h in combinations), default=1)
    coefficients = np.zeros((highest, len(combinations), p))
    for i, h in enumerate(combinations):
        coefficients[: len(h), i] = h
    return OutputDerivatives(coefficients)


def _decoupling_condition(system: StateSpace, B_y: Array, orders: tuple[int, ...]) -> float:
    scaled = B_y.copy()
    for axis in (1, 0, 1):  # alternate: rows and columns to unit size, so that units do not matter
        size = np.max(np.abs(scaled), axis=axis, keepdims=True)
        scaled = scaled / np.where(size > 0, size, 1.0)
    condition = float(np.linalg.cond(scaled))
    if not condition < DECOUPLING_CONDITION_LIMIT:
        raise RelativeDegreeError(
            f"the outputs {list(system.outputs.names)}, differentiated {list(orders)} times, depend on the inputs "
            f"{list(system.inputs.names)} by a matrix with condition number {condition:.1e} (limit "
            f"{DECOUPLING_CONDITION_LIMIT:.0e}), so that rounding decides what sets them independently; choose other outputs, or "
            "leave out of the model what is that weak"
        )
    return condition
