"""A flexible beam on a sliding base with a payload at its tip, as MJCF: any number of hinged segments, any geometry and damping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import one_of
from invtrack.arrays import Array, finite_number, real_numbers, whole_number
from invtrack.errors import PlantError
from invtrack.mechanisms.beam_mjcf import beam_mjcf
from invtrack.mechanisms.chain import Chain

Orientation = Literal["level", "upright", "hanging"]

GRAVITY = 9.81
"""[m/s^2]"""

MOST_SEGMENTS = 200
"""Segments at most: MuJoCo's cost and the fastest mode grow with their square."""

STEP_ANGLE = 1.0
"""Angle [rad] by which the fastest mode turns in one time step: RK4 is stable up to 2.8 of it."""


@dataclass(frozen=True, kw_only=True)
class Beam:
    """A slender elastic beam that a force on its sliding base moves across its length, with a payload at the tip.

    An Euler-Bernoulli beam in n segments of the length h = length / n: n hinges with the stiffness E I / h at h/2, 3h/2, ...,
    between n - 1 rigid rods of the length h, and half a rod at root and tip. So the frequencies converge with h^2: with 40
    segments the first three modes of the clamped beam are 0.014, 0.050 and 0.082 % too high, with the 12 of models/beam.xml, which
    is `Beam().mjcf()`, 0.16, 0.56 and 0.91 %.

    In the model: the base "base" with the joint "base" and the motor "force" on it, hinges "bend1", "bend2", ... from the root on,
    the body "payload" at the tip (so "body:payload:mass" is a parameter), and sites: "station0" at the root, "station1", ... at the
    hinges, "tip". The damping is a velocity coupling of the hinges, which invtrack applies and MuJoCo alone does not.

    Args:
        length, width, thickness: of the beam [m]; it bends across its thickness.
        youngs_modulus, density: of its material [N/m^2], [kg/m^3].
        segments: how many, n.
        base_mass: [kg].
        payload, payload_inertia: mass [kg] at the tip, and its moment of inertia [kg m^2] about the tip.
        damping: damping ratios of the flexible modes on the free base with this payload: one for all of them, or those of the
            slowest ones, of which the last is that of all others, too.
        orientation: "level" along x, bending in the horizontal plane, free of gravity; "upright" and "hanging" along z.

    Raises PlantError for numbers out of range, half segments that are shorter than thick, and an upright beam that buckles.
    """

    length: float = 1.2
    width: float = 0.04
    thickness: float = 0.005
    youngs_modulus: float = 70e9
    density: float = 2700.0
    segments: int = 12
    base_mass: float = 5.0
    payload: float = 0.5
    payload_inertia: float = 0.0
    damping: float | Sequence[float] = 0.01
    orientation: Orientation = "level"

    def __post_init__(self) -> None:
        positive = ("length", "width", "thickness", "youngs_modulus", "density", "base_mass")
        for name in (*positive, "payload", "payload_inertia"):
            value = finite_number(name, getattr(self, name), error=PlantError)
            if value < 0 or (value == 0 and name in positive):
                raise PlantError(f"a beam's {name} must be {'positive' if name in positive else 'zero or more'}, got {value:.6g}")
            object.__setattr__(self, name, value)
        object.__setattr__(
            self, "segments", whole_number("segments", self.segments, lowest=1, highest=MOST_SEGMENTS, error=PlantError)
        )
        one_of("orientation", self.orientation, get_args(Orientation), error=PlantError)
        ratios = np.atleast_1d(real_numbers("damping", self.damping, error=PlantError))
        if ratios.ndim != 1 or not 1 <= len(ratios) <= self.segments or not np.all((ratios >= 0) & (ratios < 1)):
            raise PlantError(
                f"damping must be a ratio from 0 to below 1, or those of 1 to {self.segments} modes, got {ratios.tolist()}"
            )
        if self.segment_length / 2 < self.thickness:
            raise PlantError(
                f"half segments of {self.segment_length / 2:.4g} m are shorter than the beam is thick, {self.thickness:.4g}"
                " m, which is no slender beam; take fewer segments"
            )
        lowest = np.linalg.eigvalsh(self.chain.stiffness_matrix[1:, 1:])[0]
        if not lowest > 0:
            raise PlantError(
                f"the upright beam buckles under its own weight and the payload of {self.payload:.4g} kg; make it shorter, thicker "
                "or lighter at the tip"
            )

    @property
    def bending_stiffness(self) -> float:
        """E I [N m^2]."""
        return self.youngs_modulus * self.width * self.thickness**3 / 12

    @property
    def mass_per_length(self) -> float:
        """[kg/m]"""
        return self.density * self.width * self.thickness

    @property
    def segment_length(self) -> float:
        """h = length / segments [m]."""
        return self.length / self.segments

    @property
    def hinges(self) -> tuple[str, ...]:
        """Names of the hinges from the root on; their angles are states of the same names."""
        return tuple(f"bend{i}" for i in range(1, self.segments + 1))

    @property
    def stations(self) -> Array:
        """Where the sites are along the beam (n + 2,) [m]: root, hinges, tip. Between two of them the model's beam is straight."""
        return np.concatenate([[0.0], self.segment_length * (np.arange(self.segments) + 0.5), [self.length]])

    @property
    def station_outputs(self) -> tuple[str, ...]:
        """The outputs of `Plant.from_xml` that read where the stations are, across the beam (n + 2,)."""
        axis = "y" if self.orientation == "level" else "x"
        return tuple(f"site:{name}:{axis}" for name in self._sites)

    @property
    def tip_output(self) -> str:
        """The output of `Plant.from_xml` that reads where the tip is."""
        return self.station_outputs[-1]

    @cached_property
    def chain(self) -> Chain:
        """The mechanics of the model while the beam is straight."""
        h, n = self.segment_length, self.segments
        lengths = np.concatenate([[h / 2], np.full(n - 1, h), [h / 2]])
        masses, starts = self.mass_per_length * lengths, np.concatenate([[0.0], h * (np.arange(n) + 0.5)])
        return Chain(
            base_mass=self.base_mass,
            hinges=starts[1:],
            length=self.length,
            masses=masses,
            centres=starts + lengths / 2,
            inertias=masses * lengths**2 / 12,
            payload=self.payload,
            payload_inertia=self.payload_inertia,
            stiffness=np.full(n, self.bending_stiffness / h),
            weight={"level": 0.0, "upright": -GRAVITY, "hanging": GRAVITY}[self.orientation],
        )

    @cached_property
    def frequencies(self) -> Array:
        """Natural frequencies of the model's flexible modes on the free base (n,) [rad/s], increasing."""
        return self.chain.flexible_modes()[0]

    @property
    def damping_ratios(self) -> Array:
        """Damping ratios of the flexible modes on the free base (n,)."""
        given = np.atleast_1d(np.array(self.damping, dtype=float))
        return given[np.minimum(np.arange(self.segments), len(given) - 1)]

    @cached_property
    def timestep(self) -> float:
        """Time step of the model [s]: the fastest mode turns by 1 rad at most, so RK4, stable up to 2.8, has room left.

        That of the beam without its payload, which is faster than with one, so that a payload may be set down in mid-run. Rounded
        down to two digits.
        """
        bare = replace(self.chain, payload=0.0, payload_inertia=0.0)
        longest = STEP_ANGLE / float(bare.flexible_modes()[0][-1])
        digit = 10.0 ** (math.floor(math.log10(longest)) - 1)
        return float(f"{math.floor(longest / digit) * digit:.1e}")

    @cached_property
    def damping_matrix(self) -> Array:
        """D (n, n) [N m s/rad] with which the hinges' torques -D (rates of the angles) give the modes their damping ratios."""
        return self.chain.modal_damping(self.damping_ratios)

    def surface_strain(self, angles: ArrayLike) -> Array:
        """Strain of the beam's surface at the hinges (..., n) for their angles (..., n) [rad]: curvature times half the thickness.

        Raises PlantError for another number of angles, or for such that are not finite.
        """
        return self._angles(angles) / self.segment_length * self.thickness / 2

    def strain_energy(self, angles: ArrayLike) -> Array:
        """Elastic energy [J] (...,) for the hinges' angles (..., n) [rad].

        Raises PlantError for another number of angles, or for such that are not finite.
        """
        return np.asarray(np.sum(self._angles(angles) ** 2, axis=-1) * self.bending_stiffness / self.segment_length / 2)

    def spec(self) -> mujoco.MjSpec:
        """The model as a specification, to be compiled, changed or attached to something else."""
        return mujoco.MjSpec.from_string(self.mjcf())

    def mjcf(self) -> str:
        """The model as MJCF text, all numbers to 12 digits."""
        return beam_mjcf(self)

    @property
    def _sites(self) -> tuple[str, ...]:
        return (*(f"station{i}" for i in range(self.segments + 1)), "tip")

    def _angles(self, angles: ArrayLike) -> Array:
        values = real_numbers("angles [rad]", angles, error=PlantError)
        if values.ndim == 0 or values.shape[-1] != self.segments:
            raise PlantError(f"expected the angles of {self.segments} hinges (..., {self.segments}), got shape {values.shape}")
        if not np.all(np.isfinite(values)):
            raise PlantError("the angles must be finite; leave out where a run diverged")
        return values
