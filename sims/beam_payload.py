"""An elastic beam moves its tip out and back, and loses half of its payload on the way: what people use, and what inversion buys.

Everyone commands the same base servo (10 rad/s). The usual practice: the profile under feedback alone, and with its velocity and
acceleration fed forward, S-curves, input shapers for the slowest flexible mode of the loop or for all that matter, ZPETC. Beside
it: the exact inverse through the change of the payload, on a model of few states; the optimal redesign; and the robust redesign,
one input for five beams that are a tenth off. All get the same total time, from the first moment of the input to the last, what a
plan would do before it cut off; or the same peak input, and then the time that they need for it. Then payload, stiffness and the
instant of the change are 5, 10 and 20 % off. The cases are run in MuJoCo, the tables with errors on linear models of the same beam
(six segments, all of its 14 states). Who wins is reported, and was not arranged.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

from slews.figures import CURVES, frequency_figure, over_frequency, zeros_figure
from slews.measures import KINDS, LEVELS, measured, settings, tried, with_errors
from slews.methods import ALL_MODES, BEAM, INVERSE, MASSES, METHODS, PROFILE, REDESIGN, ROBUST, ZPETC, Slew, mechanism

import invtrack
from invtrack.figures import comparison_figure
from invtrack.studies import Case, Column, Rows, Session, Setup, Study, StudyOptions, Table

TOTAL = 3.0  # [s]
LONGEST = 40.0  # [s]
ITERATIONS, SAME_PEAK = 8, 0.02
EQUAL_TIME, EQUAL_PEAK, PERFECT, FREQUENCY = "equal_time", "equal_peak", "constant_payload", "over_frequency"
PRACTICE = [name for name in METHODS if name not in (INVERSE, REDESIGN, ROBUST)]

MEASURES = (
    Column("residual vibration", "m"),
    Column("residual energy", "J"),
    Column("peak input", "N"),
    Column("peak strain"),
)
ERRORS = tuple(
    Column(f"{kind} {100 * level:g} %", "m", f"residual_vibration_{kind}_{level:g}") for kind in KINDS for level in LEVELS
)


def build(options: StudyOptions) -> Setup:
    slew = _slew(MASSES, TOTAL)
    changes = [invtrack.Change(slew.instant, payload=MASSES[1])]
    cases = [
        Case(
            _file_name(method),
            mechanism(),
            partial(slew.controller, method),
            settings={"schedule": changes, **settings(slew)},
            numbers=partial(measured, total=TOTAL),
        )
        for method in METHODS
    ]
    step = options.timestep
    return Setup(
        cases,
        sweeps={
            PERFECT: {method: partial(_constant, method, step) for method in METHODS},
            EQUAL_TIME: {method: partial(_equal_time, method, step) for method in METHODS},
            EQUAL_PEAK: {method: partial(_equal_peak, method, step) for method in METHODS},
            FREQUENCY: {method: partial(_over_frequency, method, step) for method in CURVES},
        },
        sections={"beam": {"frequencies": BEAM.frequencies.tolist(), "reduction": str(slew.reduction)}},
        figures={
            "comparison": lambda done: comparison_figure(done.among(map(_file_name, (PROFILE, "ZVD", REDESIGN)))),
            "frequency": lambda done: frequency_figure({each["method"]: each["vibration"] for each in done.section(FREQUENCY)}),
            "zeros": lambda done: zeros_figure(),
        },
        report=[
            Table(f"MuJoCo, {TOTAL:g} s in all, the payload halved after {slew.instant:g} s", MEASURES),
            Table(f"constant payload, right model, {TOTAL:g} s", MEASURES, partial(_rows, PERFECT)),
            Table(f"payload halved, {TOTAL:g} s for all; errors: the worse sign", (*MEASURES, *ERRORS), partial(_rows, EQUAL_TIME)),
            Table("the same peak input for all", (Column("total", "s"), *MEASURES, *ERRORS), partial(_rows, EQUAL_PEAK)),
            _advice,
        ],
    )


@cache
def _slew(masses: tuple[float, float], total: float) -> Slew:
    return Slew(masses, total)


def _file_name(method: str) -> str:
    return method.replace(", ", "_").replace(" ", "_").replace("-", "_")


def _constant(method: str, timestep: float, session: Session) -> dict[str, Any]:
    slew = _slew((MASSES[0], MASSES[0]), TOTAL)
    return {"method": method, **tried(slew, slew.controller(method), timestep=timestep)}


def _equal_time(method: str, timestep: float, session: Session) -> dict[str, Any]:
    slew = _slew(MASSES, TOTAL)
    return {"method": method, **with_errors(slew, slew.controller(method), timestep=timestep)}


def _equal_peak(method: str, timestep: float, session: Session) -> dict[str, Any]:
    """The time in which a method asks for the profile's peak input, and what it leaves then."""
    try:
        total = _time_of_peak(method, timestep)
        slew = _slew(MASSES, total)
        return {"method": method, **with_errors(slew, slew.controller(method), timestep=timestep)}
    except invtrack.InvtrackError as reason:
        return {"method": method, "total": None, "reason": str(reason)}


def _time_of_peak(method: str, timestep: float) -> float:
    """Total time [s] with the profile's peak input, which goes with its square. Raises InvtrackError where it gets too long."""
    limit, total = _peak(PROFILE, TOTAL, timestep), TOTAL
    for _ in range(ITERATIONS):
        peak = _peak(method, total, timestep)
        if abs(peak / limit - 1) <= SAME_PEAK:
            break
        total = round(min(max(total * (peak / limit) ** 0.5, 0.5 * total), 3 * total), 3)
        if total > LONGEST:
            raise invtrack.InvtrackError(f"needs longer than {LONGEST:g} s for a peak input of {limit:.3g} N")
    return total


@cache
def _peak(method: str, total: float, timestep: float) -> float:
    """Largest input [N] of a method that has so much time."""
    slew = _slew(MASSES, total)
    return tried(slew, slew.controller(method), timestep=timestep)["peak_input"]


def _over_frequency(method: str, timestep: float, session: Session) -> dict[str, Any]:
    slew = _slew((MASSES[0], MASSES[0]), TOTAL)
    return {"method": method, "vibration": over_frequency(slew, method, timestep=timestep)}


def _rows(sweep: str, done: Session) -> Rows:
    return {
        each["method"] if each.get("total", TOTAL) else f"{each['method']} (refused)": each if each.get("total", TOTAL) else None
        for each in done.section(sweep)
    }


def _advice(done: Session) -> str:
    """Who leaves least, in words, from the numbers of this run."""
    lines = []
    for sweep, title in ((EQUAL_TIME, "the same time"), (EQUAL_PEAK, "the same peak input")):
        rows = [each for each in done.section(sweep) if each.get("total", TOTAL)]
        pick: Callable[[str, list[str] | None], str] = partial(_least, rows)
        lines.append(
            f"With {title} and the right model {pick('residual_vibration', None)} leaves least; of what people use"
            f" {pick('residual_vibration', PRACTICE)}."
        )
        for kind in KINDS:
            key = f"residual_vibration_{kind}_0.1"
            lines.append(f"  {kind} 10 % off: {pick(key, None)}; of what people use {pick(key, PRACTICE)}.")
    inverse = [each for each in done.section(EQUAL_TIME) if each["method"] == INVERSE]
    if inverse:
        lines.append(
            f"Exact inversion holds the tip's acceleration through the change and asks for {inverse[0]['peak_input']:.0f} N at that"
            " instant, nearly as an impulse; where that is too much, redesign."
        )
    lines.append(
        f"Shapers of all modes ({', '.join(ALL_MODES)}) and {ZPETC} are made for one payload: a change on the way is what they do"
        " not know."
    )
    return "\n".join(lines)


def _least(rows: list[dict[str, Any]], key: str, among: list[str] | None) -> str:
    best = min((each for each in rows if among is None or each["method"] in among), key=lambda each: each[key], default=None)
    return "none" if best is None else f"{best['method']} ({1e3 * best[key]:.3g} mm)"


STUDY = Study("beam_payload", build, description=__doc__, defaults=StudyOptions(timestep=6e-4))

if __name__ == "__main__":
    STUDY.main()
