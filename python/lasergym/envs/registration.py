"""Registration of the environments with Gymnasium."""

from __future__ import annotations

import gymnasium as gym

__all__ = [
    "ABLATION_IDS",
    "ENVIRONMENT_IDS",
    "GALVO_IDS",
    "MILLING_IDS",
    "REMOTE_IDS",
    "register_environments",
]

ABLATION_IDS = (
    "lasergym/Star-v0",
    "lasergym/RotatedStar-v0",
    "lasergym/RandomShape-v0",
    "lasergym/Pattern-v0",
)
"""Ids of the pulse-ablation environments, easiest first."""

MILLING_IDS = ("lasergym/Milling-v0",)
"""Ids of the depth-milling environments."""

GALVO_IDS = ("lasergym/GalvoLine-v0",)
"""Ids of the scan-head environments."""

REMOTE_IDS = ("lasergym/RemoteScan-v0",)
"""Ids of the environments of robot and scanner."""

ENVIRONMENT_IDS = ABLATION_IDS + MILLING_IDS + GALVO_IDS + REMOTE_IDS
"""Ids of all environments."""


def register_environments() -> None:
    """Registers every environment with its native vector version; a second call changes nothing."""
    for env_id in ENVIRONMENT_IDS:
        if env_id not in gym.registry:
            name = env_id.removeprefix("lasergym/").removesuffix("-v0")
            gym.register(
                id=env_id,
                entry_point=f"lasergym.envs:{name}Env",
                vector_entry_point=f"lasergym.envs:{name}VectorEnv",
            )
