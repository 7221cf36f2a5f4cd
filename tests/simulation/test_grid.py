import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.errors import SimulationError
from invtrack.simulation.grid import make_grid


def test_every_breakpoint_is_a_step_boundary_exactly() -> None:
    breakpoints = [np.pi / 2, 3 * np.pi / 2, np.sqrt(2)]
    grid = make_grid(-1.0, 7.0, breakpoints, 1e-2)
    assert set(breakpoints) <= set(grid.time.tolist())
    assert grid.time[0] == -1.0
    assert grid.time[-1] == 7.0


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-100, 100),
    st.floats(1e-3, 50),
    st.lists(st.floats(0.001, 0.999), max_size=6),
    st.floats(1e-3, 1.0),
)
def test_steps_fill_the_span_evenly_and_never_exceed_the_limit(
    start: float, length: float, shares: list[float], timestep: float
) -> None:
    end = start + length
    grid = make_grid(start, end, [start + share * length for share in shares], timestep)
    steps = np.diff(grid.time)
    assert np.all(steps > 0)
    assert np.all(grid.step <= timestep * (1 + 1e-8))
    np.testing.assert_allclose(steps, grid.step[grid.interval], rtol=1e-6, atol=1e-12)
    inside = grid.middle
    assert np.all((inside > grid.edges[grid.interval]) & (inside < grid.edges[grid.interval + 1]))


def test_breakpoints_that_differ_by_rounding_are_one() -> None:
    grid = make_grid(0.0, 1.0, [0.3, 0.1 + 0.2, 1.0 - 1e-15], 0.1)
    assert len(grid.edges) == 3
    assert np.diff(grid.time).min() > 0.05


def test_a_whole_number_of_steps_is_not_made_one_longer_by_rounding() -> None:
    assert make_grid(0.0, 0.3, [], 0.1).n_steps == 3


@pytest.mark.parametrize(
    ("start", "end", "timestep", "message"),
    [
        (0.0, 1.0, 0.0, "time step"),
        (0.0, 1.0, np.nan, "time step"),
        (1.0, 1.0, 0.1, "must end after it starts"),
        (0.0, np.inf, 0.1, "end"),
    ],
)
def test_impossible_grids_are_refused(start: float, end: float, timestep: float, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        make_grid(start, end, [], timestep)
