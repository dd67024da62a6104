"""The single environments: the process, its arguments and its errors."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lasergym
from lasergym import errors

IDS = lasergym.envs.ABLATION_IDS


def pulse_by_pixel_rule(
    remaining: np.ndarray, forbidden: np.ndarray, x: float, y: float, radius: float
) -> tuple[int, int]:
    """The process as the documentation states it; machines the pixels in place."""
    centres = np.arange(100) + 0.5
    disc = (centres[None, :] - x) ** 2 + (centres[:, None] - y) ** 2 <= radius**2
    hits, misses = int((remaining & disc).sum()), int((forbidden & disc).sum())
    remaining &= ~disc
    forbidden &= ~disc
    return hits, misses


@settings(max_examples=50, deadline=None)
@given(env_id=st.sampled_from(IDS), seed=st.integers(0, 2**31), radius=st.floats(1.0, 20.0))
def test_process_is_as_documented(env_id: str, seed: int, radius: float) -> None:
    env = gym.make(env_id, observation="layers", pulse_radius_px=radius, max_pulses=12)
    observation, info = env.reset(seed=seed)
    assert info == {"machined_fraction": 0.0, "off_target_fraction": 0.0, "pulses": 0}
    remaining, forbidden = observation[0] == 255, observation[1] == 255
    assert (remaining ^ forbidden).all()
    assert (observation[2] == 255).all()
    area = int(remaining.sum())
    generator = np.random.default_rng(seed)
    total_hits = total_misses = 0
    episode_return = 0.0
    for pulses in range(1, 13):
        action = generator.uniform(-1.3, 1.3, 2).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        x, y = 50 * (1 + np.clip(action, -1, 1).astype(np.float64))
        hits, misses = pulse_by_pixel_rule(remaining, forbidden, x, y, radius)
        total_hits += hits
        total_misses += misses
        episode_return += reward
        assert reward == (hits - misses) / 10_000
        assert info["machined_fraction"] == total_hits / area
        assert info["off_target_fraction"] == total_misses / area
        assert info["pulses"] == pulses
        np.testing.assert_array_equal(observation[0], remaining * np.uint8(255))
        np.testing.assert_array_equal(observation[1], forbidden * np.uint8(255))
        assert (observation[2] == round(255 * (12 - pulses) / 12 + 1e-9)).all()
        assert terminated == (total_hits >= 0.99 * area or pulses == 12)
        assert truncated is False
        if terminated:
            assert info["is_success"] == (total_hits >= 0.99 * area)
            break
        assert "is_success" not in info
    assert episode_return == pytest.approx((total_hits - total_misses) / 10_000, abs=1e-12)


@pytest.mark.parametrize("env_id", IDS)
def test_states_can_be_cloned_and_restored(env_id: str) -> None:
    env: Any = gym.make(env_id, pointing_error_px=2.0, radius_error=0.1, max_pulses=5).unwrapped
    env.reset(seed=4)
    env.step(np.zeros(2, np.float32))
    state = env.clone_state()
    actions = [np.full(2, a, np.float32) for a in (-0.5, 0.1, 0.4, 0.2)]

    def play() -> list[Any]:
        steps = [env.step(action) for action in actions]
        return [*steps, env.reset()]

    first = play()
    for _ in range(2):
        env.restore_state(state)
        for one, other in zip(first, play(), strict=True):
            np.testing.assert_array_equal(one[0], other[0])
            assert one[1:] == other[1:]


def test_errors_of_the_stage_move_pulses_about_the_aim() -> None:
    env: Any = gym.make("lasergym/Star-v0", pointing_error_px=3.0, radius_error=0.1).unwrapped
    env.render_mode = "rgb_array"
    landed = []
    for seed in range(400):
        env.reset(seed=seed)
        env.step(np.zeros(2, np.float32))
        landed.append(env._trajectory.pulses[0])
    x, y, radius = np.array(landed).T
    for values, mean, deviation in ((x, 50, 3), (y, 50, 3), (radius, 9, 0.9)):
        assert abs(values.mean() - mean) < 5 * deviation / np.sqrt(400)
        assert abs(values.std() / deviation - 1) < 5 / np.sqrt(800)


def test_pattern_takes_arrays_and_files(assets: Path, tmp_path: Path) -> None:
    target = lasergym.targets.star(20.0)
    file = tmp_path / "target.png"
    lasergym.targets.save(target, file)
    np.testing.assert_array_equal(lasergym.targets.load(file, fit="exact"), target)
    for pattern in (target, target.astype(np.uint8), target.astype(float)):
        observation, _ = gym.make("lasergym/Pattern-v0", target=pattern).reset(seed=0)
        np.testing.assert_array_equal(observation[0] > 0, target)
    drawing = assets / "thumbs_up.svg"
    observation, _ = gym.make("lasergym/Pattern-v0", target=str(drawing)).reset(seed=0)
    np.testing.assert_array_equal(observation[0] > 0, lasergym.targets.load(drawing))


def test_areas_are_those_of_the_shapes() -> None:
    areas = lasergym.targets.random_shape_areas(2_000_000_000, 20)
    shapes = [lasergym.targets.random_shape(2_000_000_000 + k) for k in range(20)]
    assert areas.tolist() == [shape.sum() for shape in shapes]
    with pytest.raises(errors.OptionError, match="count"):
        lasergym.targets.random_shape_areas(0, -1)


def test_reset_options_give_a_target() -> None:
    env = gym.make("lasergym/Star-v0")
    target = lasergym.targets.random_shape(seed=2)
    observation, _ = env.reset(seed=1, options={"target": target})
    np.testing.assert_array_equal(observation[0] > 0, target)
    observation, _ = env.reset()
    np.testing.assert_array_equal(observation[0] > 0, lasergym.targets.star())
    with pytest.raises(errors.OptionError, match="angle"):
        env.reset(options={"angle": 3})


def test_specs_can_be_written_as_json() -> None:
    env = gym.make("lasergym/RandomShape-v0", observation="layers", max_pulses=30)
    assert env.spec is not None
    twin = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    np.testing.assert_array_equal(env.reset(seed=6)[0], twin.reset(seed=6)[0])


@pytest.mark.parametrize(
    ("action", "error"),
    [
        (np.zeros(3, np.float32), errors.ActionShapeError),
        (np.zeros((1, 2), np.float32), errors.ActionShapeError),
        (0.0, errors.ActionShapeError),
        (["left", "right"], errors.ActionTypeError),
        (np.zeros(2, np.complex64), errors.ActionTypeError),
        (np.array([None, 1.0]), errors.ActionTypeError),
        (np.array([np.nan, 0.0], np.float32), errors.ActionNotFiniteError),
        (np.array([0.0, -np.inf]), errors.ActionNotFiniteError),
        (np.array([1e300, 0.0]), errors.ActionNotFiniteError),
    ],
)
def test_bad_actions_are_named(action: Any, error: type[Exception]) -> None:
    env = gym.make("lasergym/Star-v0", disable_env_checker=True)
    env.reset(seed=0)
    with pytest.raises(error) as caught:
        env.step(action)
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, errors.LasergymError)
    assert env.step(np.zeros(2, np.float32))[4]["pulses"] == 1


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        ({"max_pulses": 0}, "max_pulses"),
        ({"max_pulses": -1}, "max_pulses"),
        ({"max_pulses": 2**40}, "max_pulses"),
        ({"max_pulses": 10**25}, "max_pulses"),
        ({"max_pulses": 4.5}, "max_pulses"),
        ({"pulse_radius_px": 0.0}, "pulse_radius_px"),
        ({"pulse_radius_px": float("nan")}, "pulse_radius_px"),
        ({"completion": 0.0}, "completion"),
        ({"completion": 1.1}, "completion"),
        ({"pointing_error_px": -1.0}, "pointing_error_px"),
        ({"radius_error": 2.0}, "radius_error"),
        ({"observation": "pixels"}, "observation"),
        ({"target": np.ones((100, 100), bool)}, "target"),
    ],
)
def test_bad_settings_are_named(settings: dict[str, Any], name: str) -> None:
    with pytest.raises(errors.OptionError, match=name):
        lasergym.envs.StarEnv(**settings)


@pytest.mark.parametrize(
    ("target", "error"),
    [
        (np.zeros((100, 100), bool), errors.EmptyTargetError),
        (np.ones((100, 100), bool), errors.FullTargetError),
        (np.zeros((50, 50), bool), errors.TargetShapeError),
        (np.full((100, 100), 7), errors.TargetShapeError),
        (np.full((100, 100), "x"), errors.TargetShapeError),
        ("no such file.png", errors.DrawingNotFoundError),
    ],
)
def test_bad_targets_are_named(target: Any, error: type[Exception]) -> None:
    with pytest.raises(error) as caught:
        lasergym.envs.PatternEnv(target=target)
    assert isinstance(caught.value, ValueError)
    with pytest.raises(error):
        lasergym.plan(target)


def test_steps_outside_an_episode_are_named() -> None:
    env = lasergym.envs.StarEnv(max_pulses=1)
    action = np.zeros(2, np.float32)
    with pytest.raises(errors.EpisodeOverError, match="reset"):
        env.step(action)
    env.reset(seed=0)
    env.step(action)
    with pytest.raises(errors.EpisodeOverError, match="reset"):
        env.step(action)


def test_an_unknown_render_mode_is_named() -> None:
    with pytest.raises(errors.RenderModeError, match="ansi"):
        lasergym.envs.StarEnv(render_mode="hologram")


def test_render_shows_the_state() -> None:
    env = gym.make("lasergym/Star-v0", render_mode="rgb_array")
    env.reset(seed=0)
    before: Any = env.render()
    env.step(np.zeros(2, np.float32))
    after: Any = env.render()
    assert before.shape == after.shape == (400, 400, 3)
    assert before.dtype == np.uint8
    assert (before != after).any()
    text = gym.make("lasergym/Star-v0", render_mode="ansi")
    text.reset(seed=0)
    frame: Any = text.render()
    assert "#" in frame
    assert "pulses 0" in frame
    assert max(map(len, frame.splitlines())) <= 60


@pytest.mark.parametrize("env_id", IDS)
def test_docstrings_follow_the_gymnasium_headings(env_id: str) -> None:
    document = gym.make(env_id).unwrapped.__doc__ or ""
    for heading in (
        "Description",
        "Action Space",
        "Observation Space",
        "Rewards",
        "Starting State",
        "Episode Termination",
        "Arguments",
        "Reset Arguments",
        "Version History",
        "References",
    ):
        assert f"## {heading}\n" in document
