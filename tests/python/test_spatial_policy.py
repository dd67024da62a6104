"""The spatial policy: exact physics, a proper density, and what learns from it."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import lasergym
from lasergym.errors import OptionError

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3 import A2C, PPO
from torch.nn import functional

from lasergym.sb3 import CellDistribution, CorrectionNet, SpatialPolicy, make_vec_env
from lasergym.sb3.spatial_position import best_actions, corrected_scores
from lasergym.sb3.spatial_scores import RingScores, ring_scores
from lasergym.sb3.spatial_view import views

OBSERVATIONS = gym.spaces.Box(0, 255, (3, 100, 100), np.uint8)
ACTIONS = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
CENTERS = np.arange(100) + 0.5


def policy(**options: Any) -> SpatialPolicy:
    return SpatialPolicy(OBSERVATIONS, ACTIONS, lambda _: 1e-3, **options)


def state(seed: int, pulses: int, max_pulses: int = 45) -> NDArray[np.uint8]:
    """The observation of a random shape after random pulses."""
    environment = gym.make(
        "lasergym/RandomShape-v0", observation="layers", max_pulses=max_pulses, completion=1.0
    )
    observation, _ = environment.reset(seed=seed)
    for action in np.random.default_rng(seed).uniform(-1, 1, (pulses, 2)).astype(np.float32):
        observation, *_ = environment.step(action)
    return np.array(observation)


def states(count: int) -> torch.Tensor:
    made = [state(seed, pulses) for seed, pulses in enumerate(np.linspace(0, 40, count, dtype=int))]
    return torch.from_numpy(np.stack(made))


def scores_of(observations: torch.Tensor, **options: Any) -> RingScores:
    settings = {"pulse_radius_px": 9.0, "ring_weight": 0.35, "max_pulses": 45} | options
    return ring_scores(observations, **settings)


def disc(x: float, y: float, radius_px: float) -> NDArray[np.bool_]:
    covered: NDArray[np.bool_] = (CENTERS - x) ** 2 + ((CENTERS - y) ** 2)[:, None] <= radius_px**2
    return covered


def sums_within(values: NDArray[Any], radius_px: float) -> NDArray[np.int64]:
    """Sums over a disc about every pixel centre, pixel by pixel of the disc."""
    reach = int(radius_px)
    padded = np.pad(values.astype(np.int64), reach)
    sums = np.zeros((100, 100), np.int64)
    for down in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            if down**2 + right**2 <= radius_px**2:
                rows, columns = reach + down, reach + right
                sums += padded[rows : rows + 100, columns : columns + 100]
    return sums


# Physics


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    pulses=st.integers(0, 44),
    radius_px=st.one_of(st.just(9.0), st.floats(0.3, 20.0)),
)
def test_scores_are_sums_over_discs(seed: int, pulses: int, radius_px: float) -> None:
    observation = state(seed, pulses)
    scores = scores_of(torch.from_numpy(observation[None]), pulse_radius_px=radius_px)
    remaining, forbidden = (observation[:2] > 0).astype(np.int64)
    gains = sums_within(remaining - forbidden, radius_px)
    rings = sums_within(remaining, radius_px + 3.0) - sums_within(remaining, radius_px)
    np.testing.assert_array_equal(scores.layers[0].numpy(), [remaining, forbidden, gains, rings])
    expected = (gains - 0.35 * rings).astype(np.float32)
    np.testing.assert_array_equal(scores.scores_px[0].numpy(), expected)
    promises = gains.astype(np.float32) - np.float32(0.35) * rings.astype(np.float32)
    promises[gains <= 0] = -np.inf
    best = promises.argmax() if (gains > 0).any() else gains.argmax()
    assert tuple(scores.candidates[0].tolist()) == np.unravel_index(best, (100, 100))


def test_gains_at_pixel_centres_are_the_rewards_of_the_environment() -> None:
    # No pixel centre lies at the rim of this radius, where rounding of the action would decide.
    environment = gym.make(
        "lasergym/RandomShape-v0", observation="layers", completion=1.0, pulse_radius_px=9.02
    )
    first = np.random.default_rng(5).uniform(-1, 1, (7, 2)).astype(np.float32)
    for row, column in np.random.default_rng(0).integers(0, 100, (20, 2)).tolist():
        environment.reset(seed=5)
        for action in first:
            observation, *_ = environment.step(action)
        scores = scores_of(torch.from_numpy(np.array(observation[None])), pulse_radius_px=9.02)
        action = (np.array([column + 0.5, row + 0.5]) / 50 - 1).astype(np.float32)
        _, reward, *_ = environment.step(action)
        assert float(reward) * 1e4 == pytest.approx(int(scores.gains_px[0, row, column]))


def test_where_nothing_gains_the_least_loss_is_the_candidate() -> None:
    observation = torch.zeros(1, 3, 100, 100, dtype=torch.uint8)
    observation[0, 1] = 255
    observation[0, 1, 60, 70] = 0
    scores = scores_of(observation)
    gains = scores.gains_px[0]
    assert int(gains.max()) < 0
    assert scores.candidates[0].tolist() == [0, 0]  # A quarter of a pulse.


@pytest.mark.parametrize("max_pulses", [1, 7, 45, 200, 255])
def test_pulses_left_are_exact(max_pulses: int) -> None:
    left = torch.arange(max_pulses + 1)
    levels = torch.floor(255 * left.double() / max_pulses + 0.5).to(torch.uint8)
    observations = levels[:, None, None, None].expand(-1, 3, 100, 100)
    scores = scores_of(observations, max_pulses=max_pulses)
    assert scores.pulses_left.tolist() == left.tolist()


def test_a_view_shows_the_layers_about_the_candidate() -> None:
    observations = states(3)
    scores = scores_of(observations)
    scores = replace(scores, candidates=torch.tensor([[0, 99], [50, 3], [97, 60]]))
    seen = views(scores)
    assert seen.shape == (3, 18, 28, 28)
    for index, (row, column) in enumerate(scores.candidates.tolist()):
        for view_row in range(56):
            for view_column in (0, 1, 27, 28, 55):
                phase = 2 * (view_row % 2) + view_column % 2
                j, i = row + view_row - 28, column + view_column - 28
                inside = 0 <= j < 100 and 0 <= i < 100
                layers = scores.layers[index, :, j, i].tolist() if inside else [0] * 4
                expected = [value / scale for value, scale in zip(layers, (1, 1, 128, 128))]  # noqa: B905
                shown = seen[index, phase:16:4, view_row // 2, view_column // 2].tolist()
                assert shown == expected
        pulses_left = round(float(observations[index, 2, 0, 0]) * 45 / 255)
        area_px = int((observations[index, 0] > 0).sum())
        constants = torch.tensor([pulses_left / 45, area_px / (250 * pulses_left)])
        assert torch.allclose(seen[index, 16:], constants[:, None, None].expand(-1, 28, 28))


# Decisions


def decided(
    observation: NDArray[np.uint8],
    candidate: tuple[int, int],
    scores: NDArray[np.float32],
    corrections: NDArray[np.float32],
) -> NDArray[np.float32]:
    """The best action, place by place."""
    left = (observation[0] > 0).astype(int)
    worth = left - (observation[1] > 0).astype(int)
    one = np.float32(1.0)
    best, pixel = -np.inf, candidate
    for down in range(17):
        for right in range(17):
            row, column = candidate[0] + down - 8, candidate[1] + right - 8
            if 0 <= row < 100 and 0 <= column < 100:
                value = scores[row, column] + corrections[down, right]
                gains = worth[disc(column + 0.5, row + 0.5, 9.0)].sum() > 0
                if value > best and (gains or (row, column) == candidate):
                    best, pixel = value, (row, column)

    def split(place: float) -> tuple[int, np.float32]:
        place = min(max(place + 8.0, 0.0), 16.0)
        whole = min(int(place), 15)
        return whole, np.float32(place - whole)

    chosen: tuple[float, int, Any] = (-np.inf, -1000, None)
    for down in range(-4, 5):
        for right in range(-4, 5):
            x, y = pixel[1] + 0.5 + right / 8, pixel[0] + 0.5 + down / 8
            action = np.array([x / 50 - 1, y / 50 - 1]).astype(np.float32)
            reached = 50.0 * (1.0 + action.astype(np.float64))
            mark = disc(reached[0], reached[1], 9.0)
            gain = int(worth[mark].sum())
            ring = int(left[disc(reached[0], reached[1], 12.0)].sum() - left[mark].sum())
            score = np.float32(gain - 0.35 * ring if gain > 0 else -np.inf)
            (i, to_right), (j, to_down) = (
                split(reached[0] - candidate[1] - 0.5),
                split(reached[1] - candidate[0] - 0.5),
            )
            upper, lower = (
                (one - to_right) * corrections[k, i] + to_right * corrections[k, i + 1]
                for k in (j, j + 1)
            )
            value = score + ((one - to_down) * upper + to_down * lower)
            nearness = -(down**2 + right**2)
            if value > chosen[0] or (value == chosen[0] and nearness > chosen[1]):
                chosen = (value, nearness, action)
    action = chosen[2]
    assert isinstance(action, np.ndarray)
    return action


@pytest.mark.parametrize("spread_px", [0.0, 20.0])
def test_decisions_are_those_of_the_planner(spread_px: float) -> None:
    observations = states(6)
    corners = torch.zeros(4, 3, 100, 100, dtype=torch.uint8)  # Candidates at the border.
    corners[:, 2] = 255
    corners[0, 0, :6, :5] = corners[1, 0, -4:, -6:] = corners[2, 0, 40:50, -3:] = 255
    observations = torch.cat([observations, corners])
    scores = scores_of(observations)
    corrections = spread_px * torch.randn(10, 17, 17, generator=torch.manual_seed(0))
    actions = best_actions(
        scores, corrections, pulse_radius_px=9.0, ring_weight=0.35, polish_px=0.5
    )
    for index, action in enumerate(actions):
        row, column = scores.candidates[index].tolist()
        expected = decided(
            observations[index].numpy(),
            (row, column),
            scores.scores_px[index].numpy(),
            corrections[index].numpy(),
        )
        np.testing.assert_array_equal(action.numpy(), expected)


def test_untrained_the_policy_is_nearly_the_greedy_planner_and_better_than_random() -> None:
    target = lasergym.targets.star()
    environment = gym.make("lasergym/Star-v0", observation="layers")
    observation, _ = environment.reset(seed=0)
    untrained, total, over = policy(), 0.0, False
    while not over:
        action, _ = untrained.predict(np.array(observation), deterministic=True)
        observation, reward, over, _, _ = environment.step(action)
        total += float(reward)
    greedy = lasergym.plan(target, planner="greedy").reward
    assert total > greedy - 0.01


def test_shifted_targets_have_shifted_decisions() -> None:
    torch.manual_seed(0)
    agent = with_random_corrections()
    square = torch.zeros(1, 3, 100, 100, dtype=torch.uint8)
    square[:, 2] = 200
    square[0, 0, 36:61, 40:62] = 255
    square[0, 1] = 255 - square[0, 0]
    shifted = square.clone()
    shifted[0, :2] = torch.roll(square[0, :2], (5, -7), (1, 2))
    first, second = agent.predict(torch.cat([square, shifted]).numpy(), deterministic=True)[0]
    np.testing.assert_allclose(50 * (second - first), [-7, 5], atol=1e-4)


def with_random_corrections(scale: float = 0.5, **options: Any) -> SpatialPolicy:
    agent = policy(**options)
    torch.nn.init.normal_(agent.network.out.weight, std=scale)
    return agent


# Density


def random_distribution(batch: int = 3) -> tuple[CellDistribution, torch.Tensor]:
    logits = 2 * torch.randn(batch, 100, 100, generator=torch.manual_seed(1))
    return CellDistribution().proba_distribution(logits), logits


def test_the_density_integrates_to_one() -> None:
    distribution, _ = random_distribution(1)
    assert float(distribution.probabilities.sum()) == pytest.approx(1.0, abs=1e-5)
    steps = 8  # Midpoints within every pixel, all over the workpiece.
    places = torch.from_numpy((np.arange(100 * steps) + 0.5) / (50 * steps) - 1).float()
    actions = torch.cartesian_prod(places, places)
    cell = torch.cartesian_prod(places[80 * steps : 81 * steps], places[:steps])
    logs = distribution.log_prob(cell)
    mean = float(logs.exp().mean()) * 0.02**2
    assert mean == pytest.approx(float(distribution.probabilities[0, 0, 80]), rel=1e-5)
    whole = distribution.log_prob(actions).double().exp().mean() * 4.0
    assert float(whole) == pytest.approx(1.0, abs=1e-5)


@settings(max_examples=100, deadline=None)
@given(st.floats(-1, 1, width=32), st.floats(-1, 1, width=32))
def test_a_log_probability_is_that_of_the_pixel(x: float, y: float) -> None:
    distribution, logits = random_distribution(1)
    column, row = (min(math.floor(50.0 * (1.0 + place)), 99) for place in (x, y))
    weights = logits[0].double().exp()
    expected = math.log(float(weights[row, column] / weights.sum()) / 0.02**2)
    found = float(distribution.log_prob(torch.tensor([[x, y]], dtype=torch.float32)))
    assert found == pytest.approx(expected, abs=1e-4)


def test_the_entropy_is_exact() -> None:
    distribution, logits = random_distribution()
    probabilities = torch.softmax(logits.double().flatten(1), 1)
    density = probabilities / 0.02**2
    expected = -(probabilities * density.log()).sum(1)
    assert torch.allclose(distribution.entropy().double(), expected, atol=1e-4)
    even = CellDistribution().proba_distribution(torch.zeros(1, 100, 100))
    assert float(even.entropy()) == pytest.approx(math.log(4.0), abs=1e-5)


def test_borders_belong_to_the_pixel_that_begins_there() -> None:
    logits = torch.arange(10_000.0).reshape(1, 100, 100) / 1e4
    distribution = CellDistribution().proba_distribution(logits)
    edges = (torch.arange(101) / 50 - 1).float()
    actions = torch.stack([edges, torch.full_like(edges, -1.0)], 1)
    around = [torch.nextafter(actions[:, 0], torch.tensor(end)) for end in (-2.0, 2.0)]
    for places in (actions[:, 0], *around):
        places = places.clamp(-1, 1)
        columns = [min(math.floor(50.0 * (1.0 + float(one))), 99) for one in places]
        logs = distribution.log_prob(torch.stack([places, actions[:, 1]], 1))
        expected = logits.flatten().log_softmax(0)[columns] - math.log(0.02**2)
        assert torch.allclose(logs, expected, atol=1e-6)


def test_samples_follow_the_density_within_the_workpiece() -> None:
    torch.manual_seed(3)
    count = 10_000
    logits = 0.5 * torch.randn(1, 100, 100)
    distribution = CellDistribution().proba_distribution(logits.expand(count // 50, -1, -1))
    actions = torch.cat([distribution.sample() for _ in range(50)])
    assert actions.dtype == torch.float32
    assert float(actions.abs().max()) <= 1.0
    coarse = functional.avg_pool2d(distribution.probabilities[:1], 10)[0].flatten() * 100
    cells = (5 * (1 + actions)).long().clamp(max=9)
    observed = torch.bincount(cells[:, 1] * 10 + cells[:, 0], minlength=100)
    expected = coarse * count
    chi_squared = float(((observed - expected) ** 2 / expected).sum())
    assert 54.0 < chi_squared < 161.0  # 99 degrees of freedom, both tails 1e-4 or less
    within = (50 * (1 + actions.double())) % 1.0
    for axis in (0, 1):
        counts = torch.bincount((10 * within[:, axis]).long().clamp(max=9), minlength=10)
        chi_squared = float(((counts - count / 10) ** 2 / (count / 10)).sum())
        assert chi_squared < 34.0  # 9 degrees of freedom, tail 1e-4


def test_a_sample_stays_in_its_pixel() -> None:
    torch.manual_seed(0)
    for row, column in [(0, 0), (49, 50), (50, 49), (99, 99), (33, 66)]:
        logits = torch.full((1, 100, 100), -1000.0)
        logits[0, row, column] = 0.0
        distribution = CellDistribution().proba_distribution(logits.expand(200, -1, -1))
        actions = torch.cat([distribution.sample() for _ in range(5)])
        distribution.proba_distribution(logits)
        assert float(distribution.log_prob(actions).min()) > 7.0
        center = torch.tensor([column + 0.5, row + 0.5])
        assert torch.allclose(50 * (1 + distribution.mode()[0]), center, atol=1e-5)
        drawn, logs = distribution.log_prob_from_params(logits)
        assert torch.equal(distribution.log_prob(drawn), logs)


def test_logits_are_corrected_scores_over_the_temperature() -> None:
    observations = states(4)
    agent = with_random_corrections(inverse_temperature_per_px=0.1)
    with torch.no_grad():
        sight = agent._look(observations)
    probabilities = agent.get_distribution(observations).probabilities.double()
    values = sight.scores.scores_px.double().clone()
    for index, (row, column) in enumerate(sight.scores.candidates.tolist()):
        for down in range(-8, 9):
            for right in range(-8, 9):
                if 0 <= row + down < 100 and 0 <= column + right < 100:
                    correction = sight.corrections[index, 8 + down, 8 + right]
                    values[index, row + down, column + right] += float(correction)
    gaining = sight.scores.gains_px > 0
    values[~gaining] = sight.scores.gains_px[~gaining].double() - 128.0
    expected = torch.softmax(0.1 * values.flatten(1), 1).reshape(values.shape)
    assert torch.allclose(probabilities, expected, rtol=1e-3, atol=1e-7)
    untouched = corrected_scores(sight.scores, torch.zeros(4, 17, 17))
    assert torch.equal(untouched, sight.scores.scores_px)
    for index in range(4):  # Untrained, where nothing gains is the least probable.
        plain = policy().get_distribution(observations).probabilities[index]
        assert plain[~gaining[index]].max() <= plain[gaining[index]].min()


# Learning


def test_gradients_are_finite_differences() -> None:
    torch.manual_seed(0)
    agent = with_random_corrections(0.1, channels=8).double()
    observations = states(3)
    actions = torch.from_numpy(agent.get_distribution(observations).sample().numpy())
    weight, temperature = agent.network.out.weight, agent.inverse_temperature.log_per_px

    def loss() -> torch.Tensor:
        _, logs, entropies = agent.evaluate_actions(observations.double(), actions)
        return logs.sum() + 0.3 * entropies.sum()

    views_before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    try:
        agent.zero_grad()
        loss().backward()  # type: ignore[no-untyped-call]
        for parameter, place in [(weight, (0, 1, 0, 0)), (weight, (3, 6, 0, 0)), (temperature, ())]:
            assert parameter.grad is not None
            step = 1e-6
            with torch.no_grad():
                parameter[place] += step
                above = float(loss())
                parameter[place] -= 2 * step
                below = float(loss())
                parameter[place] += step
            difference = (above - below) / (2 * step)
            assert float(parameter.grad[place]) == pytest.approx(difference, rel=1e-4, abs=1e-6)
    finally:
        torch.set_default_dtype(views_before)


def test_values_do_not_train_the_network() -> None:
    agent = with_random_corrections()
    agent.predict_values(states(2)).sum().backward()  # type: ignore[no-untyped-call]
    assert all(parameter.grad is None for parameter in agent.network.parameters())
    assert all(parameter.grad is not None for parameter in agent.value_net.parameters())


def test_all_ways_to_ask_agree() -> None:
    agent = with_random_corrections()
    observations = states(3)
    actions, values, logs = agent(observations)
    evaluated = agent.evaluate_actions(observations.float(), actions)
    assert actions.shape == (3, 2)
    assert values.shape == (3, 1)
    assert torch.allclose(evaluated[0], values)
    assert torch.allclose(evaluated[1], logs)
    assert torch.allclose(agent.predict_values(observations), values)
    assert torch.allclose(agent.get_distribution(observations).log_prob(actions), logs)
    best, _, _ = agent(observations, deterministic=True)
    predicted, _ = agent.predict(observations.numpy(), deterministic=True)
    np.testing.assert_array_equal(best.numpy(), predicted)
    alone, _ = agent.predict(observations[1].numpy(), deterministic=True)
    np.testing.assert_array_equal(predicted[1], alone)


def test_it_has_few_parameters() -> None:
    assert sum(parameter.numel() for parameter in policy().parameters()) < 1_500_000


@pytest.mark.parametrize("algorithm", [PPO, A2C])
def test_it_learns_and_survives_a_file(algorithm: Any, tmp_path: Path) -> None:
    environments = make_vec_env(
        "lasergym/RandomShape-v0", n_envs=8, seed=0, observation="layers", max_pulses=8
    )
    arguments: dict[str, Any] = {"n_steps": 4, "policy_kwargs": {"max_pulses": 8, "channels": 8}}
    if algorithm is PPO:
        arguments |= {"batch_size": 16, "n_epochs": 2}
    model = algorithm(SpatialPolicy, environments, seed=0, **arguments)
    before = [parameter.clone() for parameter in model.policy.parameters()]
    model.learn(64)
    assert model.num_timesteps == 64
    after = list(model.policy.parameters())
    assert all(bool(parameter.isfinite().all()) for parameter in after)
    assert any(not torch.equal(one, other) for one, other in zip(before, after, strict=True))
    model.save(tmp_path / "model.zip")
    loaded = algorithm.load(tmp_path / "model.zip")
    observations = environments.reset()
    expected, _ = model.predict(observations, deterministic=True)
    np.testing.assert_array_equal(loaded.predict(observations, deterministic=True)[0], expected)
    model.policy.save(tmp_path / "policy.pt")
    alone = SpatialPolicy.load(str(tmp_path / "policy.pt"))
    np.testing.assert_array_equal(alone.predict(observations, deterministic=True)[0], expected)


# Export


def run_layers(network: Any, seen: torch.Tensor) -> torch.Tensor:
    """The layers of an exported network, one after the other."""
    results = {"input": seen}
    previous = "input"
    for layer in network.layers:
        inputs = [results[name] for name in layer.inputs or (previous,)]
        taken = layer.settings
        match layer.kind:
            case "conv2d":
                weight, bias = (network.tensors[taken[role]] for role in ("weight", "bias"))
                result = functional.conv2d(inputs[0], weight, bias, dilation=taken["dilation"])
            case "silu":
                result = inputs[0] * torch.sigmoid(inputs[0])
            case "add":
                result = inputs[0] + inputs[1]
            case "crop":
                height, width = inputs[0].shape[-2:]
                rows = slice(taken["top"], height - taken["bottom"])
                result = inputs[0][..., rows, taken["left"] : width - taken["right"]]
            case "pixel_shuffle":
                result = functional.pixel_shuffle(inputs[0], taken["factor"])
            case kind:
                raise AssertionError(kind)
        results[layer.name], previous = result, layer.name
    return results[previous]


def test_the_exported_network_gives_the_corrections() -> None:
    pytest.importorskip("safetensors")
    agent = with_random_corrections()
    network = agent.exported()
    assert network.input_shape == (18, 28, 28)
    assert network.decision == {"kind": "spatial", "ring_weight": 0.35, "polish_px": 0.5}
    seen = torch.randn(2, 18, 28, 28)
    corrections = run_layers(network, seen)
    assert corrections.shape == (2, 1, 17, 17)
    assert torch.allclose(corrections[:, 0], agent.network(seen), atol=1e-5)
    other = CorrectionNet()
    other.load_exported(dict(network.tensors))
    assert torch.equal(other(seen), agent.network(seen))


def test_the_runner_decides_as_torch_does(tmp_path: Path) -> None:
    pytest.importorskip("safetensors")
    runner = pytest.importorskip("lasergym.policy")
    from lasergym.export import export_policy

    torch.manual_seed(0)
    agent = with_random_corrections(2.0)
    export_policy(agent, tmp_path / "policy.safetensors")
    native = runner.Policy.load(tmp_path / "policy.safetensors")
    observations = states(12).numpy()
    expected, _ = agent.predict(observations, deterministic=True)
    for observation, action in zip(observations, expected, strict=True):
        np.testing.assert_array_equal(native.act(observation, max_pulses=45), action)


# Options


@pytest.mark.parametrize(
    "options",
    [
        {"max_pulses": 0},
        {"pulse_radius_px": 0.0},
        {"ring_weight": 1.1},
        {"polish_px": float("nan")},
        {"inverse_temperature_per_px": 0.0},
        {"channels": 0},
        {"value_channels": 0},
        {"use_sde": True},
    ],
)
def test_an_option_outside_its_range_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(OptionError, match=next(iter(options))):
        policy(**options)


@pytest.mark.parametrize(
    ("observations", "actions"),
    [
        (gym.spaces.Box(0, 255, (1, 100, 100), np.uint8), ACTIONS),
        (gym.spaces.Box(-10.0, 10.0, (3, 100, 100), np.float32), ACTIONS),
        (OBSERVATIONS, gym.spaces.Box(-1.0, 1.0, (3,), np.float32)),
    ],
)
def test_other_spaces_are_refused(observations: gym.Space[Any], actions: gym.Space[Any]) -> None:
    with pytest.raises(OptionError, match="SpatialPolicy"):
        SpatialPolicy(observations, actions, lambda _: 1e-3)
