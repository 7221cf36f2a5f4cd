"""The cost of runs whose integrals are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.results import run_cost
from invtrack.results.result import RunResult, Signal
from tests.synthetic_runs import diverged, two_mode_run


def slow_run(steps: int) -> RunResult:
    """From 0 to 2 s: x = (t, 1), y - y_d = t^2, u = 3 and then 5."""
    time = np.linspace(0.0, 2.0, steps + 1)
    run = two_mode_run()
    return replace(
        run,
        time=time,
        state=Signal(np.column_stack([time, np.ones_like(time)]), Channels(("a", "b"), ("m", "m"))),
        output=Signal((time**2 + 7.0)[:, None], Channels(("y",), ("m",))),
        reference=Signal(np.full((steps + 1, 1), 7.0), Channels(("y",), ("m",))),
        applied=Signal(np.where(time[:-1] < 1.0, 3.0, 5.0)[:, None], Channels(("u",), ("N",))),
    )


def test_cost_is_the_sum_of_the_three_integrals() -> None:
    run = slow_run(2000)
    assert run_cost(run, R=2.0, Q_y=0.0) == pytest.approx(2 * (9 + 25), rel=1e-12)
    assert run_cost(run, R=2.0, Q_y=0.0, u_0=[3.0]) == pytest.approx(2 * 4, rel=1e-12)
    assert run_cost(run, R=0.0, Q_y=3.0) == pytest.approx(3 * 32 / 5, rel=1e-6)
    assert run_cost(run, R=0.0, Q_x=[[1.0, 0.5], [0.5, 4.0]], Q_y=0.0) == pytest.approx(8 / 3 + 2 + 8, rel=1e-6)
    assert run_cost(run, R=1.0, Q_x=1.0, Q_y=1.0) == pytest.approx(34 + 8 / 3 + 2 + 32 / 5, rel=1e-6)


def test_rest_may_be_another_in_each_step() -> None:
    """u - u_0 = 1 throughout; x = (t, 1) counted from (0, 1) for the first second, then from (2, 0)."""
    run, steps = slow_run(2000), 2000
    late = (np.arange(steps) >= steps // 2)[:, None]
    assert run_cost(run, R=2.0, Q_y=0.0, u_0=np.where(late, 4.0, 2.0)) == pytest.approx(4.0, rel=1e-12)
    x_0 = np.where(late, [2.0, 0.0], [0.0, 1.0])
    assert run_cost(run, R=0.0, Q_x=1.0, Q_y=0.0, x_0=x_0) == pytest.approx(1 / 3 + 1 / 3 + 1, rel=1e-6)
    assert run_cost(run, R=0.0, Q_x=1.0, Q_y=0.0, x_0=[1.0, 1.0]) == pytest.approx(2 / 3, rel=1e-6)
    with pytest.raises(
        InvtrackError, match=r"x_0 must be a finite number for each of a \[m\], b \[m\], or those of each of the 2000"
    ):
        run_cost(run, R=0.0, Q_y=0.0, x_0=np.zeros((2001, 2)))


def test_error_falls_with_the_square_of_the_step() -> None:
    misses = [abs(run_cost(slow_run(steps), R=0.0, Q_y=1.0) - 32 / 5) for steps in (50, 100, 200)]
    assert np.log2(misses[0] / misses[1]) == pytest.approx(2, abs=0.01)
    assert np.log2(misses[1] / misses[2]) == pytest.approx(2, abs=0.01)


def test_another_wanted_motion_takes_the_place_of_the_reference() -> None:
    run = slow_run(2000)
    assert run_cost(run, R=0.0, Q_y=1.0, wanted=run.output.values - 2.0) == pytest.approx(8.0, rel=1e-12)


def test_what_has_no_cost_is_refused() -> None:
    run = slow_run(10)
    with pytest.raises(InvtrackError, match=r"Q_x must be a number or a \(2, 2\) matrix"):
        run_cost(run, R=1.0, Q_x=np.eye(3), Q_y=1.0)
    with pytest.raises(InvtrackError, match=r"wanted has shape \(11,\), expected \(11, 1\)"):
        run_cost(run, R=1.0, Q_y=1.0, wanted=run.time)
    with pytest.raises(InvtrackError, match="diverged"):
        run_cost(diverged(two_mode_run(), at=1.0), R=1.0, Q_y=1.0)
