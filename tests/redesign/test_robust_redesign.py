"""One input for several models: the least mean cost over what the plant may turn out to be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg

from invtrack.errors import RedesignError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.redesign.cost import cost
from invtrack.redesign.quadratic import quadratic_redesign
from tests.redesign.plants import HEAVIER, MINIMUM, NONMINIMUM, UNSTABLE, WEIGHTS, simulated, there_and_back

TIMES = np.linspace(-20.0, 26.0, 4601)
Q_X, Q_Y, R = WEIGHTS["Q_x"], WEIGHTS["Q_y"], WEIGHTS["R"]


def cost_of_input(model: StateSpace | SwitchedSystem, u: Any) -> float:
    """Simulated, Simpson's rule on every other time."""
    x = simulated(model, u, TIMES)
    C = SwitchedSystem([model]).systems[0].C if isinstance(model, StateSpace) else model.systems[0].C
    miss = x @ C[0] - there_and_back()(TIMES)[:, 0]
    rate = R * u(TIMES)[:, 0] ** 2 + np.einsum("mi,ij,mj->m", x, Q_X, x) + Q_Y * miss**2
    h = TIMES[1] - TIMES[0]
    return float(h / 3 * (rate[0] + rate[-1] + 4 * np.sum(rate[1:-1:2]) + 2 * np.sum(rate[2:-1:2])))


def test_one_model_in_a_list_is_that_model() -> None:
    plain, listed = (quadratic_redesign(model, there_and_back(), **WEIGHTS) for model in (NONMINIMUM, [NONMINIMUM]))
    assert np.array_equal(plain(TIMES).u, listed(TIMES).u)
    assert listed.variants == ()


def test_the_same_model_twice_is_that_model() -> None:
    plain, twice = (quadratic_redesign(model, there_and_back(), **WEIGHTS) for model in (NONMINIMUM, [NONMINIMUM] * 2))
    assert np.max(np.abs(plain(TIMES).u - twice(TIMES).u)) < 1e-12


@pytest.mark.parametrize("probabilities", [None, (3.0, 1.0)])
def test_cheaper_on_the_mean_than_either_optimum(probabilities: Any) -> None:
    models = [NONMINIMUM, HEAVIER]
    share = np.array([0.5, 0.5] if probabilities is None else [0.75, 0.25])
    robust = quadratic_redesign(models, there_and_back(), **WEIGHTS, probabilities=probabilities)
    assert robust.probabilities == pytest.approx(share)
    assert robust.optimality_gap < 1e-12

    def mean_cost(u: Any) -> float:
        return float(share @ [cost_of_input(model, u) for model in models])

    least = mean_cost(robust.inputs)
    assert share @ [cost(variant, **WEIGHTS) for variant in robust.variants] == pytest.approx(least, rel=1e-6)
    for model in models:
        assert mean_cost(quadratic_redesign(model, there_and_back(), **WEIGHTS).inputs) > 1.001 * least


def test_each_variant_is_what_the_input_makes_of_its_model() -> None:
    jumping = [SwitchedSystem([NONMINIMUM, HEAVIER], [0.5]), SwitchedSystem([HEAVIER, NONMINIMUM], [1.25]), MINIMUM]
    robust = quadratic_redesign(jumping, there_and_back(), **WEIGHTS)
    times = np.linspace(-50.0, 12.0, 6201)
    for model, variant in zip(jumping, robust.variants, strict=True):
        assert np.array_equal(variant(times).u, robust(times).u)
        x = simulated(model, robust.inputs, times)
        assert np.max(np.abs(variant(times).x - x)) < 1e-6 * np.max(np.abs(x))
        assert variant.certificate.dynamics_residual < 1e-12


def test_against_a_discretized_least_squares_problem() -> None:
    """Inputs constant over steps of h, states from rest at -8 s to 14 s: the minimum tends to the optimum's with h^2."""
    models, share = [NONMINIMUM, HEAVIER], np.array([0.25, 0.75])
    robust = quadratic_redesign(models, there_and_back(), **WEIGHTS, probabilities=share)
    least = float(share @ [cost(variant, **WEIGHTS) for variant in robust.variants])
    above = []
    for h in (0.1, 0.05):
        count = round(22.0 / h)
        times = -8.0 + h * np.arange(count + 1)
        rows, wanted = [np.sqrt(R * h) * np.eye(count)], [np.zeros(count)]
        fine = 4  # states are weighed four times a step, by the trapezoidal rule
        for model, weight in zip(models, share, strict=True):
            step = scipy.linalg.expm(np.block([[model.A, model.B], [np.zeros((1, 4))]]) * h / fine)
            A_d, B_d = step[:3, :3], step[:3, 3]
            x, response = np.zeros((3, count)), []
            for k in range(count * fine):
                x = A_d @ x
                x[:, k // fine] += B_d
                response.append(x)
            X = np.array(response)
            at = times[0] + h / fine * (1 + np.arange(count * fine))
            scale = np.sqrt(weight * h / fine)
            rows += [scale * np.sqrt(Q_Y) * (model.C @ X)[:, 0], scale * np.sqrt(0.3) * X[:, 0], scale * np.sqrt(0.1) * X[:, 2]]
            wanted += [scale * np.sqrt(Q_Y) * there_and_back()(at)[:, 0], np.zeros(len(at)), np.zeros(len(at))]
        M, b = np.vstack(rows), np.concatenate(wanted)
        u = np.linalg.lstsq(M, b, rcond=None)[0]
        above.append(float(np.sum((M @ u - b) ** 2)) / least - 1)
    assert 0 < above[1] < 0.3 * above[0] < 0.003


@pytest.mark.parametrize(
    ("models", "options", "message"),
    [
        ([], {}, "a list of at least one"),
        ([NONMINIMUM, HEAVIER], {"probabilities": [1.0]}, r"positive, one for each of 2 model\(s\)"),
        ([NONMINIMUM, HEAVIER], {"probabilities": [1.0, 0.0]}, "positive"),
        ([NONMINIMUM, StateSpace([[-1.0]], [[1.0]], [[1.0]])], {"Q_x": 0.0}, "model 1 of 2 differs from the first in its states"),
        ([UNSTABLE, UNSTABLE], {}, "one input cannot bring to rest a mode that is the same"),
    ],
)
def test_refusals(models: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(RedesignError, match=message):
        quadratic_redesign(models, there_and_back(), **{**WEIGHTS, **options})
