"""A slow error beside fast dynamics, between many short pieces, or at rest must show in the certificate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from invtrack.arrays import Array
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.certificate import ACCURACY, Certificate, certify
from invtrack.plans.plan import Plan
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.windows import windows
from invtrack.references.profiles import rest_to_rest
from invtrack.references.samples import sampled_reference
from invtrack.references.signal import PiecewiseSignal

SLEW = rest_to_rest(0.0, 1.0, 3.0, smoothness=3)
SAMPLES = sampled_reference(np.linspace(0.0, 3.0, 61), SLEW(np.linspace(0.0, 3.0, 61)))


def plant(fast: float, slow: float) -> StateSpace:
    """An oscillator with the zeros `fast` and -`slow`: y = q - q' / fast, q'' = u - q - q' + eta, eta' = q - slow eta."""
    A = np.array([[0.0, 1.0, 0.0], [-1.0, -1.0, 1.0], [1.0, 0.0, -slow]])
    return StateSpace(A, [[0.0], [1.0], [0.0]], [[1.0, -1.0 / fast, 0.0]])


def stiff_plant(fast: float, slow: float) -> StateSpace:
    """The same zeros, the fast one that of a mode of the plant: y' = u - y + f + eta, f' = fast (f - y), eta' = y - slow eta."""
    A = np.array([[-1.0, 1.0, 1.0], [-fast, fast, 0.0], [1.0, 0.0, -slow]])
    return StateSpace(A, [[1.0], [0.0], [0.0]], [[1.0, 0.0, 0.0]])


def certified(model: StateSpace, plan: Plan, reference: PiecewiseSignal) -> Certificate:
    return certify(as_switched(model), plan.trajectory, reference, (plan.start, plan.end))


@pytest.mark.parametrize("reference", [SLEW, SAMPLES], ids=["one piece", "60 pieces"])
@pytest.mark.parametrize("fast", [1e6, -1e6, 1e2])
@pytest.mark.parametrize("make", [plant, stiff_plant])
def test_a_slow_drift_beside_a_fast_zero_is_caught(make: object, fast: float, reference: PiecewiseSignal) -> None:
    """The plan of a plant whose slow zero is off by 1e-6 of itself: each state drifts from the true one by about as much."""
    assert callable(make)
    model = make(fast, 0.5)
    right, drifting = invert(model, reference), invert(make(fast, 0.5 * (1 + 1e-6)), reference)
    assert certified(model, right, reference).dynamics_residual < 1e-10
    assert certified(model, drifting, reference).dynamics_residual > 2 * ACCURACY


def test_a_rest_that_is_none_is_caught() -> None:
    """Held by an input that is off by 1e-6 after the manoeuvre."""
    model = plant(1e6, 0.5)
    plan = invert(model, SLEW)
    after, scale = plan.trajectory.after, np.diag([1.0, 1.0, 1.0, 1 + 1e-6, 1.0])
    held = replace(plan.trajectory, after=replace(after, X_w=scale @ after.X_w, v=np.zeros_like(after.v)))
    found = certify(as_switched(model), held, SLEW, (plan.start, plan.end))
    assert found.dynamics_residual > 0.1 * 1e-6


def spans(trajectory: Trajectory, switch_times: Array, pace: float) -> list[tuple[float, float]]:
    """Windows, from where to where, once it is clear that their panels leave no gap and cross nothing."""
    found = windows(trajectory, switch_times, np.full(len(switch_times) + 1, pace), (-5.0, 8.0), 200)
    stops = np.union1d(trajectory.breakpoints, switch_times)
    assert np.all(found.ends > found.starts)
    assert np.array_equal(np.searchsorted(stops, found.starts, side="right"), np.searchsorted(stops, found.ends, side="left"))
    assert np.array_equal(trajectory.locate((found.starts + found.ends) / 2), found.piece)
    joined = found.owner[1:] == found.owner[:-1]
    assert found.starts[1:][joined] == pytest.approx(found.ends[:-1][joined], abs=1e-14)
    return list(zip(found.starts[found.first].tolist(), found.ends[found.last].tolist(), strict=True))


def test_windows_are_as_long_as_the_motion_is_slow_whatever_is_fast() -> None:
    for fast in (10.0, 1e3, 1e9):
        plan = invert(plant(fast, 0.5), SLEW)
        lengths = [b - a for a, b in spans(plan.trajectory, np.zeros(0), 1.0)]
        assert np.median(lengths) > 0.2


def test_short_pieces_make_up_a_window_together() -> None:
    plan = invert(plant(10.0, 0.5), SAMPLES)
    found = spans(plan.trajectory, np.array([1.003]), 1.0)
    inside = [(a, b) for a, b in found if a >= 0 and b <= 3]
    assert np.ravel(inside)[1:-1:2] == pytest.approx(np.ravel(inside)[2::2])  # without a gap
    assert np.median(np.diff(inside)) > 0.15
    assert not any(a < 1.003 < b for a, b in found)


def test_right_plans_through_jumps_keep_their_certificates() -> None:
    models = [plant(fast, 0.5) for fast in (1e4, 3e4, 1e4)]
    plan = invert(SwitchedSystem([replace_output(model, models[0]) for model in models], [1.0, 2.0]), SLEW)
    assert plan.certificate.worst(exact=True) < 1e-10


@pytest.mark.parametrize("duration", [1e-3, 1e300])
def test_a_plant_without_dynamics_of_its_own(duration: float) -> None:
    """An integrator has no pace, and nothing overflows for it."""
    plan = invert(StateSpace([[0.0]], [[1.0]], [[1.0]]), rest_to_rest(0.0, 1e4, duration))
    assert plan.certificate.worst(exact=True) < 1e-12


def replace_output(model: StateSpace, first: StateSpace) -> StateSpace:
    return StateSpace(model.A, model.B, first.C)
