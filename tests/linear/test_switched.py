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


def about(x0: list[float], u0: float, y0: float) -> StateSpace:
    return StateSpace(LIGHT.A, LIGHT.B, LIGHT.C, operating_point=OperatingPoint(np.array(x0), np.array([u0]), np.array([y0])))


def mechanism(angle: float) -> StateSpace:
    """Measured from a configuration with a quaternion: one number more than the state has."""
    return about([np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0, 0.0, 0.0, 0.0], 0.0, 0.0)


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
        (lambda: SwitchedSystem([LIGHT, mechanism(1.0)], [1.0]), "interval 1 measures its states from the x0"),
        (
            lambda: SwitchedSystem([mechanism(0.0), mechanism(1.0)], [1.0]),
            "no difference of the 6 states can be told; linearize all",
        ),
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


def test_each_interval_is_at_rest_in_its_own_equilibrium_measured_from_the_first() -> None:
    first, second = about([1.0, 0, 0, 0, 0, 0], 5.0, -2.0), about([1.5, 0, -0.25, 0, 0, 0], 8.0, 3.0)
    switched = SwitchedSystem([first, second, first], [1.0, 2.0])
    assert switched.rest_states.tolist() == [[0.0] * 6, [0.5, 0.0, -0.25, 0.0, 0.0, 0.0], [0.0] * 6]
    assert (switched.rest_inputs.tolist(), switched.rest_outputs.tolist()) == ([[5.0], [8.0], [5.0]], [[-2.0], [3.0], [-2.0]])
    assert switched.shifts.tolist() == [[-0.5, 0.0, 0.25, 0.0, 0.0, 0.0], [0.5, 0.0, -0.25, 0.0, 0.0, 0.0]]
    assert all(system.operating_point.x0.tolist() == [1.0, 0, 0, 0, 0, 0] for system in switched.systems)
    assert switched.systems[0] is first
    assert (len(switched.distinct), switched.rests_in_one_place) == (2, False)
    again = SwitchedSystem(switched.systems, switched.switch_times)  # what is in the frame already stays as it is
    assert again.systems == switched.systems


def test_equilibria_change_coordinates_with_the_models() -> None:
    T = np.random.default_rng(2).normal(size=(6, 6))
    models = about([1.0, 0, 0, 0, 0, 0], 5.0, -2.0), about([1.5, 0, -0.25, 0, 0, 0], 8.0, 3.0)
    plain = SwitchedSystem(models, [1.0])
    before, after = SwitchedSystem([m.transformed(T) for m in models], [1.0]), [m.transformed(T) for m in plain.systems]
    assert before.rest_states == pytest.approx(plain.rest_states @ T.T)
    assert SwitchedSystem(after, [1.0]).rest_states == pytest.approx(plain.rest_states @ T.T)


def test_configurations_that_agree_to_rounding_are_one_frame() -> None:
    assert SwitchedSystem([mechanism(0.3), mechanism(0.3 + 1e-12)], [1.0]).rests_in_one_place


def test_switch_times_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        SwitchedSystem([LIGHT, HEAVY], [1.0]).switch_times[0] = 2.0
