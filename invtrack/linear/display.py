"""How a linear model shows itself: in a line, and in a notebook as matrices."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np

from invtrack.arrays import Array
from invtrack.channels import Channels

if TYPE_CHECKING:
    from invtrack.linear.state_space import StateSpace

SHOWN = 10
"""Rows and columns of a matrix that are shown, at most; of larger ones the first and the last of them are."""

DIGITS = 4
"""Significant digits of an entry."""


def in_a_line(model: StateSpace) -> str:
    """<StateSpace: 6 states, input base_force [N], output tip_position [m]; tip_mass=10>."""
    parts = f"{model.n_states} states, {_listed('input', model.inputs)}, {_listed('output', model.outputs)}"
    held = ", ".join(f"{name}={value:.6g}" for name, value in model.parameters.items())
    return f"<StateSpace: {parts}{'; ' if held else ''}{held}>"


def in_latex(model: StateSpace) -> str:
    """Both equations with their matrices, without delimiters; x, u and y are deviations from rest."""
    A, B, C, D = (_matrix(matrix) for matrix in (model.A, model.B, model.C, model.D))
    through = f" + {D}\\,u" if np.any(model.D) else ""
    return f"\\begin{{aligned}}\\dot x &= {A}\\,x + {B}\\,u \\\\ y &= {C}\\,x{through}\\end{{aligned}}"


def in_html(model: StateSpace) -> str:
    """The line, the matrices as a notebook typesets them, and the names and units of the states."""
    states = ", ".join(html.escape(label) for label in model.states.labels)
    return f"<p>{html.escape(in_a_line(model)[1:-1])}</p><p>$${in_latex(model)}$$</p><p>x: {states}</p>"


def _listed(kind: str, channels: Channels) -> str:
    labels = ", ".join(channels.labels)
    return f"{kind}{'s' if len(channels) > 1 else ''} {labels}"


def _matrix(values: Array) -> str:
    rows, columns = (_chosen(count) for count in values.shape)
    lines = [" & ".join(_entry(values, i, j) for j in columns) for i in rows]
    return "\\begin{bmatrix}" + " \\\\ ".join(lines) + "\\end{bmatrix}"


def _chosen(count: int) -> list[int | None]:
    """Which of so many rows or columns are shown, None for those between."""
    if count <= SHOWN:
        return list(range(count))
    return [*range(SHOWN // 2), None, *range(count - SHOWN // 2, count)]


def _entry(values: Array, i: int | None, j: int | None) -> str:
    if i is None or j is None:
        return "\\ddots" if i is None and j is None else "\\vdots" if i is None else "\\cdots"
    text = f"{values[i, j] + 0.0:.{DIGITS}g}"
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    return f"{mantissa} \\cdot 10^{{{int(exponent)}}}"
