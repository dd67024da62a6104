"""The Stable-Baselines3 adapter equals `DummyVecEnv` over monitored single environments."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lasergym
from lasergym.errors import OptionError

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv


def assert_same_rows(expected: list[dict[str, Any]], actual: list[dict[str, Any]]) -> None:
    """Same infos; the duration of an episode is a matter of the clock."""
    for one, other in zip(expected, actual, strict=True):
        assert one.keys() == other.keys()
        for key, value in one.items():
            if key == "terminal_observation":
                np.testing.assert_array_equal(value, other[key], strict=True)
            elif key == "episode":
                assert value["r"] == pytest.approx(other[key]["r"], abs=1e-9)
                assert value["l"] == other[key]["l"]
                assert other[key]["t"] >= 0
            else:
                assert value == other[key]
                assert type(value) is type(other[key])


@settings(max_examples=30, deadline=None)
@given(
    env_id=st.sampled_from(lasergym.envs.ABLATION_IDS),
    n_envs=st.integers(1, 4),
    seed=st.integers(0, 2**31),
    limit=st.one_of(st.none(), st.integers(1, 6)),
    max_pulses=st.integers(1, 6),
    threads=st.integers(1, 3),
)
def test_adapter_equals_dummy_vec_env(
    env_id: str, n_envs: int, seed: int, limit: int | None, max_pulses: int, threads: int
) -> None:
    arguments: dict[str, Any] = {"max_pulses": max_pulses, "pointing_error_px": 1.0}
    if limit is not None:
        arguments["max_episode_steps"] = limit
    dummy = DummyVecEnv([lambda: Monitor(gym.make(env_id, **arguments)) for _ in range(n_envs)])
    dummy.seed(seed)
    native = lasergym.sb3.make_vec_env(env_id, n_envs, seed, threads=threads, **arguments)
    np.testing.assert_array_equal(dummy.reset(), native.reset(), strict=True)
    assert dummy.reset_infos == native.reset_infos
    generator = np.random.default_rng(seed)
    kept: list[tuple[Any, Any]] = []
    for _ in range(15):
        actions = generator.uniform(-1, 1, (n_envs, 2)).astype(np.float32)
        expected, actual = dummy.step(actions), native.step(actions)
        for one, other in zip(expected[:3], actual[:3], strict=True):
            np.testing.assert_array_equal(one, other, strict=True)
        assert_same_rows(expected[3], actual[3])
        assert dummy.reset_infos == native.reset_infos
        kept.append((expected[0], actual[0]))
    for one, other in kept:
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(dummy.reset(), native.reset())


def test_seed_and_options_act_at_the_next_reset() -> None:
    target = lasergym.targets.star(10.0)
    environment = lasergym.sb3.make_vec_env("lasergym/RandomShape-v0", n_envs=2, seed=1)
    first = environment.reset()
    second = environment.reset()
    assert (first != second).any()
    environment.seed(1)
    np.testing.assert_array_equal(environment.reset(), first)
    environment.set_options({"target": target})
    assert (((environment.reset() > 0) == target).all(axis=(1, 2, 3))).all()
    environment.set_options([{}, {"target": target}])
    observations = environment.reset()
    assert ((observations[1] > 0) == target).all()
    assert not ((observations[0] > 0) == target).all()
    environment.set_options({"speed": 2})
    with pytest.raises(OptionError, match="speed"):
        environment.reset()


def test_attributes_methods_and_images() -> None:
    environment = lasergym.sb3.make_vec_env(
        "lasergym/Star-v0", n_envs=3, seed=1, render_mode="rgb_array"
    )
    environment.reset()
    environment.step(np.zeros((3, 2), np.float32))
    assert environment.get_attr("render_mode") == ["rgb_array"] * 3
    assert environment.has_attr("settings")
    assert not environment.has_attr("no_such_attribute")
    environment.set_attr("label", "mine", indices=[1])
    assert environment.get_attr("label", indices=1) == ["mine"]
    remaining = environment.env_method("remaining", indices=[0, 2])
    assert [image.sum() for image in remaining] == [4842 - 256] * 2
    assert environment.env_is_wrapped(Monitor) == [True] * 3
    images = environment.get_images()
    assert [image.shape for image in images if image is not None] == [(400, 400, 3)] * 3
    assert environment.render("rgb_array") is not None
    environment.close()


def test_ppo_learns_and_is_evaluated() -> None:
    environment = lasergym.sb3.make_vec_env("lasergym/Star-v0", n_envs=8, seed=0, max_pulses=10)
    model = PPO("CnnPolicy", environment, n_steps=16, batch_size=64, n_epochs=1, seed=0)
    model.learn(256)
    assert len(model.ep_info_buffer or []) > 0
    mean, _ = evaluate_policy(model, environment, n_eval_episodes=8)
    assert np.isfinite(mean)


def test_other_autoreset_modes_are_refused() -> None:
    with pytest.raises(OptionError, match="SAME_STEP"):
        lasergym.sb3.NativeVecEnv(gym.make_vec("lasergym/Star-v0", num_envs=2).unwrapped)
