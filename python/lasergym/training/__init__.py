"""Training agents: configurations, runs that survive a crash, and evaluation beside planners.

Importing this package needs no torch; :mod:`lasergym.training.run` and
:mod:`lasergym.training.agents` do, with the extra ``lasergym[train]``.
"""

from lasergym.training.config import (
    A2cConfig,
    Activation,
    ConfigError,
    EvaluationConfig,
    MethodConfig,
    Phase,
    PolicyConfig,
    PolicyKind,
    PpoConfig,
    RunConfig,
    TaskConfig,
    TrainingConfig,
)
from lasergym.training.presets import preset
from lasergym.training.self_imitation import SelfImitationOptions

__all__ = [
    "A2cConfig",
    "Activation",
    "ConfigError",
    "EvaluationConfig",
    "MethodConfig",
    "Phase",
    "PolicyConfig",
    "PolicyKind",
    "PpoConfig",
    "RunConfig",
    "SelfImitationOptions",
    "TaskConfig",
    "TrainingConfig",
    "preset",
]
