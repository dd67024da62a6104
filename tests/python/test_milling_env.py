"""The milling environment: spaces, rewards, targets, saved states, pictures, plans."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import lasergym
from lasergym import milling
from lasergym.cli import main
from lasergym.errors import (
    ActionNotFiniteError,
    ActionShapeError,
    DepthMapError,
    EmptyTargetError,
    EpisodeOverError,
    OptionError,
    RenderModeError,
)

ENV_ID = "lasergym/Milling-v0"


def make(**arguments: Any) -> Any:
    return gym.make(ENV_ID, disable_env_checker=True, **arguments).unwrapped


def test_rewards_are_the_fall_of_the_tracking_error() -> None:
    env = make(max_spots=30)
    observation, info = env.reset(seed=3)
    assert info["tracking_error_percent"] == 100.0
    assert observation.min() == 128  # nothing is too deep yet
    generator = np.random.default_rng(0)
    total, terminated = 0.0, False
    while not terminated:
        action = generator.uniform(-1, 1, 3).astype(np.float32)
        observation, reward, terminated, _, info = env.step(action)
        total += reward
    error = np.abs(env.depth_um() - env.target_um()).sum() / env.target_um().sum()
    assert total == pytest.approx(1 - error, abs=1e-9)
    assert info["tracking_error_percent"] == pytest.approx(100 * error, abs=1e-7)
    assert info["spots"] == 30
    assert info["is_success"] is False
    with pytest.raises(EpisodeOverError):
        env.step(action)


def test_the_observation_is_the_residual_depth() -> None:
    env = make(observation="layers", max_spots=4)
    env.reset(seed=1)
    observation, *_ = env.step(np.array([0.2, -0.3, 1.0], np.float32))
    part = (env.target_um() - env.depth_um()) / env.target_um().max()
    np.testing.assert_allclose(observation[0], 255 * np.clip(part, 0, 1), atol=0.51)
    np.testing.assert_allclose(observation[1], 255 * np.clip(-part, 0, 1), atol=0.51)
    assert (observation[2] == 191).all()


def test_targets_are_given_for_all_episodes_or_for_one() -> None:
    dish = milling.random_relief(seed=5, depth_um=10)
    env = make(target=dish)
    env.reset(seed=0)
    np.testing.assert_array_equal(env.target_um(), dish)
    other = np.full((100, 100), 4.0)
    env.reset(options={"target": other})
    np.testing.assert_array_equal(env.target_um(), other)
    env.reset()
    np.testing.assert_array_equal(env.target_um(), dish)
    envs = gym.make_vec(ENV_ID, num_envs=2)
    envs.reset(seed=0, options={"target": [None, other]})
    vector: Any = envs.unwrapped
    np.testing.assert_array_equal(vector.target_um(1), other)
    assert (vector.depth_um(0) == 0).all()


def test_saved_states_replay() -> None:
    env = make(pointing_error_um=5.0, dwell_error=0.2)
    env.reset(seed=7)
    state = env.clone_state()
    action = np.zeros(3, np.float32)
    first = env.step(action)[1]
    env.restore_state(state)
    assert env.step(action)[1] == first


def test_bad_arguments_and_actions_are_refused() -> None:
    for arguments, error in (
        ({"max_spots": 0}, OptionError),
        ({"tolerance_percent": 100.0}, OptionError),
        ({"observation": "depth"}, OptionError),
        ({"process": "axe"}, OptionError),
        ({"dwell_error": 0.7}, OptionError),
        ({"depth_um": -1.0}, OptionError),
        ({"render_mode": "svg"}, RenderModeError),
        ({"target": np.zeros((3, 3))}, DepthMapError),
        ({"target": np.zeros((100, 100)), "depth_um": 1.0}, EmptyTargetError),
        ({"target": np.full((100, 100), np.nan), "depth_um": 1.0}, DepthMapError),
    ):
        with pytest.raises(error):
            lasergym.envs.MillingEnv(**arguments)  # type: ignore[arg-type]
    env = make()
    with pytest.raises(OptionError, match="unknown reset options"):
        env.reset(options={"depth": 1})
    env.reset(seed=0)
    with pytest.raises(ActionShapeError):
        env.step(np.zeros(2, np.float32))
    with pytest.raises(ActionNotFiniteError):
        env.step(np.array([0, np.nan, 0], np.float32))


@pytest.mark.parametrize("render_mode", ["rgb_array", "ansi"])
def test_the_picture_shows_what_is_left(render_mode: str) -> None:
    env = make(render_mode=render_mode)
    env.reset(seed=0)
    before = env.render()
    env.step(np.array([0, 0, 1], np.float32))
    after = env.render()
    if render_mode == "ansi":
        assert before != after
        assert after.splitlines()[-1].startswith("spots 1  tracking error")
        return
    assert after.shape == (400, 400, 3)
    assert after.dtype == np.uint8
    assert not np.array_equal(before, after)
    envs = gym.make_vec(ENV_ID, num_envs=1, render_mode="rgb_array")
    envs.reset(seed=0)
    frames = envs.render()
    assert frames is not None
    np.testing.assert_array_equal(frames[0], before)


@pytest.mark.parametrize("process", milling.PROCESSES)
def test_the_adjoint_plans_better_and_the_environment_agrees(process: str) -> None:
    relief = milling.random_relief(seed=11, depth_um=milling.full_scale_um(process))
    usual = milling.plan_spots(relief, "pixel-by-pixel", process=process)
    best = milling.plan_spots(relief, "adjoint", process=process)
    assert best.tracking_error_percent < 0.7 * usual.tracking_error_percent
    env = make(process=process, target=relief)
    env.reset(seed=0)
    total = 0.0
    for action in best.actions:
        _, reward, _, _, info = env.step(action)
        total += reward
    assert total == pytest.approx(best.reward, abs=1e-12)
    assert info["tracking_error_percent"] == best.tracking_error_percent
    assert best.xy_um.shape == (best.spots, 2)
    assert best.dwell_s.min() > 0


def test_the_planner_stops_when_told() -> None:
    relief = milling.random_relief(seed=1)
    seen: list[float] = []

    def stop(fraction: float) -> bool:
        seen.append(fraction)
        return len(seen) == 2

    assert milling.plan_spots(relief, progress=stop, max_spots=64).partial
    assert len(seen) == 2
    with pytest.raises(OptionError, match="planner"):
        milling.plan_spots(relief, "raster")  # type: ignore[arg-type]


def test_compare_has_the_adjoint_as_baseline(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["compare", "--task", "milling", "--reliefs", "2", "--max-pulses", "100"]
    command += ["--jobs", "1", "--no-pictures", "-o", str(tmp_path / "out"), "--json"]
    assert main(command) == 0
    groups = json.loads(capsys.readouterr().out)["groups"]
    (group,) = groups
    figures = group["planners"]
    assert group["name"] == "milling"
    assert group["targets"] == 2
    assert set(figures) == {"pixel-by-pixel", "adjoint"}
    assert figures["adjoint"]["reward"]["mean"] > figures["pixel-by-pixel"]["reward"]["mean"]
    # The same command goes on from the results that there are.
    assert main(command) == 0
    assert "depth maps" in (tmp_path / "out" / "table1.md").read_text(encoding="utf-8")


def test_compare_refuses_planners_that_do_not_fit(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, words in (
        (("--task", "milling", "--planners", "raster"), "no planner is given for the task milling"),
        (("--task", "star", "--planners", "raster,adjoint"), "'adjoint' does none of the tasks"),
        (("--task", "milling", "--reliefs", "0"), "reliefs is 0"),
    ):
        assert main(["compare", *arguments]) in (1, 2)
        assert words in capsys.readouterr().err.replace("\n", " ")


def test_stable_baselines3_takes_the_environment() -> None:
    pytest.importorskip("stable_baselines3")
    venv = lasergym.sb3.make_vec_env(ENV_ID, n_envs=2, seed=0, max_spots=3)
    observations = venv.reset()
    assert observations.shape == (2, 1, 100, 100)
    for _ in range(3):
        _, rewards, dones, infos = venv.step(np.zeros((2, 3), np.float32))
    assert rewards.shape == (2,)
    assert dones.all()
    assert infos[0]["episode"]["l"] == 3
