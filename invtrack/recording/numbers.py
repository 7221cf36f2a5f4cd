"""What a recording says of its runs in numbers: the metrics, with the reasons of those that are not defined, and the remarks."""

from __future__ import annotations

import numpy as np
import rerun as rr

from invtrack.recording.series import entity_path
from invtrack.results.metrics import metrics
from invtrack.results.result import RunResult


def send_numbers(recording: rr.RecordingStream, run: RunResult, *, name: str) -> None:
    """Send the metrics of a run, as a text document; name: of the case, which stands under `run.name`."""
    document = rr.TextDocument(numbers_text(run, name), media_type=rr.MediaType.MARKDOWN)
    recording.log(entity_path(run.name, "metrics"), document, static=True, strict=True)


def numbers_text(run: RunResult, name: str) -> str:
    """The metrics of the run, in Markdown."""
    output, force = ("/".join(dict.fromkeys(signal.channels.units)) for signal in (run.output, run.applied))
    units = {"error": output, "residual": output, "peak": force, "vibration": "s", "preactuation": "s", "postactuation": "s"}
    with np.errstate(over="ignore", invalid="ignore"):  # whatever a run holds can be recorded
        found = metrics(run)
    lines = [f"**{name}**, {run.status}, {len(run.time)} samples", "", "| metric | value |", "|---|---|"]
    for metric, value in found.items():
        if metric != "notes":
            unit = next(unit for word, unit in units.items() if word in metric)
            lines.append(f"| {metric.replace('_', ' ')} | {'-' if value is None else f'{value:.3g} {unit}'} |")
    lines += ["", *(f"- {metric.replace('_', ' ')}: {note}" for metric, note in found.notes.items())]
    return "\n".join([*lines, *(f"- {remark}" for remark in run.remarks)])
