"""Holds and what they run through."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.control.protocol import Instants


def interval(t: np.ndarray) -> np.ndarray:
    """Switches at 1 and 2."""
    return np.searchsorted([1.0, 2.0], t, side="right")


def test_parts_in_one_interval_are_taken_together() -> None:
    """Two holds from 0.6 and 1.4, in three and in two parts, of which the first goes over a switch."""
    middle = np.array([0.7, 0.9, 1.2, 1.5, 1.75])
    asked = Instants(
        time=np.array([0.6, 1.4]),
        hold=np.array([0.8, 0.5]),
        inside=np.array([0.7, 1.5]),
        first=np.array([0, 3]),
        part_middle=middle,
        part_inside=middle,
        part_share=np.array([0.25, 0.25, 0.5, 0.4, 0.6]),
    )
    assert asked.part_owner.tolist() == [0, 0, 0, 1, 1]
    assert asked.segments(interval) == [((0, 0.4), (1, 0.4)), ((1, 0.5),)]


def test_a_hold_may_run_through_a_whole_interval() -> None:
    middle = np.array([0.95, 1.5, 2.05])
    asked = Instants(np.array([0.9]), np.array([1.2]), middle[:1], np.array([0]), middle, middle, np.array([0.1, 1.0, 0.1]) / 1.2)
    assert asked.segments(interval) == [((0, 0.1), (1, 1.0), (2, 0.1))]


def test_holds_equal_but_for_rounding_are_one_and_the_same() -> None:
    time = np.array([1e-3 * k for k in range(500)])
    asked = Instants.undivided(time, np.diff(np.append(time, 0.5)), time + 5e-4)
    assert len(set(asked.hold.tolist())) > 1
    assert set(asked.segments(interval)) == {((0, 1e-3),)}
    assert asked.mean_over_hold(lambda times, inside: times[:, None])[:, 0] == pytest.approx(time + 5e-4)
