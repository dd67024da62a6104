"""The environment of one line on a scan head."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import lasergym
from lasergym.errors import ActionError, EpisodeOverError, OptionError

ENV_ID = "lasergym/GalvoLine-v0"


def test_the_checkers_find_no_fault() -> None:
    env = gym.make(ENV_ID)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(env, warn=True, skip_render_check=True)


def test_the_baseline_is_far_better_than_chance() -> None:
    env = gym.make(ENV_ID).unwrapped
    assert isinstance(env, lasergym.envs.GalvoLineEnv)
    env.action_space.seed(1)
    returns: dict[str, list[float]] = {"baseline": [], "random": []}
    for policy, found in returns.items():
        env.reset(seed=3)
        for _ in range(50):
            action = env.baseline_action() if policy == "baseline" else env.action_space.sample()
            _, reward, terminated, truncated, _ = env.step(action)
            assert terminated
            assert not truncated
            found.append(float(reward))
            env.reset()
    assert np.mean(returns["baseline"]) > np.mean(returns["random"]) + 5


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_vector_and_single_environments_agree(mode: AutoresetMode) -> None:
    envs = gym.make_vec(ENV_ID, num_envs=3, autoreset_mode=mode)
    assert isinstance(envs.unwrapped, lasergym.envs.GalvoLineVectorEnv)
    assert envs.metadata["autoreset_mode"] is mode
    singles = [gym.make(ENV_ID) for _ in range(3)]
    observations, _ = envs.reset(seed=5)
    expected = [env.reset(seed=5 + k)[0] for k, env in enumerate(singles)]
    np.testing.assert_array_equal(observations, expected)
    envs.action_space.seed(2)
    for _ in range(4):
        actions = envs.action_space.sample()
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        made = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        np.testing.assert_array_equal(rewards, [one[1] for one in made])
        assert terminated.all()
        assert not truncated.any()
        np.testing.assert_array_equal(infos["episode"]["r"], rewards)
        expected = [env.reset()[0] for env in singles]
        if mode == AutoresetMode.NEXT_STEP:
            observations, rewards, terminated, *_ = envs.step(actions)
            assert not terminated.any()
            assert not rewards.any()
        elif mode == AutoresetMode.DISABLED:
            with pytest.raises(EpisodeOverError):
                envs.step(actions)
            observations, _ = envs.reset(options={"reset_mask": np.ones(3, np.bool_)})
        np.testing.assert_array_equal(observations, expected)


def test_mistakes_are_refused() -> None:
    env = gym.make(ENV_ID).unwrapped
    with pytest.raises(EpisodeOverError):
        env.step(np.zeros(4, np.float32))
    env.reset(seed=1)
    for action in (np.zeros(3, np.float32), np.full(4, np.nan, np.float32)):
        with pytest.raises(ActionError):
            env.step(action)
    with pytest.raises(OptionError):
        env.reset(options={"x": 1})
    with pytest.raises(OptionError):
        gym.make(ENV_ID, pitch_scale=0.0)
