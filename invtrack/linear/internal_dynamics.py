"""Invariant zeros and the internal dynamics, split into a stable and an antistable part."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.arrays import Array, ComplexArray, as_divisor, complex_numbers, finite_number, shown
from invtrack.errors import ModelError, NonHyperbolicError
from invtrack.linear.hidden_modes import COUPLING_TOLERANCE, ERROR_GROWTH, zero_kinds
from invtrack.linear.internal_pencil import InternalPencil, internal_pencil
from invtrack.linear.invariant_parts import invariant_parts
from invtrack.linear.normal_form import NormalForm, normal_form
from invtrack.linear.propagation import Propagator
from invtrack.linear.pseudospectrum import Pseudospectrum
from invtrack.linear.staircase import unreached
from invtrack.linear.state_space import StateSpace

AXIS_TOLERANCE = 1e-8
"""Places for zeros that are moved count as on the imaginary axis where |Re| is below this share of their magnitude."""

ROUNDING_FACTOR = 10.0
"""Uncertainty of the internal dynamics' matrix, in units of n eps times the norm of the terms that it is the sum of."""

NOT_UNIQUE = "so the bounded inverse does not exist or is not unique, and none decays both before and after the manoeuvre"
"""What follows from zeros on the axis in general."""

LEAVE_OUT = "leave it out of the model (invtrack.linear.without_hidden_modes)"
"""Where it is known that such a mode does no harm."""

REMEDIES = {
    "transmission zero": "move these poles of the inverse off the axis (invtrack.modified_inversion), or track another output",
    "uncontrollable mode": f"no input moves it: damp it, add an actuator that moves it, or {LEAVE_OUT}",
    "unobservable mode": f"no output shows it: choose an output that does, damp it, or {LEAVE_OUT}",
    "uncontrollable and unobservable mode": f"no input moves it and no output shows it: {LEAVE_OUT}",
}


@dataclass(frozen=True, eq=False)
class InternalDynamics:
    """eta' = A_eta eta + A_zeta zeta + B_r chi + B_v v, the dynamics left when the outputs are prescribed (see `NormalForm`).

    Args:
        form: the plant's normal form.
        A_eta, A_zeta, B_r: (n_z, n_z), (n_z, rho) and (n_z, p), for n_z = n - rho internal states.
        B_v: how inputs that are left over move them (n_z, m - p): u = F x + G chi + Z v.
        unmoved: orthonormal basis (n_z, h) of what they do not move; all of it for as many inputs as outputs.
        zeros: eigenvalues of A_eta in it, the plant's invariant zeros (h,) [rad/s].
        uncertainty: how large a perturbation of A_eta rounding, and the error of a model found numerically, may amount to.
        pencil: the same dynamics where they are far faster than the plant.
    """

    form: NormalForm
    A_eta: Array
    A_zeta: Array
    B_r: Array
    B_v: Array
    unmoved: Array
    zeros: ComplexArray
    uncertainty: float
    pencil: InternalPencil | None = None

    @property
    def unmoved_part(self) -> Array:
        """A_eta in what inputs that are left over do not move (h, h)."""
        return np.asarray(self.unmoved.T @ self.A_eta @ self.unmoved)


@dataclass(frozen=True, eq=False)
class SplitDynamics:
    """Internal dynamics in coordinates eta = W_s z_s + W_u z_u in which the stable and the antistable part are decoupled.

    z_s' = A_s z_s + G_s [zeta; chi], z_u' = A_u z_u + G_u [zeta; chi], with z_s = L_s eta, z_u = L_u eta.

    Args:
        internal: the dynamics before they are split.
        A_s, A_u: stable (n_s, n_s) and antistable (n_u, n_u).
        G_s, G_u: (n_s, rho + p) and (n_u, rho + p).
        W_s, W_u: (n_z, n_s) and (n_z, n_u).
        L_s, L_u: (n_s, n_z) and (n_u, n_z).
        quick: which states of z_s and of z_u belong to zeros far beyond the plant's own modes, coupled with no others.
        neutral: of the zeros on the imaginary axis, where they are kept apart as the last n_c entries of z_s, the pseudoinverse of
            their block of A_s (n_c, n_c); see `TwoSidedSystem`.
    """

    internal: InternalDynamics
    A_s: Array
    A_u: Array
    G_s: Array
    G_u: Array
    W_s: Array
    W_u: Array
    L_s: Array
    L_u: Array
    quick: tuple[slice, slice]
    neutral: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @cached_property
    def propagators(self) -> tuple[Propagator, Propagator]:
        """exp(A_s tau) and exp(-A_u tau), each in the direction in which it decays."""
        return Propagator(self.A_s), Propagator(-self.A_u)

    def in_units_of(self, unit: float) -> SplitDynamics:
        """The same dynamics with z_s and z_u measured in another unit: W_s z_s + W_u z_u stays what it is."""
        return replace(
            self,
            G_s=self.G_s / unit,
            G_u=self.G_u / unit,
            W_s=self.W_s * unit,
            W_u=self.W_u * unit,
            L_s=self.L_s / unit,
            L_u=self.L_u / unit,
        )


def internal_dynamics(system: StateSpace, R: Array | None = None) -> InternalDynamics:
    """Internal dynamics of `system` with the output and its derivatives as the input. Raises RelativeDegreeError.

    R (m, m): how dear the inputs are, which decides what is left over of more inputs than outputs (`NormalForm.tracking_law`).
    """
    form = normal_form(system)
    F, G, Z = form.tracking_law(R)
    A_y = system.A + system.B @ F
    A_eta = form.N @ A_y @ form.V
    rounding = ROUNDING_FACTOR * system.n_states * np.finfo(float).eps
    errors = rounding * (np.abs(system.A) + np.abs(system.B) @ np.abs(F)) + system.errors("A") + system.errors("B") @ np.abs(F)
    # What the entries are uncertain by, and what N and V, orthonormal in the form's units, are.
    uncertainty = float(np.linalg.norm(np.abs(form.N) @ errors @ np.abs(form.V)))
    uncertainty += system.n_states * np.finfo(float).eps * float(np.linalg.norm(A_y * form.units / form.units[:, None]))
    B_v, into = form.N @ system.B @ Z, np.abs(form.N)
    B_terms, B_errors = into @ np.abs(system.B) @ np.abs(Z), into @ system.errors("B") @ np.abs(Z)
    B_v = np.where(np.abs(B_v) <= rounding * B_terms + ERROR_GROWTH * B_errors, 0.0, B_v)
    B_error = np.maximum(COUPLING_TOLERANCE * np.linalg.norm(B_terms, axis=0), ERROR_GROWTH * np.linalg.norm(B_errors, axis=0))
    unmoved = _unmoved(A_eta, uncertainty, B_v, B_error)
    return InternalDynamics(
        form=form,
        A_eta=A_eta,
        A_zeta=form.N @ A_y @ form.P,
        B_r=form.N @ system.B @ G,
        B_v=B_v,
        unmoved=unmoved,
        zeros=np.sort_complex(np.linalg.eigvals(unmoved.T @ A_eta @ unmoved).astype(complex)),
        uncertainty=uncertainty if A_eta.size else 0.0,
        pencil=internal_pencil(system, form, A_eta),
    )


def _unmoved(A_eta: Array, A_error: float, B_v: Array, B_error: Array) -> Array:
    """Orthonormal basis of what B_v does not reach through A_eta (n_z, h). B_error (m - p,): below which a column is none."""
    A_couples = max(COUPLING_TOLERANCE * float(np.linalg.norm(A_eta)), ERROR_GROWTH * A_error)
    return unreached([A_eta / as_divisor(A_couples)], B_v / as_divisor(B_error))


def zeros_on_axis(internal: InternalDynamics) -> ComplexArray:
    """Those zeros that cannot be told from ones on the imaginary axis, repeated ones included; see `on_axis`."""
    return internal.zeros[on_axis(internal)]


def on_axis(internal: InternalDynamics) -> NDArray[np.bool_]:
    """Which of the zeros cannot be told from ones on the imaginary axis, (h,), to within the matrix's uncertainty."""
    return Pseudospectrum(internal.unmoved_part).joins_axis(internal.zeros, internal.uncertainty)


def split_dynamics(system: StateSpace, *, endless: bool = True) -> SplitDynamics:
    """Internal dynamics split by an ordered real Schur form and a Sylvester equation.

    endless: whether the plant stays as it is for all of the past or future. Over an interval that ends, zeros on the imaginary axis
    do no harm; they are then counted with the stable ones.

    Raises NonHyperbolicError for zeros on the imaginary axis if endless, RelativeDegreeError as `internal_dynamics` does.
    """
    internal = internal_dynamics(system)
    refused = on_axis(internal)
    if np.any(refused) and endless:
        kinds = zero_kinds(system, internal.zeros)
        raise NonHyperbolicError(axis_message(internal, refused, kinds, NOT_UNIQUE))
    stable = refused | (internal.zeros.real <= 0)
    # By the nearest zero: reordering the Schur form puts one on the axis to either side of it.
    return split_by(internal, lambda zero: bool(stable[np.argmin(np.abs(internal.zeros - zero))]))


def split_by(internal: InternalDynamics, stable: Callable[[complex], bool]) -> SplitDynamics:
    """Internal dynamics split into the part with the zeros for which `stable` holds and the rest; the two sets must not meet."""
    if internal.pencil is None:
        parts, quick = invariant_parts(internal.A_eta, stable), (0, 0)
        drive = np.hstack([internal.A_zeta, internal.B_r])
        G_s, G_u = parts.L_1 @ drive, parts.L_2 @ drive
    else:
        found = internal.pencil.parts(stable)
        parts, G_s, G_u, quick = found.parts, found.D_1, found.D_2, found.quick
    n_s, n_u = len(parts.A_1), len(parts.A_2)
    return SplitDynamics(
        internal=internal,
        A_s=parts.A_1,
        A_u=parts.A_2,
        G_s=G_s,
        G_u=G_u,
        W_s=parts.W_1,
        W_u=parts.W_2,
        L_s=parts.L_1,
        L_u=parts.L_2,
        quick=(slice(n_s - quick[0], n_s), slice(n_u - quick[1], n_u)),
    )


def axis_message(internal: InternalDynamics, refused: NDArray[np.bool_], kinds: Sequence[str], consequence: str) -> str:
    """The sentence that refuses some of the zeros on the imaginary axis: what follows from them, and what can be done.

    Args:
        internal: the internal dynamics.
        refused: which of the zeros (n_z,).
        kinds: of all zeros (n_z,), see `zero_kinds`.
        consequence: what follows from their being on the axis.
    """
    size = float(np.max(np.abs(internal.zeros)))
    listed = format_zeros(internal.zeros[refused], size)
    message = (
        f"internal dynamics are not hyperbolic: zeros at {listed} lie on the imaginary axis to within what the model "
        f"resolves, {consequence}"
    )
    for kind, remedy in REMEDIES.items():
        alike = internal.zeros[refused & (np.array(kinds) == kind)]
        if alike.size and kind == "transmission zero":
            message += f"; {remedy}"
        elif alike.size:
            number, article = ("zero", "an") if alike.size == 1 else ("zeros", "each an")
            message += f"; the {number} at {format_zeros(alike, size)}: {article} {kind} of the plant, {remedy}"
    return message


def format_zeros(zeros: ArrayLike, size: float = 0.0) -> str:
    """Zeros (m,) as text, conjugates together: "-0.5, 0.0425+-4.305j". Parts below 1e-12 of `size` are written as 0.

    Raises ModelError for what is no vector of numbers.
    """
    values = np.atleast_1d(complex_numbers("zeros", zeros, error=ModelError))
    if values.ndim != 1:
        raise ModelError(f"zeros must be a vector of numbers, got shape {values.shape}")
    if not np.all(np.isfinite(values)):
        raise ModelError(f"zeros must be finite numbers, got {shown(zeros)}")
    size, texts = finite_number("size", size, error=ModelError), []
    for zero in values:
        real, imag = (0.0 if abs(part) <= 1e-12 * max(size, abs(zero)) else float(part) for part in (zero.real, zero.imag))
        if imag >= 0:
            texts.append(f"{real:.4g}" if imag == 0 else f"{real:.4g}+-{imag:.4g}j")
    return ", ".join(texts)
