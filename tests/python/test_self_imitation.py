"""Self-imitation learning: the laws of its replay and its loss, and that agents learn with it."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lasergym
from lasergym.errors import OptionError

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3 import A2C, DQN, PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from lasergym.sb3 import (
    PrioritisedReplay,
    ReplayError,
    SelfImitation,
    SelfImitationOptions,
    discounted_returns,
    self_imitation_loss,
)


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


class Aim(gym.Env[Any, Any]):
    """Hit the mark on a line: of 16 steps, those within 0.1 of it earn one each."""

    def __init__(self) -> None:
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float32)
        self.steps = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.steps = 0
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        reward = float(abs(float(action[0]) - 0.6) < 0.1)
        return np.zeros(1, np.float32), reward, self.steps == 16, False, {}


def aims(count: int = 4) -> DummyVecEnv:
    return DummyVecEnv([Aim for _ in range(count)])


def loss_of(returns: list[float], values: torch.Tensor, **settings_: Any) -> Any:
    count = len(returns)
    log_probabilities = torch.full((count,), -1.5, requires_grad=True)
    loss = self_imitation_loss(
        log_probabilities,
        values,
        torch.zeros(count),
        torch.tensor(returns),
        torch.ones(count),
        SelfImitationOptions(**settings_),
    )
    return loss, log_probabilities


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(0, 5)), min_size=1, max_size=20))
def test_nothing_is_imitated_where_no_return_exceeds_its_value(
    pairs: list[tuple[float, float]],
) -> None:
    returns = torch.tensor([one for one, _ in pairs])
    values = (returns + torch.tensor([above for _, above in pairs])).requires_grad_()
    loss, log_probabilities = loss_of([one for one, _ in pairs], values)
    assert float(loss.total.detach()) == 0.0
    assert loss.imitated == 0
    loss.total.backward()
    assert not values.grad.any()  # type: ignore[union-attr]
    assert not log_probabilities.grad.any()


def test_the_loss_is_that_of_the_paper() -> None:
    values = torch.tensor([0.2, 0.0, 3.0], requires_grad=True)
    loss, log_probabilities = loss_of(
        [0.5, 0.7, 1.0], values, least_samples=1, loss_weight=1.0, value_weight=0.25
    )
    assert float(loss.policy) == pytest.approx((1.5 * 0.3 + 1.5 * 0.7) / 2)
    assert float(loss.value) == pytest.approx(0.5 * (0.3**2 + 0.7**2) / 2)
    assert float(loss.total.detach()) == pytest.approx(
        float(loss.policy) + 0.25 * float(loss.value)
    )
    loss.total.backward()
    # Only samples with a positive advantage have a gradient, and none goes through the advantage.
    assert log_probabilities.grad.tolist() == pytest.approx([-0.3 / 2, -0.7 / 2, 0.0])
    assert values.grad.tolist() == pytest.approx(  # type: ignore[union-attr]
        [-0.25 * 0.3 / 2, -0.25 * 0.7 / 2, 0.0]
    )


def test_advantages_are_clipped_and_few_samples_weigh_little() -> None:
    values = torch.zeros(2, requires_grad=True)
    loss, log_probabilities = loss_of(
        [5.0, -1.0], values, clip=2.0, least_samples=10, loss_weight=1.0, value_weight=1.0
    )
    assert loss.advantages.tolist() == [2.0, 0.0]
    loss.total.backward()
    assert log_probabilities.grad.tolist() == pytest.approx([-0.2, 0.0])
    assert values.grad.tolist() == pytest.approx([-0.2, 0.0])  # type: ignore[union-attr]


@settings(max_examples=50, deadline=None)
@given(
    rewards=st.lists(st.floats(-1, 1), min_size=1, max_size=30),
    gamma=st.floats(0.0, 1.0),
)
def test_returns_are_discounted_sums(rewards: list[float], gamma: float) -> None:
    returns = discounted_returns(np.array(rewards), gamma)
    for start, found in enumerate(returns):
        expected = sum(gamma**step * one for step, one in enumerate(rewards[start:]))
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("alpha", [0.0, 0.6, 1.0])
def test_samples_are_drawn_by_their_priority(alpha: float) -> None:
    replay = PrioritisedReplay(8, alpha)
    replay.add(np.zeros((8, 1)), np.zeros((8, 1)), np.arange(8.0))
    priorities = np.array([1.0, 2.0, 4.0, 0.0, 1.0, 0.5, 8.0, 1.0])
    replay.set_priorities(np.arange(8), priorities)
    chances = np.maximum(priorities, 1e-6) ** alpha
    chances /= chances.sum()
    np.testing.assert_allclose(replay.probabilities(), chances)
    draws = 100_000
    batch = replay.sample(draws, 0.5, np.random.default_rng(0))
    frequencies = np.bincount(batch.indices, minlength=8) / draws
    np.testing.assert_allclose(frequencies, chances, atol=5 * np.sqrt(0.25 / draws))
    # With all samples weighed by 1/P, each would count alike.
    expected = (chances / chances.min()) ** -0.5
    np.testing.assert_allclose(batch.weights, expected[batch.indices], rtol=1e-5)


@settings(max_examples=30, deadline=None)
@given(
    capacity=st.integers(1, 12),
    sizes=st.lists(st.integers(1, 9), min_size=1, max_size=6),
    plain_from=st.integers(0, 6),
    seed=st.integers(0, 1000),
)
def test_a_replay_keeps_the_latest_samples_exactly(
    capacity: int, sizes: list[int], plain_from: int, seed: int
) -> None:
    generator = np.random.default_rng(seed)
    replay = PrioritisedReplay(capacity, 0.6)
    images, returns = [], []
    for batch, size in enumerate(sizes):
        levels = generator.integers(0, 256, (size, 2, 1, 1, 2), dtype=np.uint8)
        which = generator.integers(0, 2, (size, 2, 5, 7))
        image = np.where(which == 1, levels[..., 0], levels[..., 1])
        if batch >= plain_from:
            image = generator.integers(0, 256, (size, 2, 5, 7), dtype=np.uint8)
        images += list(image)
        added = generator.normal(size=size)
        returns += added.tolist()
        replay.add(image, added[:, None], added)
    assert len(replay) == min(capacity, len(images))
    drawn = replay.sample(64, 0.1, generator)
    latest = dict(zip(returns[-capacity:], images[-capacity:], strict=True))
    for image, value, action in zip(drawn.observations, drawn.returns, drawn.actions, strict=True):
        np.testing.assert_array_equal(image, latest[value], strict=True)
        assert action[0] == value


def test_images_of_lasergym_take_a_bit_a_pixel() -> None:
    environment = lasergym.sb3.make_vec_env("lasergym/Star-v0", 4, 0, observation="layers")
    replay = PrioritisedReplay(1000, 0.6)
    environment.reset()
    observations, *_ = environment.step(np.zeros((4, 2), np.float32))
    replay.add(observations, np.zeros((4, 2), np.float32), np.zeros(4))
    assert replay.memory_bytes < 1000 * 4000
    batch = replay.sample(64, 0.0, np.random.default_rng(0))
    np.testing.assert_array_equal(batch.observations, observations[batch.indices], strict=True)


@pytest.mark.parametrize(
    ("samples", "reason"),
    [
        ((np.zeros((2, 1)), np.zeros((1, 1)), np.zeros(1)), "must be as many"),
        ((np.zeros((1, 1)), np.zeros((1, 1)), np.array([np.nan])), "not finite"),
        ((np.zeros((1, 2)), np.zeros((1, 1)), np.zeros(1)), "observations have shape"),
        ((np.zeros((1, 1)), np.zeros((1, 2)), np.zeros(1)), "actions have shape"),
    ],
)
def test_samples_that_do_not_fit_are_refused(samples: Any, reason: str) -> None:
    replay = PrioritisedReplay(4, 0.6)
    replay.add(np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1))
    with pytest.raises(ReplayError, match=reason):
        replay.add(*samples)


def test_an_empty_replay_gives_nothing() -> None:
    with pytest.raises(ReplayError, match="empty"):
        PrioritisedReplay(4, 0.6).sample(1, 0.1, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("updates", -1),
        ("batch_size", 0),
        ("capacity", 0),
        ("alpha", 1.5),
        ("beta", -0.1),
        ("loss_weight", float("nan")),
        ("value_weight", -1.0),
        ("entropy_weight", float("inf")),
        ("clip", 0.0),
        ("least_samples", 0),
        ("begin_samples", 0),
    ],
)
def test_settings_outside_their_range_are_refused(name: str, value: Any) -> None:
    with pytest.raises(OptionError, match=name):
        SelfImitationOptions(**{name: value})


def test_off_policy_algorithms_are_refused() -> None:
    model = DQN("MlpPolicy", "CartPole-v1", buffer_size=100)
    with pytest.raises(OptionError, match="DQN"):
        model.learn(1, callback=SelfImitation())


@pytest.mark.parametrize("normalised", [False, True])
def test_the_replay_holds_what_the_environment_gave(normalised: bool) -> None:
    environment: Any = lasergym.sb3.make_vec_env("lasergym/Star-v0", 3, 0, max_pulses=4)
    extra: dict[str, Any] = {}
    if normalised:
        environment = VecNormalize(environment, gamma=0.5)
        extra = {"normalize_images": False}
    imitation = SelfImitation()
    model = PPO(
        "MlpPolicy",
        environment,
        n_steps=8,
        batch_size=24,
        n_epochs=1,
        gamma=0.5,
        seed=0,
        policy_kwargs=extra,
    )
    model.learn(24, callback=imitation)
    assert len(imitation.replay) == 24
    # Replayed: the actions of an episode lead to its observations and returns.
    batch = imitation.replay.sample(500, 0.1, np.random.default_rng(0))
    order = [int(np.flatnonzero(batch.indices == index)[0]) for index in range(4)]
    single = gym.make("lasergym/Star-v0", max_pulses=4)
    observation, _ = single.reset(seed=0)
    rewards = []
    for index in order:
        np.testing.assert_array_equal(batch.observations[index], observation, strict=True)
        action = np.clip(batch.actions[index], -1, 1)
        observation, reward, *_ = single.step(action)
        rewards.append(reward)
    returns = [batch.returns[index] for index in order]
    np.testing.assert_allclose(returns, discounted_returns(np.array(rewards), 0.5), atol=1e-6)


def test_the_same_seed_gives_the_same_agent_and_saved_memory_goes_on(tmp_path: Path) -> None:
    agents = []
    for _ in range(2):
        imitation = SelfImitation(SelfImitationOptions(updates=3, begin_samples=16), seed=5)
        model = PPO("MlpPolicy", aims(), n_steps=16, batch_size=32, n_epochs=1, seed=0)
        model.learn(192, callback=imitation)
        agents.append((model, imitation))
    (one, first), (other, second) = agents
    for mine, theirs in zip(one.policy.parameters(), other.policy.parameters(), strict=True):
        assert torch.equal(mine, theirs)
    first.save(tmp_path / "memory.npz")
    copy = SelfImitation(seed=99)
    copy.load(tmp_path / "memory.npz")
    expected = second.replay.sample(20, 0.1, second.generator)
    found = copy.replay.sample(20, 0.1, copy.generator)
    for mine, theirs in zip(vars(expected).values(), vars(found).values(), strict=True):
        np.testing.assert_array_equal(mine, theirs, strict=True)


def test_a_memory_of_another_capacity_is_refused(tmp_path: Path) -> None:
    imitation = SelfImitation()
    imitation.replay.add(np.zeros((9, 1)), np.zeros((9, 1)), np.zeros(9))
    imitation.save(tmp_path / "memory.npz")
    with pytest.raises(ReplayError, match="do not fit"):
        SelfImitation(SelfImitationOptions(capacity=8)).load(tmp_path / "memory.npz")


@pytest.mark.parametrize("algorithm", [PPO, A2C])
def test_self_imitation_learns_at_least_what_the_algorithm_alone_does(algorithm: Any) -> None:
    def final_return(callback: SelfImitation | None, seed: int) -> float:
        model = algorithm("MlpPolicy", aims(), n_steps=32, gamma=0.0, learning_rate=3e-3, seed=seed)
        model.learn(1536, callback=callback)
        return mean_return(model)

    seeds = (0, 1)
    alone = np.mean([final_return(None, seed) for seed in seeds])
    options = SelfImitationOptions(loss_weight=1.0, begin_samples=64)
    together = np.mean([final_return(SelfImitation(options, seed), seed) for seed in seeds])
    assert together >= alone


def mean_return(model: Any) -> float:
    """The mean return of sixteen episodes of the agent as it acts in training."""
    environment = aims(16)
    observations = environment.reset()
    returns = np.zeros(16)
    for _ in range(16):
        actions, _ = model.predict(observations)
        observations, rewards, _, _ = environment.step(actions)
        returns += rewards
    return float(returns.mean())
