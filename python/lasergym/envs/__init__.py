"""Gymnasium environments; importing this module registers them."""

from lasergym.envs.ablation import (
    AblationEnv,
    PatternEnv,
    RandomShapeEnv,
    RotatedStarEnv,
    StarEnv,
)
from lasergym.envs.registration import ABLATION_IDS, register_environments
from lasergym.envs.vector import (
    AblationVectorEnv,
    PatternVectorEnv,
    RandomShapeVectorEnv,
    RotatedStarVectorEnv,
    StarVectorEnv,
)

__all__ = [
    "ABLATION_IDS",
    "AblationEnv",
    "AblationVectorEnv",
    "PatternEnv",
    "PatternVectorEnv",
    "RandomShapeEnv",
    "RandomShapeVectorEnv",
    "RotatedStarEnv",
    "RotatedStarVectorEnv",
    "StarEnv",
    "StarVectorEnv",
    "register_environments",
]

register_environments()
