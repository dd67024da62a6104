"""Policy files in Python: the runner decides as torch does, and an episode is the plan."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import lasergym
from lasergym.errors import OptionError, PolicyError, ShapeError
from lasergym.policy import SHIPPED_POLICIES, Policy

torch = pytest.importorskip("torch")

from lasergym.export import ExportedNetwork, export_module, write_network  # noqa: E402
from lasergym.sb3.spatial_network import CorrectionNet  # noqa: E402

DECISION = {"kind": "spatial", "ring_weight": 0.35, "polish_px": 0.5}


def correction_net(seed: int) -> CorrectionNet:
    torch.manual_seed(seed)
    network = CorrectionNet(8)
    torch.nn.init.normal_(network.out.weight, std=3.0)
    return network.eval()


def spatial_policy(folder: Path, network: CorrectionNet) -> Policy:
    layers, tensors = network.exported_layers()
    path = folder / "policy.safetensors"
    write_network(ExportedNetwork((18, 28, 28), layers, tensors, decision=DECISION), path)
    return Policy.load(path)


def test_the_runner_computes_what_torch_does(tmp_path: Path) -> None:
    network = correction_net(1)
    policy = spatial_policy(tmp_path, network)
    views = np.random.default_rng(2).random((20, 18, 28, 28), np.float32)
    with torch.no_grad():
        expected = network(torch.from_numpy(views)).numpy().reshape(20, -1)
    found = policy.native.run(views.reshape(20, -1))
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_an_episode_of_the_policy_is_its_plan(tmp_path: Path, seed: int) -> None:
    policy = spatial_policy(tmp_path, correction_net(seed))
    env = gym.make("lasergym/RandomShape-v0", observation="layers", max_pulses=30)
    observation, _ = env.reset(seed=seed)
    target = env.unwrapped.remaining()  # type: ignore[attr-defined]
    plan = lasergym.plan(target, "policy", policy=policy, max_pulses=30)
    earned, actions = 0.0, []
    for _ in range(plan.pulses):
        action = policy.act(observation, max_pulses=30)
        observation, reward, terminated, _, _ = env.step(action)
        earned += float(reward)
        actions.append(action)
        if terminated:
            break
    np.testing.assert_array_equal(np.array(actions), plan.actions[: len(actions)])
    expected = lasergym.score(target, plan.xy_px[: len(actions)]).reward
    assert earned == pytest.approx(expected, abs=1e-9)


def test_an_untrained_policy_is_a_little_better_than_greedy(tmp_path: Path) -> None:
    policy = spatial_policy(tmp_path, CorrectionNet(4).eval())
    rewards = []
    for seed in range(20):
        target = lasergym.targets.random_shape(seed=seed)
        plans = (
            lasergym.plan(target, "policy", policy=policy, max_pulses=30),
            lasergym.plan(target, "greedy", max_pulses=30),
        )
        rewards.append([plan.reward for plan in plans])
    ours, greedy = np.mean(rewards, axis=0)
    assert greedy <= ours < greedy + 0.01


def test_a_direct_policy_maps_observations_to_actions(tmp_path: Path) -> None:
    torch.manual_seed(0)
    module = torch.nn.Sequential(
        torch.nn.Conv2d(3, 2, 9, stride=9), torch.nn.Flatten(), torch.nn.Linear(242, 2)
    ).eval()
    path = tmp_path / "direct.safetensors"
    export_module(module, path, (3, 100, 100), decision={"kind": "direct"})
    policy = Policy.load(path)
    env = gym.make("lasergym/Star-v0", observation="layers")
    observation, _ = env.reset(seed=0)
    with torch.no_grad():
        expected = module(torch.from_numpy(observation[None].astype(np.float32)))[0].numpy()
    np.testing.assert_allclose(policy.act(observation), expected, rtol=1e-4, atol=1e-4)
    plan = lasergym.plan(lasergym.targets.star(), "policy", policy=path, max_pulses=2)
    np.testing.assert_allclose(plan.actions[0], expected.clip(-1, 1), rtol=1e-4, atol=1e-4)


def test_observations_of_another_shape_are_refused(tmp_path: Path) -> None:
    policy = spatial_policy(tmp_path, CorrectionNet(2))
    with pytest.raises(ShapeError, match=r"\(3, 100, 100\)"):
        policy.act(np.zeros((1, 100, 100), np.uint8))


def test_a_finished_workpiece_needs_no_decision(tmp_path: Path) -> None:
    policy = spatial_policy(tmp_path, CorrectionNet(2))
    assert np.isfinite(policy.act(np.zeros((3, 100, 100), np.uint8))).all()


def test_files_that_are_no_policies_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PolicyError, match="there is no policy file"):
        Policy.load(tmp_path / "missing.safetensors")
    with pytest.raises(PolicyError):
        Policy.from_bytes(b"not a policy")
    path = tmp_path / "policy.safetensors"
    layers, tensors = CorrectionNet(2).exported_layers()
    for decision, reason in (
        ({"kind": "guess"}, "guess"),
        ({"kind": "direct"}, "takes 14112 values"),
        (DECISION | {"polish_px": 50.0}, "polish_px"),
    ):
        write_network(ExportedNetwork((18, 28, 28), layers, tensors, decision=decision), path)
        with pytest.raises((PolicyError, OptionError), match=reason):
            Policy.load(path)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    spatial_policy(tmp_path, CorrectionNet(2))
    content = (tmp_path / "policy.safetensors").read_bytes()
    header = struct.unpack("<Q", content[:8])[0]
    assert json.loads(content[8 : 8 + header])["__metadata__"]["lasergym"]
    for length in (0, 7, 8 + header // 2, len(content) - 1):
        with pytest.raises(PolicyError):
            Policy.from_bytes(content[:length])


def test_a_policy_goes_with_its_planner_and_no_other(tmp_path: Path) -> None:
    target = lasergym.targets.star()
    with pytest.raises(OptionError, match="policy"):
        lasergym.plan(target, "greedy", policy=spatial_policy(tmp_path, CorrectionNet(2)))


def test_shipped_policies_are_known_by_name() -> None:
    target = lasergym.targets.star()
    for name in SHIPPED_POLICIES:
        policy = Policy.load(name)
        assert policy.manifest["training"]["updates"] > 0
        named = lasergym.plan(target, "policy", policy=name, max_pulses=40)
        np.testing.assert_array_equal(
            named.xy_px, lasergym.plan(target, "policy", policy=policy, max_pulses=40).xy_px
        )
        assert named.reward > lasergym.plan(target, "greedy", max_pulses=40).reward
    unnamed = lasergym.plan(target, "policy", max_pulses=40)
    general = lasergym.plan(target, "policy", policy="random-shape", max_pulses=40)
    np.testing.assert_array_equal(unnamed.xy_px, general.xy_px)
    with pytest.raises(PolicyError, match="rotated-star"):
        Policy.load("hexagon")


def test_foresight_without_moves_is_the_policy_and_with_them_better(tmp_path: Path) -> None:
    policy = spatial_policy(tmp_path, CorrectionNet(4).eval())
    rewards = []
    for seed in range(6):
        target = lasergym.targets.random_shape(seed=seed)
        settings = {"policy": policy, "max_pulses": 30}
        alone = lasergym.plan(target, "policy", **settings)
        thoughtful = lasergym.plan(target, "agent-mpc", iterations=4000, seed=1, **settings)
        again = lasergym.plan(target, "agent-mpc", iterations=4000, seed=1, **settings)
        np.testing.assert_array_equal(thoughtful.xy_px, again.xy_px)
        thoughtless = lasergym.plan(target, "agent-mpc", budget_s=0.0, **settings)
        np.testing.assert_array_equal(thoughtless.xy_px, alone.xy_px)
        rewards.append((thoughtful.reward, alone.reward))
    thoughtful_reward, alone_reward = np.mean(rewards, axis=0)
    assert thoughtful_reward > alone_reward


def test_with_known_pointing_errors_planning_on_what_is_expected_pays() -> None:
    generator = np.random.default_rng(5)
    rewards = []
    for seed in range(4):
        target = lasergym.targets.random_shape(seed=seed)
        plans = [
            lasergym.plan(
                target, "agent-mpc", max_pulses=20, iterations=1500, pointing_error_px=error_px
            )
            for error_px in (0.0, 4.0)
        ]
        for _ in range(20):
            errors_px = generator.normal(0.0, 4.0, (20, 2))
            rewards.append(
                [
                    lasergym.score(target, plan.xy_px + errors_px[: plan.pulses]).reward
                    for plan in plans
                ]
            )
    nominal_reward, expecting_reward = np.mean(rewards, axis=0)
    assert expecting_reward > nominal_reward


def test_pointing_errors_are_for_agent_mpc_and_in_range() -> None:
    target = lasergym.targets.star()
    with pytest.raises(OptionError, match="only agent-mpc"):
        lasergym.plan(target, "greedy", pointing_error_px=1.0)
    for error_px in (-1.0, 8.5, float("nan")):
        with pytest.raises(OptionError, match=r"in \[0, 8\] px"):
            lasergym.plan(target, "agent-mpc", pointing_error_px=error_px)
