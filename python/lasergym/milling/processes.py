"""Processes that mill: shipped profiles, TOML files, and calibration from trenches."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lasergym import _native
from lasergym.errors import OptionError

__all__ = [
    "PROCESSES",
    "Calibration",
    "FittedParameter",
    "calibrate",
    "profile_text",
]


_SHIPPED: dict[str, str] = dict(_native.shipped_profiles())

PROCESSES: tuple[str, ...] = tuple(_SHIPPED)
"""Names of the shipped process profiles."""


@dataclass(frozen=True)
class FittedParameter:
    """A parameter and how well trenches determine it.

    Attributes:
        name: Its name, unit included, as in profiles.
        value: The value that fits best.
        confidence_95: Half-width of its 95 % confidence interval.
    """

    name: str
    value: float
    confidence_95: float


@dataclass(frozen=True)
class Calibration:
    """A process fitted to trenches.

    Attributes:
        parameters: The fitted parameters.
        rms_um: Root mean square distance between measured and modelled depths, µm.
    """

    parameters: tuple[FittedParameter, ...]
    rms_um: float


def profile_text(process: str | Path) -> str:
    """The TOML text of a shipped profile or of a file.

    Raises:
        OptionError: There is neither a profile nor a file of that name.
    """
    if isinstance(process, str) and process in _SHIPPED:
        return _SHIPPED[process]
    path = Path(process)
    if not path.is_file():
        names = ", ".join(PROCESSES)
        raise OptionError(f"process is {str(process)!r}, but must be {names} or a TOML file")
    return path.read_text(encoding="utf-8", errors="replace")


def calibrate(trenches: str | Path, process: str | Path = "laser-graphite") -> Calibration:
    """Fits footprint and law of a process to measured trenches of straight passes.

    Args:
        trenches: Name of a CSV file with the columns ``speed_mm_s,y_um,depth_um``; lines of equal
            speed that follow one another are one trench. Two speeds or more.
        process: The profile to start from.

    Raises:
        MillingError: The file cannot be read, or does not determine the parameters.
    """
    text = Path(trenches).read_text(encoding="utf-8", errors="replace")
    parameters, rms_um = _native.calibrate_trenches(text, profile_text(process))
    return Calibration(tuple(FittedParameter(*parameter) for parameter in parameters), rms_um)
