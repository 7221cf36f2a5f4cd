"""Frequency responses: magnitude and phase over frequency."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from invtrack.errors import InvtrackError
from invtrack.figures.style import line_looks, new_figure, shared_style

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def frequency_response_figure(
    title: str, *, w: Array, curves: Mapping[str, ComplexArray], magnitude: str, phase: bool = True
) -> Figure:
    """Magnitude on logarithmic axes and, below it, the continuous phase of each curve, left out with phase=False.

    The phase starts between -270 and 90 degrees: a double integrator's at -180.

    w (m,): frequencies [rad/s], positive and increasing. curves: {name: response (m,)}. magnitude: label of the upper axis, with
    its unit. Raises InvtrackError where frequencies are not positive or not in order, and where lengths differ.
    """
    if not curves or len(w) < 2 or w[0] <= 0 or np.any(np.diff(w) <= 0):
        raise InvtrackError("expected at least one curve over two or more positive frequencies that increase")
    for name, curve in curves.items():
        if np.shape(curve) != np.shape(w):
            raise InvtrackError(f"curve {name!r} has shape {np.shape(curve)}, expected one value for each of {len(w)} frequencies")
    with shared_style():
        figure = new_figure(title, width=8.0, height=4.8 if phase else 3.4)
        all_axes = figure.subplots(2 if phase else 1, 1, sharex=True, squeeze=False, height_ratios=[1.5, 1.0] if phase else [1.0])[
            :, 0
        ]
        for (name, curve), look in zip(curves.items(), line_looks(len(curves)), strict=True):
            all_axes[0].loglog(w, np.abs(curve), label=name, **look)
            if phase:
                all_axes[1].semilogx(w, _phase(curve), **look)
        all_axes[0].set_ylabel(magnitude)
        if phase:
            all_axes[1].set_ylabel("phase [degrees]")
        all_axes[-1].set_xlabel("frequency [rad/s]")
        all_axes[0].margins(x=0.0)
        if len(curves) > 1:
            figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside lower left", ncols=4)
    return figure


def _phase(curve: ComplexArray) -> Array:
    """Continuous phase [degrees]; a lead of more than a quarter turn at the lowest frequency counts as a lag."""
    phase = np.degrees(np.unwrap(np.angle(curve)))
    return np.asarray(phase - 360.0 if phase[0] > 90.0 + 1e-6 else phase)
