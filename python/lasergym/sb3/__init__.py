"""Stable-Baselines3 on the native environments; needs the extra ``lasergym[train]``."""

from lasergym.sb3.vec_env import EnvironmentView, NativeVecEnv, make_vec_env

# After vec_env, which says what to install where Stable-Baselines3 is missing.
from lasergym.sb3.self_imitation import (  # isort: skip
    SelfImitation,
    SelfImitationLoss,
    SelfImitationOptions,
    discounted_returns,
    self_imitation_loss,
)
from lasergym.sb3.replay import PrioritisedReplay, ReplayBatch, ReplayError
from lasergym.sb3.spatial_distribution import CellDistribution
from lasergym.sb3.spatial_network import CorrectionNet
from lasergym.sb3.spatial_policy import SpatialPolicy
from lasergym.sb3.thinning import ThinnedPixels, thinned

__all__ = [
    "CellDistribution",
    "CorrectionNet",
    "EnvironmentView",
    "NativeVecEnv",
    "PrioritisedReplay",
    "ReplayBatch",
    "ReplayError",
    "SelfImitation",
    "SelfImitationLoss",
    "SelfImitationOptions",
    "SpatialPolicy",
    "ThinnedPixels",
    "discounted_returns",
    "make_vec_env",
    "self_imitation_loss",
    "thinned",
]
