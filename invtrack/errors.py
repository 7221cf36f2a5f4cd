"""Every error that invtrack raises on purpose, and the warnings that have a class of their own.

Each message says what was expected, what came instead and what to do about it. All of them derive from `InvtrackError`, so a script
can catch one type and print one readable line.
"""


class InvtrackError(Exception):
    """Base of all errors that invtrack raises on purpose."""


class ChannelError(InvtrackError, ValueError):
    """Names or units of channels do not fit each other, or no channel has the name that is asked for."""


class ModelError(InvtrackError, ValueError):
    """A linear model is malformed: wrong shapes, names, or numbers that are not finite."""


class RelativeDegreeError(InvtrackError, ValueError):
    """The plant has no inverse (its transfer matrix is singular or nearly so), or no vector relative degree where one is needed."""


class TrajectoryError(InvtrackError, ValueError):
    """A reference is malformed, or not smooth enough for the plant."""


class PlanError(InvtrackError, ValueError):
    """No plan can be made as asked, or the one found cannot be trusted; the message says why and what would help."""


class InversionError(PlanError):
    """No bounded inverse exists; the message says which condition fails and what would help."""


class NonHyperbolicError(InversionError):
    """The internal dynamics have eigenvalues on the imaginary axis."""


class CompatibilityError(InversionError):
    """At a parameter jump the state cannot be continuous and the output exact at once."""


class BoundednessError(InversionError):
    """The conditions that keep the solution bounded before and after the manoeuvre cannot all be met."""


class RedesignError(PlanError):
    """No optimal plan exists as asked: weights, limits or a held value; the message says which and what would help."""


class ControlError(InvtrackError, ValueError):
    """A gain or controller cannot be designed or does not fit the plant."""


class PlantError(InvtrackError, ValueError):
    """An MJCF model, a name in it, a parameter or an operating point is not usable as asked."""


class SimulationError(InvtrackError, ValueError):
    """A simulation was asked for something it cannot do."""


class LearningError(InvtrackError, ValueError):
    """Learning from run to run is not possible as asked: the error does not contract, or a run does not fit."""


class SweepError(InvtrackError, ValueError):
    """A sweep, its design or what its study returns is not usable as asked."""


class FileError(InvtrackError, ValueError):
    """A file or folder cannot be read or written, or does not hold what it should."""


class RecordingError(InvtrackError, ValueError):
    """Runs cannot be recorded as asked, or a recording holds no runs."""


class LongRunWarning(RuntimeWarning):
    """A simulation takes many steps, or was cut short because nobody asked for so many of them."""
