"""Segments and tails as one trajectory, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from invtrack.linear.propagation import Propagator
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import PolynomialSegments, Trajectory, TwoSidedSegments, grouped
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem

STILL = Tail.holding(1, np.zeros(1))


def driven(A_f: float, A_b: float) -> DrivenSystem:
    """x = z_f + z_b + w, z_f' = A_f z_f + w, z_b' = A_b z_b, w' = 3 w."""
    one = np.eye(1)
    system = TwoSidedSystem(Part(A_f * one, one, one), Part(A_b * one, one, one), np.eye(2, 1))
    return DrivenSystem(system, 3 * one, one, np.zeros((1, 1)), one, one)


def two_sided() -> Trajectory:
    """On [0, 1]: z_f(0) = 1, w(0) = 2, z_b(1) = 3; after it 4 e^-6t, before it 7 e^5t."""
    w = np.array([[2.0], [2 * np.exp(3.0)]])
    segments = TwoSidedSegments(driven(-2.0, 5.0), np.hstack([[[1.0]], w[:1]]), np.hstack([[[3.0]], w[1:]]))
    one, zero = np.eye(1), np.zeros(1, dtype=np.intp)
    before = replace(STILL, direction=-1, departure=Propagator(-5 * one), X=one, v=np.array([7.0]))
    after = replace(STILL, departure=Propagator(-6 * one), X=one, v=np.array([4.0]))
    return Trajectory(np.array([0.0, 1.0]), (segments,), zero, zero, before, after)


def inner(t: np.ndarray) -> np.ndarray:
    """z_f = (1 - 2/5) e^-2t + 2/5 e^3t."""
    return 0.6 * np.exp(-2 * t) + 0.4 * np.exp(3 * t) + 3 * np.exp(5 * (t - 1)) + 2 * np.exp(3 * t)


def test_forward_and_backward_parts_against_closed_form() -> None:
    t = np.array([-1.0, 0.0, 0.25, 1.0, 1.0, 3.0])
    expected = [7 * np.exp(-5), *inner(np.array([0.0, 0.25, 1.0])), 4.0, 4 * np.exp(-12)]
    assert two_sided()(t, np.array([0, 1, 1, 1, 2, 2]))[:, 0] == pytest.approx(expected, rel=1e-13)


def test_a_derivative_is_that_of_the_values() -> None:
    trajectory, t, h = two_sided(), np.array([-0.5, 0.3, 0.8, 1.7]), 1e-6
    slope = (trajectory.at(t + h, None) - trajectory.at(t - h, None)) / (2 * h)
    assert trajectory.derivative().at(t, None) == pytest.approx(slope, rel=1e-8)


def test_values_are_mapped_in_every_piece() -> None:
    M, t = np.array([[2.0], [-3.0]]), np.array([-0.5, 0.3, 0.8, 1.7])
    assert two_sided().mapped(M).at(t, None) == pytest.approx(two_sided().at(t, None) @ M.T)


def test_polynomials_between_exponential_tails() -> None:
    """1 + 2 t + 3 t^2 on [0, 2], 5 - t on [2, 2.5]; a two-sided segment in between: kinds may mix."""
    breakpoints = np.array([0.0, 2.0, 3.0, 3.5])
    polynomials = PolynomialSegments(np.array([[[1.0], [4.0], [12.0]], [[5.0], [-0.5], [0.0]]]), np.array([2.0, 0.5]))
    w = np.array([[2.0]])
    exponential = TwoSidedSegments(driven(-2.0, 5.0), np.hstack([[[1.0]], w]), np.hstack([[[3.0]], w * np.exp(3.0)]))
    trajectory = Trajectory(
        breakpoints, (polynomials, exponential), np.array([0, 1, 0]), np.array([0, 0, 1]), replace(STILL, direction=-1), STILL
    )
    t = np.array([0.0, 1.0, 2.0, 2.25, 3.0, 3.5])
    expected = [1.0, 6.0, 17.0, *inner(np.array([0.25])), 5.0, 4.5]
    piece = np.array([1, 1, 1, 2, 3, 3])
    assert trajectory(t, piece)[:, 0] == pytest.approx(expected)
    slopes = trajectory.derivative()(np.array([0.0, 1.0, 3.1]), np.array([1, 1, 3]))[:, 0]
    assert slopes == pytest.approx([2.0, 8.0, -1.0])


def test_pieces_of_one_owner_share_a_group() -> None:
    made: list[tuple[int, list[int]]] = []

    def make(owner: int, pieces: np.ndarray) -> PolynomialSegments:
        made.append((owner, pieces.tolist()))
        return PolynomialSegments(np.full((len(pieces), 1, 1), float(owner)) + pieces[:, None, None] / 10, np.ones(len(pieces)))

    trajectory = grouped(np.arange(5.0), np.array([7, 3, 7, 3]), make, replace(STILL, direction=-1), STILL)
    assert made == [(3, [1, 3]), (7, [0, 2])]
    assert trajectory.at([0.5, 1.5, 2.5, 3.5], None)[:, 0] == pytest.approx([7.0, 3.1, 7.2, 3.3])
