"""A small draw of what `python -m tests.random_draws` does at length, and the judges themselves put to the test."""

from __future__ import annotations

import inspect
from dataclasses import replace

import numpy as np
import pytest

from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.references.profiles import rest_to_rest
from tests.linear.random_plants import assert_same_set, block, plant_with
from tests.random_draws.calls import attempted
from tests.random_draws.command import broken_bounds, table
from tests.random_draws.invariant_zeros import Judgement, judged
from tests.random_draws.least_inputs import HiddenMotions, gain
from tests.random_draws.outcomes import WRONG, Outcome, plant_outcome, switched_outcome, wide_outcome
from tests.random_draws.plants import Matrices, Units, drawn_plant
from tests.random_draws.shooting import Contradiction, contradiction
from tests.random_draws.valid_calls import Call, public_doors, valid_calls
from tests.random_draws.wide_plants import drawn_wide_plant

NONMINIMUM_PHASE = Matrices(*(np.array(M) for M in ([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], [[1.0, -1.0]], [[0.0]])))
"""(1 - s) / (s^2 + 3 s + 2): a zero at 1."""

OF_ANY_NAME = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


def matrices(system: StateSpace) -> Matrices:
    return Matrices(system.A, system.B, system.C, system.D)


@pytest.mark.parametrize("number", range(12))
def test_a_plan_is_right_and_a_refusal_has_its_reason(number: int) -> None:
    outcome = plant_outcome(7, number)
    assert outcome.kind in ("plan right", "refused, no solution", "refused, in the band"), outcome


@pytest.mark.parametrize("number", range(8))
def test_a_plan_of_least_input_is_right_and_a_refusal_has_its_reason(number: int) -> None:
    outcome = wide_outcome(7, number)
    assert outcome.kind in ("plan right", "refused, no solution", "refused, in the band"), outcome


def test_inputs_that_are_not_the_least_are_seen() -> None:
    """A plan that is right for another weight of the inputs."""
    drawn = drawn_wide_plant(7, 1)
    motions = HiddenMotions.of(drawn.unit)
    assert motions is not None
    zeros = motions.judgement(drawn.weight).zeros
    dearer = np.linspace(1.0, 1.1, len(drawn.R))
    plan, other = (invert(drawn.model, drawn.reference, R=R) for R in (drawn.R, drawn.R * np.outer(dearer, dearer)))
    assert gain(plan, drawn.unit, drawn.units, drawn.weight, zeros) < 1e-8
    assert gain(other, drawn.unit, drawn.units, drawn.weight, zeros) > 1e-3


def test_a_plan_that_never_comes_to_rest_is_refused() -> None:
    """Modes 3e-7 of the plant's pace from the axis, in pairs on both sides of it: rounding decides what shows first."""
    outcome = wide_outcome(0, 250)
    assert outcome.kind == "refused, in the band"
    assert "does not come to rest" in outcome.detail or "misses its own equations" in outcome.detail


@pytest.mark.parametrize(("number", "kind"), [(5816, "plan right"), (9456, "plan right"), (5699, "refused, no solution")])
def test_draws_at_the_limits_of_rounding(number: int, kind: str) -> None:
    """Forces that reach the output through two springs hardly damped; inputs that depend on each other, behind 31 states."""
    assert plant_outcome(0, number).kind == kind


def test_a_draw_depends_on_its_number_alone() -> None:
    first, again = drawn_plant(3, 17), drawn_plant(3, 17)
    assert np.array_equal(first.model.A, again.model.A)
    assert np.array_equal(first.reference(1.0), again.reference(1.0))


def test_units_change_no_digit() -> None:
    drawn = drawn_plant(3, 17)
    back = drawn.model.A * drawn.units.x / drawn.units.x[:, None]
    assert np.array_equal(back, drawn.unit.A)


ZEROS = {"distinct": [-1.0, 0.3 + 2j, 5.0], "near": [1e-7 + 1j, -2.0], "repeated": [-1.0, -1.0]}


@pytest.mark.parametrize("zeros", ZEROS.values(), ids=ZEROS)
@pytest.mark.parametrize("degrees", [(1,), (3, 1), (2, 4, 2)])
def test_zeros_known_by_construction_are_found(degrees: tuple[int, ...], zeros: list[complex]) -> None:
    plant = plant_with(np.random.default_rng(1), degrees, block(*zeros))
    mixed = replace(matrices(plant), C=np.triu(np.ones((len(degrees),) * 2)) @ plant.C)  # loses its vector relative degree
    for which in (matrices(plant), mixed):
        judgement = judged(which)
        assert_same_set(judgement.zeros, np.linalg.eigvals(block(*zeros)), 1e-9)
        assert judgement.verdict == "solvable"
        assert judgement.highest == max(degrees)


@pytest.mark.parametrize(
    ("plant", "verdict"),
    [
        (NONMINIMUM_PHASE, "solvable"),
        (replace(NONMINIMUM_PHASE, C=np.array([[1.0, 0.0]])), "solvable"),  # no zero
        (replace(NONMINIMUM_PHASE, C=np.array([[0.0, 1.0]])), "on the axis"),  # a zero at the origin
        (replace(NONMINIMUM_PHASE, C=np.array([[1e-15, 1.0]])), "on the axis"),
        (replace(NONMINIMUM_PHASE, C=np.array([[1e-13, 1.0]])), "band"),
        (replace(NONMINIMUM_PHASE, C=np.array([[1e-10, 1.0]])), "solvable"),
        (replace(NONMINIMUM_PHASE, B=np.zeros((2, 1))), "degenerate"),
        (Matrices(-np.eye(2), np.eye(2), np.ones((2, 2)), np.zeros((2, 2))), "degenerate"),  # both outputs are the same
        (Matrices(-np.eye(2), np.eye(2), np.eye(2), np.ones((2, 2))), "solvable"),  # feedthrough of rank one
    ],
)
def test_verdicts(plant: Matrices, verdict: str) -> None:
    assert judged(plant).verdict == verdict


def one(size: int) -> Units:
    return Units(np.ones(size), np.ones(1), np.ones(1))


def missed(plant: Matrices, planned_for: Matrices, judgement: Judgement) -> Contradiction:
    model = StateSpace(planned_for.A, planned_for.B, planned_for.C, planned_for.D)
    plan = invert(model, rest_to_rest(0.0, 1.0, 2.0, smoothness=3))
    return contradiction(plan, [plant], np.zeros(0), one(len(plant.A)), zeros=judgement.zeros)


def test_a_plan_of_another_plant_is_contradicted() -> None:
    """By as much as the plants differ: 1e-4 in the stiffness, in the input's gain, in the output."""
    judgement = judged(NONMINIMUM_PHASE)
    assert missed(NONMINIMUM_PHASE, NONMINIMUM_PHASE, judgement).worst < 1e-9
    A, B, C = NONMINIMUM_PHASE.A.copy(), NONMINIMUM_PHASE.B * 1.0001, NONMINIMUM_PHASE.C * 1.0001
    A[1, 0] *= 1.0001
    for which in ("A", "B"):
        found = missed(replace(NONMINIMUM_PHASE, **{which: {"A": A, "B": B}[which]}), NONMINIMUM_PHASE, judgement)
        assert WRONG < found.dynamics < 1e-4
        assert found.output < 1e-9
    found = missed(replace(NONMINIMUM_PHASE, C=C), NONMINIMUM_PHASE, judgement)
    assert found.output > WRONG
    assert found.dynamics < 1e-9


@pytest.mark.parametrize("seconds", [1e-3, -1e-3])
def test_a_plan_that_is_late_is_contradicted(seconds: float) -> None:
    plan = invert(StateSpace(*(getattr(NONMINIMUM_PHASE, name) for name in "ABCD")), rest_to_rest(0.0, 1.0, 2.0))
    late = replace(plan, trajectory=replace(plan.trajectory, breakpoints=plan.trajectory.breakpoints + seconds))
    found = contradiction(late, [NONMINIMUM_PHASE], np.zeros(0), one(2), zeros=np.array([1.0 + 0j]))
    assert found.output > WRONG


@pytest.mark.parametrize("number", range(15))
def test_switched_plants(number: int) -> None:
    outcome = switched_outcome(7, number)
    assert outcome.kind in ("plan right", "refused, no solution", "refused, in the band"), outcome


@pytest.mark.parametrize("number", [246, 846, 956])
def test_switched_plants_that_have_no_bounded_inverse(number: int) -> None:
    """An output that changes at rest, before a mode that grows 1e14 times over the next interval, or for ever; a chain of three
    integrators with rounding beside it."""
    outcome = switched_outcome(0, number)
    assert outcome.kind == "refused, no solution", outcome
    assert "; BoundednessError" in outcome.detail, outcome


def test_every_public_door_has_a_call_that_succeeds() -> None:
    calls = valid_calls()
    assert public_doors() <= {name.partition(".")[0] for name in calls}
    for name in ("StateSpace", "rest_to_rest", "simulate", "print_table"):
        calls[name].function(**calls[name].arguments)


@pytest.mark.parametrize("name", list(valid_calls()))
def test_every_argument_is_replaced(name: str) -> None:
    """What a call leaves out keeps its default and would never be drawn."""
    call = valid_calls()[name]
    if " of " in name:  # another way to call what has a call with every argument
        return
    named = [each for each in inspect.signature(call.function).parameters.values() if each.kind not in OF_ANY_NAME]
    assert {each.name for each in named} <= set(call.arguments)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    "value", ["text", "object", "ragged list", "masked array", "NaN matrix", "larger than any float", "generator"]
)
@pytest.mark.parametrize("name", ["StateSpace", "SwitchedSystem", "invert", "lqr", "TrackingController", "simulate", "peak_input"])
def test_a_malformed_call_is_refused(name: str, value: str) -> None:
    call = valid_calls()[name]
    for argument in call.arguments:
        kind, detail = attempted(name, {argument: value})
        assert kind in ("refused", "accepted"), f"{name}({argument} = {value}): {detail}"


def test_what_is_no_refusal_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call that fails with an exception of somebody else's, and one that takes anything, are reported."""
    calls = {
        "strict": Call(lambda x: float(x) + 1.0, {"x": 1.0}),
        "lax": Call(lambda x: None, {"x": 1.0}),
    }
    monkeypatch.setattr("tests.random_draws.calls.valid_calls", lambda: calls)
    assert attempted("strict", {"x": "text"}) == ("foreign exception", "ValueError: could not convert string to float: 'much'")
    assert attempted("lax", {"x": "object"})[0] == "malformed, yet accepted"
    assert attempted("lax", {"x": "half"})[0] == "accepted"


def test_the_bounds() -> None:
    right, refused = Outcome(0, "dense", "plan right"), Outcome(1, "dense", "refused though solvable")
    assert broken_bounds("plants", [right] * 1000 + [refused]) == []
    assert broken_bounds("plants", [right] * 997 + [refused] * 2) != []
    assert broken_bounds("plants", [right, Outcome(2, "dense", "plan wrong")]) != []
    assert "refused though solvable x 1 (as no. 1)" in table("plants", [right, refused])
