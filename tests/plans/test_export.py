"""Exported plans: held input that the plant follows to second order, files that give back every bit, clear refusals."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.signal
from numpy.typing import NDArray

from invtrack.channels import Channels
from invtrack.errors import FileError, TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.plans.export import export_plan, sampled_plan
from invtrack.plans.plan import Plan
from invtrack.plans.sampled import SampledPlan, read_samples, write_samples
from invtrack.references.profiles import rest_to_rest
from invtrack.references.reference_file import load_reference
from invtrack.references.samples import sampled_reference

Array = NDArray[np.float64]

# (1 - s) / ((s + 1) (s + 2)): stable, one antistable zero, relative degree 1.
PLANT = StateSpace(
    [[0.0, 1.0], [-2.0, -3.0]],
    [[0.0], [1.0]],
    [[1.0, -1.0]],
    inputs=Channels(["force"], ["N"]),
    outputs=Channels(["tip"], ["m"]),
    states=["q", "q'"],
)


@cache
def plan_of(smoothness: int) -> Plan:
    """With smoothness 0 the input jumps at both ends of the manoeuvre, which no rate meets."""
    return invert(PLANT, rest_to_rest(0.0, 1.0, np.pi, smoothness=smoothness))


def output_error(table: SampledPlan, rate: float) -> float:
    """Largest error of the plant's output at the instants, its input held over each period, from the table's first state."""
    A, B, C, _, _ = scipy.signal.cont2discrete((PLANT.A, PLANT.B, PLANT.C, PLANT.D), 1.0 / rate, method="zoh")
    x, worst = table.x_ref[0], 0.0
    for u, y_d in zip(table.u_ff, table.y_d, strict=True):
        worst = max(worst, float(np.max(np.abs(C @ x - y_d))))
        x = A @ x + B @ u
    return worst


@pytest.mark.parametrize(
    ("inputs", "smoothness", "order"),
    [("midpoint", 2, 2), ("midpoint", 0, 2), ("average", 2, 2), ("average", 0, 2), ("sample", 2, 1)],
)
def test_held_input_drives_the_plant_along_the_plan(inputs: Any, smoothness: int, order: int) -> None:
    rates = 10.0 * 2.0 ** np.arange(5)
    plan = plan_of(smoothness)
    errors = [output_error(sampled_plan(plan, rate=rate, inputs=inputs), rate) for rate in rates]
    slope = -np.polyfit(np.log(rates), np.log(errors), 1)[0]
    assert abs(slope - order) < 0.2
    assert errors[-1] < 1e-4 or order == 1


def test_average_keeps_the_impulse_of_every_hold() -> None:
    plan, rate = plan_of(0), 3.0
    table = sampled_plan(plan, rate=rate, inputs="average", start=-1.0, end=4.0)
    for t, u in zip(table.time, table.u_ff[:, 0], strict=True):
        cuts = [t, *(b for b in plan.breakpoints if t < b < t + 1 / rate), t + 1 / rate]
        impulse = sum(
            scipy.integrate.quad(lambda s, m=(a + b) / 2: plan(s, inside=m).u[0, 0], a, b, epsabs=1e-12)[0]
            for a, b in pairwise(cuts)
        )
        assert u / rate == pytest.approx(impulse, abs=1e-10)


def test_a_hold_across_a_jump_weighs_both_sides_by_their_time() -> None:
    plan = plan_of(0)
    table = sampled_plan(plan, rate=1.0, start=-0.25, end=0.75)  # the input jumps at 0
    before, after = plan([-0.125, 0.375]).u[:, 0]
    assert table.u_ff[0, 0] == pytest.approx(0.25 * before + 0.75 * after, rel=1e-14)
    assert abs(np.diff(plan([0.0, 0.0], inside=[-1.0, 1.0]).u[:, 0])) > 0.1


def test_instants_cover_the_plan_and_their_values_are_the_plans() -> None:
    plan = plan_of(2)
    table = sampled_plan(plan, rate=100.0)
    assert table.time[0] == plan.start
    assert table.time[-1] <= plan.end < table.time[-1] + 0.01
    np.testing.assert_allclose(np.diff(table.time), 0.01, rtol=1e-9)
    values = plan(table.time)
    for array, expected in ((table.x_ref, values.x), (table.y_d, values.y_d), (table.y, values.y)):
        np.testing.assert_allclose(array, expected, rtol=0, atol=1e-14)
    assert table.names == {"u_ff": ("force [N]",), "x_ref": ("q", "q'"), "y_d": ("tip [m]",), "y": ("tip [m]",)}
    cut = sampled_plan(plan, rate=10.0, start=0.3, end=1.0)
    np.testing.assert_allclose(cut.time, [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0], rtol=1e-15)


def test_an_instant_on_a_breakpoint_takes_the_right_side_whatever_the_rounding() -> None:
    assert 0.1 + 7 / 10 < 0.8  # the instant that is meant to be 0.8 lies a bit before
    plan = invert(PLANT, rest_to_rest(0.0, 1.0, 2.0, smoothness=0, start_time=0.8))
    table = sampled_plan(plan, rate=10.0, start=0.1, end=1.0, inputs="sample")
    left, right = plan([0.8, 0.8], inside=[0.7, 0.9]).u[:, 0]
    assert table.u_ff[7, 0] == pytest.approx(right, rel=1e-12)
    assert abs(right - left) > 0.1


def same_bits(one: SampledPlan, other: SampledPlan) -> bool:
    """Whether all numbers and texts agree to the last bit."""
    arrays = ("time", "u_ff", "x_ref", "y_d", "y")
    texts = (dict(one.names), one.notes, one.origin) == (dict(other.names), other.notes, other.origin)
    return texts and all(getattr(one, name).tobytes() == getattr(other, name).tobytes() for name in arrays)


def test_a_plan_comes_back_bit_for_bit(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    assert export_plan(plan_of(2), path, rate=37.0) == path
    table = sampled_plan(plan_of(2), rate=37.0)
    assert same_bits(read_samples(path), table)
    odd = replace(table, names={**table.names, "y": ('tip [m, "true"]',)})
    assert not same_bits(odd, table)
    assert same_bits(read_samples(write_samples(odd, path)), odd)
    assert os.listdir(tmp_path) == [path.name]


def test_extreme_numbers_survive(tmp_path: Path) -> None:
    numbers = np.array([[-0.0], [5e-324], [np.nextafter(1.0, 2.0)], [-1.7976931348623157e308], [0.1]])
    names = dict.fromkeys(("u_ff", "x_ref", "y_d", "y"), ("a",))
    table = SampledPlan(np.arange(5.0) / 3.0, numbers, -numbers, numbers[::-1], numbers / 3.0, names)
    assert same_bits(read_samples(write_samples(table, tmp_path / "table.csv")), table)


def test_csv_opens_in_ordinary_readers_and_as_a_reference(tmp_path: Path) -> None:
    path = export_plan(plan_of(2), tmp_path / "table.csv", rate=50.0)
    table = read_samples(path)
    plain = np.genfromtxt(path, delimiter=",", names=True)
    assert np.array_equal(plain[plain.dtype.names[0]], table.time)
    assert np.array_equal(plain[plain.dtype.names[1]], table.u_ff[:, 0])
    lines = path.read_text().splitlines()
    assert lines[0] == "time [s],u_ff.force [N],x_ref.q,x_ref.q',y_d.tip [m],y.tip [m]"
    comments = "\n".join(line for line in lines if line.startswith("#"))
    for word in (
        "stable inversion",
        "50 Hz",
        "midpoint",
        "middle of the hold",
        "manoeuvre",
        "preactuation",
        "certificate",
        "rest within 1e-10",
    ):
        assert word in comments
    reference = load_reference(path, channels=["y_d.tip"])
    assert np.array_equal(reference(table.time), table.y_d)


def test_a_hundred_thousand_rows_of_a_sampled_reference(tmp_path: Path) -> None:
    times = np.linspace(0.0, np.pi, 50)
    plan = invert(PLANT, sampled_reference(times, np.sin(times) ** 2))
    rate = 100_000 / (plan.end - plan.start)
    table = read_samples(export_plan(plan, tmp_path / "table.csv", rate=rate))
    assert abs(len(table.time) - 100_001) <= 1
    np.testing.assert_allclose(table.y, table.y_d, atol=1e-9)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = export_plan(plan_of(2), tmp_path / "table.csv", rate=10.0)
    old = path.read_bytes()

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(FileError, match=r"cannot write .*table\.csv: No space left"):
        export_plan(plan_of(2), path, rate=20.0)
    assert path.read_bytes() == old
    assert os.listdir(tmp_path) == ["table.csv"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 0.0}, r"rate must be a positive number .* got 0\.0"),
        ({"rate": np.nan}, r"rate must be a positive"),
        ({"rate": 10.0, "start": 1.0, "end": 0.0}, r"start <= end.* got start 1\.0 and end 0\.0"),
        ({"rate": 10.0, "end": np.inf}, r"start <= end"),
        ({"rate": 1e12}, r"rows, expected at most"),
        ({"rate": 10.0, "inputs": "middle"}, r"'midpoint', 'average', 'sample', got 'middle'"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        sampled_plan(plan_of(2), **options)


def test_bad_paths_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"ends in \.csv, got 'table\.mat'"):
        export_plan(plan_of(2), tmp_path / "table.mat", rate=10.0)
    with pytest.raises(FileError, match=r"cannot write .*No such file or directory"):
        export_plan(plan_of(2), tmp_path / "absent" / "table.csv", rate=10.0)
    with pytest.raises(FileError, match=r"cannot read .*No such file"):
        read_samples(tmp_path / "absent.csv")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            b"time [s],u_ff.a,y.a\n0,1,2\n",
            r"is not a plan file: expected columns time, u_ff, x_ref, y_d, y .* got: time \[s\]",
        ),
        (b"time [s],y.a,u_ff.a,x_ref.b,y_d.a\n0,1,2,3,4\n", r"is not a plan file"),
        (b"time [s],u_ff.a,x_ref.b,y_d.a,y.a\n0,1,2,3\n", r"line 2: expected 5 cells"),
    ],
)
def test_files_that_hold_no_plan_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "table.csv").write_bytes(content)
    with pytest.raises(FileError, match=message):
        read_samples(tmp_path / "table.csv")


def test_samples_of_wrong_shapes_are_refused() -> None:
    table = sampled_plan(plan_of(2), rate=10.0)
    with pytest.raises(TrajectoryError, match=r"u_ff has shape \(3, 1\), expected"):
        SampledPlan(table.time, table.u_ff[:3], table.x_ref, table.y_d, table.y, table.names)
