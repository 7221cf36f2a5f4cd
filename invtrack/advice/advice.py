"""What was tried, what is recommended and why: as a table in a terminal, in a notebook, and as numbers."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

from invtrack.advice.trial import Trial
from invtrack.studies.table import Column, Rows, print_table, short_number

if TYPE_CHECKING:
    from rich.console import Console

WIDTH = 200
"""Characters of a line of the table as text."""


@dataclass(frozen=True, eq=False, repr=False)
class Advice:
    """All methods compared on one motion, and the one that is recommended.

    Args:
        plant: name of what was moved.
        trials: all that were tried, the recommended one first, then those that do what was asked by their peak input.
        excluded: by the names of methods of which nothing could be tried, why.
        recommended: None where nothing does what was asked.
        reason: why.
        error: that is acceptable, as a share of the motion.
        input_unit: of the peak inputs.
        off: the parameters that were off, one after the other, by name and share.
        source: lines of Python that make `plant`, or `model`, where these are known.
        command: the command line that runs the recommended plan, where there is one.
    """

    plant: str
    trials: tuple[Trial, ...]
    excluded: Mapping[str, str]
    recommended: Trial | None
    reason: str
    error: float
    input_unit: str
    off: tuple[str, ...]
    source: tuple[str, ...] = ()
    command: str = ""

    @property
    def program(self) -> str:
        """The lines of Python that make the recommended plan and its run; empty where none is recommended.

        They take up with `plant` where a Plant was given, otherwise with `model`, unless `source` makes these; a reference that was
        a signal they know as `reference`.
        """
        if self.recommended is None:
            return ""
        return "\n".join(["import invtrack", "", *self.source, self.recommended.program])

    @property
    def columns(self) -> list[Column]:
        """Of the table."""
        off = [Column("error off", "%", "error_off"), Column("vibration off", "%", "vibration_off")] if self.off else []
        return [
            Column("verdict"),
            Column("duration", "s"),
            Column("smooth", "", "smoothness"),
            Column("error", "%"),
            Column("residual vibration", "%"),
            Column("peak input", self.input_unit),
            Column("preactuation", "s"),
            Column("ringing", "s"),
            *off,
        ]

    @property
    def best(self) -> list[Trial]:
        """The best trial of each method, in the order of all."""
        found: dict[str, Trial] = {}
        for trial in self.trials:
            found.setdefault(trial.method, trial)
        return list(found.values())

    @cached_property
    def rows(self) -> Rows:
        """Of the table: the trials by their names, errors and vibrations in % of the motion."""
        percent = ("error", "residual_vibration", "error_off", "vibration_off")
        rows: dict[str, Mapping[str, Any]] = {}
        for trial in self.trials:
            figures = trial.row
            shares = {name: None if figures[name] is None else 100 * figures[name] for name in percent}
            name = trial.method
            while name in rows:
                name += " "  # one method at several smoothnesses and durations: rows need names of their own
            rows[name] = {**figures, **shares, "verdict": self.verdict(trial)}
        return rows

    def verdict(self, trial: Trial) -> str:
        """What a row says of a trial."""
        if trial is self.recommended:
            return "recommended"
        return "does it" if trial.meets else f"misses {', '.join(trial.misses)}"

    @property
    def refusals(self) -> dict[str, str]:
        """Why methods are excluded, those with the same reason together."""
        names: dict[str, list[str]] = {}
        for name, text in self.excluded.items():
            names.setdefault(text, []).append(name)
        return {", ".join(alike): text for text, alike in names.items()}

    def as_dict(self) -> dict[str, Any]:
        """Everything in the types of JSON, shares as shares."""
        return {
            "plant": self.plant,
            "recommended": None if self.recommended is None else self.recommended.row,
            "reason": self.reason,
            "program": self.program,
            "command": self.command,
            "error": self.error,
            "input_unit": self.input_unit,
            "parameters_off": list(self.off),
            "trials": [trial.row for trial in self.trials],
            "excluded": dict(self.excluded),
        }

    def show(self, console: Console | None = None) -> None:
        """Print the recommendation, the table, what is excluded and the program; to standard output unless a console is given."""
        from rich.console import Console
        from rich.text import Text

        console = Console() if console is None else console
        console.print(Text(self.headline, style="bold"), soft_wrap=True)
        console.print(Text(f"{self.reason}.\n"), soft_wrap=True)
        rows = dict(zip(self.rows, self.trials, strict=True))
        best = {name: self.rows[name] for name, trial in rows.items() if trial in self.best}
        print_table("", columns=self.columns, rows=best, row_header="method", console=console)
        if len(best) < len(rows):
            more = f"{len(rows) - len(best)} more, at other smoothnesses, durations and weights, are in `trials`"
            console.print(Text(f"the best of each method; {more}"), soft_wrap=True)
        if self.off:
            console.print(Text(f"off: one at a time {', '.join(self.off)}"), soft_wrap=True)
        for name, text in self.refusals.items():
            console.print(Text(f"not {name}: {text}"), soft_wrap=True)
        if self.recommended is not None:
            console.print(Text(f"\nThe lines that make it:\n\n{self.program}"), soft_wrap=True)
            if self.command:
                console.print(Text(f"\nOr the command:\n\n{self.command}"), soft_wrap=True)

    @property
    def headline(self) -> str:
        """The recommendation in a few words."""
        trial = self.recommended
        if trial is None:
            return f"{self.plant}: no recommendation"
        smooth = "" if trial.smoothness is None else f", smoothness {trial.smoothness}"
        return f"{self.plant}: {trial.method} of a motion of {trial.duration:.4g} s{smooth}"

    def __str__(self) -> str:
        from rich.console import Console

        text = io.StringIO()
        self.show(Console(file=text, width=WIDTH))
        return text.getvalue()

    def __repr__(self) -> str:
        """The recommendation, without arrays."""
        return f"<Advice for {self.headline}; {len(self.trials)} trials, {len(self.excluded)} methods excluded>"

    def _repr_html_(self) -> str:
        """The same as HTML, for a notebook."""
        head = "".join(f"<th>{escape(_header(column))}</th>" for column in self.columns)
        body = ""
        for trial, (name, row) in zip(self.trials, self.rows.items(), strict=True):
            cells = "".join(f"<td>{escape(_cell((row or {})[column.key]))}</td>" for column in self.columns)
            style = ' style="font-weight:bold"' if trial is self.recommended else ""
            body += f"<tr{style}><td>{escape(name)}</td>{cells}</tr>"
        excluded = "".join(f"<li><b>{escape(name)}</b>: {escape(text)}</li>" for name, text in self.refusals.items())
        return (
            f"<p><b>{escape(self.headline)}</b>: {escape(self.reason)}.</p>"
            f"<table><thead><tr><th>method</th>{head}</tr></thead><tbody>{body}</tbody></table>"
            + (f"<p>Excluded:</p><ul>{excluded}</ul>" if excluded else "")
            + (f"<pre>{escape(self.program)}</pre>" if self.program else "")
        )


def _header(column: Column) -> str:
    return f"{column.name} [{column.unit}]" if column.unit else column.name


def _cell(value: Any) -> str:
    return "-" if value is None else short_number(value) if isinstance(value, float) else str(value)
