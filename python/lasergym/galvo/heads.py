"""Scan heads by name or from TOML files."""

from __future__ import annotations

from pathlib import Path

from lasergym import _native
from lasergym.errors import OptionError

__all__ = [
    "HEADS",
    "head_text",
]


_SHIPPED: dict[str, str] = dict(_native.galvo_heads())

HEADS: tuple[str, ...] = tuple(_SHIPPED)
"""Names of the shipped heads; all have the lag of Penchev et al., 216.4 µs."""


def head_text(head: str | Path) -> str:
    """The TOML text of a shipped head or of a head file.

    Raises:
        OptionError: There is neither a head nor a file of that name.
    """
    if str(head) in _SHIPPED:
        return _SHIPPED[str(head)]
    path = Path(head)
    if not path.is_file():
        raise OptionError(
            f"there is no head named {str(head)!r}: use one of {', '.join(HEADS)}, or the name of "
            "a TOML file"
        )
    text = path.read_text(encoding="utf-8", errors="replace")
    _native.galvo_head(text)
    return text
