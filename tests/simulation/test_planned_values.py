"""A plan's values on the grids of runs, and what is kept of them."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.simulation import planned_values as module
from invtrack.simulation.grid import Grid, make_grid
from invtrack.simulation.planned_values import planned_values


@pytest.fixture(scope="module")
def plan() -> invtrack.Plan:
    """Of a mass on a spring on a mass, whose second half is stiffer."""
    soft, stiff = (
        invtrack.StateSpace(
            [[0, 0, 1, 0], [0, 0, 0, 1], [-k, k, -0.1, 0.1], [k, -k, 0.1, -0.1]], [[0], [0], [1], [0]], [[0, 1, 0, 0]]
        )
        for k in (4.0, 9.0)
    )
    model = invtrack.SwitchedSystem([soft, stiff], switch_times=[1.5])
    return invtrack.quadratic_redesign(model, invtrack.rest_to_rest(0.0, 1.0, duration=3.0), Q_y=1e4, R=1.0)


def grid(plan: invtrack.Plan, late: float = 0.0) -> Grid:
    return make_grid(-2.0, 5.0, [*plan.breakpoints, 0.7 + late], 1e-3)


def test_values_are_those_of_the_plan_on_either_side_of_every_breakpoint(plan: invtrack.Plan) -> None:
    here = grid(plan)
    samples, middle_inputs = planned_values(plan, here)
    expected = plan(here.time, inside=np.append(here.middle, here.middle[-1]))
    for name in ("x", "u", "y", "y_d"):
        np.testing.assert_allclose(getattr(samples, name), getattr(expected, name), rtol=0, atol=1e-12)
    middles = (here.time[:-1] + here.time[1:]) / 2
    np.testing.assert_allclose(middle_inputs, plan.inputs(middles, inside=here.middle), rtol=0, atol=1e-12)


def test_what_runs_before_left_changes_no_bit(plan: invtrack.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    planned_values(plan, grid(plan))
    after, after_inputs = planned_values(plan, grid(plan, 0.01))
    monkeypatch.setattr(module, "_known", {})
    fresh, fresh_inputs = planned_values(plan, grid(plan, 0.01))
    assert all(np.array_equal(getattr(after, name), getattr(fresh, name)) for name in ("x", "u", "y", "y_d"))
    assert np.array_equal(after_inputs, fresh_inputs)


def test_only_new_stretches_are_evaluated_and_only_so_much_is_kept(plan: invtrack.Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    evaluated = []
    work = module._evaluated
    monkeypatch.setattr(module, "_evaluated", lambda plan, grid, steps: evaluated.append(len(steps)) or work(plan, grid, steps))
    monkeypatch.setattr(module, "_known", {})
    planned_values(plan, grid(plan))
    assert sum(evaluated) == 7000
    evaluated.clear()
    planned_values(plan, grid(plan, 0.01))
    assert sum(evaluated) == 1500  # the interval in which the instant lies
    evaluated.clear()
    monkeypatch.setattr(module, "KEPT", 1)
    monkeypatch.setattr(module, "_known", {})
    for _ in range(2):
        planned_values(plan, grid(plan))
    assert sum(evaluated) == 14_000
