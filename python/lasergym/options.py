"""Checks of options that several modules take."""

from __future__ import annotations

import operator
from typing import Any

from lasergym.errors import OptionError

__all__ = ["LARGEST_SEED", "integer_in"]

LARGEST_SEED = 2**64 - 1
"""Seeds are from 0 to this."""


def integer_in(name: str, value: Any, smallest: int, largest: int) -> int:
    """``value`` as an int from ``smallest`` to ``largest``.

    Raises:
        OptionError: It is no integer or out of range.
    """
    try:
        number = operator.index(value)
    except TypeError as error:
        raise OptionError(f"{name} is {value!r}, but must be an integer") from error
    if not smallest <= number <= largest:
        raise OptionError(f"{name} is {number}, but must be from {smallest} to {largest}")
    return number
