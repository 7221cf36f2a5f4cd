"""Controllers around a plan, their gains, and observers for what is not measured."""

from invtrack.control.amplification import amplification
from invtrack.control.bryson import bryson
from invtrack.control.exosystem_controller import ExosystemController
from invtrack.control.gains import GainsAlong, GainSchedule, place
from invtrack.control.lifted_gains import lifted_gains
from invtrack.control.lqr import lqr
from invtrack.control.observer import ExosystemObserver, KalmanFilter, LuenbergerObserver, Observer
from invtrack.control.output_feedback import OutputFeedbackController, OutputFeedbackLaw
from invtrack.control.protocol import AffineLaw, Controller, DifferenceLaw, Instants, Law, Planned
from invtrack.control.tracking_controller import PlanFollower, TrackingController

__all__ = [
    "AffineLaw",
    "Controller",
    "DifferenceLaw",
    "ExosystemController",
    "ExosystemObserver",
    "GainSchedule",
    "GainsAlong",
    "Instants",
    "KalmanFilter",
    "Law",
    "LuenbergerObserver",
    "Observer",
    "OutputFeedbackController",
    "OutputFeedbackLaw",
    "PlanFollower",
    "Planned",
    "TrackingController",
    "amplification",
    "bryson",
    "lifted_gains",
    "lqr",
    "place",
]
