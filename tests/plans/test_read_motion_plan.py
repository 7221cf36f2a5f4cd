"""A plan on the motion of a mechanism read back from its samples: with the mechanism, it behaves as the plan that was exported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.control import amplification
from invtrack.errors import FileError
from tests.inversion.nonlinear.mechanisms import CART_POLE, cart_pole, link, satellite

RATE = 1000.0
PAYLOADS = [invtrack.Change(0.3, payload=0.5), invtrack.Change(0.7, payload=0.1)]


@pytest.fixture(scope="module")
def turned() -> tuple[invtrack.Plant, invtrack.Plan]:
    """A free body that turns by two radians about a skew axis."""
    plant = satellite()
    ways = (0.5, -1.0, 0.3, 1.5, -1.0, 0.8)
    reference = invtrack.references.stack([invtrack.rest_to_rest(0.0, way, duration=2.0) for way in ways])
    return plant, invtrack.invert(plant, reference)


def read_back(plan: invtrack.Plan, plant: invtrack.Plant, folder: Path, rate: float = RATE) -> invtrack.Plan:
    return invtrack.read_plan(invtrack.export_plan(plan, folder / "plan.csv", rate=rate), plant=plant)


def test_states_differ_as_rotations_do(turned: tuple[invtrack.Plant, invtrack.Plan], tmp_path: Path) -> None:
    plant, plan = turned
    found = read_back(plan, plant, tmp_path)
    assert found.difference is not None
    (x_ref,) = plan.states([1.0])
    x = x_ref + 0.3 * np.eye(12)[3]  # rx
    assert np.max(np.abs(found.difference(x, x_ref) - (x - x_ref))) > 1e-2  # rotation vectors do not subtract
    assert found.difference(x, x_ref) == pytest.approx(plan.difference(x, x_ref), rel=1e-12)  # type: ignore[misc]


def test_it_drives_a_body_that_turns_as_well_as_its_rate_allows(
    turned: tuple[invtrack.Plant, invtrack.Plan], tmp_path: Path
) -> None:
    plant, plan = turned
    found = read_back(plan, plant, tmp_path)
    errors = []
    for each in (plan, found):
        controller = invtrack.TrackingController(each, invtrack.lqr(each, Q=1.0, R=1.0))
        run = invtrack.simulate(plant, controller, timestep=1 / RATE, end=3.0, vibration_period=1.0)
        errors.append(invtrack.max_error(run))
    assert errors[1] < 2 * errors[0] + 1e-9


def test_between_its_samples_it_goes_on_as_the_mechanism_does(tmp_path: Path) -> None:
    """With inputs that are held: off by the square of their period, in states as in outputs."""
    plant = cart_pole()
    plan = invtrack.invert(plant, invtrack.rest_to_rest(0.0, 10.0, duration=2.0))
    t, errors = np.linspace(plan.start, plan.end, 4001), []
    for rate in (100.0, 200.0):
        found = read_back(plan, plant, tmp_path, rate)
        size = np.max(np.abs(plan(t).x), axis=0)
        errors.append(np.max(np.abs(found(t).x - plan(t).x) / size))
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) > 1.7


def test_feedback_along_it_is_that_along_the_plan(tmp_path: Path) -> None:
    """Gains, and by how much they let departures grow, with the pole leaning by half a right angle on the way."""
    plant = cart_pole()
    plan = invtrack.invert(plant, invtrack.rest_to_rest(0.0, 10.0, duration=2.0))
    found = read_back(plan, plant, tmp_path)
    gains, again = (invtrack.lqr(each, Q=1.0, R=1.0) for each in (plan, found))
    times = np.linspace(0.0, 2.0, 41) + 1e-5
    K, K_again = (np.stack(each.gains)[each.interval(times)] for each in (gains, again))
    assert K_again == pytest.approx(K, abs=0.02 * np.max(np.abs(K)))
    assert amplification(found, again) == pytest.approx(amplification(plan, gains), rel=0.05)


def test_parameters_change_in_it_as_in_the_plan(tmp_path: Path) -> None:
    plant = link(hanging=True)
    plan = invtrack.invert(plant, invtrack.rest_to_rest(-np.pi / 3, np.pi / 6, duration=1.0), schedule=PAYLOADS)
    found = read_back(plan, plant, tmp_path)
    assert found.schedule == plan.schedule
    t = np.linspace(plan.start, plan.end, 3001)
    jumps = np.array([change.time for change in PAYLOADS])
    t = t[np.min(np.abs(t[:, None] - jumps), axis=1) > 0.02]  # but for the rows around them, over which the input is averaged
    assert found(t).x == pytest.approx(plan(t).x, abs=1e-3 * np.max(np.abs(plan(t).x)))
    assert found.rest_inputs == pytest.approx(plan.rest_inputs, rel=1e-3)


def test_without_its_mechanism_or_with_another_it_is_refused(tmp_path: Path) -> None:
    plant = cart_pole()
    path = invtrack.export_plan(
        invtrack.invert(plant, invtrack.rest_to_rest(0.0, 1.0, duration=2.0)), tmp_path / "plan.csv", rate=50.0
    )
    with pytest.raises(FileError, match=r"plan\.csv: .* read it with the plant that it was made for, .*plant=plant"):
        invtrack.read_plan(path)
    with pytest.raises(FileError, match=r"plan\.csv: plant 'satellite' has the states .*, the plan is for"):
        invtrack.read_plan(path, plant=satellite())
    with pytest.raises(FileError, match=r"count from the operating point \[0\.0, 0\.0, 0\.0, 0\.0\], plant 'cart_pole' stands at"):
        invtrack.read_plan(path, plant=plant.at(qpos={"cart": 0.5}))
    with pytest.raises(FileError, match=r"plant must be the invtrack\.Plant that the plan was made for, got 'cart_pole'"):
        invtrack.read_plan(path, plant="cart_pole")
    other = invtrack.Plant.from_xml(CART_POLE, inputs=["force"], outputs=["joint:pole"])
    with pytest.raises(FileError, match=r"has the outputs \['joint:pole'\], the plan is for \['joint:cart'\]"):
        invtrack.read_plan(path, plant=other)
