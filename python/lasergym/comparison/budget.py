"""How many pulses a planner may use on a target."""

import math
import re
from dataclasses import dataclass

from lasergym.errors import OptionError

__all__ = ["PulseBudget"]

_MAX_PULSES = 10_000


@dataclass(frozen=True)
class PulseBudget:
    """A number of pulses, or one that grows with the area of the target.

    Attributes:
        pulses: Most pulses on every target, from 1 to 10 000; None where the area decides.
        area_per_pulse_px: Then ceil(area / this) pulses are allowed; px, at least 1.
    """

    pulses: int | None = 45
    area_per_pulse_px: float | None = None

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            OptionError: A figure is outside its range, or not exactly one of the two is given.
        """
        if (self.pulses is None) == (self.area_per_pulse_px is None):
            raise OptionError("a pulse budget is either a number of pulses or an area per pulse")
        if self.pulses is not None and not 1 <= self.pulses <= _MAX_PULSES:
            raise OptionError(f"max_pulses is {self.pulses}, but must be from 1 to {_MAX_PULSES}")
        area_px = self.area_per_pulse_px
        if area_px is not None and not 1 <= area_px < math.inf:
            raise OptionError(f"max_pulses is area/{area_px:g}, but a pulse needs at least 1 px")

    @classmethod
    def parse(cls, text: str) -> "PulseBudget":
        """Reads ``45`` or ``area/125``.

        Raises:
            OptionError: The text is neither, or the number is outside its range.
        """
        if re.fullmatch(r"[+-]?\d{1,9}", text):
            return cls(pulses=int(text))
        by_area = re.fullmatch(r"area/(\d{1,9}(?:\.\d{1,9})?)", text)
        if by_area is None:
            raise OptionError(f"max_pulses is {text!r}, but must be like 45 or area/125")
        return cls(pulses=None, area_per_pulse_px=float(by_area[1]))

    def pulses_for(self, area_px: int) -> int:
        """Most pulses on a target of this area, px."""
        if self.area_per_pulse_px is not None:
            return math.ceil(area_px / self.area_per_pulse_px)
        return self.pulses or 0

    def __str__(self) -> str:
        """As :meth:`parse` reads it."""
        if self.area_per_pulse_px is not None:
            return f"area/{self.area_per_pulse_px:g}"
        return str(self.pulses)
