"""CSV files as people have them: separators, decimal commas, headers or none, units, and exported plans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.channels import Channels
from invtrack.errors import FileError
from invtrack.references.unit_conversion import conversion, is_unit

TIMES, TIP, ANGLE = np.array([0.0, 0.25, 0.5, 1.25]), np.array([0.0, 0.002, -0.0305, 1.5]), np.array([0.0, 10.0, 90.0, 45.0])
OUTPUTS = Channels(["tip", "angle"], ["m", "rad"])


def written(folder: Path, text: str) -> Path:
    path = folder / "motion.csv"
    path.write_text(text, encoding="utf-8")
    return path


def table(separator: str, *columns: np.ndarray, comma: bool = False) -> str:
    lines = [separator.join(repr(value) for value in row) for row in np.column_stack(columns).tolist()]
    text = "\n".join(lines) + "\n"
    return text.replace(".", ",") if comma else text


def assert_goes_through(signal: invtrack.PiecewiseSignal, *values: np.ndarray) -> None:
    assert np.array_equal(signal.breakpoints, TIMES)
    np.testing.assert_array_equal(signal(TIMES), np.column_stack(values))


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("header", [("time", "tip", "angle"), ("t", "tip", "angle"), ("Time (s)", "tip", "angle"), None])
@pytest.mark.parametrize("comma", [False, True])
def test_separators_decimal_commas_and_missing_headers(
    tmp_path: Path, separator: str, header: tuple[str, ...] | None, comma: bool
) -> None:
    if comma and separator == ",":
        return  # cannot be told apart
    head = "# exported from a spreadsheet\n" + (separator.join(header) + "\n" if header else "")
    path = written(tmp_path, head + table(separator, TIMES, TIP, ANGLE, comma=comma))
    assert_goes_through(invtrack.load_reference(path), TIP, ANGLE)
    assert_goes_through(invtrack.load_reference(path, channels=["tip", "angle"]), TIP, ANGLE)


@pytest.mark.parametrize(
    "header", ["t/ms,angle [deg],tip [mm],note", "time [ms],angle (°),tip (mm),note", "T (ms),angle/degrees,tip/mm,note"]
)
def test_values_come_in_the_units_of_the_outputs(tmp_path: Path, header: str) -> None:
    rows = [
        f"{1e3 * t!r},{a!r},{1e3 * y!r},free text" for t, y, a in zip(*map(np.ndarray.tolist, (TIMES, TIP, ANGLE)), strict=True)
    ]
    signal = invtrack.load_reference(written(tmp_path, "\n".join([header, *rows])), channels=OUTPUTS)
    assert signal.breakpoints == pytest.approx(TIMES, rel=1e-15)
    assert signal(TIMES) == pytest.approx(np.column_stack([TIP, np.deg2rad(ANGLE)]), rel=1e-14)


def test_a_column_without_unit_is_in_that_of_its_output_and_unknown_units_are_left_alone(tmp_path: Path) -> None:
    path = written(tmp_path, "t,tip,angle (left) [furlong]\n" + table(",", TIMES, TIP, ANGLE))
    assert_goes_through(invtrack.load_reference(path, channels=Channels(["tip", "angle (left)"], ["m", ""])), TIP, ANGLE)
    with pytest.raises(FileError, match=r"the column 'angle \(left\) \[furlong\]' in \[rad\] or a unit .*; convert its values"):
        invtrack.load_reference(path, channels=Channels(["angle (left)"], ["rad"]))


def test_a_unit_of_something_else_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "t,tip [deg]\n" + table(",", TIMES, TIP))
    with pytest.raises(FileError, match=r"the column 'tip \[deg\]' in \[m\]"):
        invtrack.load_reference(path, channels=Channels(["tip"], ["m"]))


@pytest.mark.parametrize("channels", [None, ["angle"], Channels(["angle"], ["rad"])])
def test_the_wanted_output_of_an_exported_plan(tmp_path: Path, channels: Channels | list[str] | None) -> None:
    model = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], outputs=Channels(["angle"], ["rad"]))
    reference = invtrack.rest_to_rest(0.0, 1.0, duration=1.0, smoothness=4)
    path = invtrack.export_plan(invtrack.invert(model, reference), tmp_path / "plan.csv", rate=50.0)
    read = invtrack.load_reference(path, channels=channels)
    at = np.linspace(-0.5, 1.5, 101)
    assert read(at) == pytest.approx(reference(at), abs=1e-6)
    assert invtrack.invert(model, read).certificate.dynamics_residual < 1e-8


@pytest.mark.parametrize(
    ("unit", "to", "number"),
    [
        ("mm", "m", 1e-3),
        ("µm", "mm", 1e-3),
        ("deg", "rad", np.pi / 180),
        ("°/s", "rad/s", np.pi / 180),
        ("rpm", "rad/s", np.pi / 30),
        ("min", "s", 60.0),
        ("m/s^2", "mm/ms^2", 1e-3),
        ("cm²", "m^2", 1e-4),
        ("Nm", "N m", 1.0),
        ("kN m/rad", "N m/deg", 1000 * np.pi / 180),
        ("N", "x10 N", 0.1),
        ("x0.1 rad", "rad", 0.1),
        ("kg m^2/s", "g m^2 s^-1", 1e3),
        ("%", "1", 0.01),
        ("anything at all", "anything at all", 1.0),
    ],
)
def test_conversions(unit: str, to: str, number: float) -> None:
    found = conversion(unit, to)
    assert found is not None
    assert found.applied(np.array([2.0])) == pytest.approx(np.array([2.0 * number]), rel=1e-15)


@pytest.mark.parametrize(
    ("unit", "to"), [("m", "rad"), ("N m", "J"), ("Hz", "rad/s"), ("in", "m"), ("", "m"), ("m^", "m"), ("x0 N", "N"), ("m/", "m")]
)
def test_what_is_not_certain_is_not_converted(unit: str, to: str) -> None:
    assert conversion(unit, to) is None


def test_words_are_no_units() -> None:
    assert not any(map(is_unit, ("left", "tip", "", "d", "x", "2", "position")))


def test_decimal_fractions_are_rounded_once() -> None:
    factor = conversion("ms", "s")
    assert factor is not None
    assert factor.applied(np.arange(1000.0)).tolist() == [n / 1000 for n in range(1000)]
