"""The beam against the theory of Euler and Bernoulli, which knows nothing of segments, and against MuJoCo."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
import scipy.linalg
from scipy.optimize import brentq

import invtrack
from invtrack.arrays import Array
from invtrack.errors import PlantError
from invtrack.mechanisms import Beam

CLAMPED_FREE = (1.8751040687119611, 4.6940911329741745, 7.8547574382376126)  # beta L, roots of 1 + cos cosh
NUMBER = re.compile(r"(?<![\w.])(-?\d+\.?\d*(?:e[-+]?\d+)?)(?![\w.])")  # not those in names
FORTY_SEGMENTS = (1.4e-4, 5.0e-4, 8.2e-4)  # relative errors of the frequencies, to two digits


def base_locked(beam: Beam) -> Array:
    """Natural frequencies [rad/s] of the compiled model without the joint of its base, from MuJoCo's own inertias."""
    spec = beam.spec()
    for element in (*spec.actuators, *(joint for joint in spec.joints if joint.name == "base")):
        spec.delete(element)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return np.sqrt(scipy.linalg.eigh(np.diag(np.ravel(model.jnt_stiffness)[: model.nv]), M)[0])


def of_theory(beam: Beam, beta_L: Array) -> Array:
    """The frequencies [rad/s] of these wave numbers, (beta L)^2 sqrt(E I / (m' L^4)), all from the beam's geometry."""
    stiffness = beam.youngs_modulus * beam.width * beam.thickness**3 / 12
    per_length = beam.density * beam.width * beam.thickness
    return beta_L**2 * math.sqrt(stiffness / (per_length * beam.length**4))


def roots(function: Callable[[float], float], count: int) -> Array:
    """The first zeros of a function of beta L, above 0.3."""
    grid = np.linspace(0.3, 12.0, 2000)
    values = [function(x) for x in grid]
    ends = [k for k in range(len(grid) - 1) if values[k] * values[k + 1] < 0]
    return np.array([brentq(function, grid[k], grid[k + 1], xtol=1e-13) for k in ends[:count]])


def characteristic(beam: Beam, *, base: float | None) -> Callable[[float], float]:
    """The determinant of the beam's boundary conditions over beta L: root held, or on a free base of this mass without turning."""
    bare = beam.density * beam.width * beam.thickness * beam.length
    tip, turning = beam.payload / bare, beam.payload_inertia / (bare * beam.length**2)

    def determinant(b: float) -> float:
        # w = a cos + b sin + c cosh + d sinh of beta x, lengths in L; forces in E I / L^3.
        c, s, ch, sh = math.cos(b), math.sin(b), math.cosh(b), math.sinh(b)
        root = [1.0, 0.0, 1.0, 0.0] if base is None else [b * base / bare, 1.0, b * base / bare, -1.0]
        rows = [
            root,  # place held, or shear force that accelerates the base
            [0.0, 1.0, 0.0, 1.0],
            [-c + turning * b**3 * s, -s - turning * b**3 * c, ch - turning * b**3 * sh, sh - turning * b**3 * ch],
            [s + tip * b * c, -c + tip * b * s, sh + tip * b * ch, ch + tip * b * sh],
        ]
        return float(np.linalg.det(rows))

    return determinant


def linear(beam: Beam, *outputs: str) -> invtrack.StateSpace:
    return invtrack.linearize(invtrack.Plant.from_xml(beam.mjcf(), inputs=["force"], outputs=outputs or ["joint:base"]))


def modes(values: Array) -> tuple[Array, Array]:
    """Frequencies [rad/s], increasing, and damping ratios of complex pairs."""
    pairs = values[values.imag > 1.0]
    pairs = pairs[np.argsort(np.abs(pairs))]
    return np.abs(pairs), -pairs.real / np.abs(pairs)


def test_clamped_frequencies_are_those_of_theory_and_converge_with_the_square_of_the_segments() -> None:
    errors = []
    for segments in (20, 40):
        beam = Beam(segments=segments, payload=0.0)
        errors.append(base_locked(beam)[:3] / of_theory(beam, np.array(CLAMPED_FREE)) - 1)
    assert errors[1] == pytest.approx(FORTY_SEGMENTS, rel=0.03)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize(("payload", "inertia"), [(0.1, 0.0), (0.5, 0.0), (0.5, 0.02)])
def test_with_a_payload_they_solve_the_transcendental_equation(payload: float, inertia: float) -> None:
    beam = Beam(segments=40, payload=payload, payload_inertia=inertia)
    expected = roots(characteristic(beam, base=None), 3)
    if not inertia:
        mu = payload / (2700.0 * 0.04 * 0.005 * 1.2)
        for b in expected:
            c, s, ch, sh = math.cos(b), math.sin(b), math.cosh(b), math.sinh(b)
            assert (1 + c * ch + mu * b * (c * sh - s * ch)) / ch == pytest.approx(0.0, abs=1e-10)
    assert base_locked(beam)[:3] == pytest.approx(of_theory(beam, expected), rel=1.5e-3)


def test_on_a_free_base_its_mass_counts_and_the_clamped_frequencies_are_zeros() -> None:
    beam = Beam(segments=40, base_mass=0.8, payload=0.3, payload_inertia=1e-3, damping=0.0)
    model = linear(beam)
    poles = modes(np.linalg.eigvals(model.A))[0]
    assert poles[:3] == pytest.approx(of_theory(beam, roots(characteristic(beam, base=0.8), 3)), rel=2e-3)
    assert poles == pytest.approx(beam.frequencies, rel=1e-6)
    clamped = of_theory(beam, roots(characteristic(beam, base=None), 3))
    assert modes(invtrack.linear.zeros(model))[0][:3] == pytest.approx(clamped, rel=2e-3)
    heavy = Beam(segments=12, base_mass=1e7, payload=0.3)  # hardly moves: the poles become those zeros
    assert heavy.frequencies[:3] == pytest.approx(base_locked(heavy)[:3], rel=1e-6)


@pytest.mark.parametrize(("damping", "expected"), [(0.02, [0.02] * 5), ((0.005, 0.03, 0.01), [0.005, 0.03, 0.01, 0.01, 0.01])])
@pytest.mark.parametrize("orientation", ["level", "hanging"])
def test_the_modes_have_the_damping_ratios_that_were_asked_for(
    damping: float | tuple[float, ...], expected: list[float], orientation: str
) -> None:
    beam = Beam(segments=5, damping=damping, orientation=orientation)
    frequencies, ratios = modes(np.linalg.eigvals(linear(beam).A))
    assert ratios == pytest.approx(expected, rel=1e-6)
    assert frequencies == pytest.approx(beam.frequencies, rel=1e-7)
    assert np.linalg.eigvalsh(beam.damping_matrix)[0] > 0


def test_gravity_slows_an_upright_beam_and_quickens_a_hanging_one() -> None:
    beams = {place: Beam(segments=6, orientation=place) for place in ("level", "upright", "hanging")}
    for beam in beams.values():
        assert modes(np.linalg.eigvals(linear(beam).A))[0] == pytest.approx(beam.frequencies, rel=1e-7)
    slowest = [beams[place].frequencies[0] for place in ("upright", "level", "hanging")]
    assert slowest == sorted(slowest)


def test_an_upright_beam_buckles_at_the_weight_of_theory() -> None:
    # m' g L^3 / (E I) = 7.837 by its own weight (Greenhill 1881), P L^2 / (E I) = pi^2 / 4 by a load at the tip (Euler).
    def tall(factor: float) -> float:
        return float((factor * 7.8373 * 70e9 * 0.005**2 / 12 / (2700.0 * 9.81)) ** (1 / 3))

    Beam(segments=60, length=tall(0.99), payload=0.0, orientation="upright")
    with pytest.raises(PlantError, match="buckles"):
        Beam(segments=60, length=tall(1.01), payload=0.0, orientation="upright")
    stiffness = 70e9 * 0.04 * 0.005**3 / 12
    load = np.pi**2 / 4 * stiffness / 1.2**2 / 9.81
    Beam(segments=60, density=1e-3, payload=0.99 * load, orientation="upright")
    with pytest.raises(PlantError, match="buckles"):
        Beam(segments=60, density=1e-3, payload=1.01 * load, orientation="upright")


def test_strain_and_energy_are_those_of_a_beam_under_a_force_at_its_tip() -> None:
    beam, force = Beam(segments=40), 0.2
    x = beam.stations[1:-1]
    angles = force * (beam.length - x) * beam.segment_length / (70e9 * 0.04 * 0.005**3 / 12)  # moment / stiffness of a hinge
    assert beam.surface_strain(angles) == pytest.approx(force * (1.2 - x) / (70e9 * 0.04 * 0.005**2 / 6), rel=1e-12)
    assert beam.strain_energy(angles) == pytest.approx(force**2 * 1.2**3 / (6 * 70e9 * 0.04 * 0.005**3 / 12), rel=1e-3)


def test_a_turn_of_any_hinge_moves_the_tip_the_way_the_base_slides() -> None:
    for orientation in ("level", "upright", "hanging"):
        beam = Beam(segments=4, orientation=orientation)
        plant = invtrack.Plant.from_xml(beam.mjcf(), inputs=["force"], outputs=beam.station_outputs)
        C = invtrack.linearize(plant).C[:, :5]
        lever = np.maximum(beam.stations[:, None] - beam.stations[1:-1], 0.0)  # of each hinge to each station
        assert pytest.approx(np.hstack([np.ones((6, 1)), lever]), abs=1e-8) == C


def test_the_shipped_model_is_what_the_builder_gives() -> None:
    path = invtrack.model_path("beam")
    shipped, made = (re.split(NUMBER, text) for text in (path.read_text(encoding="utf-8"), Beam().mjcf()))
    assert shipped[::2] == made[::2]
    numbers, again = (np.array(text[1::2], dtype=float) for text in (shipped, made))
    np.testing.assert_allclose(again, numbers, rtol=1e-10, atol=1e-13)  # the last of twelve digits depends on the processor
    assert mujoco.MjModel.from_xml_path(str(path)).opt.timestep == Beam().timestep


def test_the_time_step_lets_the_fastest_mode_turn_by_a_radian_with_any_payload() -> None:
    beam = Beam(segments=8, payload=2.0)
    bare = Beam(segments=8, payload=0.0).frequencies[-1]
    assert beam.frequencies[-1] < bare
    assert 0.9 < beam.timestep * bare <= 1.0


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"length": 0.0}, "length must be positive"),
        ({"payload": -1.0}, "payload must be zero or more"),
        ({"segments": 0}, "segments must be a whole number from 1"),
        ({"damping": 1.0}, "damping must be a ratio"),
        ({"damping": [0.01] * 13}, "1 to 12 modes"),
        ({"orientation": "sideways"}, "orientation must be one of"),
        ({"segments": 200, "thickness": 0.004}, "shorter than the beam is thick"),
    ],
)
def test_what_is_no_beam_is_refused(changed: dict[str, object], message: str) -> None:
    with pytest.raises(PlantError, match=message):
        Beam(**changed)  # type: ignore[arg-type]


def test_angles_of_another_beam_are_refused() -> None:
    with pytest.raises(PlantError, match="angles of 12 hinges"):
        Beam().surface_strain(np.zeros(5))
