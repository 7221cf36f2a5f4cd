"""A study: named cases run one after the other, each kept as soon as it is done; then tables, figures and one summary.

A module that holds a study says what is its own and leaves the rest to this package:

    def build(options: StudyOptions) -> Setup:
        plant, controller = ...
        return Setup([Case("feedforward", plant, controller)], report=[Table("What is shown", [Column("max error", "m")])])

    STUDY = Study("my_study", build, description=__doc__)

    if __name__ == "__main__":
        STUDY.main()

Status with which the program ends: 0 complete, 1 refused, 2 a command line that cannot be read, 3 a simulation diverged,
130 interrupted.
"""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, NoReturn, TypeVar

import tyro

from invtrack.control.protocol import Controller
from invtrack.errors import InvtrackError
from invtrack.figures import save_figure
from invtrack.plant.plant import Plant
from invtrack.results import metrics
from invtrack.results.result import RunResult
from invtrack.simulation.linear_plant import LinearPlant
from invtrack.studies.folder import RunFolder, Status
from invtrack.studies.options import StudyOptions
from invtrack.studies.origin import made_by, plan_in_words
from invtrack.studies.session import DivergedError, MissingError, Session
from invtrack.studies.table import Column, Rows, print_table

COMPLETE, REFUSED, DIVERGED, INTERRUPTED = 0, 1, 3, 130  # 2: tyro's, as everybody's; 130: 128 + SIGINT, as shells report it

RESERVED = {"study", "status", "model", "timestep", "seed", "cases", "plans", "made_by", "warnings", "files"}
"""What the summary says of every study."""

Figure = Any
"""A matplotlib Figure, which only `invtrack.figures` knows."""

Options = TypeVar("Options", bound=StudyOptions)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One simulation under a name of its own.

    Args:
        name: what its files, row and numbers are called.
        plant: a MuJoCo plant, or a LinearPlant for the prediction.
        controller: the controller, or a function that plans it when the case's turn has come.
        settings: arguments of `invtrack.simulate` other than name and progress; timestep and seed are the study's unless given
            here.
        numbers: function that makes what the summary says of the run, beside its status.
        figures: functions that draw the run, by key; saved as <key>_<name>.png.
        recorded: whether its recording is kept, <name>.rrd and <name>.parquet.
        refused_by: the error by which the controller's planning must be refused, where this is what the case shows.
    """

    name: str = field(kw_only=False)
    plant: Plant | LinearPlant = field(kw_only=False)
    controller: Controller | Callable[[], Controller] = field(kw_only=False)
    settings: Mapping[str, Any] = field(default_factory=dict)
    numbers: Callable[[RunResult], Mapping[str, Any]] = metrics
    figures: Mapping[str, Callable[[RunResult], Figure]] = field(default_factory=dict)
    recorded: bool = True
    refused_by: type[InvtrackError] | None = None


@dataclass(frozen=True)
class Table:
    """A table of the report. rows: makes its rows from the session; one row per case unless given."""

    title: str
    columns: Sequence[Column]
    rows: Callable[[Session], Rows] = Session.rows
    row_header: str = "case"


@dataclass(frozen=True)
class Setup:
    """What a study consists of; everything but the cases may be left out.

    Args:
        cases: in the order in which they run.
        sweeps: by the key of their list in the summary, named points that run after the cases; the value of a point joins the list
            as soon as it is there.
        sections: by their key, values for the summary or functions that make them once cases and sweeps are done.
        figures: functions that draw them, by the name of the file.
        report: tables, texts and functions that make texts, in the order in which they are printed.
    """

    cases: Sequence[Case]
    sweeps: Mapping[str, Mapping[str, Callable[[Session], Any]]] = field(default_factory=dict)
    sections: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Callable[[Session], Figure]] = field(default_factory=dict)
    report: Sequence[Table | str | Callable[[Session], str]] = ()

    def __post_init__(self) -> None:
        keys = [case.name for case in self.cases], [*self.sweeps, *self.sections], [*self.figures]
        for names in (*keys, [*self.case_names, *self.sweeps]):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise InvtrackError(f"expected cases, sections and figures with names of their own, got {', '.join(twice)} twice")
        taken = sorted(RESERVED & set(keys[1]))
        if taken:
            raise InvtrackError(f"expected sections under names that the summary does not use itself, got {', '.join(taken)}")
        for name in (*keys[0], *keys[2]):
            if not name or name != Path(name).name or name.startswith("."):
                raise InvtrackError(f"expected names that files can have, got {name!r}")

    @property
    def case_names(self) -> list[str]:
        """Names of the cases."""
        return [case.name for case in self.cases]

    def chosen(self, names: Sequence[str]) -> tuple[list[Case], list[str]]:
        """The cases and the sweeps among `names`, all where there are none. Raises InvtrackError for a name that is neither."""
        known = [*self.case_names, *self.sweeps]
        unknown = [name for name in names if name not in known]
        if unknown:
            raise InvtrackError(f"--case: there is no case {', '.join(unknown)}; there are: {', '.join(known)}")
        wanted = names or known
        return [case for case in self.cases if case.name in wanted], [name for name in self.sweeps if name in wanted]


class Study(Generic[Options]):
    """A study with a name, to be run from a command line or from a program.

    name: also of the folder runs/<name>, into which it writes unless told otherwise. build: makes the setup for the options given;
    what it plans comes before the first case. description: what --help says. defaults: the options' defaults and, by its type,
    the options that there are.
    """

    def __init__(
        self,
        name: str,
        build: Callable[[Options], Setup],
        *,
        defaults: Options,
        description: str | None = None,
    ) -> None:
        self.name = name
        self.build = build
        self.description = description or ""
        self.defaults = replace(defaults, out=defaults.out or self._own_folder)

    def main(self, args: Sequence[str] | None = None) -> NoReturn:
        """Read the command line (the process's unless given), run, and end the program with the status of the study.

        What cannot be done ends with one readable line; an exception that is none of invtrack's is a defect and keeps
        its traceback.
        """
        try:
            options = tyro.cli(type(self.defaults), default=self.defaults, description=self.description, prog=self.name, args=args)
            summary = self.run(options)
        except (InvtrackError, OSError) as error:
            message = f"{error.filename}: {error.strerror}" if isinstance(error, OSError) and error.filename else str(error)
            self._leave("; ".join([message, *getattr(error, "__notes__", [])]), REFUSED)
        except KeyboardInterrupt:
            self._leave("interrupted", INTERRUPTED)
        raise SystemExit(DIVERGED if summary["status"] == "diverged" else COMPLETE)

    def run(self, options: Options) -> dict[str, Any]:
        """Run the study and return its summary, as it stands in summary.json.

        {"study", "status": "complete" or "diverged", "model", the options that matter, "made_by": {"command", "versions"}, "cases":
        {case: {metric: number in SI units, ..., "status"}}, "plans": {case: its method, certificate and remarks}, sweeps and
        sections by key, "files": names of the files written}. An interruption
        leaves a summary with the status "interrupted" and the cases done, and is then raised again; after any other
        failure they stand in unfinished.json.

        Raises InvtrackError where the folder, the options, a plan or a simulation is refused.
        """
        folder = RunFolder(options.out or self._own_folder)
        setup = self.build(options)
        chosen = setup.chosen(options.case)
        models = dict.fromkeys(case.plant.name for case in setup.cases)
        session = Session(options)
        run = _Run(self.name, setup, options, session, folder)
        folder.begin()
        try:
            folder.keep(study=self.name, model=", ".join(models), **options.that_matter(), made_by=made_by(), cases={}, plans={})
            run.cases(chosen[0])
            run.sweeps(chosen[1])
            run.sections()
            if options.figures:
                run.figures()
        except KeyboardInterrupt:
            run.finish("interrupted")
            raise
        except Exception as error:
            error.add_note(f"what was done before is kept in {folder.path}")
            raise
        return run.finish("diverged" if session.diverged else "complete")

    @property
    def _own_folder(self) -> Path:
        return Path("runs") / self.name

    def _leave(self, message: str, status: int) -> NoReturn:
        print(f"{self.name}: {message}", file=sys.stderr)
        raise SystemExit(status)


@dataclass(frozen=True)
class _Run:
    """One run of a study, step by step."""

    name: str
    setup: Setup
    options: StudyOptions
    session: Session
    folder: RunFolder
    plans: dict[str, dict[str, Any]] = field(default_factory=dict)

    def cases(self, cases: Sequence[Case]) -> None:
        for number, case in enumerate(cases, start=1):
            with self.session.activity(f"{case.name} ({number} of {len(cases)})"):
                self.session.numbers[case.name] = self._case(case)
                self.folder.keep(cases=self.session.numbers, plans=self.plans)

    def _case(self, case: Case) -> dict[str, Any]:
        """Simulate, record and draw one case, and return its numbers."""
        try:
            controller = case.controller() if callable(case.controller) else case.controller
        except InvtrackError as error:
            if case.refused_by is None or not isinstance(error, case.refused_by):
                raise
            return {"status": "refused", "reason": str(error)}
        if case.refused_by is not None:
            raise InvtrackError(f"case {case.name!r} was to be refused with a {case.refused_by.__name__}, but it was planned")
        self.plans[case.name] = plan_in_words(controller.plan)
        result = self.session.tried(case.plant, controller, name=case.name, **case.settings)
        if case.recorded:
            from invtrack.recording import save_recording  # loads Rerun, which no study waits for before it has run
            from invtrack.recording.samples import samples_path

            recording = self.folder.file(f"{case.name}.rrd")
            self.folder.file(samples_path(recording).name)
            save_recording(result, recording, application=self.name)
        if result.status == "diverged":
            self.session.diverged[case.name] = result.message
            return {"status": "diverged", "reason": result.message}
        self.session.runs[case.name] = result
        if self.options.figures:
            for kind, draw in case.figures.items():
                save_figure(draw(result), self.folder.file(f"{kind}_{case.name}.png"))
        return {**case.numbers(result), "status": "completed"}

    def sweeps(self, names: Sequence[str]) -> None:
        for name in names:
            values: list[Any] = []
            points = self.setup.sweeps[name]
            for number, (point, make) in enumerate(points.items(), start=1):
                what = f"{name}: {point}"
                with self.session.activity(f"{what} ({number} of {len(points)})"), self._left_out_where_missing(what):
                    values.append(make(self.session))
                    self.folder.keep(**{name: values})
            if values:
                self.session.sections[name] = values

    def sections(self) -> None:
        for name, value in self.setup.sections.items():
            with self.session.activity(name), self._left_out_where_missing(name):
                self.session.sections[name] = value(self.session) if callable(value) else value
                self.folder.keep(**{name: self.session.sections[name]})

    def figures(self) -> None:
        for name, draw in self.setup.figures.items():
            with self.session.activity(f"figure {name}"), self._left_out_where_missing(name):
                figure = draw(self.session)
                save_figure(figure, self.folder.file(f"{name}.png"))

    @contextmanager
    def _left_out_where_missing(self, name: str) -> Iterator[None]:
        """What is made of the cases is left out where a case that it needs is not there."""
        try:
            yield
        except MissingError:
            pass
        except DivergedError as error:
            self.session.diverged[name] = str(error)

    def finish(self, status: Status) -> dict[str, Any]:
        """Write the summary, then print it or the report."""
        if self.session.remarks:
            self.folder.keep(warnings=self.session.remarks)
        summary = self.folder.finish(status)
        if self.options.json:
            print(json.dumps(summary, indent=2, allow_nan=False))
        elif not self.options.quiet:
            self._report(summary)
        for name, reason in self.session.diverged.items():
            print(f"{self.name}: {name} diverged ({reason}); a smaller --timestep may help", file=sys.stderr)
        return summary

    def _report(self, summary: Mapping[str, Any]) -> None:
        for item in self.setup.report:
            try:
                if isinstance(item, Table):
                    rows = item.rows(self.session)
                    if rows:
                        print_table(item.title, columns=item.columns, rows=rows, row_header=item.row_header)
                else:
                    print(item if isinstance(item, str) else item(self.session))
            except MissingError:
                continue
        for name, texts in self.session.remarks.items():
            print(*(f"{name}: {text}" for text in texts), sep="\n")
        print(self._closing_line(summary["files"]))

    def _closing_line(self, files: Sequence[str]) -> str:
        kinds = {"recording": ".rrd", "figure": ".png"}
        counts = {kind: sum(name.endswith(ending) for name in files) for kind, ending in kinds.items()}
        written = ["summary.json", *(f"{count} {kind}{'s' * (count > 1)}" for kind, count in counts.items() if count)]
        look = f"; look into the recordings with: rerun {shlex.quote(str(self.folder.path))}/*.rrd" if counts["recording"] else ""
        return f"written to {self.folder.path}: {', '.join(written)}{look}"
