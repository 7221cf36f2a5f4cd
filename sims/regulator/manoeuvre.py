"""The paper's manoeuvre through two jumps, each law once from rest and once from the state that it wants at the start."""

from __future__ import annotations

from typing import Any

import numpy as np
from regulator.rig import LONG, OBSERVER_POLES, STATE_OBSERVER, Rig, interval_errors

import invtrack
from invtrack.control import Instants
from invtrack.figures import tracking_figure
from invtrack.studies import Case, Column, Rows, Session, Table

MASSES = (0.0, 100.0, 10.0)  # [kg]
JUMPS = (np.pi / 2, 3 * np.pi / 2)  # [s]
END = 2 * np.pi  # [s]
INTERVALS = ("before", "mass_0", "mass_100", "mass_10", "after")
FROM_OWN_STATE = "_from_exact_state"

COLUMNS = (
    Column("max error", "m"),
    *(Column(f"error {name.replace('_', ' ')}", "m", f"error_{name}") for name in INTERVALS),
    Column("residual vibration", "m"),
    Column("peak input", "N"),
)


def cases(rig: Rig) -> list[Case]:
    """From rest; then, without the name's first transient, from the law's own state."""
    estimated = {"exosystem_observer": invtrack.LuenbergerObserver(OBSERVER_POLES)}
    laws = {
        "exact_map": rig.controller("exact_map"),
        "switched_francis": rig.controller("switched_francis"),
        "single_francis": rig.controller("single_francis"),
        "estimated_exosystem": rig.controller("exact_map", **estimated),
        "output_feedback": rig.controller("exact_map", state_observer=STATE_OBSERVER),
    }
    drawn = {"tracking": tracking_figure}
    from_rest = [rig.case(name, law, numbers=_numbers, figures=drawn) for name, law in laws.items()]
    from_own_state = []
    for name in ("exact_map", "switched_francis", "single_francis", "estimated_exosystem"):
        own_state = rig.own_state(name if name in rig.maps else "exact_map")
        settings = {"start": 0.0, "initial_state": own_state}
        from_own_state.append(rig.case(name + FROM_OWN_STATE, laws[name], numbers=_numbers, settings=settings))
    return [*from_rest, *from_own_state]


def _numbers(run: invtrack.RunResult) -> dict[str, Any]:
    edges = [min(float(run.time[0]), 0.0), 0.0, *JUMPS, END, float(run.time[-1])]
    errors: dict[str, float | None] = dict(zip(INTERVALS, interval_errors(run, edges), strict=True))
    if run.time[0] >= 0:
        errors["before"] = None
    return {**invtrack.metrics(run), **{f"error_{name}": value for name, value in errors.items()}}


def report(start: float, decay: dict[str, float]) -> list[Table | str]:
    """The table, and what it compares."""
    return [
        Table("Regulation through tip-mass jumps, in MuJoCo", COLUMNS, _rows),
        "All cases have the same feedback poles in every interval; all but single_francis, whose regulator stays that of the\n"
        f"first mass, know the jumps. From rest the runs begin {-start:.1f} s before the manoeuvre: exact_map needs that time and\n"
        "the exosystem's state beforehand. The Francis regulators act from 0 s on and need neither; they leave transients for\n"
        f"the feedback to take down. {FROM_OWN_STATE}: started at 0 s in the state that the law itself wants there, so that\n"
        "only what the jumps cause (in estimated_exosystem: the wrong estimate) is left. error before, mass .., after: largest\n"
        "|y - y_d| before the manoeuvre, between its jumps, and after it. estimated_exosystem: x_e is estimated from y_d, from\n"
        f"zero on; slowest pole designed -{decay['designed']:.3f} 1/s, measured -{decay['measured']:.3f} 1/s.\n",
    ]


def _rows(done: Session) -> Rows:
    return done.rows([name for name in done.numbers if not name.startswith(LONG)])


def estimate_errors(rig: Rig, timestep: float) -> tuple[np.ndarray, np.ndarray]:
    """Size (m,) of the error of the exosystem's estimate at times (m,) [s] from the start of the manoeuvre to its end."""
    controller = rig.controller("exact_map", exosystem_observer=invtrack.LuenbergerObserver(OBSERVER_POLES))
    time = np.linspace(0.0, END, round(END / timestep), endpoint=False)
    hold = np.full(len(time), END / len(time))
    asked = Instants.undivided(time, hold, time + hold / 2)
    error = controller.exosystem_states(asked) - rig.controller("exact_map").exosystem_states(asked)
    return time, np.linalg.norm(error, axis=1)


def decay_rates(time: np.ndarray, error: np.ndarray) -> dict[str, float]:
    """Rate [1/s] at which the estimate's error falls once the faster poles are gone, beside the slowest designed pole."""
    fitted = (time > END / 2) & (time < 0.75 * END)
    slope = np.polyfit(time[fitted], np.log(error[fitted]), 1)[0]
    return {"designed": float(-max(OBSERVER_POLES)), "measured": float(-slope)}
