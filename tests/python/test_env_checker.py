"""The environments keep the contract of Gymnasium and of Stable-Baselines3, without a warning.

`make test` runs this file under several versions of Gymnasium; the rest of the tests under one.
"""

import warnings

import gymnasium as gym
import pytest
from gymnasium.utils.env_checker import check_env

import lasergym

CASES = [
    *((env_id, mode) for env_id in lasergym.envs.ABLATION_IDS for mode in ("remaining", "layers")),
    *((env_id, mode) for env_id in lasergym.envs.MILLING_IDS for mode in ("residual", "layers")),
]
RENDER_MODES = (None, "rgb_array", "ansi", "human")


@pytest.fixture(autouse=True)
def _no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


@pytest.mark.parametrize(("env_id", "observation"), CASES)
@pytest.mark.parametrize("render_mode", RENDER_MODES)
def test_gymnasium_finds_no_fault(env_id: str, observation: str, render_mode: str | None) -> None:
    if render_mode == "human":
        pytest.importorskip("pygame")
    env = gym.make(env_id, observation=observation, render_mode=render_mode)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Rendering of the other modes is checked where they are the mode of the environment.
        check_env(env.unwrapped, skip_render_check=render_mode is None)
    env.close()


@pytest.mark.parametrize(("env_id", "observation"), CASES)
@pytest.mark.parametrize("render_mode", RENDER_MODES)
def test_stable_baselines3_finds_no_fault(
    env_id: str, observation: str, render_mode: str | None
) -> None:
    if render_mode == "human":
        pytest.importorskip("pygame")
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gym.make(env_id, observation=observation, render_mode=render_mode)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(env, warn=True, skip_render_check=render_mode is None)
    env.close()


@pytest.mark.parametrize("env_id", lasergym.envs.ENVIRONMENT_IDS)
def test_wrapped_environments_run(env_id: str) -> None:
    env = gym.make(f"lasergym:{env_id}", max_episode_steps=5)
    env = gym.wrappers.RecordEpisodeStatistics(env)
    env.reset(seed=1)
    over, steps = False, 0
    while not over:
        *_, terminated, truncated, info = env.step(env.action_space.sample())
        over, steps = terminated or truncated, steps + 1
    assert info["episode"]["l"] == steps <= 5


@pytest.mark.parametrize("env_id", lasergym.envs.ENVIRONMENT_IDS)
@pytest.mark.parametrize("mode", list(gym.vector.AutoresetMode))
def test_vector_environments_are_native_and_declare_their_mode(
    env_id: str, mode: gym.vector.AutoresetMode
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        envs = gym.make_vec(env_id, num_envs=3, autoreset_mode=mode)
    assert isinstance(envs.unwrapped, lasergym.envs.SeededVectorEnv)
    assert envs.metadata["autoreset_mode"] is mode
    observations, _ = envs.reset(seed=1)
    assert envs.observation_space.contains(observations)
    single = gym.make(env_id)
    assert envs.observation_space == gym.vector.utils.batch_space(single.observation_space, 3)
    assert envs.action_space == gym.vector.utils.batch_space(single.action_space, 3)
    assert envs.action_space.contains(envs.action_space.sample())


def test_gymnasium_wrappers_of_vector_environments_work() -> None:
    envs = gym.make_vec("lasergym/Star-v0", num_envs=2, max_pulses=3, episode_statistics=False)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    envs = gym.wrappers.vector.NormalizeObservation(envs)
    envs.reset(seed=1)
    for _ in range(3):
        *_, infos = envs.step(envs.action_space.sample())
    assert infos["episode"]["l"].tolist() == [3, 3]
