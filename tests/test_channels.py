"""Channels: names, units, and what fits what."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import invtrack
from invtrack.channels import Channels
from invtrack.errors import ChannelError
from tests.simulation.rigs import cantilever_rig

CHANNELS = Channels(["tip", "angle", "ratio"], ["m", "rad", ""])


def test_channels_by_name_position_and_label() -> None:
    assert (len(CHANNELS), CHANNELS.index("angle"), "tip" in CHANNELS, "base" in CHANNELS) == (3, 1, True, False)
    assert CHANNELS.labels == ("tip [m]", "angle [rad]", "ratio")
    assert str(CHANNELS) == "tip [m], angle [rad], ratio"
    assert str(Channels()) == "none"
    assert Channels.numbered("u", 2) == Channels(("u1", "u2"), ("", ""))
    assert Channels.of(CHANNELS) is CHANNELS
    assert Channels.of(["tip"]).units == ("",)


def test_a_subset_is_in_the_order_asked_for() -> None:
    assert CHANNELS.subset(["ratio", "tip"]) == Channels(["ratio", "tip"], ["", "m"])
    assert CHANNELS.with_units({"ratio": "1", "other": "N"}).units == ("m", "rad", "1")


def test_an_unknown_unit_fits_any_and_another_one_does_not() -> None:
    assert Channels(CHANNELS.names) != CHANNELS
    assert CHANNELS.fits(Channels(CHANNELS.names))
    assert not CHANNELS.fits(CHANNELS.with_units({"tip": "mm"}))
    assert not CHANNELS.fits(CHANNELS.subset(["angle", "tip", "ratio"]))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Channels(["a", "a"]), r"expected distinct names of channels, got \['a', 'a'\]"),
        (lambda: Channels(["a", "b"], ["m"]), r"expected one unit for each of the channels \['a', 'b'\], got \['m'\]"),
        (lambda: Channels("tip"), "expected a list of names such as .*'tip'"),
        (lambda: Channels(["a"], "m"), "expected a list of units such as .*'m'"),
        (lambda: CHANNELS.index("base"), "no channel is named 'base'; there are: tip, angle, ratio"),
        (lambda: CHANNELS.subset(["tip", "base"]), "no channel is named 'base'"),
    ],
)
def test_bad_channels_are_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(ChannelError, match=message):
        build()


def test_units_reach_the_run_from_the_plant_without_being_asked_for() -> None:
    rig = cantilever_rig(1e-3, measurements=("base_position", "tip_position"))
    plan = rig.plan
    assert (plan.model.states, plan.model.inputs, plan.model.outputs) == (rig.plant.states, rig.plant.inputs, rig.plant.outputs)
    assert plan.model.measurements == rig.plant.measurements
    assert rig.model.systems[0].transformed(np.eye(6)).outputs == rig.plant.outputs
    for plant in (rig.plant, invtrack.LinearPlant(rig.model)):
        run = invtrack.simulate(plant, rig.controller, timestep=0.02, start=0.0, end=1.0, initial_state=plan(0.0).x[0])
        assert run.state.channels == run.state_reference.channels == rig.plant.states
        assert run.output.channels == run.reference.channels == Channels(["tip_position"], ["m"])
        assert run.applied.channels == Channels(["base_force"], ["N"])
