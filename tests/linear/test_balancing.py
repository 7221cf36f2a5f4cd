"""Scales that make results independent of units."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse.csgraph

from invtrack.linear.scaling import LARGEST_SCALE, SMALL, balancing_scale, parts


@pytest.mark.parametrize("seed", range(5))
def test_units_are_undone_and_eigenvalues_kept(seed: int) -> None:
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(5, 5))
    unit = 2.0 ** rng.integers(-30, 31, size=5)
    foreign = unit[:, None] * M / unit
    scale = balancing_scale(foreign)
    balanced = foreign * scale / scale[:, None]
    assert np.max(np.abs(balanced)) < 16 * np.max(np.abs(M))
    assert np.sort_complex(np.linalg.eigvals(balanced)) == pytest.approx(np.sort_complex(np.linalg.eigvals(M)), abs=1e-12)


def test_a_triangular_matrix_is_left_alone_within_its_parts() -> None:
    M = np.triu(np.random.default_rng(0).normal(size=(6, 6)) * 10.0 ** np.arange(6))
    assert np.array_equal(balancing_scale(M, within_parts=True), np.ones(6))
    swapping = np.array([[0.0, 2.0**20], [2.0**-20, 0.0]])
    scale = balancing_scale(np.block([[swapping, np.ones((2, 1))], [np.zeros((1, 3))]]), within_parts=True)
    assert scale[0] / scale[1] == pytest.approx(2.0**20)


def test_scales_are_powers_of_two_within_bounds() -> None:
    """Also for a matrix in parts that do not act on each other, and for a chain of integrators."""
    for M in (np.array([[1e-9, 1e9], [0.0, 1e-9]]), np.diag([1e200, 1e-200], k=1), np.zeros((3, 3)), np.zeros((0, 0))):
        scale = balancing_scale(M)
        assert scale.shape == (len(M),)
        assert np.array_equal(np.log2(scale), np.rint(np.log2(scale)))
        assert np.all((scale >= 1 / LARGEST_SCALE) & (scale <= LARGEST_SCALE))


@pytest.mark.parametrize("one_way", [False, True])
def test_parts_are_the_components_of_the_graph_whatever_its_size(one_way: bool) -> None:
    """Of few states and of many, also where entries are tiny, against scipy's search of the graph of entries that are not zero."""
    rng = np.random.default_rng(0)
    for size in (1, 2, 3, 17, SMALL, SMALL + 1):
        M = rng.normal(size=(size, size)) * 1e-30 * (rng.uniform(size=(size, size)) < 1.2 / size)
        graph = scipy.sparse.csr_array(M != 0)
        expected = scipy.sparse.csgraph.connected_components(graph, connection="weak" if one_way else "strong")[1]
        found = parts(M, one_way=one_way)
        np.testing.assert_array_equal(found[:, None] == found, expected[:, None] == expected)
