"""The paper's cycle of payloads over and over: the exosystem runs on, and so do the jumps."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from regulator.rig import LONG, OBSERVER_POLES, POLES, STATE_OBSERVER, Rig, interval_errors, rig

import invtrack
from invtrack.studies import Case, Column, Rows, Session, Table

CYCLES = 16
CYCLE = 2 * np.pi  # [s]
MASSES = (0.0, 100.0, 10.0)  # [kg], in each cycle
JUMPS = (np.pi / 2, 3 * np.pi / 2, 2 * np.pi)  # [s], in each cycle

COLUMNS = (
    Column("max error", "m"),
    Column("first cycle", "m"),
    Column("middle cycle", "m"),
    Column("last cycle", "m"),
    Column("residual vibration", "m"),
    Column("peak input", "N"),
)


def long_rig(plant: invtrack.Plant) -> Rig:
    """The payload is exchanged 3 times in each cycle, except at the very end."""
    jumps = [k * CYCLE + t for k in range(CYCLES) for t in JUMPS][:-1]
    return rig(plant, MASSES * CYCLES, jumps, end=CYCLES * CYCLE)


def cases(rig: Rig) -> list[Case]:
    """The exact map, the switched regulators, and the exact map with everything estimated."""
    everything_estimated = {
        "exosystem_observer": invtrack.LuenbergerObserver(OBSERVER_POLES),
        "state_observer": STATE_OBSERVER,
    }
    laws = {
        "exact_map": rig.controller("exact_map"),
        "switched_francis": rig.controller("switched_francis"),
        "estimated": rig.controller("exact_map", **everything_estimated),
    }
    return [rig.case(LONG + name, law, numbers=_numbers) for name, law in laws.items()]


def _numbers(run: invtrack.RunResult) -> dict[str, Any]:
    errors = interval_errors(run, [k * CYCLE for k in range(CYCLES + 1)])
    shown = {"first_cycle": errors[0], "middle_cycle": errors[CYCLES // 2], "last_cycle": errors[-1]}
    return {**invtrack.metrics(run), **shown, "cycle_errors": errors}


def rate_through_jumps(rig: Rig) -> float:
    """Rate [1/s] at which the closed loop x' = (A_k - B_k K_k) x contracts over one cycle: -log(spectral radius) / cycle.

    Poles that are the same in every interval do not make it their own: the modes change at each jump.
    """
    transition = np.eye(rig.model.n_states)
    durations = np.diff([0.0, *JUMPS])
    for system, K, duration in zip(rig.model.systems[:3], rig.gains.gains[:3], durations, strict=True):
        transition = scipy.linalg.expm((system.A - system.B @ K) * duration) @ transition
    return float(-np.log(np.max(np.abs(np.linalg.eigvals(transition)))) / CYCLE)


def report(jumps: int, rate: float) -> list[Table | str]:
    """The table, and what it compares."""
    slowest = max(pole.real for pole in POLES)
    return [
        Table(f"{CYCLES} cycles with {jumps} exchanges of the payload, in MuJoCo", COLUMNS, _rows),
        "long_estimated starts from rest and knows nothing before 0 s: x_e is estimated from y_d, x from base and tip position.\n"
        f"Its first transient dies out as the closed loop's do through jumps, at {rate:.3f} 1/s (slowest pole {slowest:g} 1/s),\n"
        "and no jump adds a new one. The switched regulators meet every jump with a new one. first, middle, last cycle: the\n"
        "largest |y - y_d| there.",
    ]


def _rows(done: Session) -> Rows:
    return done.rows([name for name in done.numbers if name.startswith(LONG)])
