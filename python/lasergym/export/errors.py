"""What can go wrong with an export."""

from lasergym.errors import LasergymError


class ExportError(LasergymError, ValueError):
    """A policy cannot be written as a file for the runner."""


class UnsupportedLayerError(ExportError):
    """A network does something that the runner has no layer for."""


class ParityError(LasergymError, AssertionError):
    """The runner and torch give different actions."""
