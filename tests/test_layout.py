"""Tables as text keep their columns apart, however many outputs there are and however long names and numbers are."""

from __future__ import annotations

import re

import numpy as np
import pytest

from invtrack.channels import Channels
from invtrack.inversion.feasibility import feasibility
from invtrack.layout import aligned
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zero_report
from invtrack.references.profiles import rest_to_rest
from invtrack.references.reference_report import reference_report
from tests.linear.random_plants import block, plant_with

OUTPUTS = 7
NAMES = Channels([f"site:end_effector_of_the_left_arm_{i}:x" for i in range(OUTPUTS)], ["kg m^2/s^2/rad"] * OUTPUTS)


def cells(line: str) -> list[str]:
    """The cells of a line: what two blanks or more keep apart."""
    return re.split(r" {2,}", line.strip())


def many_outputs(links: float = 0.45) -> StateSpace:
    """Seven double integrators that act on one another."""
    none, one = np.zeros((OUTPUTS, OUTPUTS)), np.eye(OUTPUTS)
    B = one + links * np.eye(OUTPUTS, k=1)
    return StateSpace(np.block([[none, one], [none, none]]), np.vstack([none, B]), np.hstack([one, none]), outputs=NAMES)


def test_columns_begin_where_their_head_does() -> None:
    rows = [("a", "a cell much longer than its head", "1"), ("", "b", "22")]
    head, *lines = aligned(("first", "second", "third"), rows)
    for row, line in zip(rows, lines, strict=True):
        assert line[head.index("second") :].startswith(row[1])
        assert line[head.index("third") :] == row[2]


def test_feasibility_of_seven_outputs() -> None:
    switched = SwitchedSystem([many_outputs(), many_outputs(0.1)], [0.5])
    lines = str(feasibility(switched, rest_to_rest(np.zeros(OUTPUTS), np.ones(OUTPUTS), duration=1.0))).splitlines()
    first = next(i for i, line in enumerate(lines) if "rel. degree" in line)
    assert [len(cells(line)) for line in lines[first : first + 3]] == [8, 8, 8]
    assert cells(lines[first + 1])[2] == "2, 2, 2, 2, 2, 2, 2"
    assert float(cells(lines[first + 1])[3]) > 1.0


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_zeros_with_long_numbers(scale: float) -> None:
    plant = plant_with(np.random.default_rng(0), (2,), block(-1.234567e-4 + 4.321321j, -5.0, 3.0), mixed=False)
    report = zero_report(StateSpace(plant.A * scale, plant.B * scale, plant.C))
    head, *lines = str(report).splitlines()[1:5]
    assert cells(head) == ["zero [rad/s]", "side", "time constant [s]", "frequency [rad/s]", "kind"]
    assert len(lines) == 3
    assert [cells(line)[4] for line in lines] == ["transmission zero"] * 3
    assert float(cells(lines[0])[0]) == pytest.approx(-5.0 * scale, rel=1e-3)


def test_a_reference_of_seven_outputs_with_long_units() -> None:
    reference = rest_to_rest(np.zeros(OUTPUTS), np.full(OUTPUTS, 1.23456e-12), duration=1e-7)
    report = str(reference_report(reference, channels=NAMES))
    for name, text in zip(NAMES.names, report.split("\n  order")[1:], strict=True):
        rows = text.splitlines()[1:4]
        assert name in report
        assert [len(cells(row)) for row in rows] == [4, 4, 4]
