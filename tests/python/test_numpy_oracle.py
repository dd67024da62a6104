"""The native batch equals its second implementation in NumPy, bit for bit."""

from typing import Any, get_args

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import lasergym
from lasergym.envs.settings import native_seed
from numpy_ablation import NumpyAblation, Streams, Task, WholeGridNumpyAblation

TASKS = get_args(Task)


def actions(generator: np.random.Generator, num_envs: int) -> NDArray[np.float32]:
    """Actions a little beyond the workpiece; a third of them set the centres of pulses on pixel
    edges and centres, where pixels lie exactly on the rim."""
    drawn = generator.uniform(-1.1, 1.1, (num_envs, 2))
    drawn[::3] = np.round(100 * drawn[::3]) / 100
    drawn[1::6] = np.round(64 * drawn[1::6]) / 64
    return drawn.astype(np.float32)


def assert_equal_steps(task: Task, num_envs: int, seed: int, steps: int, **arguments: Any) -> None:
    envs = gym.make_vec(f"lasergym/{task}-v0", num_envs=num_envs, copy=False, **arguments)
    oracle = NumpyAblation(task, num_envs, **arguments)
    expected, _ = envs.reset(seed=seed)
    generators = [gym.utils.seeding.np_random(seed + k)[0] for k in range(num_envs)]
    actual = oracle.reset(seed=[native_seed(generator) for generator in generators])
    np.testing.assert_array_equal(actual, expected, strict=True)
    generator = np.random.default_rng(seed)
    for _ in range(steps):
        action = actions(generator, num_envs)
        expected, reward, terminated, truncated, infos = envs.step(action)
        actual, oracle_reward, oracle_terminated, oracle_infos = oracle.step(action)
        np.testing.assert_array_equal(actual, expected, strict=True)
        np.testing.assert_array_equal(oracle_reward, reward, strict=True)
        np.testing.assert_array_equal(oracle_terminated, terminated, strict=True)
        assert not truncated.any()
        for key, values in oracle_infos.items():
            np.testing.assert_array_equal(values, infos[key])


@pytest.mark.parametrize("task", TASKS)
def test_the_whole_grid_equals_the_window(task: Task) -> None:
    window, grid = NumpyAblation(task, 9), WholeGridNumpyAblation(task, 9)
    window.reset(seed=3)
    grid.reset(seed=3)
    generator = np.random.default_rng(0)
    for _ in range(100):
        action = actions(generator, 9)
        for one, other in zip(window.step(action)[:3], grid.step(action)[:3], strict=True):
            np.testing.assert_array_equal(one, other, strict=True)


@pytest.mark.parametrize("task", TASKS)
def test_hundreds_of_steps_are_equal(task: Task) -> None:
    assert_equal_steps(task, num_envs=32, seed=7, steps=300)


@settings(max_examples=25, deadline=None)
@given(
    task=st.sampled_from(TASKS),
    num_envs=st.integers(1, 12),
    seed=st.integers(0, 2**31),
    pulse_radius_px=st.one_of(st.integers(2, 100).map(lambda k: k / 2), st.floats(0.5, 50.0)),
    max_pulses=st.integers(1, 20),
    completion=st.floats(0.05, 1.0),
)
def test_steps_with_any_setting_are_equal(
    task: Task,
    num_envs: int,
    seed: int,
    pulse_radius_px: float,
    max_pulses: int,
    completion: float,
) -> None:
    assert_equal_steps(
        task,
        num_envs,
        seed,
        steps=40,
        pulse_radius_px=pulse_radius_px,
        max_pulses=max_pulses,
        completion=completion,
    )


def test_streams_are_those_of_numpy() -> None:
    streams = Streams(3)
    for index, seed in enumerate((0, 1, 2**64 - 1)):
        streams.seed(index, seed)
    expected = []
    for index in range(3):
        generator = np.random.PCG64()
        state = generator.state
        state["state"]["state"] = int(streams.state_high[index]) << 64 | int(
            streams.state_low[index]
        )
        state["state"]["inc"] = int(streams.increment_high[index]) << 64 | int(
            streams.increment_low[index]
        )
        generator.state = state
        expected.append(generator.random_raw(100))
    drawn = np.stack([streams.next(np.arange(3)) for _ in range(100)], axis=1)
    np.testing.assert_array_equal(drawn, np.array(expected))


def test_a_random_shape_is_that_of_the_library() -> None:
    oracle = NumpyAblation("RandomShape", 50)
    shapes = oracle.reset(seed=0)[:, 0] == 255
    for seed, shape in enumerate(shapes):
        np.testing.assert_array_equal(lasergym.targets.random_shape(seed), shape)
