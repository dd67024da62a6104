"""PPO of RLlib on native vector environments.

Run ``python training/rllib_recipe.py --iterations 100``; beside lasergym it needs
``pip install "ray[rllib]" torch``. (``ray[rllib]`` 2.60 pins gymnasium 1.2.2.)

RLlib uses a native vector environment only where it is told to, with ``VECTOR_ENTRY_POINT``, and
counts the step after an episode's last as no step: the autoreset mode must be ``NEXT_STEP``, which
is the default. The prefix ``lasergym:`` registers the environments in every worker.
"""

from __future__ import annotations

import argparse
from typing import Any

import gymnasium as gym
import numpy as np
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.connectors.env_to_module.observation_preprocessor import (
    SingleAgentObservationPreprocessor,
)
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig


class ScaledImages(SingleAgentObservationPreprocessor):
    """What RLlib's convolutions take: float32 in [0, 1], channel last, every second pixel."""

    def recompute_output_observation_space(
        self,
        input_observation_space: Any,
        input_action_space: Any,  # noqa: ARG002 - RLlib's signature
    ) -> gym.Space[Any]:
        """The space of the images."""
        channels, height, width = input_observation_space.shape
        return gym.spaces.Box(0.0, 1.0, (height // 2, width // 2, channels), np.float32)

    def preprocess(self, observation: Any, episode: Any) -> Any:  # noqa: ARG002 - RLlib's signature
        """One image."""
        return np.moveaxis(observation[:, 1::2, 1::2], 0, -1).astype(np.float32) / 255.0


def make_config(env_id: str, environments: int, runners: int, batch: int) -> PPOConfig:
    """The configuration.

    Args:
        env_id: An id of lasergym.
        environments: Environments that each runner steps together.
        runners: Worker processes; 0 steps in this process.
        batch: Pulses of an update.
    """
    config = PPOConfig()
    config.environment(
        f"lasergym:{env_id}",
        env_config={"observation": "layers", "autoreset_mode": gym.vector.AutoresetMode.NEXT_STEP},
    )
    config.env_runners(
        num_env_runners=runners,
        num_envs_per_env_runner=environments,
        gym_env_vectorize_mode=gym.VectorizeMode.VECTOR_ENTRY_POINT,
        env_to_module_connector=lambda *_, **__: ScaledImages(),
        rollout_fragment_length="auto",
    )
    config.training(
        gamma=0.9,
        lambda_=0.95,
        lr=3e-4,
        train_batch_size_per_learner=batch,
        minibatch_size=min(512, batch),
        num_epochs=4,
    )
    config.rl_module(
        model_config=DefaultModelConfig(
            conv_filters=[(16, 8, 4), (32, 4, 2), (32, 3, 2)],
            conv_activation="relu",
            head_fcnet_hiddens=[256],
            vf_share_layers=True,
        )
    )
    return config


def main() -> None:
    """Trains and prints the mean return after each update."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--env-id", default="lasergym/Star-v0", help="environment")
    parser.add_argument("--iterations", type=int, default=100, help="updates")
    parser.add_argument("--environments", type=int, default=64, help="environments of a runner")
    parser.add_argument("--runners", type=int, default=0, help="worker processes")
    parser.add_argument("--batch", type=int, default=2880, help="pulses of an update")
    arguments = parser.parse_args()
    config = make_config(
        arguments.env_id, arguments.environments, arguments.runners, arguments.batch
    )
    algorithm = config.build_algo()
    for _ in range(arguments.iterations):
        result = algorithm.train()
        steps = int(result["num_env_steps_sampled_lifetime"])
        mean = result["env_runners"].get("episode_return_mean", float("nan"))
        print(f"{steps} pulses: mean return {mean:.4f}")
    algorithm.stop()


if __name__ == "__main__":
    main()
