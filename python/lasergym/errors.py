"""Every exception of lasergym, under one root.

Bad arguments and bad files are also :class:`ValueError`, so that ``except ValueError`` catches
them.
"""


class LasergymError(Exception):
    """The root of all exceptions of lasergym."""


class OptionError(LasergymError, ValueError):
    """An option is outside its range or not one of the accepted names."""


class ShapeError(LasergymError, ValueError):
    """An array does not fit the environments it is meant for."""


class ThreadsError(LasergymError, RuntimeError):
    """Worker threads could not be started."""


class MissingExtraError(LasergymError, ImportError):
    """An optional dependency is not installed."""


class TargetError(LasergymError, ValueError):
    """A target cannot be machined."""


class EmptyTargetError(TargetError):
    """A target has no pixel."""


class FullTargetError(TargetError):
    """A target covers the whole workpiece."""


class TargetShapeError(TargetError):
    """A target is not a Boolean array of shape (100, 100)."""


class ActionError(LasergymError, ValueError):
    """An action cannot be carried out."""


class ActionShapeError(ActionError):
    """An action has the wrong shape."""


class ActionTypeError(ActionError, TypeError):
    """An action is not an array of real numbers."""


class ActionNotFiniteError(ActionError):
    """An action is not a number or infinite."""


class PositionError(LasergymError, ValueError):
    """A pulse position is not a finite point."""


class EpisodeOverError(LasergymError, RuntimeError):
    """A step was made before the first reset or after the end of an episode."""


class RenderModeError(LasergymError, ValueError):
    """A render mode is not one of the accepted names."""


class DrawingError(LasergymError, ValueError):
    """A drawing cannot be read as a target."""


class DrawingNotFoundError(DrawingError, FileNotFoundError):
    """There is no file of that name."""


class DrawingUnreadableError(DrawingError, OSError):
    """The system does not let the file be read."""


class UnknownDrawingFormatError(DrawingError):
    """A file is neither PNG, JPEG, SVG nor DXF."""


class BrokenDrawingError(DrawingError):
    """A file is damaged, truncated or not what its name says."""


class DrawingSizeError(DrawingError):
    """A drawing is larger than what is read, or not of the size that an exact fit needs."""


class NoShapesError(DrawingError):
    """A drawing has nothing that could be machined."""


class UnknownEntitiesError(DrawingError):
    """A DXF file has entities that are not understood."""


class OpenContourError(DrawingError):
    """Lines of a DXF file do not close."""


class MissingFontError(DrawingError):
    """Text of an SVG file cannot be set, since no font is installed."""


class PlanError(LasergymError, ValueError):
    """A plan cannot be made."""


class PolicyError(LasergymError, ValueError):
    """A policy file is damaged, unknown or does not fit."""


class OptimiserError(LasergymError, ValueError):
    """CMA-ES cannot start or go on."""


class ProgramError(LasergymError, ValueError):
    """A machine program cannot be read or written."""


class DriverError(LasergymError):
    """A device of a machine failed; a job takes it as the fault ``kind``."""

    kind = "other"


class DriverTimeoutError(DriverError, TimeoutError):
    """A device did not answer in time."""

    kind = "timeout"


class OutOfLimitsError(DriverError, ValueError):
    """A position is beyond the limits of the stage, or not a number."""

    kind = "out_of_limits"


class InterlockError(DriverError):
    """A door, an emergency stop or a shutter is open."""

    kind = "interlock"


class DisconnectedError(DriverError, ConnectionError):
    """A device is gone."""

    kind = "disconnected"


class ProtocolError(DriverError):
    """What a device said cannot be true."""

    kind = "protocol"


class JobError(LasergymError, ValueError):
    """A job cannot be begun or resumed as it was asked for."""


class JournalError(JobError):
    """A journal cannot be read."""


class JobFailedError(LasergymError, RuntimeError):
    """A job cannot go on, for instance since its journal cannot be written."""


class CalibrationError(LasergymError, ValueError):
    """The camera's view of the workpiece is not known well enough."""


class MillingError(LasergymError, ValueError):
    """A milling job, its passes, profile or trenches cannot be used."""


class DepthMapError(MillingError):
    """A depth map cannot be read or milled."""


class GalvoError(LasergymError, ValueError):
    """A scan head, its calibration, or a program for it cannot be used."""


class RemoteError(LasergymError, ValueError):
    """A task for robot and scanner cannot be read or planned."""


class InfeasibleTaskError(RemoteError):
    """A subtask cannot be processed; the message says which, why, and what would help."""
