"""Designs: the right points with the right probabilities, and seeds that do not depend on how many there are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from invtrack.errors import SweepError
from invtrack.sweeps import Design, grid, latin_hypercube, listed, monte_carlo

PARAMETERS = {"mass": stats.norm(100.0, 2.0), "instant": stats.uniform(-0.02, 0.04), "noise": stats.loguniform(1e-4, 1e-2)}


def test_a_grid_is_every_combination_with_the_last_parameter_fastest() -> None:
    design = grid({"gain": [1, 2], "method": ["exact", "redesign", "modified"]})
    assert [tuple(point.values()) for point in design.points] == [
        (1, "exact"), (1, "redesign"), (1, "modified"), (2, "exact"), (2, "redesign"), (2, "modified")
    ]  # fmt: skip


def test_repeats_of_a_grid_have_the_same_seeds_at_every_point() -> None:
    design = grid({"gain": [1.0, 2.0]}, repeats=3)
    assert design.seeds[:3] == design.seeds[3:]
    assert len(set(design.seeds)) == 3


@pytest.mark.parametrize("make", [monte_carlo, latin_hypercube])
def test_samples_have_the_distributions_asked_for(make: Callable[..., Design]) -> None:
    design = make(PARAMETERS, 2000, seed=4)
    for name, distribution in PARAMETERS.items():
        values = np.array(design.column(name), dtype=float)
        assert stats.kstest(values, distribution.cdf).pvalue > 0.01  # an independent judge of the distribution
    ranks = stats.spearmanr(np.column_stack([design.column(name) for name in PARAMETERS])).statistic
    assert np.max(np.abs(ranks - np.eye(3))) < 4 / np.sqrt(2000)
    assert len(set(design.seeds)) == 2000


def test_a_latin_hypercube_meets_each_interval_of_equal_probability_once() -> None:
    design = latin_hypercube(PARAMETERS, 50)
    for name, distribution in PARAMETERS.items():
        shares = distribution.cdf(np.array(design.column(name), dtype=float))
        assert sorted(np.floor(50 * shares).astype(int).tolist()) == list(range(50))


def test_a_longer_monte_carlo_design_begins_with_the_shorter_one() -> None:
    short, long = (monte_carlo(PARAMETERS, count, seed=7) for count in (10, 200))
    assert long.points[:10] == short.points
    assert long.seeds[:10] == short.seeds
    assert monte_carlo(PARAMETERS, 10, seed=8).points != short.points


def test_choices_are_equally_likely_and_discrete_distributions_give_whole_numbers() -> None:
    design = monte_carlo({"method": ["a", "b", "c"], "count": stats.randint(2, 5), "on": [True, False]}, 3000)
    for name, kind, values in (("method", str, {"a", "b", "c"}), ("count", int, {2, 3, 4}), ("on", bool, {True, False})):
        column = design.column(name)
        assert {type(value) for value in column} == {kind}
        assert set(column) == values
        counts = [column.count(value) for value in values]
        assert stats.chisquare(counts).pvalue > 0.01


def test_many_samples_of_few_choices_differ_in_their_seeds() -> None:
    design = monte_carlo({"method": ["exact", "redesign"]}, 50_000)
    assert len(set(design.seeds)) == 50_000


def test_crossing_compares_on_the_same_samples_and_noise() -> None:
    samples = monte_carlo({"mass": stats.norm(100.0, 2.0)}, 3)
    design = samples.crossed_with({"method": ["exact", "redesign"]})
    assert [point["method"] for point in design.points] == ["exact", "redesign"] * 3
    assert design.column("mass")[::2] == design.column("mass")[1::2] == samples.column("mass")
    assert design.seeds[::2] == design.seeds[1::2] == samples.seeds


def test_whole_numbers_among_numbers_are_numbers() -> None:
    assert listed([{"gain": 1}, {"gain": 0.5}]).column("gain") == (1.0, 0.5)
    assert {type(value) for value in listed([{"gain": np.float64(1)}, {"gain": 2}]).column("gain")} == {float}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: listed([]), "expected at least one point, got none"),
        (lambda: listed([{"a": 1}, {"b": 1}]), "point 1 has the parameters b, expected those of point 0, a"),
        (lambda: Design([{"a": 1}, {"a": 1}], [5, 5]), "points 0 and 1 are the same, {'a': 1}, with the same seed 5"),
        (lambda: Design([{"a": 1}], [1, 2]), "expected a seed for each of 1 points, got 2 seeds"),
        (lambda: listed([{"seed": 1}]), "a parameter cannot be called 'seed'"),
        (lambda: listed([{"a": 1}, {"a": "b"}]), "parameter 'a': expected numbers, texts, or True and False, .* got int and str"),
        (lambda: listed([{"a": np.nan}]), "parameter 'a': expected .* got nan"),
        (lambda: listed([{"a": np.eye(2)}]), r"got an array of shape \(2, 2\); name what is none of these"),
        (lambda: listed([{"a": 2**70}]), "whole numbers of at most 64 bits"),
        (lambda: grid({"a": []}), "parameter 'a' has no values"),
        (lambda: grid({"a": 3}), "parameter 'a' must be a list of values, got 3"),
        (lambda: monte_carlo({}, 3), "expected at least one parameter to sample"),
        (lambda: monte_carlo({"a": stats.norm}, 0), "samples must be a whole number from 1 on, got 0"),
        (lambda: monte_carlo({"a": stats.gamma}, 3), "parameter 'a' must be a frozen distribution"),
        (lambda: monte_carlo({"a": stats.norm(0.0, -1.0)}, 3), "parameter 'a' must be a distribution of one finite number"),
        (
            lambda: monte_carlo({"a": 3.0}, 3),
            "parameter 'a' must be a frozen distribution of scipy.stats or a list of values, got 3.0",
        ),
        (lambda: grid({"a": [1]}).crossed_with({"a": [2]}), "the points already have a"),
        (lambda: grid({"a": [1]}).column("b"), "no parameter named 'b'; there are: a"),
    ],
)
def test_what_is_no_design_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(SweepError, match=message):
        make()
