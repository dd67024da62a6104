"""The command line: ``lasergym COMMAND …``, data on stdout, everything else on stderr."""

from lasergym.cli.app import main

__all__ = ["main"]
