"""Systems with jumps: which interval a time belongs to, and what does not fit together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from invtrack.errors import ModelError
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from tests.cited_plants import cantilever_paper

LIGHT, HEAVY = StateSpace(*cantilever_paper(0.0)), StateSpace(*cantilever_paper(100.0))
SMALL = StateSpace([[-1.0]], [[1.0]], [[1.0]])


def about(u0: float, y0: float) -> StateSpace:
    return StateSpace(LIGHT.A, LIGHT.B, LIGHT.C, operating_point=OperatingPoint(np.zeros(6), np.array([u0]), np.array([y0])))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: SwitchedSystem([]), "got 0 systems and 0 switch times"),
        (lambda: SwitchedSystem([LIGHT], [1.0]), "got 1 systems and 1 switch times"),
        (lambda: SwitchedSystem([LIGHT, HEAVY]), "got 2 systems and 0 switch times"),
        (lambda: SwitchedSystem([LIGHT] * 3, [2.0, 1.0]), "must be finite and increase"),
        (lambda: SwitchedSystem([LIGHT] * 3, [1.0, 1.0]), "must be finite and increase"),
        (lambda: SwitchedSystem([LIGHT, HEAVY], [np.nan]), "must be finite and increase"),
        (lambda: SwitchedSystem([LIGHT, HEAVY], [np.inf]), "must be finite and increase"),
        (lambda: SwitchedSystem([LIGHT, SMALL], [1.0]), "interval 1 has the states x1, interval 0 has x1, x2, x3"),
        (
            lambda: SwitchedSystem([LIGHT, StateSpace(LIGHT.A, LIGHT.B, LIGHT.C, outputs=["tip"])], [1.0]),
            "interval 1 has the outputs tip, interval 0 has y1",
        ),
        (lambda: SwitchedSystem([about(1.0, 0.0), about(2.0, 0.0)], [1.0]), "another operating point"),
        (lambda: SwitchedSystem([about(1.0, 0.0), about(1.0, 3.0)], [1.0]), r"y0 \[3.0\] against \[0.0\]"),
        (lambda: as_switched([LIGHT, HEAVY]), "expected a StateSpace"),
    ],
)
def test_bad_input_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        build()


def test_a_switch_time_belongs_to_the_interval_that_it_starts() -> None:
    switched = SwitchedSystem([LIGHT, HEAVY, LIGHT], [1.0, 2.5])
    times = [-np.inf, np.nextafter(1.0, 0.0), 1.0, np.nextafter(2.5, 0.0), 2.5, np.inf]
    assert switched.interval(times).tolist() == [0, 0, 1, 1, 2, 2]
    assert len(switched) == 3


def test_one_interval_is_the_ordinary_case() -> None:
    switched = as_switched(LIGHT)
    assert switched.systems == (LIGHT,)
    assert switched.interval([-5.0, 5.0]).tolist() == [0, 0]
    assert as_switched(switched) is switched


def test_switch_times_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        SwitchedSystem([LIGHT, HEAVY], [1.0]).switch_times[0] = 2.0
