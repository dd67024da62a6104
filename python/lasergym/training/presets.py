"""The configuration of each task that ``lasergym train ENV_ID`` takes."""

from __future__ import annotations

from lasergym.envs import ABLATION_IDS
from lasergym.training.config import (
    Activation,
    EvaluationConfig,
    MethodConfig,
    PolicyConfig,
    PolicyKind,
    PpoConfig,
    RunConfig,
    TaskConfig,
    TrainingConfig,
)
from lasergym.training.self_imitation import SelfImitationOptions
from lasergym.training.tables import ConfigError, nearest

__all__ = ["preset"]


def preset(env_id: str, *, quick: bool = False) -> TrainingConfig:
    """The configuration of a task.

    Args:
        env_id: Id of the environment; ``"lasergym/"`` and ``"-v0"`` may be left out.
        quick: A small network on thinned observations, which shows learning within minutes on a
            processor; the others are made for hours.

    Raises:
        ConfigError: There is no such environment.
    """
    names = {
        env_id.removeprefix("lasergym/").removesuffix("-v0"): env_id for env_id in ABLATION_IDS
    }
    full = names.get(env_id, env_id)
    if full not in ABLATION_IDS:
        raise ConfigError(f"{env_id!r} is no environment{nearest(env_id, [*ABLATION_IDS])}")
    return _quick(full) if quick else _thorough(full)


def _quick(env_id: str) -> TrainingConfig:
    """A perceptron that plans a pulse or two ahead: with γ = 0.5 learning has less noise."""
    return TrainingConfig(
        task=TaskConfig(env_id=env_id, thinning=5),
        policy=PolicyConfig(kind=PolicyKind.MLP, hidden_layers=(64, 64)),
        method=MethodConfig(ppo=PpoConfig(gamma=0.5, learning_rate=1e-3)),
        run=RunConfig(steps=500_000, checkpoint_min=1.0),
        evaluation=EvaluationConfig(every_steps=100_000, targets=16, anneal_s=0.5),
    )


def _thorough(env_id: str) -> TrainingConfig:
    """PPO with self-imitation and a network that sees every second pixel."""
    steps = {
        "lasergym/Star-v0": 36_000_000,
        "lasergym/RotatedStar-v0": 150_000_000,
        "lasergym/RandomShape-v0": 300_000_000,
    }
    targets = {"lasergym/RotatedStar-v0": 36, "lasergym/RandomShape-v0": 64}
    return TrainingConfig(
        task=TaskConfig(env_id=env_id, thinning=2, normalise_rewards=True),
        policy=PolicyConfig(
            kind=PolicyKind.CNN,
            activation=Activation.RELU,
            arguments={"features_extractor_kwargs": {"features_dim": 256}},
        ),
        method=MethodConfig(
            ppo=PpoConfig(gamma=0.9, learning_rate=3e-4, final_learning_rate=0.0),
            self_imitation=SelfImitationOptions(),
        ),
        run=RunConfig(steps=steps.get(env_id, 36_000_000)),
        evaluation=EvaluationConfig(
            every_steps=500_000,
            targets=targets.get(env_id, 1),
            planners=("greedy", "anneal", "cma-es"),
            cma_es_s=5.0,
        ),
    )
