"""Self-imitation learning for the on-policy algorithms of Stable-Baselines3.

Oh, Guo, Singh and Lee (2018), "Self-Imitation Learning", ICML, arXiv:1806.05635: after each update
of PPO or A2C the agent also learns from what it once did better than its value function expects.
The defaults are those of the authors' code for PPO, github.com/junhyukoh/self-imitation-learning,
baselines/ppo2/ppo2_sil.py and baselines/common/self_imitation.py.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from lasergym.errors import OptionError
from lasergym.options import LARGEST_SEED, integer_in
from lasergym.sb3.replay import PrioritisedReplay, ReplayBatch, ReplayError
from lasergym.training.self_imitation import SelfImitationOptions

__all__ = [
    "SelfImitation",
    "SelfImitationLoss",
    "SelfImitationOptions",
    "discounted_returns",
    "self_imitation_loss",
]


class SelfImitationLoss(NamedTuple):
    """The loss of a batch and its parts.

    Attributes:
        total: What is minimised, a scalar.
        policy: Mean of w · −log π(a | s) · (R − V)₊ over the imitated samples, a scalar without
            gradient.
        value: Mean of w · ½ (R − V)₊² over them, a scalar without gradient.
        advantages: (R − V)₊ up to the clip, shape (batch,), without gradient.
        imitated: Number of samples with a positive advantage.
    """

    total: torch.Tensor
    policy: torch.Tensor
    value: torch.Tensor
    advantages: torch.Tensor
    imitated: int


def discounted_returns(rewards: NDArray[Any], gamma: float) -> NDArray[np.float64]:
    """Σₖ γᵏ rₜ₊ₖ to the end of one episode, shape (steps,)."""
    returns = np.zeros(len(rewards))
    following = 0.0
    for step in reversed(range(len(rewards))):
        following = float(rewards[step]) + gamma * following
        returns[step] = following
    return returns


def self_imitation_loss(
    log_probabilities: torch.Tensor,
    values: torch.Tensor,
    entropies: torch.Tensor,
    returns: torch.Tensor,
    weights: torch.Tensor,
    options: SelfImitationOptions,
) -> SelfImitationLoss:
    """Oh et al. (2018), equations 1 to 3.

    Args:
        log_probabilities: log π(a | s), shape (batch,).
        values: V(s), shape (batch,).
        entropies: Entropy of π(· | s), shape (batch,).
        returns: R, shape (batch,).
        weights: Importance weights, shape (batch,).
        options: Factors and clip.
    """
    positive = (returns - values).clamp(min=0.0)  # (R − V)₊: no gradient where R ≤ V
    advantages = positive.detach().clamp(max=options.clip)
    imitated = positive.detach() > 0
    count = int(imitated.sum())
    samples = max(count, options.least_samples)
    policy = -(weights * log_probabilities * advantages).sum() / samples
    # ½ (R − V)₊² up to the clip and a line beyond, whose slope is the clipped advantage.
    beyond = (positive - options.clip).clamp(min=0.0)
    value = (weights * 0.5 * (positive.square() - beyond.square())).sum() / samples
    entropy = (weights * entropies * imitated).sum() / samples
    total = options.loss_weight * (
        policy + options.value_weight * value - options.entropy_weight * entropy
    )
    return SelfImitationLoss(total, policy.detach(), value.detach(), advantages, count)


class SelfImitation(BaseCallback):
    """Self-imitation learning for PPO, A2C and other on-policy algorithms.

    ``PPO(...).learn(steps, callback=SelfImitation())``. It follows the episodes, remembers them
    when they end, and after each update of the algorithm makes gradient steps of its own with the
    algorithm's optimiser. Observations are remembered as the environments give them; under
    ``VecNormalize`` observations and returns are scaled with the statistics of the moment when they
    are used, so that returns and values always have the same scale. (``VecNormalize`` also clips
    rewards, which returns are spared.)

    Image observations take one bit a pixel. With the same seed the same samples are drawn.
    """

    def __init__(
        self, options: SelfImitationOptions | None = None, seed: int = 0, verbose: int = 0
    ) -> None:
        """Makes the callback; ``seed`` is that of its own random stream."""
        super().__init__(verbose)
        self.options = options or SelfImitationOptions()
        self.replay = PrioritisedReplay(self.options.capacity, self.options.alpha)
        self.generator = np.random.Generator(
            np.random.PCG64(integer_in("seed", seed, 0, LARGEST_SEED))
        )
        self._observations: NDArray[Any] | None = None
        self._episodes: list[_Episode] = []
        self._unlearnt = False

    def save(self, path: str | Path) -> None:
        """Writes memory and random stream as an ``.npz`` file; episodes under way are left out."""
        stream = np.array(_stream_words(self.generator), np.uint64)
        arrays: dict[str, Any] = {"stream": stream, **self.replay.state()}
        with Path(path).open("wb") as file:
            np.savez(file, **arrays)

    def load(self, path: str | Path) -> None:
        """Goes on from what :meth:`save` wrote.

        Raises:
            ReplayError: The file is damaged or of another capacity.
        """
        try:
            with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as kept:
                arrays = dict(kept)
            _set_stream_words(self.generator, arrays.pop("stream").tolist())
        except (ValueError, KeyError, IndexError, EOFError, zipfile.BadZipFile) as error:
            raise ReplayError(f"{path} is damaged: {error}") from error
        self.replay.load_state(arrays)

    def _init_callback(self) -> None:
        if not isinstance(self.model, OnPolicyAlgorithm):
            raise OptionError(
                f"self-imitation needs an on-policy algorithm, but this is "
                f"{type(self.model).__name__}"
            )

    def _on_training_start(self) -> None:
        count = self.training_env.num_envs
        self._episodes = [_Episode() for _ in range(count)]
        self._unlearnt = False
        self._observations = None

    def _on_rollout_start(self) -> None:
        """Follows the update of the algorithm, except before the first rollout."""
        if self._unlearnt:
            self.learn()
        if self._observations is None:
            self._observations = self._current_observations(self.model._last_obs)

    def _on_rollout_end(self) -> None:
        self._unlearnt = True

    def _on_training_end(self) -> None:
        if self._unlearnt:
            self.learn()

    def _on_step(self) -> bool:
        observations = self._observations
        if observations is None or self.options.updates == 0:
            return True
        rewards = self.locals["rewards"]
        normaliser = self.model.get_vec_normalize_env()
        if normaliser is not None:
            rewards = normaliser.get_original_reward()
        for index, done in enumerate(self.locals["dones"]):
            episode = self._episodes[index]
            episode.append(observations[index], self.locals["actions"][index], rewards[index])
            # An episode that a time limit cuts off has no known return.
            if done:
                if not self.locals["infos"][index].get("TimeLimit.truncated", False):
                    self.replay.add(*episode.samples(self.model.gamma))  # type: ignore[attr-defined]
                self._episodes[index] = _Episode()
        self._observations = self._current_observations(self.locals["new_obs"])
        return True

    def learn(self) -> None:
        """Makes the gradient steps that follow an update of the algorithm."""
        self._unlearnt = False
        if self.options.updates == 0 or len(self.replay) < self.options.begin_samples:
            return
        losses: list[SelfImitationLoss] = []
        self.model.policy.set_training_mode(True)
        for _ in range(self.options.updates):
            batch = self.replay.sample(
                min(self.options.batch_size, len(self.replay)), self.options.beta, self.generator
            )
            losses.append(self._step(batch))
        self.model.policy.set_training_mode(False)
        for name, figures in (
            ("policy_loss", [float(loss.policy) for loss in losses]),
            ("value_loss", [float(loss.value) for loss in losses]),
            ("imitated_fraction", [loss.imitated / len(loss.advantages) for loss in losses]),
        ):
            self.logger.record(f"self_imitation/{name}", float(np.mean(figures)))
        self.logger.record("self_imitation/samples", len(self.replay))

    def _step(self, batch: ReplayBatch) -> SelfImitationLoss:
        model: Any = self.model
        policy = model.policy
        observations, returns = batch.observations, batch.returns
        normaliser = model.get_vec_normalize_env()
        if normaliser is not None:
            observations = normaliser.normalize_obs(observations)
            returns = returns * _reward_factor(normaliser)
        actions = torch.as_tensor(batch.actions, device=model.device)
        if isinstance(model.action_space, spaces.Discrete):
            actions = actions.long().flatten()
        values, log_probabilities, entropies = policy.evaluate_actions(
            torch.as_tensor(observations, device=model.device), actions
        )
        entropies = -log_probabilities if entropies is None else entropies
        loss = self_imitation_loss(
            log_probabilities,
            values.flatten(),
            entropies,
            torch.as_tensor(returns, dtype=torch.float32, device=model.device),
            torch.as_tensor(batch.weights, device=model.device),
            self.options,
        )
        policy.optimizer.zero_grad()
        loss.total.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(policy.parameters(), model.max_grad_norm)
        policy.optimizer.step()
        self.replay.set_priorities(batch.indices, loss.advantages.cpu().numpy())
        return loss

    def _current_observations(self, observations: Any) -> NDArray[Any]:
        """The observations of the moment as the environments give them."""
        normaliser = self.model.get_vec_normalize_env()
        if normaliser is not None:
            observations = normaliser.get_original_obs()
        if isinstance(observations, dict):
            raise OptionError("self-imitation cannot remember observations that are dictionaries")
        return np.array(observations)


class _Episode:
    """An episode under way."""

    def __init__(self) -> None:
        self._observations: list[NDArray[Any]] = []
        self._actions: list[NDArray[Any]] = []
        self._rewards: list[float] = []

    def append(self, observation: NDArray[Any], action: NDArray[Any], reward: float) -> None:
        self._observations.append(observation)
        self._actions.append(action)
        self._rewards.append(float(reward))

    def samples(self, gamma: float) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.float64]]:
        """Observations, actions and returns."""
        returns = discounted_returns(np.array(self._rewards), gamma)
        return np.stack(self._observations), np.stack(self._actions), returns


def _reward_factor(normaliser: VecNormalize) -> float:
    """What a normaliser multiplies rewards by at the moment."""
    if not normaliser.norm_reward:
        return 1.0
    return float(1.0 / np.sqrt(normaliser.ret_rms.var + normaliser.epsilon))


def _stream_words(generator: np.random.Generator) -> list[int]:
    """The state of a PCG64 stream as six words of 64 bits."""
    state: Any = generator.bit_generator.state
    words = []
    for name in ("state", "inc"):
        words += [state["state"][name] >> 64, state["state"][name] & (2**64 - 1)]
    return [*words, int(state["has_uint32"]), int(state["uinteger"])]


def _set_stream_words(generator: np.random.Generator, words: list[int]) -> None:
    generator.bit_generator.state = {
        "bit_generator": "PCG64",
        "state": {"state": words[0] << 64 | words[1], "inc": words[2] << 64 | words[3]},
        "has_uint32": words[4],
        "uinteger": words[5],
    }
