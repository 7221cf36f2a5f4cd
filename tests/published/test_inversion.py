"""Exact inversion of published plants: plans that an independent integration confirms, refusals that exact arithmetic confirms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from invtrack.errors import NonHyperbolicError
from invtrack.inversion import invert
from invtrack.linear import StateSpace, SwitchedSystem, normal_form
from invtrack.plans import Plan, preactuation_bound
from invtrack.references import rest_to_rest
from tests.published.library import (
    NO_VECTOR_RELATIVE_DEGREE_IN_A_CHOICE,
    PLANTS,
    SINGULAR,
    ZEROS_ON_THE_AXIS,
    cases,
)
from tests.published.mechanisms import CANTILEVER, CART_PENDULUM
from tests.published.plant import Choice, PublishedPlant
from tests.published.replay import replay

Complex = NDArray[np.complex128]

TARGETS = np.array([1.0, -0.5, 0.7, 0.3])
SAMPLED = 5
"""Of the choices of outputs without a relative degree, at most about as many are planned with and integrated."""

ON_AXIS = 1e-12
"""Exact zeros nearer to the imaginary axis than this share of their size lie on it: the nearest other one here is at 7e-3."""


def right_zeros(plant: PublishedPlant, choice: Choice) -> Complex:
    zeros = plant.exact.zeros(*choice)
    assert zeros is not None
    return zeros


def slew(plant: PublishedPlant, choice: Choice, *, tolerance: float = 1e-10) -> Plan:
    """All outputs of the choice move at once, as smoothly as the inverse takes."""
    degrees = plant.exact.relative_degree(*choice) or normal_form(plant.square(choice)).derivatives
    smoothness = max(degrees)
    targets = TARGETS[: len(choice[0])]
    reference = rest_to_rest(0 * targets, targets, plant.duration, smoothness=smoothness)
    return invert(plant.square(choice), reference, tolerance=tolerance)


def assert_followed(plant: PublishedPlant, choice: Choice, *, states: float = 1e-8) -> None:
    plan = slew(plant, choice, tolerance=1e-13)
    assert plan.certificate.worst(exact=True) < 1e-9
    assert plan.certificate.rest_residual < 1e-12
    found = replay(plan, right_zeros(plant, choice))
    assert found.output_error < 1e-9
    assert found.state_error < states


HYPERBOLIC = cases(plant for plant in PLANTS if plant not in (*SINGULAR, *ZEROS_ON_THE_AXIS))


@pytest.mark.parametrize("plant", HYPERBOLIC)
def test_the_plant_follows_under_the_planned_input(plant: PublishedPlant) -> None:
    assert_followed(plant, plant.chosen)


@pytest.mark.parametrize("plant", HYPERBOLIC)
def test_the_input_grows_towards_the_manoeuvre_as_the_slowest_zero_on_the_right_does(plant: PublishedPlant) -> None:
    zeros, plan = right_zeros(plant, plant.chosen), slew(plant, plant.chosen)
    slowest = np.min(zeros.real, initial=np.inf, where=zeros.real > 0)
    bound = preactuation_bound(plan)
    assert bound.alpha == pytest.approx(slowest, rel=1e-9)
    if np.isinf(slowest):
        assert plan.preactuation == 0.0
        return
    # The tail is of the bound's size within each period of the slowest pair, and nowhere above it.
    zero = zeros[np.argmin(np.where(zeros.real > 0, zeros.real, np.inf))]
    period = 2 * np.pi / abs(zero.imag) if zero.imag else 1 / zero.real
    deep = plan.manoeuvre[0] - 15.0 / slowest - np.linspace(0.0, period, 200)
    share = np.linalg.norm(plan.inputs(deep), axis=1) / bound(deep)
    assert np.all(share <= 1 + 1e-6)
    assert np.max(share) > 0.02


@pytest.mark.parametrize("plant", cases(PLANTS))
def test_every_choice_is_served_or_has_zeros_on_the_axis(plant: PublishedPlant) -> None:
    """By exact arithmetic the choices that are refused, and no others, have zeros on the axis. Of many choices, some."""
    for choice in plant.choices[:: 1 + len(plant.choices) // 40]:
        degrees = plant.exact.relative_degree(*choice)
        if degrees is None:
            continue
        zeros = right_zeros(plant, choice)
        if np.any(np.abs(zeros.real) <= ON_AXIS * np.abs(zeros)):
            with pytest.raises(NonHyperbolicError, match="lie on the imaginary axis"):
                slew(plant, choice)
        else:
            assert slew(plant, choice).certificate.worst(exact=True) < 1e-9


@pytest.mark.parametrize("plant", cases(NO_VECTOR_RELATIVE_DEGREE_IN_A_CHOICE))
def test_every_choice_without_a_vector_relative_degree_is_served(plant: PublishedPlant) -> None:
    without = [choice for choice in plant.choices if plant.exact.relative_degree(*choice) is None]
    for choice in without[:: 1 + len(without) // SAMPLED]:
        if plant.exact.zeros(*choice) is not None:
            assert_followed(plant, choice, states=1e-7)  # some choices move the J-100 three thousand times as much as others


def test_the_replay_sees_an_error_of_a_millionth_in_the_plant() -> None:
    system, zeros = CANTILEVER.square(), right_zeros(CANTILEVER, CANTILEVER.chosen)
    plan = slew(CANTILEVER, CANTILEVER.chosen, tolerance=1e-13)
    wrong = replace(plan, model=SwitchedSystem([StateSpace(system.A, system.B * (1 + 1e-6), system.C)]))
    assert 1e-7 < replay(wrong, zeros).output_error < 1e-5


def test_the_replay_sees_states_that_do_not_belong_to_the_input() -> None:
    """An unstable plant is started anew from the planned states, which must lead to one another."""
    system, zeros = CART_PENDULUM.square(), right_zeros(CART_PENDULUM, CART_PENDULUM.chosen)
    plan = slew(CART_PENDULUM, CART_PENDULUM.chosen, tolerance=1e-13)
    wrong = replace(plan, model=SwitchedSystem([StateSpace(system.A + 1e-6 * np.eye(4), system.B, system.C)]))
    assert replay(wrong, zeros).stretches > 10
    assert 1e-7 < replay(wrong, zeros).state_error < 1e-5
