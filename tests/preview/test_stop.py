"""Stop now, against the linear-quadratic regulator worked out with SciPy and against what else one could do."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

import invtrack
from invtrack.errors import PlanError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.preview import inversion_planner, redesign_planner, stop
from invtrack.references.profiles import raised_cosine, rest_to_rest
from tests.cited_plants import CANTILEVER_TIP_MASSES, TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, cantilever_paper

TWIST = np.array([1.0, 0.0, -1.0, 0.0])
WEIGHTS = {"R": 1.0, "Q_x": 5000.0 * np.outer(TWIST, TWIST), "Q_y": 1.0}


@pytest.mark.parametrize("method", ["inversion", "redesign"])
def test_it_is_the_regulator_from_the_present_state(method: str) -> None:
    """x' = (A - B K)(x - x_s) and u = -K (x - x_s), x_s the rig at rest at the angle where the second disc is now."""
    model = StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C)
    times = {"preview": 4.0, "period": 0.25, "start": -4.0}
    planner = inversion_planner(model, **times) if method == "inversion" else redesign_planner(model, **times, **WEIGHTS)
    reference = rest_to_rest(0.0, 1.0, 2.0)
    for _ in range(20):
        piece = planner.update(reference)
    plan, present = stop(planner, **WEIGHTS), planner.present()
    assert planner.time == pytest.approx(1.0)
    assert present.x[0] == pytest.approx(piece([piece.end]).x[0], abs=1e-10)
    assert present.u[0] == pytest.approx(piece([piece.end]).u[0], abs=1e-10)
    K = TWO_DISC_B.T @ scipy.linalg.solve_continuous_are(
        TWO_DISC_A, TWO_DISC_B, WEIGHTS["Q_x"] + TWO_DISC_C.T @ TWO_DISC_C, np.eye(1)
    )
    angle = present.y[0, 0]
    still = np.linalg.lstsq(np.vstack([TWO_DISC_A, TWO_DISC_C]), np.array([0.0, 0.0, 0.0, 0.0, angle]), rcond=None)[0]
    for t in (0.0, 0.3, 2.0, 10.0):
        x = still + scipy.linalg.expm((TWO_DISC_A - TWO_DISC_B @ K) * t) @ (present.x[0] - still)
        at = plan([1.0 + t], inside=[1.0 + t + 1e-6])
        assert at.x[0] == pytest.approx(x, abs=2e-5)  # the printed A is at rest with turned discs to 1e-5 only
        assert at.u[0] == pytest.approx(-K @ (x - still), abs=1e-4)
    assert plan.certificate.dynamics_residual < 1e-9
    assert plan.preactuation == 0.0


def test_through_jumps_to_come_no_other_way_to_rest_costs_less() -> None:
    """Against the optimum for other weights, each cost by quadrature of its own values from now on."""
    model = SwitchedSystem([StateSpace(*cantilever_paper(mass)) for mass in CANTILEVER_TIP_MASSES], [0.5 * np.pi, 1.5 * np.pi])
    planner = inversion_planner(model, preview=8.0, period=0.5, start=-8.0)
    for _ in range(20):
        planner.update(raised_cosine(2.0))
    y_s = planner.present().y[0, 0]
    assert planner.time == pytest.approx(2.0)
    t = np.linspace(2.0, 120.0, 60001)

    def cost(plan: invtrack.Plan) -> float:
        values = plan(t, inside=t + 1e-9)
        return float(np.trapezoid(1e-5 * values.u[:, 0] ** 2 + (values.y[:, 0] - y_s) ** 2, t))

    best = stop(planner, R=1e-5, Q_y=1.0)
    assert best(2.0, inside=2.0 + 1e-9).x[0] == pytest.approx(planner.present().x[0], rel=1e-8)
    assert best.certificate.continuity < 1e-8
    assert best(119.0).y[0, 0] == pytest.approx(y_s, abs=1e-3)
    for R in (0.9e-5, 1.1e-5):
        assert cost(stop(planner, R=R, Q_y=1.0)) > cost(best)


def test_a_measured_state_and_a_place_to_stop() -> None:
    model = StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C)
    planner = inversion_planner(model, preview=1.0, period=0.25)
    state = np.array([0.1, 0.2, 0.3, -0.1])
    plan = stop(planner, **WEIGHTS, state=state, at=0.5)
    assert plan(0.0, inside=1e-9).x[0] == pytest.approx(state, abs=1e-9)
    assert plan(100.0).y[0, 0] == pytest.approx(0.5, abs=1e-4)
    with pytest.raises(PlanError, match="state"):
        stop(planner, **WEIGHTS, state=[0.0, 0.0])
