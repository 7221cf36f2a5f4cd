"""Reports: what they say, that nothing in them is markup that should be text, and how a browser lays them out."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.advice import Advice, ways
from invtrack.command import main
from invtrack.errors import FileError, InvtrackError
from invtrack.report import write_report
from invtrack.report.verdict import percent, verdict
from invtrack.results import Event, RunResult
from invtrack.studies import Case, Setup, Study, StudyOptions
from invtrack.studies.folder import RunFolder
from tests.advice.plants import crane, mass
from tests.report.browser import Layout, opened

WIDTHS = (1280, 390)


def driven(model: invtrack.StateSpace, plan: invtrack.Plan, name: str) -> RunResult:
    gains = invtrack.lqr(model, Q=1.0, R=1e-3)
    plant = invtrack.LinearPlant(model, name="crane")
    controller = invtrack.TrackingController(plan, gains)
    return invtrack.simulate(plant, controller, start=-1.0, end=8.0, timestep=1e-2, name=name)


@pytest.fixture(scope="module")
def runs() -> dict[str, RunResult]:
    model, reference = crane(), invtrack.rest_to_rest(0.0, 1.0, 3.0, smoothness=4)
    plans = {
        "exact": invtrack.invert(model, reference),
        "redesign": invtrack.quadratic_redesign(model, reference, R=1e-2, Q_y=1.0),
        "feedback": invtrack.inversion.steady_state_feedforward(model, reference),
    }
    return {name: driven(model, plan, name) for name, plan in plans.items()}


@pytest.fixture(scope="module")
def advice() -> Advice:
    chosen = tuple(way for way in ways.WAYS if way.name in ("stable inversion", "feedback alone", "causal inverse", "ZPETC"))
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(invtrack.advise.__globals__, "WAYS", chosen)
        return invtrack.advise(mass(limit=9.0), invtrack.Move(1.0, 1.0), parameter_errors={"m < 2 kg": mass()}, timestep=1e-2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with a case that tracks, one that does not and one that is refused."""
    out = tmp_path_factory.mktemp("study") / "run"

    def build(options: StudyOptions) -> Setup:
        model, reference = crane(), invtrack.rest_to_rest(0.0, 1.0, 3.0, smoothness=4)
        gains = invtrack.lqr(model, Q=1.0, R=1e-3)
        plans = {
            "exact": lambda: invtrack.invert(model, reference),
            "feedback": lambda: invtrack.inversion.steady_state_feedforward(model, reference),
            "causal": lambda: invtrack.causal_inverse(model, reference),
        }
        plant = invtrack.LinearPlant(model, name="crane <1>")
        refused = {"causal": InvtrackError}
        return Setup(
            [
                Case(
                    name,
                    plant,
                    lambda plan=plan: invtrack.TrackingController(plan(), gains),
                    settings={"start": -1.0, "end": 8.0},
                    refused_by=refused.get(name),
                )
                for name, plan in plans.items()
            ]
        )

    options = StudyOptions(out=out, timestep=1e-2, quiet=True, figures=False)
    Study("cranes", build, defaults=options).run(options)
    return out


@pytest.fixture(scope="module")
def pages(runs: dict[str, RunResult], advice: Advice, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    here = tmp_path_factory.mktemp("pages")
    named = replace(runs["redesign"], name="a" * 80, remarks=("<script>alert(1)</script>",), model="a long & strange <name>")
    with pytest.raises(SystemExit) as left:
        main(["report", str(folder)])
    assert not left.value.code
    written = {"strange": write_report(named, here / "strange.html"), "advice": write_report(advice, here / "advice.html")}
    return {name: path.read_text(encoding="utf-8") for name, path in {**written, "study": folder / "report.html"}.items()}


def verdict_of(page: str) -> str:
    found = re.search(r'<section class="verdict[^>]*"><strong>(.*?)</section>', page)
    assert found is not None
    return " ".join(re.sub("<.*?>", " ", found[1]).split())


def test_the_verdict_says_how_well_it_tracks_and_why_not(pages: dict[str, str], runs: dict[str, RunResult]) -> None:
    share = np.max(np.abs(runs["exact"].output.values - runs["exact"].reference.values))
    found = verdict({"exact": runs["exact"]}, 0.01, reasons={}, plans={})
    assert found.good
    assert found.headline == f"Tracks within {percent(share)} of the motion"
    assert float(percent(share).split()[0]) == pytest.approx(100 * share, rel=5e-3)
    found = verdict(runs, 0.01, reasons={}, plans={})
    assert found.headline == "1 of 3 cases track within 1 %"
    assert found.why.startswith("Best is exact, which misses by ")
    assert verdict_of(pages["strange"]).startswith("Misses by")
    assert "gives up that much of the motion" in verdict_of(pages["strange"])
    assert verdict_of(pages["study"]).startswith("1 of 2 cases track within 1 %")
    assert "steady-state feedforward, is no motion of the plant" in verdict_of(pages["study"])
    assert verdict_of(pages["advice"]).startswith("Take ")


def test_a_limit_that_acts_and_a_run_that_diverged_are_the_reason(runs: dict[str, RunResult]) -> None:
    acting = replace(runs["feedback"], events=(Event(0.5, "limit", "limit of drive, by 3 N", until=0.7),))
    found = verdict({"feedback": acting}, 0.01, reasons={}, plans={})
    assert not found.good
    assert found.why.endswith("limit of drive acts from t = 0.5 s.")
    lost = replace(runs["feedback"], status="diverged", message="stopped at t = 1 s")
    found = verdict({"feedback": lost}, 0.01, reasons={}, plans={})
    assert (found.good, found.headline) == (False, "The run diverged")
    assert found.why.startswith("stopped at t = 1 s")
    found = verdict({}, 0.01, reasons={"causal": "antistable zeros"}, plans={})
    assert (found.good, found.why) == (None, "causal: antistable zeros")


def test_a_study_is_told_whole(pages: dict[str, str], folder: Path) -> None:
    page = pages["study"]
    for text in ("Certificates of the plans", "stable inversion", "causal (refused)", "antistable zeros", "To repeat it", "mujoco"):
        assert text in page
    assert page.count("<svg") == 3
    summary = json.loads((folder / "summary.json").read_text())
    assert set(summary["made_by"]["versions"]) >= {"Python", "invtrack", "numpy"}
    assert summary["plans"]["exact"]["certificate"]["output_error"] < 1e-9


def test_nothing_is_markup_that_should_be_text_and_nothing_is_fetched(pages: dict[str, str]) -> None:
    for page in pages.values():
        assert "<script" not in page
        assert not re.search(r'(src|href)="(?!#|data:)', page)
        assert not re.search(r"url\((?!#)|@import", page)
        ids = re.findall(r' id="([^"]+)"', page)
        assert len(set(ids)) == len(ids)
        assert all(name in ids for name in re.findall(r'href="#([^"]+)"', page))
    assert "&lt;script&gt;alert(1)" in pages["strange"]
    assert "m &lt; 2 kg" in pages["advice"]


@pytest.fixture(scope="module")
def layouts(pages: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[tuple[str, int], Layout], str]:
    return opened(pages, WIDTHS, tmp_path_factory.mktemp("browser"))


def test_in_a_browser_no_page_is_wider_than_its_window(
    layouts: tuple[dict[tuple[str, int], Layout], str], pages: dict[str, str]
) -> None:
    found, _ = layouts
    assert found.keys() == {(name, width) for name in pages for width in WIDTHS}
    for key, layout in found.items():
        assert layout.scroll_width <= layout.client_width, key
        assert not layout.wide, key
        assert layout.verdict_bottom < 600, key


def test_in_a_browser_pages_ask_for_nothing_and_the_console_stays_empty(
    layouts: tuple[dict[tuple[str, int], Layout], str],
) -> None:
    found, console = layouts
    assert all(not layout.requests for layout in found.values())
    assert console == ""


def test_the_page_is_among_the_files_that_the_next_run_removes(pages: dict[str, str], folder: Path) -> None:
    assert "report.html" in json.loads((folder / "summary.json").read_text())["files"]
    again = RunFolder(folder)
    again.begin()
    assert not list(folder.iterdir())


def test_what_there_is_no_report_of_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"expected the folder of a run that has ended, with its summary\.json"):
        write_report(tmp_path)
    for nothing in ([], [1.0]):
        with pytest.raises(InvtrackError, match="expected a folder, an Advice, or at least one run"):
            write_report(nothing, tmp_path / "a.html")
    with pytest.raises(InvtrackError, match="error, a share of the motion"):
        write_report(tmp_path, error=2.0)
