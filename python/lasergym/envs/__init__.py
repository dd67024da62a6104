"""Gymnasium environments; importing this module registers them."""

from lasergym.envs.ablation import (
    AblationEnv,
    PatternEnv,
    RandomShapeEnv,
    RotatedStarEnv,
    StarEnv,
)
from lasergym.envs.galvo_line import GalvoLineEnv, GalvoLineVectorEnv
from lasergym.envs.milling import MillingEnv, MillingVectorEnv
from lasergym.envs.native_vector import NativeVectorEnv
from lasergym.envs.registration import (
    ABLATION_IDS,
    ENVIRONMENT_IDS,
    GALVO_IDS,
    MILLING_IDS,
    register_environments,
)
from lasergym.envs.vector import (
    AblationVectorEnv,
    PatternVectorEnv,
    RandomShapeVectorEnv,
    RotatedStarVectorEnv,
    StarVectorEnv,
)

__all__ = [
    "ABLATION_IDS",
    "ENVIRONMENT_IDS",
    "GALVO_IDS",
    "MILLING_IDS",
    "AblationEnv",
    "AblationVectorEnv",
    "GalvoLineEnv",
    "GalvoLineVectorEnv",
    "MillingEnv",
    "MillingVectorEnv",
    "NativeVectorEnv",
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
