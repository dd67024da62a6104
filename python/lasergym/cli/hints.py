"""What to do about an error, in the words of the command line."""

from lasergym import errors

__all__ = ["hint_for"]

_TARGETS = "give a PNG, JPEG, SVG or DXF file, or star, star:30, random-shape:7"

_HINTS: dict[type[errors.LasergymError], str] = {
    errors.DrawingNotFoundError: _TARGETS,
    errors.DrawingUnreadableError: _TARGETS,
    errors.UnknownDrawingFormatError: _TARGETS,
    errors.BrokenDrawingError: "open the drawing in its program and export it again",
    errors.DrawingSizeError: "make the drawing smaller, or use --fit scale",
    errors.NoShapesError: "draw at least one filled or closed shape",
    errors.UnknownEntitiesError: "explode blocks and turn the rest into polylines",
    errors.OpenContourError: "join the ends of the contour",
    errors.MissingFontError: "turn the text into paths",
    errors.EmptyTargetError: "try --invert, --ink alpha or a lower --threshold",
    errors.FullTargetError: "try --invert, a higher --threshold or a --margin-px",
    errors.DepthMapError: "give depths within reach: see --depth-um, --base-um and --layers",
    errors.MillingError: "check the size of the target against the beam of the process",
    errors.GalvoError: "see docs/galvo.md for heads, test lines and programs",
    errors.OptionError: "--help lists the options and their ranges",
    errors.ThreadsError: "ask for fewer threads",
    errors.JobError: "give a new folder with -o, or the folder of a job with --resume",
    errors.JournalError: "give the folder of a job, which has a journal.jsonl",
    errors.CalibrationError: "calibrate again: lasergym.machine.calibrate",
    errors.InfeasibleTaskError: "change the subtask or the machine as the message says",
    errors.RemoteError: "docs/remote.md lists the keys of a task",
    errors.PolicyError: "give a .safetensors file that lasergym.export wrote",
}


def hint_for(error: errors.LasergymError) -> str | None:
    """The hint for the class of ``error`` or the nearest of its bases that has one."""
    for base in type(error).__mro__:
        if base in _HINTS:
            return _HINTS[base]
    return None
