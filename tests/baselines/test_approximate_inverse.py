"""Approximate inverses of sampled plants against transfer functions in z, and the laws that give them their names."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

import invtrack
from invtrack.baselines import approximate_inverse
from invtrack.errors import InversionError, PlanError, RelativeDegreeError
from invtrack.linear import OperatingPoint
from invtrack.references import rest_to_rest, s_curve
from invtrack.references.generator import Generator, constant_generator
from tests.cited_plants import TWO_DISC_A, TWO_DISC_B, TWO_DISC_C
from tests.ringing_plants import crane, with_zeros

KINDS = ("NPZ-ignore", "ZPETC", "ZMETC")
HOLD = 0.05
SLEW = rest_to_rest(0.0, 1.0, 2.0, smoothness=3)
RAMP = Generator(np.eye(2, k=1), np.eye(1, 2))
ENDLESS = invtrack.PiecewiseSignal(
    np.array([0.0]), (constant_generator(1), RAMP), np.array([0, 1]), np.array([[0.0, 0.0], [0.0, 1.0]])
)
PLANTS = {
    "one zero": with_zeros([3.0, -1.5]),
    "a pair": with_zeros([0.6 + 4.0j, 0.6 - 4.0j]),
    "slow and fast": with_zeros([0.2, 8.0]),
    "two discs": invtrack.StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C),
}


def sampled(model: invtrack.StateSpace, hold: float = HOLD) -> tuple[Any, Any, Any, Any]:
    A, B, C, D, _ = scipy.signal.cont2discrete((model.A, model.B, model.C, model.D), hold)
    return A, B, C, D


def zeros_of(model: invtrack.StateSpace) -> np.ndarray[Any, Any]:
    """Zeros of the sampled plant, by the generalized eigenvalues of its pencil."""
    A, B, C, D = sampled(model)
    values = scipy.linalg.eigvals(np.block([[A, B], [C, D]]), scipy.linalg.block_diag(np.eye(len(A)), 0.0))
    return np.asarray(values[np.isfinite(values) & (np.abs(values) < 1e6)])


def not_cancelled(model: invtrack.StateSpace) -> np.ndarray[Any, Any]:
    """B_u, highest power first, with the gain 1 at rest: of the zeros outside the unit circle and of those that ring at z = -1."""
    b = np.real(np.poly([z for z in zeros_of(model) if abs(z) > 1 or abs(z + 1) < 0.06]))
    return b / np.sum(b)


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("kind", KINDS)
def test_samples_of_the_output_are_what_the_transfer_function_says(kind: Any, name: str) -> None:
    model = PLANTS[name]
    plan, b = approximate_inverse(model, SLEW, kind=kind, hold=HOLD), not_cancelled(model)
    k = np.arange(-40, 400)
    wanted = SLEW(k * HOLD)[:, 0]
    ahead = np.convolve(wanted, b)[len(b) - 1 :]  # B_u(z) y_d, for samples up to 400 - len(b)
    if kind == "ZPETC":
        expected = np.convolve(ahead, b[::-1])[: len(ahead)]
    elif kind == "ZMETC":
        outside = np.roots(b)[np.abs(np.roots(b)) > 1]
        f = np.real(np.poly(1 / outside))
        expected = scipy.signal.lfilter(np.append(np.zeros(len(outside)), np.sum(f)), f, ahead)
    else:
        expected = ahead
    inner = slice(20, 380)
    assert plan(k[inner] * HOLD).y[:, 0] == pytest.approx(expected[inner], abs=2e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_its_held_inputs_make_that_output(kind: Any) -> None:
    """The inputs through the sampled plant of scipy, one hold after the other."""
    model = PLANTS["a pair"]
    plan = approximate_inverse(model, SLEW, kind=kind, hold=HOLD)
    A, B, C, _ = sampled(model)
    edges = plan.breakpoints
    held = plan.inputs(edges[:-1], inside=(edges[:-1] + edges[1:]) / 2)
    assert np.array_equal(held, plan.inputs(edges[:-1] + 0.9 * np.diff(edges)))
    x, y = np.zeros(4), []
    for u in held:
        y.append((C @ x)[0])
        x = A @ x + B @ u
    assert plan(edges[:-1]).y[:, 0] == pytest.approx(y, abs=1e-9)
    assert plan.states(edges[-1:])[0] == pytest.approx(x, abs=1e-9)
    assert plan.certificate.dynamics_residual < 1e-12
    assert plan.certificate.continuity < 1e-9


def test_zero_phase() -> None:
    """A motion that is the same forward and backward comes out the same forward and backward."""
    for model in PLANTS.values():
        plan = approximate_inverse(model, SLEW, kind="ZPETC", hold=HOLD)
        t = HOLD * np.arange(41)
        assert plan(t).y + plan(t[::-1]).y == pytest.approx(np.ones((41, 1)), abs=1e-9)
        ignored = approximate_inverse(model, SLEW, kind="NPZ-ignore", hold=HOLD)
        assert np.max(np.abs(ignored(t).y + ignored(t[::-1]).y - 1)) > 1e-3


def test_zero_magnitude_error() -> None:
    """What passes all frequencies alike keeps the sum of squares, here of the steps from sample to sample."""
    for name in ("one zero", "slow and fast"):
        model = PLANTS[name]
        assert np.min(np.abs(zeros_of(model) + 1)) > 0.1  # nothing rings
        t = HOLD * np.arange(-60, 1200)
        steps = {kind: np.diff(approximate_inverse(model, SLEW, kind=kind, hold=HOLD)(t).y[:, 0]) for kind in KINDS}
        wanted = float(np.sum(np.diff(SLEW(t)[:, 0]) ** 2))
        assert np.sum(steps["ZMETC"] ** 2) == pytest.approx(wanted, rel=1e-8)
        assert all(abs(np.sum(steps[kind] ** 2) / wanted - 1) > 1e-3 for kind in ("NPZ-ignore", "ZPETC"))


def test_without_zeros_outside_it_is_exact_at_the_samples() -> None:
    plan = approximate_inverse(with_zeros([-1.0, -2.0, -5.0]), SLEW, kind="ZPETC", hold=HOLD)
    t = HOLD * np.arange(-20, 100)
    assert plan(t).y == pytest.approx(SLEW(t), abs=1e-12)
    assert plan.preactuation == pytest.approx(2 * HOLD)


def test_a_sampling_zero_on_the_circle_is_not_cancelled() -> None:
    """A mass sampled has its zero at -1: ZPETC makes (z + 2 + 1/z) / 4 of it, and its input does not ring."""
    mass = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    plan = approximate_inverse(mass, SLEW, kind="ZPETC", hold=HOLD)
    k = np.arange(-5, 60)
    wanted = SLEW(HOLD * np.arange(-6, 61))[:, 0]
    assert plan(HOLD * k).y[:, 0] == pytest.approx((wanted[:-2] + 2 * wanted[1:-1] + wanted[2:]) / 4, abs=1e-11)
    assert np.max(np.abs(plan.inputs([3.0, 5.0]))) < 1e-9
    assert plan.end < 2.5


def test_run_with_the_same_hold_it_is_what_was_planned() -> None:
    model = PLANTS["two discs"]
    gains = invtrack.lqr(model, Q=1.0, R=1.0)
    for kind in KINDS[:2]:
        plan = approximate_inverse(model, SLEW, kind=kind, hold=HOLD)
        controller = invtrack.TrackingController(plan, gains, period=HOLD)
        run = invtrack.simulate(invtrack.LinearPlant(model), controller, timestep=HOLD / 2, end=4.0)
        assert invtrack.max_error(run, wanted="planned_output") < 1e-10
        assert invtrack.max_error(run) > 1e-3


def test_which_zeros_inside_the_circle_are_cancelled() -> None:
    """A crane's sway is, hardly damped as it is: the input rings on. What sampling makes near z = -1 is not, unless asked for."""
    model, t = crane(0.3), HOLD * np.arange(-10, 100)
    plain, all_of_them = (approximate_inverse(model, SLEW, kind="ZPETC", hold=HOLD, least_damping=z) for z in (0.02, 0.0))
    assert np.max(np.abs(all_of_them(t).y - SLEW(t))) < 1e-11 < np.max(np.abs(plain(t).y - SLEW(t))) < 1e-2
    for plan in (plain, all_of_them):
        assert plan.end > 10.0
    assert any("not cancelled: -0.9" in remark for remark in plain.remarks)
    assert not any("not cancelled" in remark for remark in all_of_them.remarks)


def test_an_output_that_one_hold_hardly_moves() -> None:
    """A load on a long rope, whose own inertia alone lets the drive reach it at once."""
    d, J, m = 4.0, 0.3, 20.0  # rope [m], inertia [kg m^2] and mass [kg] of the load
    M = np.array([[10.0 + m, -m * d], [-m * d, m * d * d + J]])
    S, D = np.diag([0.0, m * 9.81 * d]), np.diag([5.0, 2.0])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, S), -np.linalg.solve(M, D)]])
    B = np.concatenate([np.zeros(2), np.linalg.solve(M, [1.0, 0.0])])[:, None]
    model = invtrack.StateSpace(A, B, [[1.0, -d, 0.0, 0.0]])
    for kind in KINDS:
        plan = approximate_inverse(model, s_curve(0.0, 2.0, duration=8.0), kind=kind, hold=HOLD)
        assert plan.certificate.continuity < np.finfo(float).eps / 2e-7  # a hold of a newton moves the load by 2e-7 m
        assert plan.certificate.output_error < 1e-2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(4))
def test_chains_of_masses_whose_far_end_one_hold_moves_by_a_billionth(seed: int, kind: Any) -> None:
    rng = np.random.default_rng(seed)
    n = 4
    M, links = np.diag(rng.uniform(0.1, 10.0, n)), np.eye(n) - np.eye(n, k=-1)
    S = links.T @ np.diag(rng.uniform(1.0, 1e3, n)) @ links
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, S), -1e-3 * np.linalg.solve(M, S)]])
    B = np.concatenate([np.zeros(n), np.linalg.solve(M, np.eye(n)[0])])[:, None]
    model = invtrack.StateSpace(A, B, np.eye(2 * n)[n - 1 : n])
    pace = float(np.max(np.abs(np.linalg.eigvals(A))))
    plan = approximate_inverse(model, rest_to_rest(0.0, 1.0, 200 / pace, smoothness=8), kind=kind, hold=0.5 / pace)
    assert plan.certificate.continuity < 1e-12
    assert plan.certificate.dynamics_residual < 1e-12
    assert plan.inputs([plan.end + 1.0])[0, 0] == pytest.approx(float(np.linalg.solve(model.C @ np.linalg.solve(-A, B), [1.0])[0]))


def test_a_motion_between_places_that_are_held_by_inputs() -> None:
    """From 2 to 3 about an operating point that is neither: superposition, in all of x, u and y."""
    model = with_zeros([3.0, -1.5], operating_point=OperatingPoint(x0=np.zeros(4), u0=[5.0], y0=[1.0]))
    plain = approximate_inverse(with_zeros([3.0, -1.5]), SLEW, kind="ZMETC", hold=HOLD)
    moved = approximate_inverse(model, SLEW + 2.0, kind="ZMETC", hold=HOLD)
    gain = float((model.C @ np.linalg.solve(-model.A, model.B))[0, 0])
    t = np.linspace(-1.0, 3.0, 30)
    assert moved(t).y == pytest.approx(plain(t).y + 2.0, abs=1e-10)
    assert moved(t).u == pytest.approx(plain(t).u + 5.0 + 1 / gain, abs=1e-7)


@pytest.mark.parametrize("exponents", [(6, -6, 3, -4), (-5, 5, 5, -5)])
def test_units_of_states_do_not_matter(exponents: tuple[int, ...]) -> None:
    model = PLANTS["two discs"]
    scaled = model.transformed(np.diag(10.0 ** np.array(exponents)))
    t = np.linspace(-1.0, 3.0, 30)
    found, plain = (approximate_inverse(each, SLEW, kind="ZPETC", hold=HOLD) for each in (scaled, model))
    assert found(t).y == pytest.approx(plain(t).y, abs=1e-9)


def test_plants_with_feedthrough() -> None:
    direct = invtrack.StateSpace([[-1.0]], [[1.0]], [[-3.0]], [[1.0]])  # (s - 2) / (s + 1)
    plan, b = approximate_inverse(direct, SLEW, kind="ZPETC", hold=HOLD), not_cancelled(direct)
    k = np.arange(-10, 60)
    ahead = np.convolve(SLEW(HOLD * k)[:, 0], b)[1:]
    expected = np.convolve(ahead, b[::-1])
    assert plan(HOLD * k[5:60]).y[:, 0] == pytest.approx(expected[5:60], abs=1e-10)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"kind": "ZPEC"}, PlanError, "kind must be one of"),
        ({"hold": 0.0}, PlanError, "hold must be a positive number of seconds"),
        ({"least_damping": -1.0}, PlanError, "least_damping must be finite and not negative"),
        ({"hold": 1e-6}, PlanError, "holds until the zeros that are cancelled have died out.*take a longer hold"),
        (
            {"reference": ENDLESS},
            PlanError,
            "this one moves on for ever after its manoeuvre",
        ),
        (
            {"model": invtrack.SwitchedSystem([PLANTS["one zero"], PLANTS["a pair"]], [1.0])},
            PlanError,
            "needs one model for all of time",
        ),
        (
            {
                "model": invtrack.StateSpace(-np.eye(2), np.eye(2), np.eye(2)),
                "reference": rest_to_rest([0.0, 0.0], [1.0, 1.0], 1.0),
            },
            RelativeDegreeError,
            "got 2 and 2",
        ),
        ({"model": invtrack.StateSpace([[-1.0]], [[1.0]], [[-1.0]], [[1.0]])}, InversionError, "cannot be held"),
        (
            {"model": invtrack.StateSpace([[-1.0, 0], [0, -2.0]], [[1.0], [0]], [[0, 1.0]])},
            PlanError,
            "no more than rounding does.*take a longer hold",
        ),
    ],
)
def test_refusals(options: dict[str, Any], error: type[Exception], message: str) -> None:
    given = {"model": PLANTS["one zero"], "reference": SLEW, "kind": "ZPETC", "hold": HOLD, **options}
    with pytest.raises(error, match=message):
        approximate_inverse(**given)
