"""Tables of TOML and JSON as frozen dataclasses, unknown keys refused."""

from __future__ import annotations

import difflib
import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from lasergym.errors import LasergymError

__all__ = ["ConfigError", "from_table", "nearest", "to_table"]

Made = TypeVar("Made")


class ConfigError(LasergymError, ValueError):
    """A training configuration cannot be read or contradicts itself."""


def from_table(kind: type[Made], table: Any, where: str = "") -> Made:
    """A dataclass with the values of a table; keys that are left out keep their defaults.

    Args:
        kind: A dataclass of numbers, texts, enums, tuples and further dataclasses.
        table: What TOML or JSON holds.
        where: Name of the table in messages.

    Raises:
        ConfigError: A key is unknown or a value of the wrong kind; the message names it.
        OptionError: A value is outside its range.
    """
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where or 'the configuration'} is {table!r}, but must be a table")
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    values = {}
    for key, value in table.items():
        path = f"{where}.{key}" if where else str(key)
        if key not in names:
            raise ConfigError(f"{path} is unknown{nearest(str(key), names)}")
        values[key] = _value(hints[key], value, path)
    return kind(**values)


def to_table(made: Any) -> Any:
    """A dataclass as JSON holds it; None and enums as they are written in a table."""
    if is_dataclass(made):
        return {field.name: to_table(getattr(made, field.name)) for field in fields(made)}
    if isinstance(made, Enum):
        return made.value
    if isinstance(made, (list, tuple)):
        return [to_table(one) for one in made]
    if isinstance(made, Mapping):
        return {key: to_table(value) for key, value in made.items()}
    return made


def nearest(name: str, accepted: list[str]) -> str:
    """``: did you mean …?``, or what is accepted."""
    found = difflib.get_close_matches(name, accepted, 1)
    if found:
        return f": did you mean {found[0]}?"
    return f": there are {', '.join(accepted)}"


def _value(hint: Any, value: Any, path: str) -> Any:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return _optional(hint, value, path)
    if origin is tuple:
        if not isinstance(value, (list, tuple)):
            raise ConfigError(f"{path} is {value!r}, but must be a list")
        (item, *_) = get_args(hint)
        return tuple(_value(item, one, f"{path}[{index}]") for index, one in enumerate(value))
    if origin is not None and issubclass(origin, Mapping):
        if not isinstance(value, Mapping):
            raise ConfigError(f"{path} is {value!r}, but must be a table")
        return dict(value)
    if is_dataclass(hint):
        return from_table(hint, value, path)  # type: ignore[arg-type]
    if issubclass(hint, Enum):
        return _enum(hint, value, path)
    return _scalar(hint, value, path)


def _optional(hint: Any, value: Any, path: str) -> Any:
    if value is None:
        return None
    (kind,) = (one for one in get_args(hint) if one is not types.NoneType)
    return _value(kind, value, path)


def _enum(kind: type[Enum], value: Any, path: str) -> Enum:
    accepted = [str(one.value) for one in kind]
    try:
        return kind(value)
    except ValueError as error:
        raise ConfigError(f"{path} is {value!r}{nearest(str(value), accepted)}") from error


def _scalar(kind: Any, value: Any, path: str) -> Any:
    words = {bool: "true or false", int: "an integer", float: "a number", str: "a text"}
    fits = isinstance(value, kind) and (kind is bool or not isinstance(value, bool))
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if not fits:
        raise ConfigError(f"{path} is {value!r}, but must be {words[kind]}")
    return value
