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
    REMOTE_IDS,
    register_environments,
)
from lasergym.envs.remote_scan import RemoteScanEnv
from lasergym.envs.remote_vector import RemoteScanVectorEnv
from lasergym.envs.seeded_vector import SeededVectorEnv
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
    "REMOTE_IDS",
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
    "RemoteScanEnv",
    "RemoteScanVectorEnv",
    "RotatedStarEnv",
    "RotatedStarVectorEnv",
    "SeededVectorEnv",
    "StarEnv",
    "StarVectorEnv",
    "register_environments",
]

register_environments()
