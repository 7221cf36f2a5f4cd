"""Trade-offs: figures against independent integrals, exact inversion as the limit, dominance by definition."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.integrate

from invtrack.errors import RedesignError
from invtrack.inversion.exact import invert
from invtrack.redesign.pareto import Outcome, TradeOff, outcome, pareto_sweep
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import rest_to_rest
from tests.redesign.plants import NONMINIMUM, TWIST, TWO_DISC, there_and_back

REFERENCE = rest_to_rest(0.0, 1.0, 30.0)
QUANTITIES = {"twist": TWIST[0]}
OUTPUT_WEIGHTS = (0.1, 1.0, 10.0, 1000.0)


@pytest.fixture(scope="module")
def sweep() -> TradeOff:
    weights = [{"R": 1.0, "Q_x": 5000.0 * TWIST.T @ TWIST, "Q_y": q_y} for q_y in OUTPUT_WEIGHTS]
    exact = invert(TWO_DISC, REFERENCE, tolerance=1e-8)
    return pareto_sweep(TWO_DISC, REFERENCE, weights=weights, quantities=QUANTITIES, exact=exact, tolerance=1e-8)


def test_more_weight_on_the_output_costs_input_and_twist(sweep: TradeOff) -> None:
    assert np.all(np.diff(sweep.values("max_error")) < 0)
    for figure in ("rms_input", "peak_twist"):
        assert np.all(np.diff(sweep.values(figure)) > 0)
    assert not np.any(sweep.dominated)


def test_the_published_trade_is_among_the_points(sweep: TradeOff) -> None:
    """With the papers' weights about 10 % of the slew is given up for half the input and two thirds of the twist."""
    assert sweep.values("max_error")[1] == pytest.approx(0.10, abs=0.005)
    assert 1 - sweep.shares("peak_input")[1] == pytest.approx(0.55, abs=0.01)
    assert 1 - sweep.shares("peak_twist")[1] == pytest.approx(0.32, abs=0.01)


def test_with_ever_more_weight_on_the_output_it_becomes_exact_inversion(sweep: TradeOff) -> None:
    assert sweep.values("max_error")[-1] < 1e-3
    assert sweep.shares("rms_input")[-1] == pytest.approx(1.0, abs=0.01)
    assert sweep.shares("peak_twist")[-1] == pytest.approx(1.0, abs=0.01)


def test_figures_are_those_of_the_plan_on_a_grid_of_its_own(sweep: TradeOff) -> None:
    for plan, found in zip(sweep.plans, sweep.outcomes, strict=True):
        times = np.linspace(plan.start, plan.end, 200_001)
        at = plan(times)
        assert found.max_error == pytest.approx(np.max(np.abs(at.y - at.y_d)), rel=1e-4)
        assert found.peak_input == pytest.approx(np.max(np.abs(at.u)), rel=1e-4)
        assert found.peaks["twist"] == pytest.approx(np.max(np.abs(at.x[:, 0] - at.x[:, 2])), rel=1e-4)
        energy = scipy.integrate.simpson(at.u[:, 0] ** 2, x=times)
        assert found.rms_input == pytest.approx(np.sqrt(energy / 30.0), rel=1e-6)


def test_each_plan_is_the_cheapest_by_its_own_weights(sweep: TradeOff) -> None:
    """At other plans' outcomes its own cost is larger: with three integrals the cost of every plan by every weight."""
    integrals = []
    for plan in sweep.plans:
        times = np.linspace(plan.start, plan.end, 100_001)
        at = plan(times)
        squares = (at.u[:, 0] ** 2, (at.x[:, 0] - at.x[:, 2]) ** 2, (at.y - at.y_d)[:, 0] ** 2)
        integrals.append([scipy.integrate.simpson(square, x=times) for square in squares])
    table = np.array([[np.dot([1.0, 5000.0, q_y], integral) for integral in integrals] for q_y in OUTPUT_WEIGHTS])
    np.testing.assert_allclose(np.diag(table), sweep.costs, rtol=1e-6)
    assert np.all(np.argmin(table, axis=1) == np.arange(len(OUTPUT_WEIGHTS)))


def test_figures_scale_with_the_motion() -> None:
    weights = [{"R": 1.0, "Q_y": 3.0}]
    once, thrice = (pareto_sweep(NONMINIMUM, there_and_back(size=size), weights=weights).outcomes[0] for size in (1.0, 3.0))
    for name, value in once.figures.items():
        assert thrice.figures[name] == pytest.approx(3 * value, rel=1e-9)


def _points(*figures: tuple[float, float, float, float]) -> TradeOff:
    plans: Any = [None] * len(figures)
    outcomes = tuple(Outcome(*values[:3], peaks={"twist": values[3]}) for values in figures)
    return TradeOff(({},) * len(figures), plans, outcomes, (0.0,) * len(figures), None)


def test_dominated_is_no_better_anywhere_and_worse_somewhere() -> None:
    a, worse, other = (1.0, 1.0, 1.0, 1.0), (1.0, 2.0, 1.0, 1.0), (2.0, 0.5, 1.0, 1.0)
    assert _points(a, worse, other).dominated.tolist() == [False, True, False]
    assert _points(a, a).dominated.tolist() == [False, False]
    assert _points(a, (1.0 + 1e-14, 1.0, 1.0, 1.0)).dominated.tolist() == [False, False]
    assert _points(a).dominated.tolist() == [False]
    units = np.array([1e6, 1e-6, 1.0, 1e3])
    scaled = [tuple((units * point).tolist()) for point in (a, worse, other)]
    assert _points(*scaled).dominated.tolist() == [False, True, False]


def test_rows_hold_figures_cost_and_dominance(sweep: TradeOff) -> None:
    assert [set(row) for row in sweep.rows] == [{"max_error", "peak_input", "rms_input", "peak_twist", "cost", "dominated"}] * 4
    assert [row["cost"] for row in sweep.rows] == list(sweep.costs)


def test_any_method_can_be_swept() -> None:
    early = partial(quadratic_redesign, max_preactuation=0.5)
    plans = pareto_sweep(NONMINIMUM, there_and_back(), weights=[{"R": 1.0, "Q_y": 5.0}], method=early).plans
    assert plans[0].preactuation == 0.5


def test_bad_requests_are_refused(sweep: TradeOff) -> None:
    good = {"R": 1.0, "Q_y": 1.0}
    for weights in ([], [{"R": 1.0}], [{**good, "q_x": 2.0}]):
        with pytest.raises(RedesignError, match="a mapping with R, Q_y and, if wanted, Q_x"):
            pareto_sweep(NONMINIMUM, there_and_back(), weights=weights)
    with pytest.raises(RedesignError, match=r"weights of 'tip' must be finite, one number for each of \['x1', 'x2', 'x3'\]"):
        pareto_sweep(NONMINIMUM, there_and_back(), weights=[good], quantities={"tip": [1.0, 0.0]})
    with pytest.raises(RedesignError, match="no figure named 'peak_tip'; there are: max_error, peak_input, rms_input, peak_twist"):
        sweep.values("peak_tip")
    with pytest.raises(RedesignError, match="exact inversion's max_error is zero"):
        sweep.shares("max_error")
    with pytest.raises(RedesignError, match="no exact inversion to compare with"):
        pareto_sweep(NONMINIMUM, there_and_back(), weights=[good]).shares("peak_input")


@pytest.mark.parametrize(
    "weights", [None, 1.0, "R", {"R": 1.0, "Q_y": 1.0}, [None], ["RQ"], [[("R", 1.0)]], np.ones(2), [{1: 2.0}]]
)
def test_what_is_no_list_of_weights(weights: Any) -> None:
    with pytest.raises(RedesignError, match="expected a list with, for each point, a mapping with R, Q_y and, if wanted, Q_x; got"):
        pareto_sweep(NONMINIMUM, there_and_back(), weights=weights)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quantities": "twist"}, "quantities must be a mapping such as .* got 'twist'"),
        ({"quantities": [("twist", {"x1": 1.0})]}, "quantities must be a mapping such as"),
        ({"quantities": {1: {"x1": 1.0}}}, "quantities must be a mapping such as"),
        ({"quantities": {"": {"x1": 1.0}}}, "quantities must be a mapping such as"),
        ({"quantities": {"twist": None}}, "weights of 'twist' must be real numbers"),
        ({"exact": quadratic_redesign}, "exact must be a plan such as .* got <function quadratic_redesign"),
        ({"exact": outcome}, "exact must be a plan"),
        ({"method": None}, "method must be a function such as .* got None"),
        ({"method": lambda *_, **__: None}, "method must return plans, as .* got None"),
    ],
)
def test_what_a_sweep_cannot_use(options: dict[str, Any], message: str) -> None:
    with pytest.raises(RedesignError, match=message):
        pareto_sweep(NONMINIMUM, there_and_back(), weights=[{"R": 1.0, "Q_y": 1.0}], **options)


def test_an_outcome_needs_a_plan() -> None:
    with pytest.raises(RedesignError, match=r"expected a plan such as .* got None"):
        outcome(None)  # type: ignore[arg-type]


def test_weights_may_come_one_after_the_other() -> None:
    points = [{"R": 1.0, "Q_y": q_y} for q_y in (1.0, 5.0)]
    assert pareto_sweep(NONMINIMUM, there_and_back(), weights=iter(points)).weights == tuple(points)  # type: ignore[arg-type]


def test_an_outcome_of_exact_inversion_has_no_error() -> None:
    found = outcome(invert(NONMINIMUM, there_and_back()))
    assert found.max_error < 1e-12
    assert found.peaks == {}


def test_quantities_by_state_names_are_the_same_as_by_number() -> None:
    plan = quadratic_redesign(NONMINIMUM, there_and_back(), R=0.1, Q_y=1.0)
    named, numbered = outcome(plan, {"q": {"x1": 2.0, "x3": -1.0}}), outcome(plan, {"q": [2.0, 0.0, -1.0]})
    assert named.peaks == numbered.peaks
    with pytest.raises(RedesignError, match=r"'q': expected weights of some of the states .* of which \['tip'\] are unknown"):
        outcome(plan, {"q": {"tip": 1.0}})
