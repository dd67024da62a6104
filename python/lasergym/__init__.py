"""Gymnasium environments, planners and agents that decide where a laser acts on a workpiece.

Importing this package registers the environments with Gymnasium.
"""

from importlib.metadata import version as _version

from lasergym import envs, errors, programs, render, targets
from lasergym.errors import LasergymError
from lasergym.planners import Plan, PlannerName, Score, plan, score

__all__ = [
    "LasergymError",
    "Plan",
    "PlannerName",
    "Score",
    "envs",
    "errors",
    "plan",
    "programs",
    "render",
    "score",
    "targets",
]

__version__ = _version("lasergym")
