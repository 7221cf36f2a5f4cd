"""A right call of every public function and class, from which malformed ones are made by replacing an argument."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

import invtrack
from invtrack import (
    baselines,
    control,
    figures,
    inversion,
    learning,
    linear,
    mechanisms,
    plans,
    plant,
    preview,
    recording,
    redesign,
    references,
    regulation,
    report,
    results,
    studies,
    testing,
)
from tests.synthetic_runs import two_mode_run

ROOMS = (
    "advice",
    "baselines",
    "control",
    "figures",
    "inversion",
    "learning",
    "linear",
    "mechanisms",
    "plans",
    "plant",
    "preview",
    "recording",
    "redesign",
    "references",
    "regulation",
    "report",
    "results",
    "simulation",
    "studies",
    "testing",
)

NOT_DOORS = {
    # what functions return; nobody makes one by hand
    *("Derivatives", "GainsAlong", "Iteration", "Linearizations", "MotionChecks", "MotionPlan", "PlantDynamics"),
    *("Certificate", "Plan", "PolynomialSegments", "PreactuationBound", "Ringing", "SampledPlan", "Samples", "Tail", "Trajectory"),
    *("TwoSidedSegments", "NormalForm", "Zero", "ZeroReport", "BoundaryConditions", "Candidate", "FeasibilityReport"),
    *(
        "IntervalReport",
        "JumpReport",
        "Modification",
        "ModifiedMotion",
        "ModifiedPlan",
        "ModifiedTrajectory",
        "TradeOff",
        "TradeOffPoint",
        "ActiveLimit",
    ),
    *("ActiveStretch", "Optimality", "OptimalTrajectory", "TrimPoint", "TrimmedQuantity", "ActingLimit", "Stretches"),
    *("ConstrainedMotion", "GaussNewtonStep", "OptimalMotion"),
    *("ConstrainedTrajectory", "FrequencyResponse", "ImpulseResponse", "Outcome", "Prefilter", "PrefilteredTrajectory"),
    *(
        "ReferenceReport",
        "InadmissibleState",
        "RegulationCertificate",
        "RegulationMap",
        "Regulator",
        "Event",
        "Metrics",
        "RunResult",
    ),
    *("Signal", "SimulatedPlant", "LinearStepper", "OutputFeedbackLaw", "AffineLaw", "DifferenceLaw"),
    *("Instants", "Planned", "Configuration", "Session", "InvtrackError", "DivergedError", "MissingError"),
    # protocols, aliases and what only its own tests make
    *("Mode", "Oscillation", "RunAssertionError"),
    *("Learned", "LearningStep", "Reduction", "ZerosAlong"),
    *("Chain", "Dynamics", "Mechanism", "mechanism"),
    *("Learned", "LearningStep"),
    *("Foreseen", "PlanPiece", "PreviewBound", "PreviewPlanner", "WorstReference"),
    *("Advice", "Trial"),
    *("Dynamics", "Mechanism", "mechanism"),
    *("Controller", "Law", "Observer", "PlanFollower", "Parameter", "Stepper", "Line", "Cell", "Rows"),
    # of studies: made of functions, checked where the study runs
    *("Case", "Setup", "Study", "Table"),
}
"""Public names that are not called with what a user hands over."""


@dataclass(frozen=True)
class Call:
    """A function or class, and arguments by name with which it succeeds.

    callbacks: the arguments that may be functions. takes: what of the bad values is right for this call after all.
    """

    function: Callable[..., Any]
    arguments: dict[str, Any]
    callbacks: tuple[str, ...] = ()
    takes: tuple[str, ...] = ()


def call(function: Callable[..., Any], *, callbacks: tuple[str, ...] = (), takes: tuple[str, ...] = (), **arguments: Any) -> Call:
    """A `Call`."""
    return Call(function, arguments, callbacks, takes)


@lru_cache(maxsize=1)
def workplace() -> tempfile.TemporaryDirectory[str]:
    """The folder in which this process makes its calls, so that what they write goes away with it."""
    return tempfile.TemporaryDirectory()


@lru_cache(maxsize=1)
def valid_calls() -> dict[str, Call]:
    """By name: those of the rooms under their own, methods as "class.method". Paths are relative to the `workplace`."""
    with contextlib.chdir(workplace().name):
        return _calls()


def _calls() -> dict[str, Call]:
    A, B, C = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[0.0], [1.0]]), np.array([[3.0, 1.0]])
    model = invtrack.StateSpace(A, B, C)
    antistable = invtrack.StateSpace(A, B, np.array([[2.0, -1.0]]))
    jumping = invtrack.SwitchedSystem([model, invtrack.StateSpace(A * 1.1, B, C)], [0.5])
    slew = invtrack.rest_to_rest(0.0, 1.0, 1.0)
    bump = invtrack.raised_cosine(1.0, period=1.0)
    plan = invtrack.invert(model, slew)
    sway = references.sinusoidal_exosystem([1.0], start=0.0, end=2 * np.pi)
    maps = invtrack.exosystem_map(model, sway)
    gains = invtrack.lqr(model, Q=1.0, R=1.0)
    zv = baselines.shaper("ZV", [(3.0, 0.1)])
    run = invtrack.simulate(invtrack.LinearPlant(model), invtrack.TrackingController(plan, gains), timestep=0.05, end=12.0)
    vibrating = two_mode_run()
    rig = invtrack.Plant.from_xml(invtrack.model_path("cantilever"), inputs=["base_force"], outputs=["tip_position"])
    swung = invtrack.simulate(
        rig, invtrack.TrackingController(invtrack.invert(invtrack.linearize(rig), slew, tolerance=1e-2)), timestep=0.05
    )
    weighed = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        parameters={"tip_mass": "body:tip:mass"},
    )
    weights = {"R": 1.0, "Q_y": 10.0}
    prefilter = redesign.prefilter(invtrack.StateSpace(A, B, np.array([[1.0, 0.0]])), **weights)
    trade_off = redesign.pareto_sweep(model, bump, weights=[weights])
    luenberger = control.LuenbergerObserver([-4.0, -5.0])
    rods = invtrack.StateSpace(np.diag([-1.0, -1.5, -20.0]), np.ones((3, 1)), np.ones((1, 3)))
    reduction = linear.modal_truncation(rods, band=0.5, modes=1)
    times, values = np.linspace(0.0, 1.0, 12), np.linspace(0.0, 1.0, 12) ** 2
    Path("reference.csv").write_text(
        "time,y\n" + "\n".join(f"{t},{v}" for t, v in zip(times, values, strict=True)), encoding="utf-8"
    )
    Path("log.csv").write_text(Path("reference.csv").read_text(encoding="utf-8"), encoding="utf-8")
    plans.export_plan(plan, "plan.csv", rate=50.0)
    recording.save_recording(vibrating, "run.rrd")
    figure = figures.plan_figure(plan)
    response = prefilter.frequency_response(np.array([0.5, 2.0]))
    w = np.array([0.5, 2.0])
    modified = {"real_part": 4.0, "axis_distance": 100.0, "error_poles": [-3.0]}
    line = (times, values)

    def panels(count: int) -> Any:
        return Figure().subplots(count)

    table: dict[str, Call] = {
        # top
        "Channels": call(invtrack.Channels, names=["a", "b"], units=["m", "N"]),
        "Channels.index": call(invtrack.Channels(["a"]).index, name="a"),
        "Channels.subset": call(invtrack.Channels(["a"]).subset, names=["a"]),
        "Channels.with_units": call(invtrack.Channels(["a"]).with_units, units={"a": "m"}),
        # linear
        "StateSpace": call(
            invtrack.StateSpace,
            A=A,
            B=B,
            C=C,
            D=np.zeros((1, 1)),
            states=["a", "b"],
            inputs=["u"],
            outputs=["y"],
            operating_point=model.operating_point,
            rest=np.zeros(2),
            input_limits=[[-1.0, 1.0]],
            measurement=model.measurement,
            parameters={"m": 1.0},
            error_estimates={"A": 0.0},
            left_out=["dry friction"],
        ),
        "StateSpace.transformed": call(model.transformed, T=np.array([[1.0, 1.0], [0.0, 1.0]]), states=["a", "b"]),
        "StateSpace.with_inputs": call(model.with_inputs, inputs=["u1"]),
        "StateSpace.with_outputs": call(model.with_outputs, outputs=["y1"]),
        "OperatingPoint": call(linear.OperatingPoint, x0=np.zeros(2), u0=np.zeros(1), y0=np.zeros(1)),
        "Measurement": call(linear.Measurement, C=C, D=np.zeros((1, 1)), channels=["y"], y0=np.zeros(1)),
        "SwitchedSystem": call(invtrack.SwitchedSystem, systems=[model, model], switch_times=[0.5]),
        "SwitchedSystem.interval": call(jumping.interval, t=[0.2, 0.7]),
        "normal_form": call(linear.normal_form, system=model),
        "relative_degree": call(linear.relative_degree, system=model),
        "zeros": call(linear.zeros, system=model),
        "zero_report": call(linear.zero_report, system=model),
        "without_hidden_modes": call(linear.without_hidden_modes, model=model),
        "format_zeros": call(linear.format_zeros, takes=("complex", "complex matrix"), zeros=[1.0 + 2.0j], size=1.0),
        "to_control": call(linear.to_control, system=model),
        "to_scipy": call(linear.to_scipy, system=model),
        "slowest_flexible_period": call(linear.slowest_flexible_period, system=model),
        "modal_truncation": call(linear.modal_truncation, model=rods, band=0.5, accuracy=0.9, modes=1, residual_stiffness=False),
        "balanced_truncation": call(linear.balanced_truncation, model=rods, band=0.5, accuracy=0.9, modes=1),
        "Reduction.output_error": call(reduction.output_error, frequencies=[0.5, 1.0], interval=0),
        "zeros_along": call(linear.zeros_along, model=invtrack.StateSpace(A, B, np.eye(2)), stations=[0.0, 1.0], places=[0.3, 0.7]),
        # references
        "rest_to_rest": call(invtrack.rest_to_rest, start=0.0, end=1.0, duration=1.0, smoothness=2, start_time=0.0),
        "s_curve": call(
            references.s_curve,
            start=0.0,
            end=1.0,
            max_jerk=8.0,
            duration=None,
            max_velocity=2.0,
            max_acceleration=4.0,
            start_time=0.0,
        ),
        "raised_cosine": call(invtrack.raised_cosine, peak=1.0, period=1.0, cycles=1, start_time=0.0),
        "constant": call(references.constant, value=1.0, at=0.0),
        "autonomous": call(references.autonomous, S=[[0.0]], R=[[1.0]], w_0=[1.0], start=0.0, end=1.0),
        "piecewise_polynomial": call(
            references.piecewise_polynomial,
            breakpoints=[0.0, 1.0],
            coefficients=[[0.0, 1.0]],
            time_scale=1.0,
            basis="power",
            held=(0.0, 1.0),
        ),
        "sampled_reference": call(invtrack.sampled_reference, times=times, values=values, degree=5, smoothness=2),
        "smoothed_reference": call(
            references.smoothed_reference, times=times, values=values, band=8.0, start=[0.0], degree=5, smoothness=2
        ),
        "load_reference": call(invtrack.load_reference, path="reference.csv", time="time", channels=["y"], degree=5, smoothness=2),
        "reference_report": call(references.reference_report, reference=slew, highest=4, channels=["y"]),
        "stack": call(references.stack, signals=[slew, slew]),
        "PiecewiseSignal": call(
            invtrack.PiecewiseSignal, breakpoints=slew.breakpoints, generators=slew.generators, kind=slew.kind, anchors=slew.anchors
        ),
        "PiecewiseSignal.__call__": call(slew.__call__, t=[0.5], derivative=1, inside=[0.5]),
        "PiecewiseSignal.shifted": call(slew.shifted, delay=1.0),
        "PiecewiseSignal.scaled": call(slew.scaled, gain=2.0),
        "PiecewiseSignal.refined": call(slew.refined, times=[0.5]),
        "PiecewiseSignal.__add__": call(slew.__add__, other=slew),
        "PiecewiseSignal.__sub__": call(slew.__sub__, other=slew),
        "Exosystem": call(references.Exosystem, A=[np.zeros((1, 1))], C=[np.ones((1, 1))], switch_times=[], names=["w"]),
        "Exosystem.reference": call(sway.reference, x_e=np.ones(sway.n_states), at=0.0),
        "Exosystem.states": call(sway.states, x_e=np.ones(sway.n_states), at=0.0, t=[0.5], inside=[0.5]),
        "Exosystem.transformed": call(sway.transformed, T=np.eye(sway.n_states), names=["a", "b", "c"][: sway.n_states]),
        "Exosystem.weighted": call(sway.weighted, weights=np.ones(sway.n_states)),
        "Exosystem.shifted": call(sway.shifted, delay=1.0),
        "exosystem": call(references.exosystem, A_e=[[0.0]], C_e=[[1.0]], start=0.0, end=1.0, outside="zero", names=["w"]),
        "sinusoidal_exosystem": call(
            references.sinusoidal_exosystem, frequencies=[1.0], bias=True, start=0.0, end=1.0, outside="zero"
        ),
        "polynomial_exosystem": call(references.polynomial_exosystem, degree=2, start=0.0, end=1.0, outside="zero"),
        "step_exosystem": call(references.step_exosystem, start=0.0, end=1.0, outside="zero"),
        "sum_exosystems": call(references.sum_exosystems, parts=[sway, sway]),
        "stack_exosystems": call(references.stack_exosystems, parts=[sway, sway]),
        # plans
        "Plan.__call__": call(plan.__call__, t=[0.5], inside=[0.5]),
        "Plan.departures": call(plan.departures, t=[0.5], inside=[0.5]),
        "Plan.states": call(plan.states, t=[0.5], inside=[0.5]),
        "Plan.inputs": call(plan.inputs, t=[0.5], inside=[0.5]),
        "certify": call(plans.certify, model=plan.model, trajectory=plan.trajectory, reference=slew, span=(0.0, 1.0)),
        "export_plan": call(plans.export_plan, plan=plan, path="out.csv", rate=50.0, inputs="midpoint", start=-1.0, end=2.0),
        "sampled_plan": call(plans.sampled_plan, plan=plan, rate=50.0, inputs="midpoint", start=-1.0, end=2.0),
        "read_plan": call(plans.read_plan, path="plan.csv", plant=None),
        "lifted": call(plans.lifted, plan=invtrack.invert(reduction.reduced, slew), reduction=reduction),
        "preactuation_bound": call(plans.preactuation_bound, plan=invtrack.invert(antistable, slew)),
        # inversion
        "invert": call(
            invtrack.invert,
            callbacks=("progress",),
            model=model,
            reference=slew,
            R=2.0,
            schedule=(),
            accuracy=1e-8,
            hold=None,
            tolerance=1e-8,
            max_preactuation=3.0,
            max_postactuation=3.0,
            progress=None,
        ),
        "feasibility": call(inversion.feasibility, model=model, reference=slew, R=2.0),
        "modified_inversion": call(
            invtrack.modified_inversion,
            callbacks=("progress",),
            model=antistable,
            reference=slew,
            **modified,
            move=None,
            interval=0,
            design="least error",
            output_scale=1.0,
            tolerance=1e-8,
            max_preactuation=3.0,
            max_postactuation=3.0,
            schedule=(),
            accuracy=1e-8,
            progress=None,
        ),
        "modified_inversion of named zeros": call(
            invtrack.modified_inversion, model=antistable, reference=slew, move={2.0: 4.0}, error_poles=[-3.0]
        ),
        "error_bound": call(inversion.error_bound, model=antistable, reference=slew, start=-1.0, output_scale=1.0),
        "tune_modified_inversion": call(
            inversion.tune_modified_inversion,
            model=antistable,
            reference=slew,
            preactuation=1.5,
            error=None,
            axis_distance=100.0,
            zeros=None,
            real_parts=(2.5, 20.0),
            level=0.01,
            error_poles=[-3.0],
        ),
        "preactuation_trade_off": call(
            inversion.preactuation_trade_off,
            model=antistable,
            reference=slew,
            real_parts=[3.0],
            axis_distance=100.0,
            zeros=None,
            level=0.01,
            error_poles=[-3.0],
        ),
        "causal_inverse": call(invtrack.causal_inverse, model=model, reference=slew, tolerance=1e-8, max_postactuation=3.0),
        "steady_state_feedforward": call(inversion.steady_state_feedforward, model=model, reference=slew, schedule=()),
        # redesign
        "Limits": call(invtrack.Limits, input=1.0, input_rate=5.0, output=2.0, states=[]),
        "StateLimit": call(invtrack.StateLimit, name="twist", row={"x1": 1.0}, limit=2.0),
        "quadratic_redesign": call(
            invtrack.quadratic_redesign,
            model=model,
            reference=bump,
            R=1.0,
            Q_x=0.1,
            Q_y=10.0,
            probabilities=[1.0],
            schedule=(),
            accuracy=1e-8,
            hold=None,
            tolerance=1e-8,
            max_preactuation=5.0,
            max_postactuation=5.0,
        ),
        "constrained_redesign": call(
            invtrack.constrained_redesign,
            model=model,
            reference=bump,
            R=1.0,
            Q_x=0.1,
            Q_y=10.0,
            limits=invtrack.Limits(input=50.0),
            step=0.05,
            schedule=(),
            accuracy=1e-8,
            hold=None,
            tolerance=1e-8,
            max_preactuation=5.0,
            max_postactuation=5.0,
        ),
        "prefilter": call(
            redesign.prefilter,
            callbacks=("R", "Q_x", "Q_y"),
            model=model,
            R=1.0,
            Q_x=0.1,
            Q_y=10.0,
            stabilizing_gain=np.zeros((1, 2)),
        ),
        "Prefilter.frequency_response": call(prefilter.frequency_response, w=w),
        "Prefilter.impulse_response": call(prefilter.impulse_response, times=times, tolerance=1e-3),
        "Prefilter.preview_time": call(prefilter.preview_time, level=0.01),
        "Prefilter.apply": call(prefilter.apply, reference=bump, times=times, tolerance=1e-4),
        "pareto_sweep": call(
            redesign.pareto_sweep,
            callbacks=("method",),
            model=model,
            reference=bump,
            weights=[weights],
            quantities={"a": {"x1": 1.0}},
            exact=None,
            method=invtrack.quadratic_redesign,
        ),
        "TradeOff.values": call(trade_off.values, figure="max_error"),
        "outcome": call(redesign.outcome, plan=plan, quantities={"a": {"x1": 1.0}}),
        "cost": call(redesign.cost, plan=invtrack.invert(model, bump), R=1.0, Q_x=0.1, Q_y=10.0),
        # regulation
        "exosystem_map": call(invtrack.exosystem_map, model=model, exosystem=sway, tolerance=1e-8),
        "francis": call(regulation.francis, system=model, A_e=sway.A[1], C_e=sway.C[1]),
        "single_francis": call(regulation.single_francis, model=model, exosystem=sway, interval=0),
        "switched_francis": call(regulation.switched_francis, model=model, exosystem=sway),
        "RegulationMap.x_map": call(maps.x_map, t=[0.5], inside=[0.5]),
        "RegulationMap.x_rest": call(maps.x_rest, t=[0.5], inside=[0.5]),
        "RegulationMap.u_rest": call(maps.u_rest, t=[0.5], inside=[0.5]),
        "RegulationMap.u_map": call(maps.u_map, t=[0.5], inside=[0.5]),
        "RegulationMap.plan": call(maps.plan, x_e=maps.admissible[:, 0], at=0.0),
        "RegulationMap.inadmissible_share": call(maps.inadmissible_share, x_e=maps.admissible[:, 0], at=0.0),
        # control
        "lqr": call(invtrack.lqr, model=model, Q=1.0, R=1.0),
        "lifted_gains": call(control.lifted_gains, gains=[[1.0]], reduction=reduction),
        "amplification": call(control.amplification, plan=plan, gains=gains),
        "bryson": call(invtrack.bryson, model=model, states={"x1": 0.1}, outputs={"y1": 0.1}, inputs={"u1": 1.0}),
        "place": call(invtrack.place, model=model, poles=[-1.0, -2.0]),
        "GainSchedule": call(invtrack.GainSchedule, gains=[np.zeros((1, 2))] * 2, switch_times=[0.5]),
        "GainSchedule.interval": call(gains.interval, t=[0.5]),
        "LuenbergerObserver": call(control.LuenbergerObserver, poles=[-4.0, -5.0]),
        "LuenbergerObserver.gain": call(luenberger.gain, system=model, period=0.01),
        "KalmanFilter": call(control.KalmanFilter, input_noise=0.1, measurement_noise=0.1),
        "KalmanFilter.gain": call(control.KalmanFilter(0.1, 0.1).gain, system=model, period=0.01),
        "ExosystemObserver": call(control.ExosystemObserver, exosystem=sway, observer=control.KalmanFilter(0.1, 0.1)),
        "TrackingController": call(invtrack.TrackingController, plan=plan, gains=gains, period=0.01),
        "OutputFeedbackController": call(
            control.OutputFeedbackController, plan=plan, gains=gains, observer=luenberger, period=0.01, measurement_delay=0.0
        ),
        "ExosystemController": call(
            control.ExosystemController,
            regulation=maps,
            gains=gains,
            exosystem_state=maps.admissible[:, 0],
            at=0.0,
            plan=None,
            exosystem_observer=control.KalmanFilter(0.1, 0.1),
            initial_estimate=np.zeros(sway.n_states),
            reference_noise=0.1,
            seed=1,
            state_observer=luenberger,
            period=0.01,
        ),
        # mechanisms
        "Beam": call(
            mechanisms.Beam,
            length=1.0,
            width=0.05,
            thickness=0.004,
            youngs_modulus=2e11,
            density=7850.0,
            segments=3,
            base_mass=4.0,
            payload=0.2,
            payload_inertia=1e-4,
            damping=[0.01, 0.02],
            orientation="hanging",
        ),
        "Beam.surface_strain": call(mechanisms.Beam(segments=2).surface_strain, angles=[0.01, 0.02]),
        "Beam.strain_energy": call(mechanisms.Beam(segments=2).strain_energy, angles=[0.01, 0.02]),
        # baselines
        "Shaper": call(baselines.Shaper, times=[0.0, 1.0], amplitudes=[0.5, 0.5], kind="own", modes=()),
        "Shaper.shaped": call(zv.shaped, reference=slew),
        "Shaper.after": call(zv.after, other=zv),
        "shaper": call(baselines.shaper, kind="EI", modes=[(3.0, 0.1)], tolerance=0.05),
        "residual_vibration_ratio": call(baselines.residual_vibration_ratio, shaper=zv, frequency=[1.0, 2.0], damping=0.1),
        "insensitivity": call(baselines.insensitivity, shaper=zv, mode=(3.0, 0.1), level=0.05),
        "flexible_modes": call(baselines.flexible_modes, model=model, gains=gains, interval=0, most_damping=0.5),
        "base_servo": call(baselines.base_servo, model=model, position="x1", frequency=2.0, damping=0.7, input="u1"),
        "feedback_tracking": call(
            baselines.feedback_tracking,
            model=model,
            reference=slew,
            gains=gains,
            command=zv.shaped(slew),
            derivatives=1,
            tolerance=1e-8,
            max_postactuation=3.0,
        ),
        "approximate_inverse": call(
            baselines.approximate_inverse, model=model, reference=slew, kind="ZPETC", hold=0.1, least_damping=0.01
        ),
        # simulation
        "LinearPlant": call(invtrack.LinearPlant, model=model, input_limits=[[-9.0, 9.0]], name="model"),
        "Sensor": call(invtrack.Sensor, noise=0.1, quantization=0.1, delay=0.1),
        "simulate": call(
            invtrack.simulate,
            plant=invtrack.LinearPlant(model),
            controller=invtrack.TrackingController(plan, gains),
            schedule=None,
            timestep=0.1,
            start=-1.0,
            end=2.0,
            evaluate="held",
            vibration_period=1.0,
            initial_state=[0.0, 0.0],
            sensors={},
            seed=0,
            name="run",
            progress=None,
            callbacks=("progress",),
            takes=("discrete system",),
        ),
        # learning
        "Learning": call(
            learning.Learning,
            callbacks=("planner",),
            planner=lambda y_d: invtrack.invert(model, y_d),
            reference=slew,
            band=5.0,
            gain=0.5,
            degree=5,
            window=(0.0, 5.0),
        ),
        "iterate": call(
            invtrack.iterate,
            callbacks=("drive", "planner", "rehearsal", "progress"),
            drive=lambda plan: run,
            planner=lambda y_d: invtrack.invert(model, y_d),
            reference=slew,
            band=5.0,
            runs=1,
            target=1.0,
            rehearsal=None,
            gain=0.5,
            degree=5,
            window=(0.0, 5.0),
            progress=None,
        ),
        # results
        "read_log": call(invtrack.read_log, path="log.csv", along=plan, columns={"y1": "y"}, time="time", zero=0.0, name="log"),
        "max_error": call(invtrack.max_error, result=run, wanted="reference"),
        "rms_error": call(results.rms_error, result=run, wanted="reference"),
        "assert_tracks": call(testing.assert_tracks, run=vibrating, within=1.0, output="tip_position"),
        "assert_settles": call(testing.assert_settles, run=vibrating, within=1.0, after=1.0, output="tip_position"),
        "assert_residual_vibration": call(
            testing.assert_residual_vibration, run=vibrating, at_most=1.0, output="tip_position", periods=1.0, duration=1.0
        ),
        "assert_peak_input": call(testing.assert_peak_input, run=vibrating, at_most=1e3, input="base_force", commanded=True),
        "oscillation": call(testing.oscillation, run=vibrating, output="tip_position", start=5.0),
        "nearest_mode": call(
            testing.nearest_mode, model=invtrack.StateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]]), frequency=1.0
        ),
        "factor_cases": call(testing.factor_cases, factors={"load": [0.9, 1.1]}, together=True),
        "RunCache": call(testing.RunCache, kept=2),
        "Artifacts": call(testing.Artifacts, folder="kept"),
        "residual_vibration": call(invtrack.residual_vibration, result=vibrating, periods=1.0, duration=1.0),
        "state_vibration": call(results.state_vibration, result=run, names=["x1"], periods=1.0, duration=1.0),
        "preactuation_time": call(results.preactuation_time, motion=plan, level=0.01),
        "postactuation_time": call(results.postactuation_time, motion=plan, level=0.01),
        "peak_input": call(results.peak_input, motion=run),
        "peak_input_above_rest": call(results.peak_input_above_rest, motion=run),
        "peak_commanded_input": call(results.peak_commanded_input, result=run),
        "metrics": call(invtrack.metrics, result=vibrating, periods=1.0, duration=1.0),
        "run_cost": call(results.run_cost, result=run, R=1.0, Q_x=0.1, Q_y=10.0, u_0=0.0, x_0=0.0, wanted=run.reference.values),
        # recording
        "save_recording": call(
            invtrack.save_recording, results=vibrating, path="saved.rrd", application="trial", every_sample=False, camera=None
        ),
        "save_animation": call(
            recording.save_animation, results=swung, path="saved.webp", rate=1.0, width=160, height=160, camera=None
        ),
        "load_recording": call(invtrack.load_recording, path="run.rrd"),
        # figures
        "tracking_figure": call(figures.tracking_figure, result=run, window=(0.0, 1.0), ax=panels(5)),
        "preactuation_figure": call(figures.preactuation_figure, result=vibrating, level=0.01, ax=panels(1)),
        "comparison_figure": call(figures.comparison_figure, results=[run, run], window=(0.0, 1.0), ax=panels(3)),
        "around_figure": call(
            figures.around_figure, results=[vibrating], times={"start": 1.0}, before=0.5, after=0.5, ax=panels(2)
        ),
        "overlay_figure": call(
            figures.overlay_figure,
            title="a",
            panels=[("y [m]", {"a": line})],
            wanted="a",
            window=(0.0, 1.0),
            limits={"y [m]": (0.0, 1.0)},
            manoeuvre=(0.0, 1.0),
            ax=panels(1),
        ),
        "plan_figure": call(figures.plan_figure, plans=plan, states=["x1"], window=(0.0, 1.0), ax=panels(3)),
        "sweep_figure": call(
            figures.sweep_figure,
            takes=("NaN vector",),
            logarithmic=False,
            title="a",
            label="p",
            values=[1.0, 2.0],
            predicted={"a": [1.0, 2.0]},
            measured={"a": [1.0, 2.0]},
            quantity="q",
            ax=panels(1),
        ),
        "bands_figure": call(
            figures.bands_figure,
            takes=("NaN vector",),
            title="a",
            time=times,
            values=np.vstack([values, values]),
            quantity="q",
            bands=(50.0, 90.0),
            manoeuvre=(0.0, 1.0),
            ax=panels(1),
        ),
        "tornado_figure": call(
            figures.tornado_figure, title="a", correlations={"mass": 0.5, "delay": -0.1}, samples=20, quantity="q", ax=panels(1)
        ),
        "histogram_figure": call(
            figures.histogram_figure, takes=("NaN vector",), title="a", values=values, quantity="q", limit=2.0, ax=panels(1)
        ),
        "Decay": call(figures.Decay, label="e [m]", time=times, values=values, rate=1.0),
        "decay_figure": call(
            figures.decay_figure, title="a", decays=[figures.Decay("e [m]", times, values + 1e-3, 1.0)], ax=panels(1)
        ),
        "frequency_response_figure": call(
            figures.frequency_response_figure,
            title="a",
            w=w,
            curves={"G": response.G_f[:, 0, 0]},
            magnitude="|G|",
            phase=True,
            ax=panels(2),
        ),
        "trade_off_figure": call(
            figures.trade_off_figure,
            title="a",
            horizontal=("p", [1.0, 2.0]),
            panels=[("q", {"a": [1.0, 2.0]})],
            notes=["a", "b"],
            horizontal_log=False,
            vertical_log=False,
            ax=panels(1),
        ),
        "save_figure": call(figures.save_figure, figure=figure, path="figure.png"),
        # plant
        "Plant": call(
            invtrack.Plant.from_xml,
            source=invtrack.model_path("cantilever"),
            inputs=["base_force"],
            outputs=["tip_position"],
            measurements=["tip_position"],
            drop_states=[],
            backlash=[],
            parameters={"tip_mass": "body:tip:mass"},
            units={},
            keyframe=None,
        ),
        "Plant.at": call(rig.at, qpos=np.zeros(3), qvel=np.zeros(3), act=None, ctrl=np.zeros(1), keyframe=None),
        "Plant.coordinates_of": call(rig.coordinates_of, x=rig.operating_point.x0),
        "Change": call(invtrack.Change, time=1.0, tip_mass=2.0),
        "linearize": call(
            invtrack.linearize,
            plant=rig,
            equilibrium="same outputs",
            step=1e-4,
            equilibrium_tolerance=1e-6,
            allow_nonequilibrium=False,
        ),
        "trim": call(
            invtrack.trim,
            plant=rig,
            outputs={"tip_position": 0.5},
            positions={"rotation": 0.0},
            controls={"base_force": 0.0},
            free=[],
            tolerance=1e-8,
        ),
        "model_path": call(invtrack.model_path, name="cantilever"),
        "with_parameter_values": call(plant.with_parameter_values, plant=weighed, values={"tip_mass": 3.0}),
        "with_input_limits": call(plant.with_input_limits, plant=rig, limits={"base_force": (-1.0, 1.0)}),
        "with_coupling_scaled": call(
            plant.with_coupling_scaled,
            name="velocity_coupling",
            scale=0.5,
            plant=invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"]),
        ),
        # preview
        "inversion_planner": call(preview.inversion_planner, model=antistable, preview=0.5, period=0.1, start=0.0, held=0.0),
        "redesign_planner": call(
            preview.redesign_planner, model=model, R=1.0, Q_x=0.0, Q_y=1.0, preview=0.5, period=0.1, start=0.0, held=[0.0]
        ),
        "PreviewPlanner.update": call(preview.inversion_planner(antistable, preview=0.5, period=0.1).update, reference=slew),
        "preview_bound": call(
            preview.preview_bound, planner=preview.inversion_planner(antistable, preview=0.5, period=0.1), gains=gains
        ),
        "preview_inversion": call(
            preview.preview_inversion,
            model=antistable,
            reference=slew,
            preview=0.5,
            period=0.1,
            tolerance=1e-8,
            max_postactuation=5.0,
        ),
        "preview_redesign": call(
            preview.preview_redesign,
            model=model,
            reference=slew,
            R=1.0,
            Q_x=0.0,
            Q_y=1.0,
            preview=0.5,
            period=0.1,
            tolerance=1e-8,
            max_postactuation=5.0,
        ),
        "stop": call(
            preview.stop,
            planner=preview.inversion_planner(antistable, preview=0.5, period=0.1),
            R=1.0,
            Q_x=0.0,
            Q_y=1.0,
            at=[1.0],
            state=[0.1, 0.2],
            tolerance=1e-8,
        ),
        "column_figure": call(figures.column_figure, result=vibrating, window=(-1.0, 1.0), ax=panels(3)),
        "svg_text": call(figures.svg_text, figure=figure, title="a"),
        # advice and report
        "advise": call(
            invtrack.advise,
            callbacks=("progress",),
            plant=model,
            reference=slew,
            error=0.01,
            limits=None,
            parameter_errors=0.0,
            max_preactuation=None,
            fastest=False,
            timestep=0.05,
            progress=None,
        ),
        "Move": call(invtrack.Move, by=1.0, duration=1.0),
        "write_report": call(report.write_report, source=run, path="report.html", error=0.01),
        # studies
        "StudyOptions": call(studies.StudyOptions, out=None, timestep=1e-3, case=(), seed=0, json=False, quiet=True, figures=False),
        "Column": call(studies.Column, name="max error", unit="m", key="max_error"),
        "print_table": call(
            studies.print_table,
            title="a",
            columns=[studies.Column("max error", "m")],
            rows={"a": {"max_error": 1.0}},
            row_header="case",
            console=Console(file=io.StringIO()),
        ),
    }
    return table


def public_doors() -> set[str]:
    """Every class and function at the top and in the rooms' faces that is called with what a user hands over."""
    members = {name: getattr(invtrack, name) for name in invtrack.__all__}
    for room in ROOMS:
        module = importlib.import_module(f"invtrack.{room}")
        members |= {name: getattr(module, name) for name in module.__all__}
    return {name for name, member in members.items() if inspect.isclass(member) or inspect.isfunction(member)} - NOT_DOORS
