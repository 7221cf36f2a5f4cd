"""The pytest plugin: runs for tests, parameters that are off, and the recording and a figure of what failed.

pytest imports this module in every run wherever invtrack is installed. It loads nothing but the standard library until a test asks
for a run, and touches no report but those of tests that have one.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from invtrack.plans.plan import Plan
    from invtrack.results.result import RunResult
    from invtrack.testing.artifacts import Artifacts
    from invtrack.testing.ringing import Oscillation
    from invtrack.testing.run_cache import RunCache

KEEP = ("failure", "always", "never")
FACTORS = "invtrack_factors"
KEPT = "invtrack"
"""Name of the section of a report, and of the property of a test, that say where its recording and figure are."""


class _Session:
    """What the plugin holds while pytest runs. runs: where runs come from, once a test has asked for one."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._artifacts: Artifacts | None = None
        self.runs: RunCache | None = None
        self.keep: str = config.getoption("invtrack_keep") or config.getini("invtrack_keep")
        if self.keep not in KEEP:
            raise pytest.UsageError(f"invtrack_keep must be one of {', '.join(KEEP)}, got {self.keep!r}")

    @property
    def artifacts(self) -> Artifacts:
        from invtrack.testing.artifacts import Artifacts

        if self._artifacts is None:
            self._artifacts = Artifacts(self._folder())
        return self._artifacts

    def _folder(self) -> Path:
        """Where it is said; pytest's cache, where the same test finds the same place again; without one a temporary folder."""
        config = self._config
        if stated := config.getoption("invtrack_artifacts"):
            return Path(config.invocation_params.dir, stated)
        if stated := config.getini("invtrack_artifacts"):
            return Path(config.rootpath, stated)
        cache = getattr(config, "cache", None)
        return Path(cache.mkdir(KEPT) if cache is not None else tempfile.mkdtemp(prefix="invtrack-"))


_SESSION = pytest.StashKey[_Session]()

Reporting = Generator[None, pytest.TestReport, pytest.TestReport]


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("invtrack", "runs of controllers (invtrack)")
    group.addoption(
        "--invtrack-keep",
        choices=KEEP,
        help="keep the recording and a figure of the runs of tests that fail, of all tests, or of none (default: failure)",
    )
    group.addoption(
        "--invtrack-artifacts",
        metavar="DIR",
        help="folder for recordings and figures, each test's in a folder of its own (default: in pytest's cache)",
    )
    parser.addini("invtrack_keep", f"{', '.join(KEEP)}: as --invtrack-keep", default="failure")
    parser.addini("invtrack_artifacts", "folder from the root directory: as --invtrack-artifacts", default="")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        f"{FACTORS}(factors, together=False): run with the named parameters off by each of their factors, one at a time or in all "
        'combinations, and as planned: {"tip_mass": [0.9, 1.1]} (invtrack)',
    )
    config.stash[_SESSION] = _Session(config)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    marker = metafunc.definition.get_closest_marker(FACTORS)
    if marker is None:
        return
    if FACTORS not in metafunc.fixturenames:
        pytest.fail(
            f"{metafunc.definition.nodeid} is marked with {FACTORS}, but neither it nor a fixture of it asks for the fixture of"
            f" that name; write for instance run = invtrack_run(plant, controller, factors={FACTORS})",
            pytrace=False,
        )
    from invtrack.errors import InvtrackError
    from invtrack.testing.factors import factor_cases

    try:
        cases = factor_cases(*marker.args, **marker.kwargs)
    except (InvtrackError, TypeError) as error:
        pytest.fail(f"marker {FACTORS} of {metafunc.definition.nodeid}: {error}", pytrace=False)
    metafunc.parametrize(FACTORS, list(cases.values()), ids=list(cases), indirect=True, scope="session")


@pytest.fixture(scope="session", name=FACTORS)
def _factors(request: pytest.FixtureRequest) -> dict[str, float]:
    """By how much which parameters are off in this test, by their names: nothing, unless it is marked with `invtrack_factors`."""
    return getattr(request, "param", {})


@pytest.fixture(scope="session", name="invtrack_run")
def _run(pytestconfig: pytest.Config) -> RunCache:
    """invtrack_run(plant, controller, **options) -> RunResult: simulated once in the session, however many tests ask for it.

    See `invtrack.testing.RunCache`: with `reference` the controller may be a function that designs one, `factors` says by how much
    parameters are off, and the options are those of `invtrack.simulate`.
    """
    from invtrack.testing.run_cache import RunCache

    session = pytestconfig.stash[_SESSION]
    session.runs = RunCache()
    return session.runs


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Reporting:
    report = yield
    session = item.config.stash[_SESSION]
    if call.when == "teardown" or session.keep == "never" or "invtrack.results.result" not in sys.modules:
        return report
    runs = _runs_of(item, call, session)
    if runs and (report.failed or (session.keep == "always" and call.when == "call")):
        rings = getattr(call.excinfo.value, "oscillation", None) if call.excinfo is not None else None
        _keep(runs, item, report, session, rings)
    elif runs and report.passed and call.when == "call":
        session.artifacts.discard(item.nodeid)
    return report


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    runs = item.config.stash[_SESSION].runs
    if runs is not None:
        runs.handed_out.clear()


def pytest_terminal_summary(terminalreporter: Any) -> None:
    reports = [report for category in terminalreporter.stats.values() for report in category]
    properties = [entry for report in reports for entry in getattr(report, "user_properties", ())]
    paths = dict.fromkeys(value for name, value in properties if name == KEPT)
    if paths:
        terminalreporter.section("runs kept (invtrack)")
        for path in paths:
            terminalreporter.write_line(path)


def _runs_of(item: pytest.Item, call: pytest.CallInfo[None], session: _Session) -> list[RunResult]:
    """The run that an assertion of ours has failed for; or all that the test, or a fixture for it, asked for or was given."""
    from invtrack.results.result import RunResult

    failed = getattr(call.excinfo.value, "run", None) if call.excinfo is not None else None
    if isinstance(failed, RunResult):
        return [failed]
    given = [run for value in getattr(item, "funcargs", {}).values() for run in _runs_in(value)]
    asked = [] if session.runs is None else session.runs.handed_out
    return list({id(run): run for run in [*given, *asked]}.values())


def _runs_in(value: object) -> Iterator[RunResult]:
    from invtrack.results.result import RunResult

    entries = value.values() if isinstance(value, dict) else value if isinstance(value, (list, tuple)) else [value]
    yield from (entry for entry in entries if isinstance(entry, RunResult))


def _keep(
    runs: list[RunResult], item: pytest.Item, report: pytest.TestReport, session: _Session, rings: Oscillation | None
) -> None:
    """Keep the runs, and say in the report where they are, and which mode of the plan's model rings."""
    lines = []
    for run in runs:
        kept = session.artifacts.keep(run, item.nodeid)
        lines += [f"run {run.name!r}", *(f"  {what:<9}  {path}" for what, path in kept.items())]
        plan = None if session.runs is None else session.runs.plan_of(run)
        if rings is not None and plan is not None:
            lines.append(f"  {'mode':<9}  {_mode(plan, rings)}")
        paths = [(KEPT, path) for path in kept.values() if os.path.exists(path)]
        item.user_properties += paths  # what the report of the teardown, and so JUnit XML, has
        report.user_properties += paths
    report.sections.append((KEPT, "\n".join(lines)))


def _mode(plan: Plan, rings: Oscillation) -> str:
    """The mode of the plan's model that rings, as far as its frequency tells."""
    from invtrack.testing.ringing import nearest_mode

    mode = nearest_mode(plan.model.systems[-1], rings.frequency)
    if mode is None:
        return "the plan's model has no oscillatory mode"
    return (
        f"nearest to {rings.frequency:.4g} Hz in the plan's model, without feedback: {mode.frequency:.4g} Hz, damping ratio "
        f"{mode.damping:.2g}, of {', '.join(mode.states)}"
    )
