"""Redesign with preview, against the linear-quadratic tracker worked out with SciPy and against plans that know everything."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.linalg

from invtrack.errors import PlanError, RedesignError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.preview import preview_redesign, redesign_planner
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import raised_cosine, rest_to_rest
from tests.cited_plants import CANTILEVER_TIP_MASSES, TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, cantilever_paper

TWIST = np.array([1.0, 0.0, -1.0, 0.0])
NODES, SHARES = np.polynomial.legendre.leggauss(24)
WEIGHTS = {"R": 1.0, "Q_x": 5000.0 * np.outer(TWIST, TWIST), "Q_y": 1.0}


def two_disc() -> StateSpace:
    return StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C)


def test_the_input_is_that_of_the_tracker_whose_costate_sees_what_is_known() -> None:
    """u = -K x - B's, s = -integral of e^(A_c'(s - t)) C' y_d with y_d going straight on beyond t + T_p (relative degree 2)."""
    A, B, C = TWO_DISC_A, TWO_DISC_B, TWO_DISC_C
    P = scipy.linalg.solve_continuous_are(A, B, WEIGHTS["Q_x"] + C.T @ C, np.eye(1))
    K = B.T @ P
    modes, V = np.linalg.eig((A - B @ K).T)
    into = np.linalg.solve(V, C[0].astype(complex))
    preview, reference = 1.5, rest_to_rest(0.0, 1.0, 2.0)
    planner = redesign_planner(two_disc(), preview=preview, period=0.25, start=-1.5, **WEIGHTS)
    x = np.zeros(4)
    for _ in range(16):
        piece = planner.update(reference)
        t, known = piece.start, piece.start + preview
        assert piece.x == pytest.approx(x, abs=1e-9)
        # Mode by mode: by quadrature up to what is known, in closed form along the straight line beyond.
        amplitude = np.zeros(4, dtype=complex)
        edges = [t, *(edge for edge in (0.0, 2.0) if t < edge < known), known]
        for a, b in itertools.pairwise(edges):
            s, weight = a + (b - a) * (NODES + 1) / 2, (b - a) / 2 * SHARES
            amplitude += np.exp(np.outer(modes, s - t)) @ (weight * reference(s)[:, 0])
        y, slope = reference(known)[0], reference(known, derivative=1)[0]
        amplitude += np.exp(modes * preview) * (-y / modes + slope / modes**2)
        costate = -(V @ (amplitude * into)).real
        assert piece.u == pytest.approx(-K @ x - B.T @ costate, abs=1e-9)
        # From there on the plan is a motion of the plant.
        h = piece.end - piece.start
        s = h * (NODES + 1) / 2
        u = piece(piece.start + s).u[:, 0]
        x = scipy.linalg.expm(A * h) @ x + sum(
            scipy.linalg.expm(A * (h - at)) @ B[:, 0] * value * share * h / 2 for at, value, share in zip(s, u, SHARES, strict=True)
        )


def test_a_long_preview_is_as_good_as_knowing_everything() -> None:
    reference = rest_to_rest(0.0, 1.0, 2.0)
    optimum = quadratic_redesign(two_disc(), reference, **WEIGHTS)
    plan = preview_redesign(two_disc(), reference, preview=75.0, period=1.0, **WEIGHTS)
    t = np.linspace(-20.0, 20.0, 201)
    assert plan.states(t) == pytest.approx(optimum.states(t), abs=1e-6)
    assert plan.inputs(t) == pytest.approx(optimum.inputs(t), abs=1e-6)
    assert plan.certificate.dynamics_residual < 1e-10
    assert plan.certificate.continuity < 1e-10


def test_through_jumps_of_the_plant_too() -> None:
    model = SwitchedSystem([StateSpace(*cantilever_paper(mass)) for mass in CANTILEVER_TIP_MASSES], [0.5 * np.pi, 1.5 * np.pi])
    optimum = quadratic_redesign(model, raised_cosine(2.0), R=1e-5, Q_y=1.0)
    plan = preview_redesign(model, raised_cosine(2.0), preview=64.0, period=1.0, R=1e-5, Q_y=1.0)
    t = np.linspace(-20.0, 15.0, 351)
    peaks = np.max(np.abs(optimum.states(t)), axis=0)
    assert np.max(np.abs(plan.states(t) - optimum.states(t)) / peaks) < 1e-6
    assert np.max(np.abs(plan.inputs(t) - optimum.inputs(t))) < 1e-5 * np.max(np.abs(optimum.inputs(t)))
    short = preview_redesign(model, raised_cosine(2.0), preview=2.0, period=0.5, R=1e-5, Q_y=1.0)
    assert short.certificate.dynamics_residual < 1e-8


def test_a_weight_that_asks_for_nothing_is_refused() -> None:
    with pytest.raises(RedesignError, match="Q_y must not be zero"):
        redesign_planner(two_disc(), R=1.0, Q_y=0.0, preview=1.0, period=0.1)


def test_outputs_that_do_not_fit_are_refused() -> None:
    with pytest.raises(PlanError, match="held must be one finite value for each of the outputs"):
        redesign_planner(two_disc(), R=1.0, Q_y=1.0, preview=1.0, period=0.1, held=[0.0, 1.0])
