"""Reports of runs, of folders of runs, and of advice, as one page each."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from invtrack.advice import Advice, Trial
from invtrack.arguments import file_path, items
from invtrack.arrays import require_share, shown
from invtrack.errors import FileError, InvtrackError
from invtrack.figures import column_figure, comparison_figure, svg_text, tracking_figure
from invtrack.files import replaced_when_complete
from invtrack.report.page import Verdict, facts, figure, folded, heading, listed, numbers, page, program, table
from invtrack.report.verdict import share_missed, verdict
from invtrack.results import RunResult, metrics
from invtrack.studies.folder import SUMMARY, add_to_run
from invtrack.studies.table import Column

FILE = "report.html"
"""What a report is called where nothing else is said."""

FAMILIAR = ("stable inversion", "feedback alone")
"""Methods whose motions stand beside the recommended one."""

MOST_FIGURES = 12
"""Runs that are drawn each by itself at most."""

Source = str | Path | RunResult | Sequence[RunResult] | Advice


def write_report(source: Source, path: str | Path | None = None, *, error: float = 0.01) -> Path:
    """Write one self-contained HTML page and return its path: the verdict, a table, figures, and what is needed to repeat it.

        invtrack.report.write_report("runs/run_crane")
        invtrack.report.write_report([exact, feedback], "both.html", error=0.005)

    The page fetches nothing: style and figures (SVG) are inside, there are no scripts. It reads well on a desk, on a phone and in
    print.

    Args:
        source: the folder of a run or study, with the summary and the recordings that it wrote; one run or several; or the Advice
            of `invtrack.advise`.
        path: of the page; report.html in the folder, or here, unless given.
        error: share of the motion within which runs are to track, for the verdict; an Advice has its own.

    Raises InvtrackError for what there is no report of, FileError where a folder holds no summary or the page cannot be written.
    """
    require_share("error, a share of the motion such as 0.01,", error, error=InvtrackError)
    folder = Path(source) if isinstance(source, str | Path) else None
    if isinstance(source, Advice):
        text = _advice(source)
    elif folder is not None:
        text = _folder(folder, error)
    else:
        listed_runs = (
            [source]
            if isinstance(source, RunResult)
            else items("source", source, expected="a folder, runs or an Advice", error=InvtrackError)
        )
        strange = [each for each in listed_runs if not isinstance(each, RunResult)]
        if strange or not listed_runs:
            raise InvtrackError(
                f"expected a folder, an Advice, or at least one run, got {shown(strange[0] if strange else source)}"
            )
        text = _runs({run.name: run for run in listed_runs}, {}, error)
    target = file_path((folder / FILE if folder is not None else FILE) if path is None else path)
    with replaced_when_complete(target) as draft:
        draft.write_text(text, encoding="utf-8")
    if folder is not None and target.parent.resolve() == folder.resolve():
        add_to_run(folder, target.name)
    return target


def _folder(folder: Path, error: float) -> str:
    from invtrack.recording import load_recording  # loads Rerun

    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError) as reason:
        raise FileError(f"{folder}: expected the folder of a run that has ended, with its {SUMMARY}: {reason}") from reason
    if not isinstance(summary, dict) or not isinstance(summary.get("cases"), dict):
        raise FileError(f"{folder / SUMMARY}: expected the summary of a run, with its cases")
    runs: dict[str, RunResult] = {}
    for case in summary["cases"]:
        if (folder / f"{case}.rrd").is_file():
            runs |= load_recording(folder / f"{case}.rrd")
    return _runs(runs, summary, error)


def _runs(runs: Mapping[str, RunResult], summary: Mapping[str, Any], error: float) -> str:
    cases: Mapping[str, Any] = summary.get("cases", {})
    reasons = {name: str(case.get("reason", case.get("status", ""))) for name, case in cases.items() if name not in runs}
    found = verdict(runs, error, reasons=reasons, plans=summary.get("plans", {}))
    model = str(summary.get("model") or ", ".join(dict.fromkeys(run.model for run in runs.values())) or "no runs")
    study = str(summary.get("study", ""))
    title = f"{model}: {', '.join(runs)}" if len(runs) == 1 else f"{model}: {len(runs)} runs"
    sections = [*_numbers(runs, error), *_figures(runs), *_remarks(runs, summary), *_origin(summary, runs)]
    return page(title, f"invtrack report{f' of {study}' if study else ''}", found, sections)


def _numbers(runs: Mapping[str, RunResult], error: float) -> list[str]:
    sections = []
    measured = {name: metrics(run) for name, run in runs.items()}
    if len(runs) == 1:
        ((name, run),) = runs.items()
        y, u = (_unit(channels.units) for channels in (run.output.channels, run.applied.channels))
        found = measured[name]
        sections.append(
            numbers(
                {
                    "largest error": (found.max_error, y),
                    "residual vibration": (found.residual_vibration, y),
                    "peak input": (found.peak_input, u),
                    "preactuation": (found.preactuation_time, "s"),
                }
            )
        )
        sections.append(listed(f"{name.replace('_', ' ')}: {note}" for name, note in found.notes.items()))
    elif runs:
        units = {
            kind: _unit([unit for run in runs.values() for unit in getattr(run, kind).channels.units])
            for kind in ("output", "applied")
        }
        columns = [
            Column("verdict"),
            Column("error", "% of motion", "share"),
            Column("max error", units["output"]),
            Column("residual vibration", units["output"]),
            Column("peak input", units["applied"]),
            Column("preactuation time", "s"),
            Column("postactuation time", "s"),
        ]
        shares = {name: share_missed(run) for name, run in runs.items()}
        rows = {
            name: {**found, "share": None if (share := shares[name]) is None else 100 * share, "verdict": _word(share, error)}
            for name, found in measured.items()
        }
        marked = {name: "" if share is None else "good" if share <= error else "bad" for name, share in shares.items()}
        sections += [heading("Cases"), table(columns, rows, row_header="case", marked=marked)]
    return sections


def _word(share: float | None, error: float) -> str:
    return "no motion, or diverged" if share is None else "tracks" if share <= error else "misses"


def _figures(runs: Mapping[str, RunResult]) -> list[str]:
    drawn = {name: run for name, run in runs.items() if len(run.time) > 1}
    if not drawn:
        return []
    sections = [heading("Motion")]
    if len(drawn) == 1:
        ((name, run),) = drawn.items()
        title = f"output, tracking error and input of {name} over time"
        return [
            *sections,
            figure("States, output, error and input", svg_text(tracking_figure(run), title=f"states, {title}"), screen="desk"),
            figure("Output, error and input", svg_text(column_figure(run), title=title), screen="phone"),
        ]
    if len({(run.output.channels, run.applied.channels) for run in drawn.values()}) == 1:
        compared = svg_text(comparison_figure(list(drawn.values())), title="errors and inputs of all cases")
        sections.append(figure("Errors and inputs of all cases", compared, screen="desk"))
    each = [
        figure(name, svg_text(column_figure(run), title=f"output, tracking error and input of {name} over time"))
        for name, run in list(drawn.items())[:MOST_FIGURES]
    ]
    sections.append(f'<div class="figures">{"".join(each)}</div>')
    if len(drawn) > MOST_FIGURES:
        sections.append(listed([f"the first {MOST_FIGURES} of {len(drawn)} cases are drawn"]))
    return sections


def _remarks(runs: Mapping[str, RunResult], summary: Mapping[str, Any]) -> list[str]:
    """What plans and runs say of themselves."""
    sections = []
    plans: Mapping[str, Any] = summary.get("plans", {})
    if plans:
        names = ("dynamics_residual", "output_error", "continuity", "rest_residual")
        columns = [Column("method"), *(Column(name.replace("_", " "), "", name) for name in names)]
        rows = {name: {**plan["certificate"], "method": plan["method"]} for name, plan in plans.items()}
        sections += [heading("Certificates of the plans"), table(columns, rows, row_header="case")]
        sections.append(listed(f"{name}: {text}" for name, plan in plans.items() for text in plan["remarks"]))
    said = [f"{name}: {text}" for name, texts in summary.get("warnings", {}).items() for text in texts]
    said += [f"{name}: {text}" for name, run in runs.items() for text in run.remarks if f"{name}: {text}" not in said]
    said += [f"{name}: {text}" for name, case in summary.get("cases", {}).items() for text in case.get("limits_exceeded", [])]
    said += [f"{name} ({case['status']}): {case['reason']}" for name, case in summary.get("cases", {}).items() if "reason" in case]
    if said:
        sections += [heading("What the runs say"), listed(said)]
    return sections


def _origin(summary: Mapping[str, Any], runs: Mapping[str, RunResult]) -> list[str]:
    """Settings, versions, and how to make it again."""
    sections = [heading("Settings")]
    hidden = {"cases", "plans", "made_by", "warnings", "files", "study", "status", "model"}
    plain = {name: value for name, value in summary.items() if name not in hidden and not isinstance(value, Mapping | list)}
    settings = {name.replace("_", " "): value for name, value in plain.items() if value is not None}
    if not summary and runs:
        run = next(iter(runs.values()))
        settings = {"timestep": run.timestep, "integrator": run.integrator, "evaluate": run.evaluate}
    origin = summary.get("made_by")
    versions = {"versions": origin["versions"]} if origin else {}
    sections.append(facts({**settings, **versions}))
    if origin:
        sections += [heading("To repeat it"), program(origin["command"])]
    return sections


def _advice(advice: Advice) -> str:
    best = advice.recommended
    said = f"{advice.reason[0].upper()}{advice.reason[1:]}."
    sections = []
    if best is None:
        found = Verdict(False, "Nothing that was tried does what was asked", said)
    else:
        smooth = "" if best.smoothness is None else f", smoothness {best.smoothness}"
        found = Verdict(True, f"Take {best.method}, {best.duration:.4g} s{smooth}", said)
        entries = {
            "error": (100 * best.error, "% of the motion"),
            "residual vibration": (100 * best.residual_vibration, "% of the motion"),
            "peak input": (best.peak_input, advice.input_unit),
            "preactuation": (best.preactuation, "s"),
        }
        sections += [numbers(entries), *_beside(advice, best)]
    sections += _trials(advice)
    if best is not None:
        sections += [heading("The lines that make it"), program(advice.program)]
        sections += [heading("Or the command"), program(advice.command)] if advice.command else []
    if advice.refusals:
        sections += [heading("What does not apply"), listed(f"{name}: {text}" for name, text in advice.refusals.items())]
    return page(f"{advice.plant}: which method to take", "invtrack advice", found, sections)


def _beside(advice: Advice, best: Trial) -> list[str]:
    """The recommended motion beside those that everybody knows."""
    shown_too = [trial for trial in advice.best if trial is best or trial.method in FAMILIAR]
    each = [
        figure(trial.method, svg_text(column_figure(trial.run), title=f"output, tracking error and input by {trial.method}"))
        for trial in shown_too
    ]
    return [heading("Motion"), f'<div class="figures">{"".join(each)}</div>']


def _trials(advice: Advice) -> list[str]:
    """The best of each method, and all others for who asks."""
    rows: dict[str, Any] = {}
    others: dict[str, Any] = {}
    marked: dict[str, str] = {}
    for trial, (name, row) in zip(advice.trials, advice.rows.items(), strict=True):
        (rows if trial in advice.best else others)[name] = row
        marked[name] = "best" if trial is advice.recommended else ""
    sections = [heading("The best of each method"), table(advice.columns, rows, row_header="method", marked=marked)]
    if advice.off:
        sections.append(listed([f"off, one parameter at a time: {', '.join(advice.off)}"]))
    if others:
        sections.append(folded(f"{len(others)} more trials", table(advice.columns, others, row_header="method")))
    return sections


def _unit(units: Sequence[str]) -> str:
    return units[0] if len(set(units)) == 1 else ""
