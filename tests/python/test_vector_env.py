"""The native vector environments equal single ones bit for bit."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st

import lasergym
from lasergym.errors import EpisodeOverError, OptionError, ShapeError

MODES = list(AutoresetMode)


def assert_same_infos(expected: dict[str, Any], actual: dict[str, Any]) -> None:
    """Same keys, masks and values; `final_obs` is an array of objects on one side, dense on the
    other."""
    assert expected.keys() == actual.keys()
    for key, value in expected.items():
        if isinstance(value, dict):
            assert_same_infos(value, actual[key])
        elif key == "final_obs":
            for index in np.flatnonzero(expected["_final_obs"]):
                np.testing.assert_array_equal(value[index], actual[key][index])
        else:
            np.testing.assert_array_equal(value, actual[key], strict=True)


@settings(max_examples=60, deadline=None)
@given(
    env_id=st.sampled_from(lasergym.envs.ABLATION_IDS),
    mode=st.sampled_from(MODES),
    threads=st.integers(1, 4),
    num_envs=st.integers(1, 5),
    seed=st.integers(0, 2**31),
    max_episode_steps=st.one_of(st.none(), st.integers(1, 9)),
    arguments=st.fixed_dictionaries(
        {},
        optional={
            "observation": st.sampled_from(["remaining", "layers"]),
            "max_pulses": st.integers(1, 8),
            "pulse_radius_px": st.floats(0.5, 30.0),
            "completion": st.floats(0.05, 1.0),
            "pointing_error_px": st.floats(0.0, 5.0),
            "radius_error": st.floats(0.0, 0.3),
            "stop_on_miss": st.booleans(),
        },
    ),
)
def test_vector_equals_single(
    env_id: str,
    mode: AutoresetMode,
    threads: int,
    num_envs: int,
    seed: int,
    max_episode_steps: int | None,
    arguments: dict[str, Any],
) -> None:
    assert_vector_equals_single(
        env_id, mode, threads, num_envs, seed, max_episode_steps, arguments, steps=20
    )


@settings(max_examples=20, deadline=None)
@given(
    mode=st.sampled_from(MODES),
    threads=st.integers(1, 3),
    num_envs=st.integers(1, 3),
    seed=st.integers(0, 2**31),
    max_episode_steps=st.one_of(st.none(), st.integers(1, 9)),
    arguments=st.fixed_dictionaries(
        {},
        optional={
            "process": st.sampled_from(lasergym.milling.PROCESSES),
            "observation": st.sampled_from(["residual", "layers"]),
            "max_spots": st.integers(1, 8),
            "tolerance_percent": st.floats(0.0, 99.5),
            "pointing_error_um": st.floats(0.0, 30.0),
            "dwell_error": st.floats(0.0, 0.5),
        },
    ),
)
def test_milling_vector_equals_single(
    mode: AutoresetMode,
    threads: int,
    num_envs: int,
    seed: int,
    max_episode_steps: int | None,
    arguments: dict[str, Any],
) -> None:
    assert_vector_equals_single(
        "lasergym/Milling-v0",
        mode,
        threads,
        num_envs,
        seed,
        max_episode_steps,
        arguments,
        steps=12,
    )


def assert_vector_equals_single(
    env_id: str,
    mode: AutoresetMode,
    threads: int,
    num_envs: int,
    seed: int,
    max_episode_steps: int | None,
    arguments: dict[str, Any],
    *,
    steps: int,
) -> None:
    limit = {} if max_episode_steps is None else {"max_episode_steps": max_episode_steps}
    singles = gym.vector.SyncVectorEnv(
        [lambda: gym.make(env_id, **arguments, **limit) for _ in range(num_envs)],
        autoreset_mode=mode,
    )
    native = gym.make_vec(
        env_id,
        num_envs=num_envs,
        autoreset_mode=mode,
        threads=threads,
        episode_statistics=False,
        **arguments,
        **limit,
    )
    generator = np.random.default_rng(seed)
    expected, actual = singles.reset(seed=seed), native.reset(seed=seed)
    np.testing.assert_array_equal(expected[0], actual[0], strict=True)
    assert_same_infos(expected[1], actual[1])
    size = native.single_action_space.shape
    assert size is not None
    for _ in range(steps):
        actions = generator.uniform(-1.2, 1.2, (num_envs, *size)).astype(np.float32)
        expected, actual = singles.step(actions), native.step(actions)
        for one, other in zip(expected[:4], actual[:4], strict=True):
            np.testing.assert_array_equal(one, other, strict=True)
        assert_same_infos(expected[4], actual[4])
        done = expected[2] | expected[3]
        if mode == AutoresetMode.DISABLED and done.any():
            expected = singles.reset(options={"reset_mask": done.copy()})
            actual = native.reset(options={"reset_mask": done.copy()})
            np.testing.assert_array_equal(expected[0], actual[0], strict=True)
            assert_same_infos(expected[1], actual[1])


@settings(max_examples=20, deadline=None)
@given(mode=st.sampled_from(MODES), seed=st.integers(0, 2**31), max_pulses=st.integers(1, 5))
def test_episode_statistics_equal_the_wrapper(
    mode: AutoresetMode, seed: int, max_pulses: int
) -> None:
    arguments: dict[str, Any] = {
        "num_envs": 3,
        "autoreset_mode": mode,
        "max_pulses": max_pulses,
        "stop_on_miss": True,
    }
    native = gym.make_vec("lasergym/Star-v0", **arguments)
    wrapped = gym.wrappers.vector.RecordEpisodeStatistics(
        gym.make_vec("lasergym/Star-v0", episode_statistics=False, **arguments)
    )
    native.reset(seed=seed)
    wrapped.reset(seed=seed)
    generator = np.random.default_rng(seed)
    for _ in range(15):
        actions = generator.uniform(-1, 1, (3, 2)).astype(np.float32)
        *_, terminated, _, actual = native.step(actions)
        *_, expected = wrapped.step(actions)
        assert ("episode" in expected) == ("episode" in actual) == terminated.any()
        if terminated.any():
            np.testing.assert_array_equal(expected["_episode"], actual["_episode"])
            np.testing.assert_allclose(expected["episode"]["r"], actual["episode"]["r"], atol=1e-12)
            np.testing.assert_array_equal(expected["episode"]["l"], actual["episode"]["l"])
            assert (actual["episode"]["t"][terminated] > 0).all()
        if mode == AutoresetMode.DISABLED and terminated.any():
            native.reset(options={"reset_mask": terminated.copy()})
            wrapped.reset(options={"reset_mask": terminated.copy()})


def test_without_copying_the_buffer_is_reused_and_equal() -> None:
    copied = gym.make_vec("lasergym/RandomShape-v0", num_envs=4, max_pulses=3)
    shared = gym.make_vec("lasergym/RandomShape-v0", num_envs=4, max_pulses=3, copy=False)
    first, _ = copied.reset(seed=5)
    buffer, _ = shared.reset(seed=5)
    kept = first.copy()
    for _ in range(10):
        actions = copied.action_space.sample()
        expected = copied.step(actions)[0]
        actual = shared.step(actions)[0]
        assert actual is buffer
        np.testing.assert_array_equal(expected, actual)
    np.testing.assert_array_equal(first, kept)


def test_vector_render_equals_single_render() -> None:
    arguments: dict[str, Any] = {"render_mode": "rgb_array", "pointing_error_px": 2.0}
    envs = gym.make_vec("lasergym/RandomShape-v0", num_envs=2, max_pulses=4, **arguments)
    single = gym.make("lasergym/RandomShape-v0", max_pulses=4, **arguments)
    envs.reset(seed=3)
    single.reset(seed=4)
    over = False
    for _ in range(7):
        actions = envs.action_space.sample()
        envs.step(actions)
        if over:
            single.reset()
            over = False
        else:
            over = single.step(actions[1])[2]
        frames = envs.render()
        assert frames is not None
        np.testing.assert_array_equal(frames[1], single.render())


def test_reset_options_give_targets() -> None:
    target = lasergym.targets.star(30.0)
    envs = gym.make_vec("lasergym/RandomShape-v0", num_envs=3)
    observations, _ = envs.reset(seed=1, options={"target": target})
    assert all(((image[0] > 0) == target).all() for image in observations)
    observations, _ = envs.reset(options={"target": [None, target, None]})
    assert ((observations[1, 0] > 0) == target).all()
    assert not ((observations[0, 0] > 0) == target).all()


def test_streams_do_not_depend_on_their_neighbours() -> None:
    few = gym.make_vec("lasergym/RandomShape-v0", num_envs=2)
    many = gym.make_vec("lasergym/RandomShape-v0", num_envs=9)
    np.testing.assert_array_equal(few.reset(seed=8)[0], many.reset(seed=8)[0][:2])
    listed = gym.make_vec("lasergym/RandomShape-v0", num_envs=2)
    np.testing.assert_array_equal(few.reset(seed=8)[0], listed.reset(seed=[8, 9])[0])


def test_unseeded_environments_differ() -> None:
    observations, _ = gym.make_vec("lasergym/RandomShape-v0", num_envs=2).reset()
    assert (observations[0] != observations[1]).any()


def test_a_bad_step_changes_nothing() -> None:
    envs = gym.make_vec("lasergym/Star-v0", num_envs=2)
    twin = gym.make_vec("lasergym/Star-v0", num_envs=2)
    envs.reset(seed=1)
    twin.reset(seed=1)
    bad = np.array([[0.0, 0.0], [np.nan, 0.0]], np.float32)
    with pytest.raises(ValueError, match="environment 1"):
        envs.step(bad)
    good = np.zeros((2, 2), np.float32)
    for one, other in zip(envs.step(good)[:4], twin.step(good)[:4], strict=True):
        np.testing.assert_array_equal(one, other)


def test_misuse_is_named() -> None:
    envs = gym.make_vec("lasergym/Star-v0", num_envs=2, max_pulses=1, autoreset_mode="Disabled")
    actions = np.zeros((2, 2), np.float32)
    with pytest.raises(EpisodeOverError):
        envs.step(actions)
    envs.reset(seed=0)
    envs.step(actions)
    with pytest.raises(EpisodeOverError, match="environment 0"):
        envs.step(actions)
    with pytest.raises(ShapeError, match="shape"):
        envs.reset(options={"reset_mask": np.ones(3, np.bool_)})
    with pytest.raises(ShapeError, match="Boolean"):
        envs.reset(options={"reset_mask": [True, False]})
    with pytest.raises(ShapeError, match="True"):
        envs.reset(options={"reset_mask": np.zeros(2, np.bool_)})
    with pytest.raises(OptionError, match="speed"):
        envs.reset(options={"speed": 3})
    with pytest.raises(ShapeError, match="seeds"):
        envs.reset(seed=[1, 2, 3])


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"num_envs": 0}, "num_envs"),
        ({"threads": 0}, "threads"),
        ({"threads": -1}, "threads"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"autoreset_mode": "Later"}, "autoreset_mode"),
        ({"max_pulses": 0}, "max_pulses"),
        ({"observation": "everything"}, "observation"),
    ],
)
def test_bad_settings_are_named(arguments: dict[str, Any], name: str) -> None:
    with pytest.raises(OptionError, match=name):
        lasergym.envs.StarVectorEnv(**({"num_envs": 2} | arguments))
