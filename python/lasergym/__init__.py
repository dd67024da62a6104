"""Gymnasium environments, planners and agents that decide where a laser acts on a workpiece.

Importing this package registers the environments with Gymnasium.
"""

from importlib import import_module as _import_module
from importlib.metadata import version as _version
from typing import Any as _Any

from lasergym import envs, errors, galvo, milling, programs, remote, render, targets
from lasergym.cma_es import CmaEs
from lasergym.errors import LasergymError
from lasergym.planners import Plan, PlannerName, Score, plan, score, shortest_order
from lasergym.policy import Policy

__all__ = [
    "CmaEs",
    "LasergymError",
    "Plan",
    "PlannerName",
    "Policy",
    "Score",
    "envs",
    "errors",
    "galvo",
    "milling",
    "plan",
    "programs",
    "remote",
    "render",
    "score",
    "shortest_order",
    "targets",
]

__version__ = _version("lasergym")


def __getattr__(name: str) -> _Any:
    """Imports ``lasergym.sb3`` when it is first used, since it needs torch."""
    if name == "sb3":
        return _import_module("lasergym.sb3")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
