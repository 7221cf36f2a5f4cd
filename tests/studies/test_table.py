"""The table is complete at every width and plain where it is not on a terminal."""

from __future__ import annotations

import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from invtrack.errors import InvtrackError
from invtrack.studies.table import Cell, Column, print_table, short_number

COLUMNS = [
    Column("max error", "m"),
    Column("residual vibration", "m"),
    Column("peak input", "N"),
    Column("preactuation time", "s"),
    Column("steps"),
]
ROWS: dict[str, dict[str, Cell]] = {
    "feedforward_only": {
        "max_error": 1.234e-7, "residual_vibration": 9.999e-12, "peak_input": -268.0, "preactuation_time": 19.6, "steps": 12000,
    },
    "feedback_only": {
        "max_error": 0.5, "residual_vibration": None, "peak_input": 3.1, "preactuation_time": 0.0, "steps": 12000,
    },
}  # fmt: skip


def printed(width: int) -> str:
    console = Console(file=io.StringIO(), width=width, highlight=False)
    print_table("Cantilever [tip]", columns=COLUMNS, rows=ROWS, console=console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [30, 50, 80, 100])
def test_every_number_and_unit_is_there_within_the_width(width: int) -> None:
    text = printed(width)
    for expected in ("1.23e-7", "1.00e-11", "-268", "19.6", "12000", "[m]", "[N]", "[s]", "Cantilever [tip]", "feedback_only"):
        assert expected in text
    assert "…" not in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width


def test_no_control_codes_away_from_a_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    print_table("Runs", columns=COLUMNS, rows=ROWS)
    out = capsys.readouterr().out
    assert "feedback_only" in out
    assert "\x1b" not in out


def test_numbers_end_under_each_other() -> None:
    rows: dict[str, dict[str, Cell]] = {str(i): {"x": value} for i, value in enumerate([-1.5e-12, 2.5, 268.0, 4e100])}
    console = Console(file=io.StringIO(), width=80)
    print_table("", columns=[Column("x")], rows=rows, console=console)
    assert isinstance(console.file, io.StringIO)
    lines = [line for line in console.file.getvalue().splitlines() if line[:1].isdigit()]
    assert [line.split()[1] for line in lines] == ["-1.50e-12", "2.50", "268", "4.00e100"]
    assert len({len(line) for line in lines}) == 1


def test_a_row_without_a_value_is_refused() -> None:
    with pytest.raises(InvtrackError, match=r"row 'exact' has no value 'max_error'; it has: rms_error"):
        print_table("", columns=[Column("max error", "m")], rows={"exact": {"rms_error": 1.0}})


def test_a_row_that_has_nothing_to_show_is_there_with_dashes(capsys: pytest.CaptureFixture[str]) -> None:
    print_table("", columns=[Column("x", "m"), Column("y", "m")], rows={"exact (diverged)": None})
    assert capsys.readouterr().out.splitlines()[-2].split() == ["exact", "(diverged)", "-", "-"]


@given(st.floats(-1.79e308, 1.79e308))
def test_short_numbers_are_right_to_three_digits(value: float) -> None:
    text = short_number(value)
    assert re.fullmatch(r"0|-?\d\.\d\de-?\d+|-?(\d\.\d\d|\d\d\.\d|\d\d\d|0\.0?\d{3})", text)
    # Half a unit of the third digit; a subnormal number has fewer digits of its own.
    assert abs(float(text) - value) <= 0.00501 * abs(value) + 5e-324


def test_what_is_not_defined_is_a_dash_whose_reason_stands_below_once(capsys: pytest.CaptureFixture[str]) -> None:
    reason, other = {"notes": {"x": "no flexible mode"}}, {"notes": {"x": "at least", "hidden": "not shown"}}
    rows: dict[str, dict[str, object]] = {
        "a": {"x": None, **reason},
        "b": {"x": None, **reason},
        "c": {"x": 1.0, **other},
        "d": {"x": 2.0},
    }
    print_table("", columns=[Column("x", "m")], rows=rows)
    out = capsys.readouterr().out
    assert [line.split() for line in out.splitlines() if line[:2] in ("a ", "b ")] == [["a", "-"], ["b", "-"]]
    assert "x (a, b): no flexible mode\nx (c): at least\n" in out
    assert "not shown" not in out
