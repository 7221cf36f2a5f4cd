"""The plugin in runs of pytest of its own: outcomes, messages, kept files, options, with and without xdist."""

from __future__ import annotations

import re
from importlib.metadata import entry_points
from pathlib import Path

import matplotlib as mpl
import pytest

import invtrack
from tests.testing.arm import ARM

INSTALLED = bool(entry_points(group="pytest11", name="invtrack"))

FIXTURES = """
import pytest
import invtrack
from arm import REFERENCE, arm, design
from invtrack.testing import assert_peak_input, assert_residual_vibration, assert_settles, assert_tracks


@pytest.fixture(scope="module")
def run(invtrack_run, invtrack_factors):
    return invtrack_run(arm(), design, reference=REFERENCE, factors=invtrack_factors, timestep=5e-3)
"""

TESTS = """
SIMULATED = []


@pytest.fixture(scope="module", autouse=True)
def counted():
    simulate = invtrack.simulate
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("invtrack.testing.run_cache.simulate", lambda *a, **k: SIMULATED.append(k["name"]) or simulate(*a, **k))
        yield


def test_settles(run):
    assert_settles(run, within=0.2, after=0.5)


def test_tracks(run):
    assert_tracks(run, within=0.2)


def test_does_not_settle(run):
    assert_settles(run, within=1e-6, after=0.5)


def test_another_assertion(run):
    assert invtrack.max_error(run) < 1e-6


@pytest.mark.invtrack_factors({"load": [1.5]})
def test_heavy(run):
    assert_settles(run, within=0.2, after=0.5)


def test_asks_itself(invtrack_run):
    run = invtrack_run(arm(), design, reference=REFERENCE, timestep=5e-3)
    assert_peak_input(run, at_most=1e-3)


def test_how_often():
    assert SIMULATED == ["arm", "arm, load-x1.5"]
"""


@pytest.fixture(autouse=True)
def _fonts(monkeypatch: pytest.MonkeyPatch) -> None:
    """matplotlib finds the fonts that it knows, although pytester moves the home folder: looking for them takes seconds."""
    monkeypatch.setenv("MPLCONFIGDIR", mpl.get_cachedir())


@pytest.fixture
def suite(pytester: pytest.Pytester) -> pytest.Pytester:
    """A folder with the mechanism and a module of tests."""
    pytester.makepyfile(arm=(Path(__file__).parent / "arm.py").read_text(), test_arm=FIXTURES + TESTS)
    return pytester


def pytest_run(suite: pytest.Pytester, *arguments: str) -> pytest.RunResult:
    plugin = () if INSTALLED else ("-p", "invtrack.testing.plugin")
    return suite.runpytest_subprocess("-p", "no:randomly", *plugin, *arguments)


def kept(folder: Path) -> list[str]:
    """Tests and endings of what is kept in a folder, without the digests in the names."""
    return sorted(
        re.sub(r"-[0-9a-f]{6}(?=/|\.)", "", path.relative_to(folder).as_posix()) for path in folder.rglob("*.*") if path.is_file()
    )


def test_one_run_serves_all_and_what_failed_is_kept_and_said_until_it_passes(suite: pytest.Pytester) -> None:
    result = pytest_run(suite)
    result.assert_outcomes(passed=5, failed=3)
    text = result.stdout.str()
    assert re.search(r"E +invtrack.testing.assertions.RunAssertionError: run 'arm' of 'arm': body:load:x does not settle", text)
    assert re.search(r"E +measured +\|y - y_d\| = \S+ m at t = \S+ s, \S+ s after the manoeuvre", text)
    assert re.search(r"E +rings +at \S+ Hz", text)
    assert re.search(
        r"mode +nearest to \S+ Hz in the plan's model, without feedback: 1.739 Hz, damping ratio 0.068, of flex \[m\]", text
    )
    assert not re.search(r"__tracebackhide__|raise RunAssertionError", text)
    folder = suite.path / ".pytest_cache" / "d" / "invtrack"
    assert kept(folder) == [f"test_arm.py-test_does_not_settle/arm.{ending}" for ending in ("parquet", "png", "rrd")]
    (recording,) = folder.rglob("*.rrd")
    (figure,) = folder.rglob("*.png")
    assert text.count(f"recording  {recording}") == 3
    assert text.count(f"figure     {figure}") == 3
    assert re.search(rf"= runs kept \(invtrack\) =+\n{re.escape(str(recording))}\n{re.escape(str(figure))}\n=", text)
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert invtrack.load_recording(recording)["arm"].output.channels.names == ("body:load:x",)
    suite.makepyfile(test_arm=(FIXTURES + TESTS).replace("within=1e-6", "within=0.2"))
    pytest_run(suite, "-k", "test_does_not_settle").assert_outcomes(passed=1, deselected=7)
    assert not kept(folder)


def test_under_xdist_each_worker_keeps_its_own_and_all_is_said(suite: pytest.Pytester) -> None:
    result = pytest_run(suite, "-n", "2", "--dist", "load", "--invtrack-artifacts", "artefacts", "-k", "not test_how_often")
    result.assert_outcomes(passed=4, failed=3)
    paths = kept(suite.path / "artefacts")
    assert {path.partition("/")[0] for path in paths} <= {
        f"test_arm.py-test_{name}" for name in ("does_not_settle", "another_assertion", "asks_itself")
    }
    assert 3 <= len(paths) <= 9
    section = result.stdout.str().partition("runs kept (invtrack)")[2]
    assert all(str(path) in section for path in (suite.path / "artefacts").rglob("*.rrd"))


def test_all_are_kept_if_asked_for_with_a_place_from_the_ini_file(suite: pytest.Pytester) -> None:
    suite.makeini("[pytest]\ninvtrack_keep = always\ninvtrack_artifacts = out/runs\n")
    pytest_run(suite, "-k", "test_tracks or test_heavy").assert_outcomes(passed=3, deselected=5)
    names = ("test_heavy-load-x1.5/arm-load-x1.5", "test_tracks/arm")
    expected = [f"test_arm.py-{name}.{ending}" for name in names for ending in ("parquet", "png", "rrd")]
    assert kept(suite.path / "out" / "runs") == expected


def test_nothing_is_kept_if_that_is_asked_for(suite: pytest.Pytester) -> None:
    result = pytest_run(suite, "--invtrack-keep=never", "--invtrack-artifacts", "out", "-k", "test_does_not_settle")
    result.assert_outcomes(failed=1, deselected=7)
    assert not (suite.path / "out").exists()
    assert "runs kept" not in result.stdout.str()


def test_what_cannot_be_written_is_said_and_breaks_nothing(suite: pytest.Pytester) -> None:
    (suite.path / "file").write_text("no folder")
    result = pytest_run(suite, "--invtrack-artifacts", "file", "-k", "test_does_not_settle")
    result.assert_outcomes(failed=1, deselected=7)
    result.stdout.re_match_lines([r"  recording  not kept: .*cannot write", r"  figure     not drawn: "], consecutive=True)


def test_a_run_without_it_loads_nothing(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        "import sys\ndef test():\n    assert not {'numpy', 'mujoco', 'rerun', 'matplotlib', 'scipy'} & set(sys.modules)\n"
    )
    result = pytest_run(pytester, "-p", "no:hypothesispytest", "-p", "no:xdist", "--invtrack-keep=always")
    result.assert_outcomes(passed=1)
    pytest_run(pytester, "--markers").stdout.fnmatch_lines(["@pytest.mark.invtrack_factors(factors, together=False): *"])


def test_a_marker_that_says_nothing_is_an_error(pytester: pytest.Pytester) -> None:
    mark = "import pytest\n@pytest.mark.invtrack_factors"
    pytester.makepyfile(
        test_unused=f"{mark}({{'load': [1.1]}})\ndef test(): pass",
        test_number=f"{mark}({{'load': 1.1}})\ndef test(invtrack_factors): pass",
        test_empty=f"{mark}()\ndef test(invtrack_factors): pass",
    )
    result = pytest_run(pytester)
    result.assert_outcomes(errors=3)
    text = re.sub(r"\s+", " ", result.stdout.str())
    assert (
        "test_unused.py::test is marked with invtrack_factors, but neither it nor a fixture of it asks for the fixture of" in text
    )
    assert "marker invtrack_factors of test_number.py::test: factors of 'load' must be a list of factors such as [0.9, 1.1]" in text
    assert re.search("marker invtrack_factors of test_empty.py::test: .*missing 1 required positional argument: 'factors'", text)


def test_a_word_that_is_no_choice_is_a_usage_error(pytester: pytest.Pytester) -> None:
    pytester.makeini("[pytest]\ninvtrack_keep = sometimes\n")
    result = pytest_run(pytester)
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*invtrack_keep must be one of failure, always, never, got 'sometimes'"])


def test_the_documented_module_fails_as_documented(pytester: pytest.Pytester) -> None:
    """That it passes as it stands is tested with the other programs of the documents."""
    document = (Path(__file__).parents[2] / "docs" / "guide" / "testing.md").read_text(encoding="utf-8")
    (module,), (said,) = (
        re.findall(rf"^```{kind}\n(.*?)^```", document, re.MULTILINE | re.DOTALL) for kind in ('python title="test_arm.py"', "text")
    )
    (pytester.path / "arm.xml").write_text(ARM.format(stiffness=40, mass=0.5))
    pytester.makepyfile(test_arm=module.replace("Q=100.0, R=0.01", "Q=1.0, R=1.0"))
    result = pytest_run(pytester, "-k", "load-x1.1")
    result.assert_outcomes(failed=1, deselected=4)
    shown = [without_digests(line) for line in result.stdout.str().splitlines()]
    for line in said.splitlines():
        expected = line.partition("RunAssertionError: ")[2] or line.removeprefix("E").strip()
        expected = without_digests(re.sub(r"^(recording|figure) +", "", expected))
        alike = [other for other in shown if NUMBER.sub("#", expected) in NUMBER.sub("#", other)]
        assert alike, f"{expected!r} is not in {shown}"
        if "pytest_cache" not in expected:
            values = [[float(value) for value in NUMBER.findall(text)] for text in (expected, alike[0])]
            assert values[1] == pytest.approx(values[0], rel=0.1)


NUMBER = re.compile(r"\d+\.?\d*(?:e-?\d+)?")


def without_digests(text: str) -> str:
    return re.sub(r"-[0-9a-f]{6}(?=/|\.)", "", text)
