"""The torsional rig of the papers, at the weights of the papers: how much output buys how much input and twist."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.inversion.exact import invert
from invtrack.redesign.cost import cost
from invtrack.redesign.prefilter.prefilter import prefilter
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import rest_to_rest
from tests.redesign.plants import TWIST, TWO_DISC, TWO_DISC_WEIGHTS

TIMES = np.linspace(-100.0, 150.0, 25_001)


def traded(duration: float) -> tuple[float, float, float]:
    """Largest change of the output as a share of the slew; shares by which the peaks of input and of twist fall."""
    reference = rest_to_rest(0.0, 1.0, duration)
    ours, exact = quadratic_redesign(TWO_DISC, reference, **TWO_DISC_WEIGHTS)(TIMES), invert(TWO_DISC, reference)(TIMES)
    peaks = [[np.max(np.abs(at.u)), np.max(np.abs(at.x @ TWIST.T))] for at in (ours, exact)]
    return float(np.max(np.abs(ours.y - ours.y_d))), 1 - peaks[0][0] / peaks[1][0], 1 - peaks[0][1] / peaks[1][1]


def test_a_slew_of_30_seconds() -> None:
    """A tenth of the motion for about 55 % of the input and 32 % of the twist (measured; the papers print 60 % and 20 %)."""
    output, effort, twist = traded(30.0)
    assert output == pytest.approx(0.10, abs=0.01)
    assert effort == pytest.approx(0.55, abs=0.02)
    assert twist == pytest.approx(0.32, abs=0.02)


def test_the_papers_reductions_occur_at_durations_of_their_own() -> None:
    assert traded(27.0)[1] == pytest.approx(0.60, abs=0.02)
    assert traded(41.0)[2] == pytest.approx(0.20, abs=0.02)
    assert traded(5.0)[0] > 0.33


def test_it_comes_to_rest_at_the_target_without_input() -> None:
    plan = quadratic_redesign(TWO_DISC, rest_to_rest(0.2, 1.0, 10.0), **TWO_DISC_WEIGHTS)
    before, after = plan(-2e3), plan(2e3)
    assert before.x[0] == pytest.approx([0.2, 0.0, 0.2, 0.0], abs=1e-9)
    assert after.x[0] == pytest.approx([1.0, 0.0, 1.0, 0.0], abs=1e-9)
    assert np.abs([before.u, after.u]).max() < 1e-9
    assert plan.certificate.rest_residual < 1e-9


def test_the_redesign_costs_less_than_exact_tracking() -> None:
    reference = rest_to_rest(0.0, 1.0, 10.0)
    plan, exact = quadratic_redesign(TWO_DISC, reference, **TWO_DISC_WEIGHTS), invert(TWO_DISC, reference)
    assert cost(plan, **TWO_DISC_WEIGHTS) < 0.5 * cost(exact, **TWO_DISC_WEIGHTS)


@pytest.mark.parametrize("r", [1.0, 1e-2])
def test_time_and_frequency_domain_agree_on_the_slew(r: float) -> None:
    """Two derivations, two algorithms, one optimum."""
    weights = {**TWO_DISC_WEIGHTS, "R": r}
    reference = rest_to_rest(0.0, 1.0, 30.0)
    filtered = prefilter(TWO_DISC, **weights).apply(reference)
    planned = quadratic_redesign(TWO_DISC, reference, **weights)(filtered.time)
    for ours, theirs in ((filtered.u, planned.u), (filtered.y, planned.y), (filtered.x, planned.x)):
        np.testing.assert_allclose(ours, theirs, atol=1e-6 * np.max(np.abs(theirs)))
