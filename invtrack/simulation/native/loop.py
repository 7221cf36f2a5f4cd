"""The loop that takes the steps of a run, compiled: everything that it works on is in the record of the run.

One step: the state is written down; where an update is due, the law turns it (or what the sensors show) into an input; the plant
takes the step; outputs and measurements at its start are written down.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from invtrack.plant.native.pointers import (
    address_in,
    call,
    callback,
    compiled,
    copy,
    count,
    entry,
    floats,
    integers,
    matrix,
    records,
)
from invtrack.plant.native.readings import READING, read
from invtrack.simulation.native.record import AFFINE, ESTIMATING, RUN, STAGES

_runs_at, _readings_at = records(RUN), records(READING)


@entry
def take_steps(runs: Any, first: int, last: int) -> int:
    """Take the steps first, ..., last - 1; returns the number of the one that could not be taken, or `last`."""
    run = runs[0]
    update, first_step = integers(run.update, last), integers(run.first_step, 1 << 62)
    n, p, k, q = run.n, run.p, run.n_values, run.n_measured
    values, u = floats(run.values, k), floats(run.u, p)
    for i in range(first, last):
        if i == first_step[run.interval + 1] or i == 0:
            if i > 0:
                run.interval += 1
            _enter(run)
        _write_state(run, i)
        seen = floats(run.seen + 8 * k * i, k)
        if run.at_stages != 0:
            run.index, run.stage = i, 0
            _step(run)
            u = floats(run.middle, p)
        else:
            if update[i] != run.latest:
                if run.from_sensors != 0:
                    refresh(run)
                    copy(values, seen)
                    _sample(run, i)
                else:
                    _deviation(run, update[i])
                _input(run, update[i])
                if run.stopped != 0:
                    return i
                run.latest = update[i]
            _send(run, u)
            _step(run)
        if run.stopped != 0:
            return i
        copy(values, seen)
        copy(u, floats(run.commanded + 8 * p * i, p))
        if run.from_sensors != 0:
            copy(floats(run.y, q), floats(run.measured + 8 * q * i, q))
            copy(floats(run.estimate, n), floats(run.estimates + 8 * n * i, n))
    return last


@compiled
def _enter(run: Any) -> None:
    if run.linear == 0:
        floats(run.timestep, 1)[0] = floats(run.lengths, run.interval + 1)[run.interval]
        floats(run.time, 1)[0] = floats(run.edges, run.interval + 1)[run.interval]


@compiled
def _write_state(run: Any, i: int) -> None:
    row = run.raw + 8 * run.width * i
    if run.linear != 0:
        copy(floats(run.qpos, run.n), floats(row, run.n))
        return
    copy(floats(run.qpos, run.nq), floats(row, run.nq))
    copy(floats(run.qvel, run.nv), floats(row + 8 * run.nq, run.nv))
    copy(floats(run.act, run.na), floats(row + 8 * (run.nq + run.nv), run.na))


@entry
def write_state(runs: Any, i: int) -> None:
    """Write the present state down as that of instant i."""
    _write_state(runs[0], i)


@compiled
def _deviation(run: Any, instant: int) -> None:
    """x, the deviation of the present state from the operating point, or from what the law of an instant measures it from."""
    x = floats(run.x, run.n)
    if run.linear != 0:
        copy(floats(run.qpos, run.n), x)
        return
    nq, nv, na = run.nq, run.nv, run.na
    qpos, qvel, act, x0 = floats(run.qpos, nq), floats(run.qvel, nv), floats(run.act, na), floats(run.x0, run.width)
    kept, turned = integers(run.kept, run.n), floats(run.coordinates, 2 * nv + na)
    if run.differentiate != 0:
        call(run.differentiate, (run.model, run.coordinates, 1.0, run.x0, run.qpos))
    for j in range(run.n):
        i = kept[j]
        if i < nv:
            x[j] = turned[i] if run.differentiate != 0 else qpos[i] - x0[i]
        elif i < 2 * nv:
            x[j] = qvel[i - nv] - x0[nq + i - nv]
        else:
            x[j] = act[i - 2 * nv] - x0[nq + i - nv]
    if run.origins != 0:
        _departure(run, run.origins + 8 * run.width * instant)


@compiled
def _departure(run: Any, address: int) -> None:
    """x, a deviation from the operating point, measured anew from the origin (width,) at an address; what is dropped is at rest."""
    nq, nv, na = run.nq, run.nv, run.na
    x, x0, origin = floats(run.x, run.n), floats(run.x0, run.width), floats(address, run.width)
    kept, coordinates, placed = integers(run.kept, run.n), floats(run.coordinates, 2 * nv + na), floats(run.placed, nq)
    for i in range(2 * nv + na):
        coordinates[i] = 0.0
    for j in range(run.n):
        coordinates[kept[j]] = x[j]
    copy(x0, placed)
    call(run.integrate, (run.model, run.placed, run.coordinates, 1.0))
    call(run.differentiate, (run.model, run.coordinates, 1.0, address, run.placed))
    for j in range(run.n):
        i = kept[j]
        x[j] = coordinates[i] if i < nv else x[j] + x0[nq + i - nv] - origin[nq + i - nv]


@entry
def differences(differentiate: int, model: int, x0: Any, raw: Any, displacement: Any) -> None:
    """Where the positions of raw states (k, .) are from those of x0, in tangent space (k, nv).

    Args:
        differentiate: address of mj_differentiatePos.
        model: address of the model.
        x0: the operating point (nq + nv + na,).
        raw: states (k, nq + nv + na).
        displacement: result (k, nv).
    """
    origin = address_in(x0)
    for k in range(raw.shape[0]):
        call(differentiate, (model, address_in(displacement[k]), 1.0, origin, address_in(raw[k])))


@compiled
def _send(run: Any, u: Any) -> None:
    """Hand the input to the actuators."""
    ctrl = floats(run.ctrl, 1 << 62)
    inputs = integers(run.inputs, run.p)
    for j in range(run.p):
        ctrl[inputs[j]] = u[j]


@compiled
def _step(run: Any) -> None:
    """One step of the plant, with the values at its start."""
    if run.linear != 0:
        if run.at_stages != 0:
            _runge_kutta(run)
        else:
            _linear_step(run)
        return
    values = floats(run.values, run.n_values)
    if run.n_early != 0:
        _place(run)
        read(_readings_at(run.early, run.n_early), values)
    call(run.step, (run.model, run.data))
    read(_readings_at(run.late, run.n_late), values)
    if run.note != 0 and (run.watching != 0 or count(run.contacts) != 0 or count(run.limits) != 0):
        call(run.note, (run.index,))
    run.index += 1


@compiled
def _place(run: Any) -> None:
    """Bring places, and tendons where they are read, up to the state."""
    if run.kinematics != 0:
        call(run.kinematics, (run.model, run.data))
    if run.tendon != 0:
        call(run.tendon, (run.model, run.data))


@compiled
def refresh(run: Any) -> None:
    """Bring `values` up to the present state and input: after a step they are one step old."""
    values = floats(run.values, run.n_values)
    if run.linear != 0:
        _sense(run)
        return
    call(run.forward, (run.model, run.data))
    read(_readings_at(run.early, run.n_early), values)
    read(_readings_at(run.late, run.n_late), values)


@entry
def refresh_all(runs: Any) -> None:
    """`refresh`, for the record of a run."""
    refresh(runs[0])


@compiled
def _sense(run: Any) -> None:
    """together <- [x - rest, sat(u) - u0], and the values of a linear plant from it."""
    n, p, k = run.n, run.p, run.n_values
    case = integers(run.case, run.interval + 1)[run.interval]
    together, x, u = floats(run.together, n + p), floats(run.qpos, n), floats(run.ctrl, p)
    rest, u0, y0 = floats(run.rests + 8 * n * case, n), floats(run.u0 + 8 * p * case, p), floats(run.y0 + 8 * k * case, k)
    low, high = floats(run.low, p), floats(run.high, p)
    for j in range(n):
        together[j] = x[j] - rest[j]
    for j in range(p):
        together[n + j] = min(max(u[j], low[j]), high[j]) - u0[j]
    rows, values = matrix(run.sensor_rows + 8 * k * (n + p) * case, k, n + p), floats(run.values, k)
    for i in range(k):
        values[i] = y0[i]
        for j in range(n + p):
            values[i] += rows[i, j] * together[j]


@compiled
def _linear_step(run: Any) -> None:
    """x <- rest + A_d (x - rest) + B_d (sat(u) - u0)."""
    _sense(run)
    n, p = run.n, run.p
    case = integers(run.case, run.interval + 1)[run.interval]
    T, rest = matrix(run.transitions + 8 * n * (n + p) * case, n, n + p), floats(run.rests + 8 * n * case, n)
    together, x = floats(run.together, n + p), floats(run.qpos, n)
    for i in range(n):
        x[i] = rest[i]
        for j in range(n + p):
            x[i] += T[i, j] * together[j]


@compiled
def _runge_kutta(run: Any) -> None:
    """One step of RK4 of a linear plant, the law evaluated at each stage."""
    n, p = run.n, run.p
    case = integers(run.case, run.interval + 1)[run.interval]
    h = floats(run.lengths, run.interval + 1)[run.interval]
    A, B = matrix(run.A + 8 * n * n * case, n, n), matrix(run.B + 8 * n * p * case, n, p)
    rest, u0 = floats(run.rests + 8 * n * case, n), floats(run.u0 + 8 * p * case, p)
    low, high, rates = floats(run.low, p), floats(run.high, p), matrix(run.rates, STAGES, n)
    live, x, u, middle = floats(run.qpos, n), floats(run.x, n), floats(run.u, p), floats(run.middle, p)
    for stage in range(STAGES):
        share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        for j in range(n):
            x[j] = live[j] + share * h * rates[stage - 1, j] if stage > 0 else live[j]
        _input(run, 3 * run.index + (0 if stage == 0 else (2 if stage == 3 else 1)))
        if run.stopped != 0:
            return
        if stage == 0:
            _send(run, u)
            _sense(run)
        elif stage == 1:
            copy(u, middle)
        for i in range(n):
            rates[stage, i] = 0.0
            for j in range(n):
                rates[stage, i] += A[i, j] * (x[j] - rest[j])
            for j in range(p):
                rates[stage, i] += B[i, j] * (min(max(u[j], low[j]), high[j]) - u0[j])
    for j in range(n):
        live[j] += h / 6 * (rates[0, j] + 2 * rates[1, j] + 2 * rates[2, j] + rates[3, j])


@compiled
def _sample(run: Any, i: int) -> None:
    """y, what the sensors show at instant i of the values seen so far.

    A late sensor shows an earlier value, interpolated between steps; before the run began, the first.
    """
    k, q = run.n_values, run.n_measured
    seen, times, columns = matrix(run.seen, i + 1, k), floats(run.times, i + 1), integers(run.columns, q)
    noise, digit, delay = floats(run.noise, q), floats(run.digit, q), floats(run.delay, q)
    random, late_from, y = floats(run.random, q), integers(run.late_from, q), floats(run.y, q)
    for j in range(q):
        column = columns[j]
        if delay[j] == 0.0 or i == 0:
            y[j] = seen[i, column]
        else:
            instant, after = times[i] - delay[j], max(late_from[j], 1)
            while after < i and times[after] < instant:
                after += 1
            late_from[j] = after
            share = min(max((instant - times[after - 1]) / (times[after] - times[after - 1]), 0.0), 1.0)
            y[j] = seen[after - 1, column] * (1 - share) + seen[after, column] * share
        y[j] += noise[j] * random[j]
        if digit[j] > 0.0:
            y[j] = np.rint(y[j] / digit[j]) * digit[j]
    run.random += 8 * q


@compiled
def _input(run: Any, instant: int) -> None:
    """u, by the law at an instant, from x or y."""
    if run.law == AFFINE:
        n, p = run.n, run.p
        K = matrix(run.gains + 8 * p * n * integers(run.which, instant + 1)[instant], p, n)
        offset, x, u = floats(run.feedforward + 8 * p * instant, p), floats(run.x, n), floats(run.u, p)
        for i in range(p):
            u[i] = offset[i]
            for j in range(n):
                u[i] -= K[i, j] * x[j]
    elif run.law == ESTIMATING:
        _estimating_input(run, instant)
    else:
        call(run.ask, (instant,))


@compiled
def _estimating_input(run: Any, instant: int) -> None:
    """See `invtrack.control.output_feedback.OutputFeedbackLaw`."""
    n, p, q = run.n, run.p, run.n_measured
    design = integers(run.which, instant + 1)[instant]
    prior, deviation, innovation = floats(run.prior, n), floats(run.deviation, n), floats(run.innovation, q)
    y, expected = floats(run.y, q), floats(run.expected + 8 * q * instant, q)
    C_m, D_m = matrix(run.C_m + 8 * q * n * design, q, n), matrix(run.D_m + 8 * q * p * design, q, p)
    hold = integers(run.seen_hold, instant + 1)[instant]
    seen_correction = floats(run.corrections + 8 * p * (hold if hold >= 0 else run.none_seen), p)
    for i in range(q):
        innovation[i] = y[i] - expected[i]
        for j in range(n):
            innovation[i] -= C_m[i, j] * prior[j]
        for j in range(p):
            innovation[i] -= D_m[i, j] * seen_correction[j]
    M, K = matrix(run.M + 8 * n * q * design, n, q), matrix(run.K + 8 * p * n * design, p, n)
    for i in range(n):
        deviation[i] = prior[i]
        for j in range(q):
            deviation[i] += M[i, j] * innovation[j]
    feedforward, u = floats(run.feedforward + 8 * p * instant, p), floats(run.u, p)
    low, high = floats(run.u_low + 8 * p * design, p), floats(run.u_high + 8 * p * design, p)
    correction = floats(run.corrections + 8 * p * instant, p)
    for i in range(p):
        u[i] = feedforward[i]
        for j in range(n):
            u[i] -= K[i, j] * deviation[j]
        correction[i] = min(max(u[i], low[i]), high[i]) - feedforward[i]
    A_d, B_d = matrix(run.A_d + 8 * n * n * design, n, n), matrix(run.B_d + 8 * n * p * design, n, p)
    drift, x_ref = floats(run.drift + 8 * n * instant, n), floats(run.x_ref + 8 * n * instant, n)
    estimate = floats(run.estimate, n)
    for i in range(n):
        prior[i] = drift[i]
        for j in range(n):
            prior[i] += A_d[i, j] * deviation[j]
        for j in range(p):
            prior[i] += B_d[i, j] * correction[j]
        estimate[i] = x_ref[i] + deviation[i]


@callback("run")
def control_at_stage(address: int) -> None:
    """The law's input for the present stage of RK4, for the record of a run at an address; called by MuJoCo's control callback."""
    run = _runs_at(address, 1)[0]
    if run.stage >= STAGES or run.stopped != 0:
        return  # an evaluation outside a step keeps the last input
    instant = 3 * run.index + (0 if run.stage == 0 else (2 if run.stage == 3 else 1))
    _deviation(run, instant)
    _input(run, instant)
    u = floats(run.u, run.p)
    _send(run, u)
    if run.stage == 1:
        copy(u, floats(run.middle, run.p))
    run.stage += 1
