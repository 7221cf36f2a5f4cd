"""S-curves against closed forms, an independent optimiser, and their limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from invtrack.errors import TrajectoryError
from invtrack.references.s_curve import s_curve
from invtrack.references.signal import PiecewiseSignal

LIMITS = [  # each phase there or not
    {"max_jerk": 50.0},
    {"max_jerk": 50.0, "max_acceleration": 4.0},
    {"max_jerk": 50.0, "max_velocity": 1.0},
    {"max_jerk": 50.0, "max_velocity": 1.2, "max_acceleration": 4.0},
    {"max_jerk": 2.0, "max_velocity": 0.3, "max_acceleration": 100.0},
]


def duration(signal: PiecewiseSignal) -> float:
    return signal.manoeuvre[1] - signal.manoeuvre[0]


def peaks(signal: PiecewiseSignal) -> list[float]:
    """Largest size of the first three derivatives, on a grid and on both sides of each breakpoint."""
    t = np.linspace(*signal.manoeuvre, 2001)[1:-1]
    return [
        max(float(np.max(np.abs(signal(t, derivative=k)))), *(float(np.max(np.abs(side))) for side in signal.sides(k)))
        for k in (1, 2, 3)
    ]


def test_the_jerk_alone_limits_a_short_motion() -> None:
    """T = (32 d / j)^(1/3), with the peak velocity 2 d / T and acceleration 8 d / T^2."""
    motion = s_curve(1.0, 3.0, max_jerk=8.0, start_time=0.5)
    assert motion.manoeuvre == pytest.approx((0.5, 2.5))
    assert peaks(motion) == pytest.approx([2.0, 4.0, 8.0], rel=1e-5)
    assert motion([0.0, 1.5, 9.0])[:, 0] == pytest.approx([1.0, 2.0, 3.0], abs=1e-15)


def test_all_limits_reached() -> None:
    """T = d / v + v / a + a / j where the motion is long enough to reach all three."""
    motion = s_curve(0.0, 10.0, max_velocity=2.0, max_acceleration=4.0, max_jerk=16.0)
    assert duration(motion) == pytest.approx(5.0 + 0.5 + 0.25)
    assert peaks(motion) == pytest.approx([2.0, 4.0, 16.0], rel=1e-12)
    assert len(motion.breakpoints) == 8


@pytest.mark.parametrize("limits", LIMITS)
def test_it_keeps_the_limits_and_is_symmetric_and_smooth(limits: dict[str, float]) -> None:
    motion = s_curve(0.0, 1.0, **limits)
    allowed = [limits.get(name, np.inf) for name in ("max_velocity", "max_acceleration", "max_jerk")]
    assert np.all(np.array(peaks(motion)) <= np.array(allowed) * (1 + 1e-12))
    assert motion.smoothness(0, 5) == 3
    t = np.linspace(0.0, duration(motion), 101)
    assert motion(t) + motion(duration(motion) - t) == pytest.approx(np.ones((101, 1)), abs=1e-13)


@pytest.mark.parametrize("limits", LIMITS)
def test_no_sampled_motion_within_the_limits_is_faster(limits: dict[str, float]) -> None:
    """The furthest that jerks constant over 120 steps each take a motion from rest to rest in the same time: a linear programme."""
    T, steps = duration(s_curve(0.0, 1.0, **limits)), 120
    h = T / steps
    A_d, B_d = np.array([[1, h, h * h / 2], [0, 1, h], [0, 0, 1]]), np.array([h**3 / 6, h * h / 2, h])
    columns = [B_d]
    for _ in range(steps - 1):
        columns.append(A_d @ columns[-1])
    states = np.zeros((steps, 3, steps))  # of each step's end, for unit jerks
    for k in range(steps):
        states[k][:, : k + 1] = np.array(columns[k::-1]).T
    bounded, bound = [], []
    for row, limit in ((1, limits.get("max_velocity")), (2, limits.get("max_acceleration"))):
        if limit is not None:
            bounded += [states[:, row], -states[:, row]]
            bound += [np.full(2 * steps, limit)]
    found = linprog(
        -states[-1, 0],
        A_ub=np.vstack(bounded) if bounded else None,
        b_ub=np.concatenate(bound) if bound else None,
        A_eq=states[-1, 1:],
        b_eq=np.zeros(2),
        bounds=(-limits["max_jerk"], limits["max_jerk"]),
    )
    assert 0.99 < -found.fun < 1 + 1e-3  # steps end elsewhere than phases, and velocity is limited at their ends alone


@pytest.mark.parametrize("limits", LIMITS)
def test_least_jerk_for_a_duration_is_the_inverse_of_least_duration_for_a_jerk(limits: dict[str, float]) -> None:
    fastest = s_curve([0.0, 2.0], [1.0, 2.0], **limits)
    others = {name: value for name, value in limits.items() if name != "max_jerk"}
    smoothest = s_curve([0.0, 2.0], [1.0, 2.0], duration=duration(fastest), **others)
    t = np.linspace(-0.1, duration(fastest) + 0.1, 200)
    for order in range(3):
        assert smoothest(t, derivative=order) == pytest.approx(fastest(t, derivative=order), abs=1e-9)


def test_channels_keep_their_own_limits_and_move_together() -> None:
    motion = s_curve([0.0, 1.0, 5.0], [2.0, -2.0, 5.0], max_velocity=[1.0, 1.0, 1e-3], max_jerk=40.0)
    t = np.linspace(*motion.manoeuvre, 500)
    velocity = motion(t, derivative=1)
    assert np.max(np.abs(velocity), axis=0) == pytest.approx([2 / 3, 1.0, 0.0])
    assert velocity[:, 1] == pytest.approx(-1.5 * velocity[:, 0], abs=1e-12)


@pytest.mark.parametrize("unit", [1e-9, 1e9])
@pytest.mark.parametrize("second", [1e-6, 1e6])
def test_units_do_not_matter(unit: float, second: float) -> None:
    plain = s_curve(0.0, 1.0, max_velocity=1.2, max_acceleration=4.0, max_jerk=50.0)
    scaled = s_curve(
        0.0,
        unit,
        max_velocity=1.2 * unit / second,
        max_acceleration=4.0 * unit / second**2,
        max_jerk=50.0 * unit / second**3,
    )
    t = np.linspace(0.0, duration(plain), 50)
    assert scaled(second * t) == pytest.approx(unit * plain(t), rel=1e-9, abs=1e-13 * unit)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "either max_jerk, .* or duration, .* got neither"),
        ({"max_jerk": 1.0, "duration": 1.0}, "got both"),
        ({"max_jerk": np.inf}, "max_jerk must be positive and finite"),
        ({"max_jerk": 1.0, "max_velocity": 0.0}, "max_velocity must be positive"),
        ({"max_jerk": 1.0, "max_acceleration": [1.0, 2.0]}, "one for each of 1 channels"),
        ({"duration": 1.0, "max_velocity": 1.0}, "duration must be more than the 1 s that the limits"),
        ({"duration": 1.5, "max_velocity": 1.0, "max_acceleration": 2.0}, "more than the 1.5 s"),
        ({"duration": 0.9, "max_acceleration": 4.0}, "more than the 1 s"),
        ({"duration": 1 + 1e-12, "max_velocity": 1.0}, "beyond what floating-point numbers resolve"),
        ({"duration": -1.0}, "duration must be a positive number of seconds"),
    ],
)
def test_refusals(options: dict[str, Any], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        s_curve(0.0, 1.0, **options)


def test_no_motion_is_refused() -> None:
    with pytest.raises(TrajectoryError, match="start and end are the same"):
        s_curve(1.0, 1.0, duration=2.0)
    with pytest.raises(TrajectoryError, match="must have the same channels"):
        s_curve([1.0, 2.0], 1.0, duration=2.0)
