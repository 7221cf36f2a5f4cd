"""One simulation for many assertions, a new one for anything that changes it; parameters that are off by factors."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.errors import InvtrackError, PlantError, SimulationError
from invtrack.testing import RunCache, factor_cases
from tests.testing.arm import REFERENCE, arm, design, written

SETTINGS = {"timestep": 5e-3, "end": 1.0}


def controller(gain: float = 1.0) -> invtrack.TrackingController:
    model = invtrack.linearize(arm())
    return invtrack.TrackingController(
        invtrack.quadratic_redesign(model, REFERENCE, R=1e-3, Q_y=gain), invtrack.lqr(model, Q=1.0, R=1.0)
    )


def test_what_is_equal_in_content_is_simulated_once(tmp_path: Path) -> None:
    runs = RunCache()
    first = runs(arm(written(tmp_path)), controller(), **SETTINGS)
    assert runs(arm(written(tmp_path)), controller(), **SETTINGS) is first
    assert first.name == "arm"


@pytest.mark.parametrize(
    "changed",
    [
        lambda folder: (arm(written(folder, stiffness=41)), controller(), SETTINGS),
        lambda folder: (arm(written(folder)), controller(gain=1.5), SETTINGS),
        lambda folder: (arm(written(folder)), controller(), {**SETTINGS, "timestep": 4e-3}),
        lambda folder: (arm(written(folder)), controller(), {**SETTINGS, "schedule": [invtrack.Change(0.5, load=1.0)]}),
        lambda folder: (arm(written(folder)), controller(), {**SETTINGS, "factors": {"load": 1.1}}),
        lambda folder: (arm(written(folder)), controller(), {**SETTINGS, "initial_state": [0.1, 0.0, 0.0, 0.0]}),
    ],
    ids=["model file", "plan", "timestep", "schedule", "factors", "initial state"],
)
def test_what_changes_the_run_makes_another(changed: object, tmp_path: Path) -> None:
    runs = RunCache()
    first = runs(arm(written(tmp_path)), controller(), **SETTINGS)
    plant, law, options = changed(tmp_path)  # type: ignore[operator]
    other = runs(plant, law, **options)
    assert not other.equals(first)


def test_a_controller_whose_gains_are_changed_makes_another_run() -> None:
    runs, law = RunCache(), controller()
    first = runs(arm(), law, **SETTINGS)
    law._gains = invtrack.GainSchedule([np.zeros((1, 4))])
    assert runs(arm(), law, **SETTINGS) is not first


def test_functions_are_the_same_only_as_the_same_object() -> None:
    runs = RunCache()
    first = runs(arm(), design, reference=REFERENCE, **SETTINGS)
    assert runs(arm(), design, reference=REFERENCE, **SETTINGS) is first
    other = partial(design, effort=2e-3)
    assert runs(arm(), other, reference=REFERENCE, **SETTINGS) is not first
    assert runs(arm(), partial(design, effort=2e-3), reference=REFERENCE, **SETTINGS) is runs(
        arm(), other, reference=REFERENCE, **SETTINGS
    )


def test_a_design_is_given_the_linearized_model_and_the_reference() -> None:
    run = RunCache()(arm(), design, reference=REFERENCE, **SETTINGS)
    assert run.equals(invtrack.simulate(arm(), design(invtrack.linearize(arm()), REFERENCE), name="arm", **SETTINGS))
    model = invtrack.linearize(arm())
    linear = RunCache()(invtrack.LinearPlant(model), design, reference=REFERENCE, **SETTINGS)
    assert linear.model == "linear model"


def test_only_the_last_runs_are_kept() -> None:
    runs = RunCache(kept=2)
    law = controller()
    first, second, third = (runs(arm(), law, name=name, **SETTINGS) for name in ("a", "b", "c"))
    assert runs(arm(), law, name="c", **SETTINGS) is third
    assert runs(arm(), law, name="b", **SETTINGS) is second
    assert runs(arm(), law, name="a", **SETTINGS) is not first
    assert runs.plan_of(second) is law.plan
    assert runs.plan_of(first) is None


def test_factors_multiply_the_values_of_the_file_of_the_plan_and_of_a_schedule() -> None:
    runs, law = RunCache(), controller()
    heavy = runs(arm(), law, factors={"load": 1.2}, **SETTINGS)
    assert heavy.name == "arm, load-x1.2"
    assert set(heavy.parameters["load"]) == {1.2 * 0.5}
    by_hand = invtrack.simulate(arm(mass=1.2 * 0.5), law, name=heavy.name, schedule=(), **SETTINGS)
    np.testing.assert_allclose(heavy.state.values, by_hand.state.values, rtol=1e-9, atol=1e-12)
    scheduled = runs(arm(), law, factors={"load": 2.0}, schedule=[invtrack.Change(0.5, load=0.75)], **SETTINGS)
    assert scheduled.parameters["load"][[0, -1]].tolist() == [1.0, 1.5]
    light, loaded = (invtrack.linearize(arm(), load=mass) for mass in (0.5, 0.75))
    switched = design(invtrack.SwitchedSystem([light, loaded], [0.5]), REFERENCE)
    planned = runs(arm(), switched, factors={"load": 2.0}, **SETTINGS)
    assert planned.parameters["load"][[0, -1]].tolist() == [1.0, 1.5]


def test_a_path_is_a_parameter_of_its_own_or_the_one_that_has_it() -> None:
    runs, law = RunCache(), controller()
    stiff = runs(arm(), law, factors={"joint:flex:stiffness": 1.5}, **SETTINGS)
    assert set(stiff.parameters["joint:flex:stiffness"]) == {60.0}
    assert set(runs(arm(), law, factors={"body:load:mass": 1.2}, **SETTINGS).parameters["load"]) == {0.6}


def test_cases_are_one_at_a_time_or_in_all_combinations() -> None:
    off = {"load": [0.9, 1.1], "joint:flex:stiffness": [1.0, 2.0]}
    assert factor_cases(off) == {
        "nominal": {},
        "load-x0.9": {"load": 0.9},
        "load-x1.1": {"load": 1.1},
        "joint:flex:stiffness-x2.0": {"joint:flex:stiffness": 2.0},
    }
    assert list(factor_cases(off, together=True)) == [
        "nominal", "joint:flex:stiffness-x2.0", "load-x0.9", "load-x0.9+joint:flex:stiffness-x2.0",
        "load-x1.1", "load-x1.1+joint:flex:stiffness-x2.0",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("factors", "says"),
    [
        ({"load": 1.1}, r"factors of 'load' must be a list of factors such as \[0.9, 1.1\], got 1.1"),
        ({"load": [0.0]}, "a factor of 'load' must be positive and finite, got 0.0"),
        ({"load": [1.1, 1.1]}, "must be distinct"),
        (["load"], "lists of factors by names of parameters"),
    ],
)
def test_malformed_factors_are_refused(factors: object, says: str) -> None:
    with pytest.raises(InvtrackError, match=says):
        factor_cases(factors)  # type: ignore[arg-type]


def test_what_makes_no_run_is_refused() -> None:
    runs, law = RunCache(), controller()
    with pytest.raises(SimulationError, match="a controller follows the reference of its own plan"):
        runs(arm(), law, reference=REFERENCE)
    with pytest.raises(SimulationError, match=r"a function controller\(model, reference\).*got function without a reference"):
        runs(arm(), design)
    with pytest.raises(SimulationError, match=r"plant must be an invtrack.Plant, or invtrack.LinearPlant\(model\), got 'arm.xml'"):
        runs("arm.xml", law)  # type: ignore[arg-type]
    with pytest.raises(SimulationError, match="a LinearPlant is off as its model says"):
        runs(invtrack.LinearPlant(law.plan.model), law, factors={"load": 1.1})
    with pytest.raises(PlantError, match="no parameter is called 'lode'"):
        runs(arm(), law, factors={"lode": 1.1})
