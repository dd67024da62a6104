"""Targets as the command line names them."""

from pathlib import Path

from lasergym import targets
from lasergym.errors import OptionError
from lasergym.targets import Fit, Ink, Target

__all__ = ["read_target"]


def read_target(
    name: str, *, margin_px: float, threshold: float, ink: Ink, invert: bool, fit: Fit
) -> Target:
    """The target of a name: ``star``, ``star:30`` (°), ``random-shape:7`` (seed) or a drawing.

    The options are those of :func:`lasergym.targets.load`; built-in targets do without them.

    Raises:
        OptionError: The number behind the colon is none.
        DrawingError: The drawing cannot be read.
    """
    kind, colon, parameter = name.partition(":")
    if kind == "star":
        return targets.star(_number(name, parameter) if colon else 0.0)
    if kind == "random-shape":
        return targets.random_shape(_seed(name, parameter) if colon else 0)
    return targets.load(
        Path(name), margin_px=margin_px, threshold=threshold, ink=ink, invert=invert, fit=fit
    )


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise OptionError(f"{name!r} needs an angle in degrees, such as star:30") from error


def _seed(name: str, text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise OptionError(f"{name!r} needs a whole number, such as random-shape:7") from error
