"""A plan read back from its samples: a plan like any other, as good as its rate."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.channels import Channels
from invtrack.errors import FileError
from invtrack.linear import OperatingPoint
from invtrack.plans.export import sampled_plan
from invtrack.plans.sampled import write_samples
from tests.cited_plants import cantilever_paper
from tests.equilibria import cantilever

POINT = OperatingPoint(x0=np.zeros(6), u0=np.array([3.0]), y0=np.array([-2.0]))
LIGHT, HEAVY = (
    invtrack.StateSpace(
        *cantilever_paper(mass),
        inputs=Channels(["force"], ["N"]),
        outputs=Channels(["tip"], ["m"]),
        operating_point=POINT,
        parameters={"tip_mass": mass},
    )
    for mass in (0.0, 100.0)
)
REFERENCE = invtrack.rest_to_rest(-2.0, -1.0, duration=3.0, smoothness=3)


@pytest.fixture(scope="module")
def plan() -> invtrack.Plan:
    return invtrack.invert(invtrack.SwitchedSystem([LIGHT, HEAVY], [1.5]), REFERENCE, tolerance=1e-6)


def read_at(plan: invtrack.Plan, folder: Path, rate: float, **options: str) -> invtrack.Plan:
    return invtrack.read_plan(invtrack.export_plan(plan, folder / "plan.csv", rate=rate, **options))  # type: ignore[arg-type]


def test_it_says_what_the_exported_plan_said(plan: invtrack.Plan, tmp_path: Path) -> None:
    found = read_at(plan, tmp_path, 20.0)
    for name in ("method", "manoeuvre", "preactuation", "postactuation", "tolerance", "certificate", "schedule"):
        assert getattr(found, name) == getattr(plan, name)
    for mine, theirs in zip(found.model.systems, plan.model.systems, strict=True):
        assert all(np.array_equal(getattr(mine, matrix), getattr(theirs, matrix)) for matrix in "ABCD")
        assert mine.parameters == theirs.parameters
    assert (found.model.inputs, found.model.outputs) == (plan.model.inputs, plan.model.outputs)
    assert f"read from {len(sampled_plan(plan, rate=20.0).time)} samples" in found.remarks[-1]


def test_it_says_that_it_rings_on(tmp_path: Path) -> None:
    """A lightly damped stable zero pair: (s^2 + 0.1 s + 4)/(s + 1)^4 in controllable form."""
    A = np.vstack([np.eye(4)[1:], [-1.0, -4.0, -6.0, -4.0]])
    plan = invtrack.invert(invtrack.StateSpace(A, np.eye(4)[:, [3]], [[4.0, 0.1, 1.0, 0.0]]), invtrack.rest_to_rest(0.0, 1.0, 1.0))
    assert plan.ringing is not None
    assert read_at(plan, tmp_path, 50.0).ringing == plan.ringing


def test_it_goes_through_its_samples(plan: invtrack.Plan, tmp_path: Path) -> None:
    rate = 20.0
    found, table = read_at(plan, tmp_path, rate), sampled_plan(plan, rate=rate)
    at = found(table.time)
    assert at.x == pytest.approx(table.x_ref, abs=1e-12 * np.abs(table.x_ref).max())
    assert at.u == pytest.approx(table.u_ff, rel=1e-12)
    assert at.y == pytest.approx(table.y, abs=1e-12)
    assert at.y_d == pytest.approx(table.y_d, abs=1e-12)
    middle = table.time + 0.4 / rate
    assert found(middle).u == pytest.approx(table.u_ff, rel=1e-12)  # held


@pytest.mark.parametrize(("inputs", "order"), [("midpoint", 2), ("sample", 1)])
def test_between_samples_it_is_as_good_as_its_rate(plan: invtrack.Plan, tmp_path: Path, inputs: str, order: int) -> None:
    """States: a mean of the input leaves h^2; a line through its samples misses the jump of the input at that of the mass."""
    t = np.linspace(plan.start, 4.0, 5003)
    errors = []
    for rate in (20.0, 40.0):
        found = read_at(plan, tmp_path, rate, inputs=inputs)
        errors.append(np.max(np.abs(found(t).x - plan(t).x)))
    assert errors[0] < 1e-2 * np.max(np.abs(plan(t).x))
    assert np.log2(errors[0] / errors[1]) > order - 0.3


def test_it_is_followed_and_simulated_like_the_plan_it_comes_from(plan: invtrack.Plan, tmp_path: Path) -> None:
    rate = 200.0
    found = read_at(plan, tmp_path, rate)
    gains = invtrack.lqr(plan.model, Q=100.0, R=0.01)
    plant = invtrack.LinearPlant(plan.model)
    runs = [
        invtrack.simulate(plant, invtrack.TrackingController(each, gains, period=1 / rate), timestep=1 / rate, end=6.0)
        for each in (plan, found)
    ]
    errors = [float(np.max(np.abs(run.output.values - plan(run.time).y))) for run in runs]
    assert errors[0] < 1e-4
    assert errors[1] < 3 * errors[0] + 1e-6
    assert runs[1].manoeuvre == runs[0].manoeuvre


def test_one_row_is_a_plan_of_rest(plan: invtrack.Plan, tmp_path: Path) -> None:
    path = invtrack.export_plan(plan, tmp_path / "row.csv", rate=1.0, start=-500.0, end=-500.0)
    found = invtrack.read_plan(path)
    assert found([-501.0, -499.5, 0.0]).y == pytest.approx(np.full((3, 1), -2.0), abs=1e-6)


def test_rows_that_do_not_say_where_they_come_from_are_refused(plan: invtrack.Plan, tmp_path: Path) -> None:
    table = sampled_plan(plan, rate=20.0)
    for origin in ("", "{}", json.dumps({**json.loads(table.origin), "model": 3})):
        with pytest.raises(FileError, match=r"odd\.csv does not say which plan it comes from"):
            invtrack.read_plan(write_samples(replace(table, origin=origin), tmp_path / "odd.csv"))


def test_a_plan_through_jumps_of_the_equilibrium_is_read_back_in_absolute_terms(tmp_path: Path) -> None:
    """Its jumps lie within rows, where velocities' slopes jump, so that the error is of the order of the rows' length there."""
    plan = invtrack.invert(cantilever(), invtrack.raised_cosine(2.0) + 0.5, tolerance=1e-6)
    times, errors = np.linspace(plan.start, plan.end, 5003), []
    for rate in (20.0, 80.0):
        found, table = read_at(plan, tmp_path, rate), sampled_plan(plan, rate=rate)
        assert found(table.time).x == pytest.approx(table.x_ref, abs=1e-12 * np.abs(table.x_ref).max())
        assert found(table.time).u == pytest.approx(table.u_ff, rel=1e-11)
        errors.append(np.max(np.abs(found(times).x - plan(times).x)) / np.max(np.abs(plan(times).x)))
        edges = found.breakpoints[1:-1]
        assert found(edges, inside=edges - 1e-6).x == pytest.approx(found(edges, inside=edges + 1e-6).x, abs=1e-9)
    assert errors[1] < errors[0] / 3 < 2e-3
    assert np.array_equal(found.model.rest_states, plan.model.rest_states)
    assert np.array_equal(found.model.rest_inputs, plan.model.rest_inputs)
    assert np.array_equal(found.model.rest_outputs, plan.model.rest_outputs)
    ends = np.array([plan.start - 5.0, plan.end + 5.0])
    assert found(ends).u == pytest.approx(plan(ends).u, abs=1e-3 * np.ptp(plan(times).u))
