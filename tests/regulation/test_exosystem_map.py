"""Laws of the exosystem's map on plants of all kinds: Francis where nothing switches, `invert` for each state, invariances."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from invtrack.errors import InversionError, NonHyperbolicError, PlanError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.exosystem import (
    Exosystem,
    exosystem,
    polynomial_exosystem,
    sinusoidal_exosystem,
    stack_exosystems,
    step_exosystem,
    sum_exosystems,
)
from invtrack.references.profiles import constant
from invtrack.regulation.exosystem_map import exosystem_map
from invtrack.regulation.francis import francis
from invtrack.regulation.francis_map import switched_francis
from invtrack.regulation.regulation_map import RegulationMap
from tests.cited_plants import TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, cantilever_paper
from tests.linear.random_plants import block, plant_with, rotation

Array = np.ndarray

CANTILEVER = [StateSpace(*cantilever_paper(m)) for m in (0.0, 100.0, 10.0)]


def worst(regulation: RegulationMap) -> float:
    c = regulation.certificate
    return max(c.dynamics_residual, c.output_error, c.boundary_residual, c.continuity)


def plants() -> dict[str, StateSpace]:
    rng = np.random.default_rng(11)
    return {
        "cantilever": CANTILEVER[1],
        "two discs": StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C),
        "two inputs": plant_with(rng, (2, 1), block(-0.6, 0.9, 0.3 + 2j)),
        "no zeros": plant_with(rng, (3,), np.zeros((0, 0))),
        "minimum phase": plant_with(rng, (1,), block(-0.5 + 1j)),
        "maximum phase": plant_with(rng, (2,), block(0.5 + 1j, 2.0)),
        "direct feedthrough": StateSpace([[-2.0]], [[1.0]], [[-3.0]], [[1.0]]),
    }


@pytest.mark.parametrize("name", plants())
def test_where_nothing_switches_the_map_is_the_francis_regulator(name: str) -> None:
    plant = plants()[name]
    p, rng = plant.n_outputs, np.random.default_rng(5)
    A_e = block(0.0, 1.3j, -0.7, 0.4)  # a bias, a sinusoid, a decaying and a growing mode
    for exo in (exosystem(A_e, rng.normal(size=(p, 5))), stack_exosystems([polynomial_exosystem(2)] * p)):
        regulation, exact = exosystem_map(plant, exo), francis(plant, exo.A[0], exo.C[0])
        t = np.array([-1e5, -1.0, 0.0, 2.0, 1e5])
        assert regulation.x_map(t) == pytest.approx(np.array([exact.Pi] * 5), abs=1e-10 * max(np.abs(exact.Pi).max(), 1.0))
        assert regulation.u_map(t) == pytest.approx(np.array([exact.Gamma] * 5), abs=1e-10 * max(np.abs(exact.Gamma).max(), 1.0))
        assert (regulation.preactuation, regulation.postactuation) == (0.0, 0.0)
        assert regulation.admissible == pytest.approx(np.eye(exo.n_states))


@pytest.mark.parametrize("times", [[0.0, 4.0], [-2.0, 9.0]])
def test_jumps_amid_an_exosystem_that_runs_for_ever(times: list[float]) -> None:
    """Neither begins nor ends at rest: the map goes from the first plant's regulator to the last one's, without any jump."""
    model, sway = SwitchedSystem(CANTILEVER, times), sinusoidal_exosystem([0.5, 1.7])
    regulation = exosystem_map(model, sway)
    assert worst(regulation) < 1e-12
    assert regulation.inadmissible == ()
    for t, plant in ((regulation.start - 5.0, CANTILEVER[0]), (regulation.end + 5.0, CANTILEVER[2])):
        Pi = francis(plant, sway.A[0], sway.C[0]).Pi
        assert regulation.x_map(t)[0] == pytest.approx(Pi, abs=1e-9 * np.abs(Pi).max())
    x_e, t = np.array([0.4, 1.0, 0.2, -0.3, 0.6]), np.linspace(-40.0, 45.0, 400)
    plan = invert(model, sway.reference(x_e, at=1.0))
    assert regulation.plan(x_e, at=1.0).states(t) == pytest.approx(plan.states(t), abs=1e-10)
    assert switched_francis(model, sway).certificate.continuity > 1e-2


def test_superposition_of_two_admissible_states_is_one() -> None:
    """A slew by bias and cosine, and one with twice the frequency: sums of plans are plans of sums."""
    rates = [1.0, 2.0]
    model = SwitchedSystem(CANTILEVER, [1.5, 4.0])
    regulation = exosystem_map(model, sinusoidal_exosystem(rates, start=0.0, end=2 * np.pi))
    first, second = np.array([1.0, -1.0, 0.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, -1.0, 0.0])  # 1 - cos t, 1 - cos 2 t
    assert regulation.inadmissible_share(first) < 1e-12
    t = np.linspace(-60.0, 60.0, 777)
    plans = [invert(model, regulation.exosystem.reference(x_e)).states(t) for x_e in (first, second)]
    both = regulation.plan(2.0 * first - 0.5 * second).states(t)
    assert both == pytest.approx(2.0 * plans[0] - 0.5 * plans[1], abs=1e-10)


def test_an_exosystem_that_switches_by_itself() -> None:
    """A fast raised_cosine for one period, then a slow one: the state carries over, and every breakpoint is at rest."""
    A = [np.zeros((3, 3)), block(0.0, 2j), block(0.0, 0.5j), np.zeros((3, 3))]
    C = [np.zeros((1, 3)), [[1.0, -1.0, 0.0]], [[1.0, -1.0, 0.0]], np.zeros((1, 3))]
    exo = Exosystem(A, C, [0.0, np.pi, 5 * np.pi])
    model = SwitchedSystem(CANTILEVER[:2], [6.0])
    regulation = exosystem_map(model, exo)
    assert worst(regulation) < 1e-11
    assert regulation.breakpoints == pytest.approx([0.0, np.pi, 6.0, 5 * np.pi])
    assert np.abs(regulation.admissible[:, 0]) == pytest.approx(np.array([1.0, 1.0, 0.0]) / np.sqrt(2), abs=1e-9)
    plan, t = invert(model, exo.reference([1.0, 1.0, 0.0])), np.linspace(-40.0, 60.0, 500)
    assert regulation.plan([1.0, 1.0, 0.0]).states(t) == pytest.approx(plan.states(t), abs=1e-10)


def test_several_outputs() -> None:
    rng = np.random.default_rng(8)
    zeta_rows = [plant_with(rng, (2, 1), block(-0.6, 0.9, 0.3 + 2j), mixed=False) for _ in range(3)]
    T = rotation(rng, zeta_rows[0].n_states)
    model = SwitchedSystem([plant.transformed(T) for plant in zeta_rows], [0.5, 2.0])
    exo = stack_exosystems(
        [sinusoidal_exosystem([1.0], start=0.0, end=2 * np.pi), sinusoidal_exosystem([2.0], start=0.0, end=2 * np.pi)]
    )
    regulation = exosystem_map(model, exo)
    assert worst(regulation) < 1e-11
    x_e, t = np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.7]), np.linspace(-30.0, 40.0, 500)  # 1 - cos t, and sin 2t
    plan = invert(model, exo.reference(x_e))
    assert regulation.plan(x_e).states(t) == pytest.approx(plan.states(t), abs=1e-10)
    assert regulation.plan(x_e).inputs(t) == pytest.approx(plan.inputs(t), abs=1e-9)
    assert np.einsum("mij,mj->mi", regulation.u_map(t), exo.states(x_e, 0.0, t)) == pytest.approx(plan.inputs(t), abs=1e-9)


@pytest.mark.parametrize("outside", ["for ever", "zero", "held"])
@pytest.mark.parametrize("seed", range(6))
def test_every_admissible_state_has_the_plan_that_invert_finds(seed: int, outside: str) -> None:
    """Random plants that jump, random exosystems with polynomials, sinusoids and exponentials in random coordinates."""
    rng = np.random.default_rng(seed)
    degrees = [(2,), (1,), (2, 1)][seed % 3]
    internal = block(*(rng.choice([-1, 1]) * rng.uniform(0.3, 2.0) + 1j * rng.uniform(0.5, 3.0) for _ in range(seed % 2 + 1)))
    plants, times = [plant_with(rng, degrees, internal, mixed=False) for _ in range(3)], np.sort(rng.uniform(-1.0, 8.0, 2))
    T = rotation(rng, plants[0].n_states)
    model = SwitchedSystem([plant.transformed(T) for plant in plants], times)
    span: dict[str, Any] = {} if outside == "for ever" else {"start": 0.0, "end": 2 * np.pi, "outside": outside}
    one = sum_exosystems(
        [sinusoidal_exosystem([2.0], bias=False, **span), polynomial_exosystem(2, **span), exosystem([[0.3]], [[1.0]], **span)]
    )
    exo = stack_exosystems([one] * len(degrees))
    exo = exo.transformed(rotation(rng, exo.n_states) @ np.diag(rng.uniform(0.5, 2.0, exo.n_states)))
    regulation = exosystem_map(model, exo)
    x_e, t = regulation.admissible @ rng.normal(size=regulation.admissible.shape[1]), np.linspace(-8.0, 15.0, 150)
    start = regulation.manoeuvre[0]
    plan, mapped, states = invert(model, exo.reference(x_e, at=start)), regulation.plan(x_e), exo.states(x_e, start, t)
    size = np.abs(plan.states(t)).max(), np.abs(plan.inputs(t)).max()
    assert mapped.states(t) == pytest.approx(plan.states(t), abs=1e-9 * size[0])
    assert np.einsum("mij,mj->mi", regulation.x_map(t), states) == pytest.approx(plan.states(t), abs=1e-9 * size[0])
    assert np.einsum("mij,mj->mi", regulation.u_map(t), states) == pytest.approx(plan.inputs(t), abs=1e-9 * size[1])


def test_growing_and_decaying_modes_over_a_finite_time() -> None:
    """x_e grows and decays by more than e^10 while the plant jumps; both outputs that begin and end at rest are followed."""
    A_e = block(0.0, 0.0, 0.0, 0.5, -0.5)
    A_e[:3, :3] = np.eye(3, k=1)
    exo = exosystem(A_e, [[1.0, 0.0, 0.0, 1.0, 1.0]], start=0.0, end=21.0, outside="held")
    model = SwitchedSystem(CANTILEVER, [3.0, 15.0])
    regulation = exosystem_map(model, exo)
    assert worst(regulation) < 1e-9
    assert regulation.admissible.shape == (5, 3)
    x_e, t = regulation.admissible @ [0.3, 1.0, -0.4], np.linspace(-40.0, 70.0, 700)
    plan = invert(model, exo.reference(x_e))
    assert regulation.plan(x_e).states(t) == pytest.approx(plan.states(t), abs=1e-9 * np.abs(plan.states(t)).max())


def test_an_endless_mode_that_dies_faster_than_the_plant_settles() -> None:
    """x_e decays as exp(-t), the ringing that a jump leaves as exp(-0.2345 t): relative to x_e it never comes to rest."""
    regulation = exosystem_map(SwitchedSystem(CANTILEVER[:2], [0.0]), exosystem([[-1.0]], [[1.0]]))
    assert np.isfinite(regulation.start)
    assert regulation.end == np.inf
    Pi = francis(CANTILEVER[1], [[-1.0]], [[1.0]]).Pi
    away = regulation.x_map([20.0, 30.0])[:, 0, 0] - Pi[0, 0]  # of the base, after the fast zero has died out
    assert np.log(away[1] / away[0]) == pytest.approx(10.0 * (1.0 - 0.234538), abs=1e-4)


def test_a_thousand_jumps_of_pick_and_place() -> None:
    """A chain of integrators grows to 1e6 over half an hour; the map does not, nor do its errors."""
    times = 1.3 + 1.7 * np.arange(1000)
    model = SwitchedSystem([CANTILEVER[k % 2] for k in range(1001)], times)
    regulation = exosystem_map(model, sum_exosystems([polynomial_exosystem(2), sinusoidal_exosystem([0.7], bias=False)]))
    assert worst(regulation) < 1e-11
    t = np.linspace(-20.0, 1750.0, 20001)
    G = regulation.x_map(t)
    assert np.max(np.abs(G)) < 1e3
    assert G[:, 1] == pytest.approx(np.broadcast_to([1.0, 0.0, 0.0, 1.0, 0.0], (len(t), 5)), abs=1e-9)  # the output is exact
    # In the middle the map repeats with the jumps: two masses, 3.4 s.
    assert regulation.x_map(900.0) == pytest.approx(regulation.x_map(903.4), abs=1e-10)


def test_time_shift_units_and_coordinates() -> None:
    rng = np.random.default_rng(21)
    exo = sinusoidal_exosystem([1.0, 1.9], start=0.0, end=2 * np.pi)
    model = SwitchedSystem(CANTILEVER, [1.5, 4.0])
    t = np.linspace(-15.0, 20.0, 60)
    regulation = exosystem_map(model, exo)
    G, F = regulation.x_map(t), regulation.u_map(t)
    later = exosystem_map(SwitchedSystem(CANTILEVER, [101.5, 104.0]), exo.shifted(100.0))
    assert later.x_map(t + 100.0) == pytest.approx(G, abs=1e-10)

    T_e = np.diag([1e6, 1.0, 1e-6, 1.0, 1.0]) @ rng.normal(size=(5, 5))
    turned = exosystem_map(model, exo.transformed(T_e))
    assert turned.x_map(t) @ T_e == pytest.approx(G, abs=1e-8)
    assert turned.u_map(t) @ T_e == pytest.approx(F, abs=1e-6)
    assert turned.admissible.shape == regulation.admissible.shape

    T = np.diag([1e3, 1.0, 1e-3, 1.0, 1e4, 1.0]) @ rotation(rng, 6)
    moved = exosystem_map(SwitchedSystem([plant.transformed(T) for plant in CANTILEVER], [1.5, 4.0]), exo)
    x_e = np.array([1.0, -1.0, 0.0, 0.0, 0.0])
    states = exo.states(x_e, 0.0, t)
    expected = np.einsum("mij,mj->mi", G, states)  # of inadmissible states the coordinates decide how they are completed
    found = np.linalg.solve(T, np.einsum("mij,mj->mi", moved.x_map(t), states).T).T
    assert found == pytest.approx(expected, abs=1e-8)

    fast = [StateSpace(plant.A * 1e3, plant.B * 1e3, plant.C) for plant in CANTILEVER]
    quick = exosystem_map(SwitchedSystem(fast, [1.5e-3, 4e-3]), Exosystem([A * 1e3 for A in exo.A], exo.C, exo.switch_times / 1e3))
    assert quick.x_map(t / 1e3) == pytest.approx(G, abs=1e-9)


def test_an_output_that_changes_with_the_plant_fixes_the_map() -> None:
    """Zero +1, y = zeta; then zero -3, y = zeta + eta: the new output decides eta at the jump (tests/inversion/test_jumps.py)."""

    def system(a: float, c: float) -> StateSpace:
        return StateSpace([[0.0, 0.0], [1.0, a]], [[1.0], [0.0]], [[1.0, c]])

    model = SwitchedSystem([system(1.0, 0.0), system(-2.0, 1.0)], [1.0])
    sway = sinusoidal_exosystem([1.3])
    regulation = exosystem_map(model, sway)
    assert worst(regulation) < 1e-12
    x_e, t = np.array([0.2, 0.5, -1.0]), np.linspace(-10.0, 10.0, 200)
    plan = invert(model, sway.reference(x_e, at=1.0))
    assert regulation.plan(x_e).states(t) == pytest.approx(plan.states(t), abs=1e-11)


def test_a_solution_that_is_not_unique_and_one_that_does_not_exist() -> None:
    """One antistable zero before and none after leaves a direction free; none before and one after asks for too much."""
    antistable = StateSpace([[0.0, 0.0], [1.0, 1.0]], [[1.0], [0.0]], [[1.0, 0.0]])
    stable = StateSpace([[0.0, 0.0], [1.0, -1.0]], [[1.0], [0.0]], [[1.0, 0.0]])
    free = exosystem_map(SwitchedSystem([antistable, stable], [1.0]), sinusoidal_exosystem([1.0]))
    assert any("not unique (1 free direction(s))" in remark for remark in free.remarks)
    assert worst(free) < 1e-12
    stuck = exosystem_map(SwitchedSystem([stable, antistable], [1.0]), sinusoidal_exosystem([1.0]))
    assert stuck.admissible.shape == (3, 2)  # Pi_1 x_e = Pi_2 x_e at the jump is one condition on x_e
    x_e = stuck.admissible @ [1.0, -2.0]
    t = np.linspace(-5, 8, 100)
    assert stuck.plan(x_e).states(t) == pytest.approx(
        invert(stuck.model, stuck.exosystem.reference(x_e, at=1.0)).states(t), abs=1e-11
    )
    with pytest.raises(InversionError, match="at t = 1 s the state that keeps the output exact jumps by"):
        stuck.plan([1.0, 0.0, 0.0])


def test_the_operating_point_is_added_to_the_plan() -> None:
    point = OperatingPoint(x0=np.zeros(6), u0=np.array([5.0]), y0=np.array([2.0]))
    plant = StateSpace(*cantilever_paper(0.0), operating_point=point)
    exo = sinusoidal_exosystem([1.0], start=0.0, end=2 * np.pi)
    x_e, t = np.array([1.0, -1.0, 0.0]), np.linspace(-10, 15, 100)
    plan, mapped = invert(plant, exo.reference(x_e) + constant(2.0)), exosystem_map(plant, exo).plan(x_e)
    assert mapped.inputs(t) == pytest.approx(plan.inputs(t), abs=1e-10)
    assert mapped(t).y == pytest.approx(plan(t).y, abs=1e-11)
    assert mapped(t).y_d == pytest.approx(plan(t).y_d, abs=1e-11)


def test_refusals_say_why() -> None:
    with pytest.raises(TrajectoryError, match="the exosystem has 2 outputs, the plant 1"):
        exosystem_map(CANTILEVER[0], stack_exosystems([step_exosystem(), step_exosystem()]))
    with pytest.raises(TrajectoryError, match=r"expected an Exosystem, .* got PiecewiseSignal; for a single reference use invert"):
        exosystem_map(CANTILEVER[0], constant(1.0))  # type: ignore[arg-type]
    with pytest.raises(TrajectoryError, match=r"expected finite times .* got nan"):
        exosystem_map(CANTILEVER[0], polynomial_exosystem(2)).x_map(np.nan)
    with pytest.raises(PlanError, match="tolerance must lie between 0 and 1, got 0"):
        exosystem_map(CANTILEVER[0], step_exosystem(), tolerance=0)
    zero = plant_with(np.random.default_rng(3), (1,), block(0.5))
    with pytest.raises(
        InversionError, match=r"runs, or holds its output, without end: .* mode at 0.5 meets the plant's zero at 0.5"
    ):
        exosystem_map(zero, exosystem([[0.5]], [[1.0]]))
    assert worst(exosystem_map(zero, exosystem([[0.5]], [[1.0]], start=0.0, end=3.0))) < 1e-12  # for a while it does no harm
    with pytest.raises(NonHyperbolicError, match="zeros at 0"):
        exosystem_map(plant_with(np.random.default_rng(3), (1,), block(3j)), step_exosystem())


def test_a_state_given_at_another_time_leaves_no_breakpoint_that_the_plan_does_not_know() -> None:
    wave = sinusoidal_exosystem([1.5])
    plan = exosystem_map(StateSpace([[-1.0]], [[1.0]], [[1.0]]), wave).plan([0.0, 1.0, 0.0], at=3.0)
    assert set(plan.reference.breakpoints) <= set(plan.breakpoints)
    times = np.array([2.0, 2.9, 3.0, 3.1])
    for inside in (None, 2.0, 4.0):
        assert plan(times, inside=inside).y_d[:, 0] == pytest.approx(np.cos(1.5 * (times - 3.0)), abs=1e-12)


def test_where_the_last_direction_is_lost_is_said() -> None:
    """What is zero at the start is zero again after a whole period; 2 s are no period of sin 3 t, so the end asks for more."""
    plant = StateSpace([[0.0, 1.0], [-4.0, -4.0]], [[0.0], [1.0]], [[1.0, -1.0]])
    whole = exosystem_map(plant, sinusoidal_exosystem([1.0], start=0.0, end=2 * np.pi))
    assert whole.directions_left == ((0.0, 2),)
    part = exosystem_map(plant, sinusoidal_exosystem([3.0], start=0.0, end=2.0))
    assert part.directions_left[-1] == (2.0, 1)
    assert part.describe_inadmissible().endswith(
        "of the exosystem's state the conditions at t = 0 s leave 2, those at t = 2 s leave 1"
    )
