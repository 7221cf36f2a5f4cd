"""The MJCF text of a beam."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from invtrack.arrays import Array

if TYPE_CHECKING:
    from invtrack.mechanisms.beam import Beam

BASE_SIZE, PAYLOAD_SIZE = 0.06, 0.03
"""Of the boxes that are drawn [m]."""

AXES = {  # along the beam, the way the base slides, axis of the hinges: its turn moves the tip the way the base slides
    "level": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "upright": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    "hanging": ((0, 0, -1), (1, 0, 0), (0, -1, 0)),
}


LOOKS = """\
  <visual>
    <global offwidth="1280" offheight="960"/>
    <headlight ambient="0.35 0.35 0.35" diffuse="0.45 0.45 0.45" specular="0 0 0"/>
    <quality offsamples="4"/>
  </visual>

  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.97 0.98 0.99" rgb2="0.80 0.85 0.90" width="64" height="384"/>
    <material name="carriage" rgba="0.16 0.31 0.48 1"/>
    <material name="beam" rgba="0.24 0.26 0.29 1"/>
    <material name="block" rgba="0.93 0.62 0.20 1"/>
  </asset>

  <default>
    <geom mass="0" contype="0" conaffinity="0"/>
  </default>""".splitlines()


def beam_mjcf(beam: Beam) -> str:
    """The text of the model that `Beam` describes."""
    along, across, axis = (np.array(each, dtype=float) for each in AXES[beam.orientation])
    lines = [
        '    <body name="base">',
        f'      <joint name="base" type="slide" axis="{_numbers(across)}"/>',
        f"      {_inertial(np.zeros(3), beam.base_mass, np.full(3, beam.base_mass * BASE_SIZE**2))}",
        f'      <geom name="base" type="box" size="{_numbers(np.full(3, BASE_SIZE / 2))}" material="carriage"/>',
        '      <site name="station0"/>',
        '      <body name="segment0">',
        *_rod(beam, 0),
    ]
    for i in range(1, beam.segments + 1):
        indent, stiffness = "  " * (i + 3), _numbers(beam.chain.stiffness[i - 1 : i])
        lines += [
            f'{indent}<body name="segment{i}" pos="{_numbers(along * beam.segment_length / (2 if i == 1 else 1))}">',
            f'{indent}  <joint name="bend{i}" type="hinge" axis="{_numbers(axis)}" stiffness="{stiffness}"/>',
            f'{indent}  <site name="station{i}"/>',
            *_rod(beam, i),
        ]
    indent, end = "  " * (beam.segments + 4), _numbers(along * beam.segment_length / 2)
    lines += [
        f'{indent}<site name="tip" pos="{end}"/>',
        f'{indent}<body name="payload" pos="{end}">',
        f"{indent}  {_inertial(np.zeros(3), beam.payload, np.full(3, beam.payload_inertia))}",
        f'{indent}  <geom name="payload" type="box" size="{_numbers(np.full(3, PAYLOAD_SIZE / 2))}" material="block"/>',
        f"{indent}</body>",
        *("  " * (i + 3) + "</body>" for i in range(beam.segments, -1, -1)),
        "    </body>",
    ]
    return "\n".join([*_head(beam, along), *lines, *_tail(beam)]) + "\n"


def _rod(beam: Beam, number: int) -> list[str]:
    """Inertia and shape of a rigid part, from where its body begins; about the axis of the hinges that of a thin rod."""
    along, thick, wide = (np.abs(np.array(each, dtype=float)) for each in AXES[beam.orientation])
    length = beam.segment_length / (1 if 0 < number < beam.segments else 2)
    mass, bending = float(beam.chain.masses[number]), float(beam.chain.inertias[number])
    about_width = mass * beam.width**2 / 12
    inertia = along * (about_width + mass * beam.thickness**2 / 12) + thick * (bending + about_width) + wide * bending
    centre = np.array(AXES[beam.orientation][0]) * length / 2
    half = (along * length + thick * beam.thickness + wide * beam.width) / 2
    indent = "  " * (number + 4)
    return [
        f"{indent}{_inertial(centre, mass, inertia)}",
        f'{indent}<geom name="segment{number}" type="box" pos="{_numbers(centre)}" size="{_numbers(half)}" material="beam"/>',
    ]


def _inertial(centre: Array, mass: float, inertia: Array) -> str:
    return f'<inertial pos="{_numbers(centre)}" mass="{_numbers([mass])}" diaginertia="{_numbers(inertia)}"/>'


def _head(beam: Beam, along: Array) -> list[str]:
    """Everything before the base."""
    place = {"level": "level, bending in the horizontal plane", "upright": "upright", "hanging": "hanging"}[beam.orientation]
    size = " x ".join(f"{side:.6g}" for side in (beam.length, beam.width, beam.thickness))
    slow = ", ".join(f"{w:.5g}" for w in beam.frequencies[:3])
    ratios = ", ".join(f"{ratio:.6g}" for ratio in beam.damping_ratios[:3])
    return [
        "<!--",
        f"  An elastic beam, {place}: {size} m, E I = {beam.bending_stiffness:.6g} N m^2, {beam.mass_per_length:.6g} kg/m, on a",
        f"  sliding base of {beam.base_mass:.6g} kg that a force moves, with a payload of {beam.payload:.6g} kg at the tip.",
        f"  In {beam.segments} segments: hinges of the stiffness E I / h at h/2, 3h/2, ..., rigid rods between them.",
        "",
        f"  Slowest flexible modes on the free base: {slow} rad/s, with the damping ratios {ratios}",
        "  by the velocity coupling of the hinges below, which invtrack applies and MuJoCo alone does not.",
        f"  Fastest mode: {beam.frequencies[-1]:.5g} rad/s. The time step lets it turn by 1 rad at most, also without payload; RK4",
        "  is stable up to 2.8 rad.",
        "",
        "  Made by invtrack.mechanisms.Beam(...).mjcf().",
        "-->",
        '<mujoco model="beam">',
        '  <compiler angle="radian"/>',
        f'  <option timestep="{beam.timestep!r}" integrator="RK4" gravity="0 0 -9.81">',
        '    <flag contact="disable"/>',
        "  </option>",
        f'  <statistic center="{_numbers(along * beam.length / 2)}" extent="{_numbers([2 * beam.length])}"/>',
        "",
        *LOOKS,
        "",
        "  <worldbody>",
        '    <light pos="0 -4 6" dir="0 0.5 -1"/>',
    ]


def _tail(beam: Beam) -> list[str]:
    """Everything after the tip."""
    rows = [f"            {_numbers(row)}" for row in -beam.damping_matrix]
    return [
        "  </worldbody>",
        "",
        "  <actuator>",
        '    <motor name="force" joint="base"/>',
        "  </actuator>",
        "",
        "  <custom>",
        '    <tuple name="velocity_coupling">',
        *(f'      <element objtype="joint" objname="{name}"/>' for name in beam.hinges),
        "    </tuple>",
        '    <numeric name="velocity_coupling" data="',
        *rows,
        '    "/>',
        "  </custom>",
        "</mujoco>",
    ]


def _numbers(values: Iterable[float] | Array) -> str:
    """Numbers as MJCF has them."""
    return " ".join(f"{float(value) + 0.0:.12g}" for value in values)
