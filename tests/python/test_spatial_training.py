"""Runs of the spatial policy: configuration, initial weights, budgets."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lasergym
from lasergym.comparison.tasks import TaskTarget
from lasergym.training import (
    ConfigError,
    EvaluationConfig,
    MethodConfig,
    Phase,
    PolicyConfig,
    PolicyKind,
    PpoConfig,
    RunConfig,
    SelfImitationOptions,
    TaskConfig,
    TrainingConfig,
)

pytest.importorskip("stable_baselines3")

import torch

from lasergym.export import export_policy
from lasergym.sb3 import SpatialPolicy
from lasergym.training.agents import Agent, AgentError, load_agent, load_weights
from lasergym.training.config import Observation
from lasergym.training.correction_options import CorrectionOptions, LessonProgress
from lasergym.training.environments import make_environments
from lasergym.training.evaluation import run_agent
from lasergym.training.run import make_model, resume, train


def small(**policy: Any) -> TrainingConfig:
    """A run of a second."""
    arguments = {"channels": 4, "value_channels": 4}
    return TrainingConfig(
        task=TaskConfig(
            env_id="lasergym/RandomShape-v0", environments=4, max_pulses=8, normalise_rewards=True
        ),
        policy=PolicyConfig(kind=PolicyKind.SPATIAL, arguments=arguments, **policy),
        method=MethodConfig(
            ppo=PpoConfig(steps_per_environment=8, batch_size=16, epochs=1),
            self_imitation=SelfImitationOptions(updates=1, batch_size=16, begin_samples=8),
        ),
        run=RunConfig(steps=64, checkpoint_steps=32, tensorboard=False),
        evaluation=EvaluationConfig(every_steps=64, targets=2, planners=()),
    )


def made(config: TrainingConfig, seed: int = 0) -> SpatialPolicy:
    """A policy of a configuration whose network corrects at random."""
    torch.manual_seed(seed)
    policy = make_model(config, make_environments(config.task, 0)).policy
    assert isinstance(policy, SpatialPolicy)
    torch.nn.init.normal_(policy.network.out.weight)
    return policy


def same_weights(one: torch.nn.Module, other: torch.nn.Module) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(first, second) for first, second in pairs)


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ({"task": {"thinning": 2}}, 'with task.thinning 1, but they are "layers" and 2'),
        ({"task": {"observation": "remaining"}}, 'they are "remaining" and 1'),
        ({"task": {"normalise_observations": True}}, "leave out task.normalise_observations"),
        ({"policy": {"kind": "spatial", "hidden_layers": [8]}}, "policy.hidden_layers is not for"),
    ],
)
def test_what_does_not_fit_the_policy_is_refused(table: dict[str, Any], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        TrainingConfig.from_table({"policy": {"kind": "spatial"}} | table)


def test_the_policy_counts_what_the_task_says() -> None:
    config = small()
    task = replace(config.task, pulse_radius_px=6.0)
    policy = made(replace(config, task=task))
    assert (policy.max_pulses, policy.pulse_radius_px) == (8, 6.0)


def test_a_run_begins_with_an_exported_policy_and_goes_on_without_it(tmp_path: Path) -> None:
    first = made(small())
    path = tmp_path / "policy.safetensors"
    export_policy(first, path)
    config = small(initial_policy=str(path))
    learning = replace(config.method.ppo, learning_rate=0.0)
    still = replace(config, method=replace(config.method, ppo=learning))
    result = train(still, tmp_path / "run", pictures=False)
    assert result.steps == 64
    assert str(replace(result.before, steps=0, training_s=0.0)) == str(
        replace(result.after, steps=0, training_s=0.0)
    )
    path.unlink()
    assert resume(tmp_path / "run", steps=96, pictures=False).steps == 96
    agent = load_agent(tmp_path / "run")
    assert isinstance(agent.policy, SpatialPolicy)
    assert same_weights(agent.policy.network, first.network)
    observations = make_environments(config.task, 7).reset()
    expected, _ = first.predict(observations, deterministic=True)
    np.testing.assert_array_equal(agent.act(observations), expected)
    of_model = load_agent(tmp_path / "run" / "model.zip")
    np.testing.assert_array_equal(of_model.act(observations), expected)


def test_a_run_changes_weights_and_another_begins_with_them(tmp_path: Path) -> None:
    config = small()
    train(config, tmp_path / "run", pictures=False)
    trained = load_agent(tmp_path / "run").policy
    assert not same_weights(trained, made(config))
    for path in (tmp_path / "run", tmp_path / "run" / "model.zip"):
        policy = made(config, seed=1)
        load_weights(policy, path)
        assert same_weights(policy, trained)


@pytest.mark.parametrize("storage", ["float32", "float16", "int8"])
def test_weights_come_back_from_an_exported_policy(storage: Any, tmp_path: Path) -> None:
    first, other = made(small()), made(small(), seed=1)
    path = tmp_path / "policy.safetensors"
    export_policy(first, path, storage=storage)
    load_weights(other, path)
    difference = (other.network.c1.weight - first.network.c1.weight).detach().abs().max()
    assert float(difference) <= {"float32": 0.0, "float16": 1e-3, "int8": 1e-2}[storage]


def test_weights_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    policy = made(small())
    path = tmp_path / "policy.safetensors"
    export_policy(made(replace(small(), policy=PolicyConfig(kind=PolicyKind.SPATIAL))), path)
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(path.read_bytes()[:100])
    (tmp_path / "no.zip").write_bytes(b"no")
    (tmp_path / "empty").mkdir()
    for name, reason in [
        ("missing.safetensors", "there is no model"),
        ("missing.zip", "there is no model"),
        ("policy.safetensors", "size mismatch"),
        ("damaged.safetensors", "cannot be read"),
        ("no.zip", "cannot be read"),
        ("empty", "holds no model.zip"),
    ]:
        with pytest.raises(AgentError, match=reason):
            load_weights(policy, tmp_path / name)
    perceptron = replace(
        small(),
        policy=PolicyConfig(kind=PolicyKind.MLP),
        task=TaskConfig(environments=4, thinning=10),
    )
    plain = make_model(perceptron, make_environments(perceptron.task, 0)).policy
    with pytest.raises(AgentError, match="holds no value"):
        load_weights(plain, path)
    with pytest.raises(ConfigError, match="there is no nowhere"):
        train(small(initial_policy="nowhere"), tmp_path / "run", pictures=False)
    assert not (tmp_path / "run").exists()


def test_pulses_are_counted_in_the_budget_of_each_target(monkeypatch: pytest.MonkeyPatch) -> None:
    policy = made(small())
    counted: list[int] = []
    predict = policy.predict

    def watched(*arguments: Any, **named: Any) -> Any:
        counted.append(policy.max_pulses)
        return predict(*arguments, **named)

    monkeypatch.setattr(policy, "predict", watched)
    targets = [
        TaskTarget("random-shapes", str(seed), lasergym.targets.random_shape(seed), budget)
        for seed, budget in enumerate((3, 5))
    ]
    run_agent(Agent(policy, Observation.LAYERS), targets)
    assert counted == [3] * 3 + [5] * 5
    assert policy.max_pulses == 8


def taught(*phases: Phase, channels: int = 4) -> TrainingConfig:
    """A run whose policy learns from the planner first."""
    lessons = CorrectionOptions(
        updates=4,
        updates_per_lesson=2,
        jobs=4,
        batch_size=4,
        moves=100,
        channels=channels,
        seed=7,
        validation_targets=2,
    )
    config = small()
    return replace(config, method=replace(config.method, phases=phases, planner=lessons))


def test_reward_goes_on_from_what_the_planner_taught(tmp_path: Path) -> None:
    told: list[LessonProgress] = []
    config = taught(Phase.PLANNER, Phase.PPO)
    result = train(config, tmp_path / "run", pictures=False, lessons=told.append)
    assert (told[-1].updates, told[-1].total_updates, told[-1].remaining_s) == (4, 4, 0.0)
    assert result.steps == 64
    lessons = torch.load(tmp_path / "run" / "planner" / "checkpoint.pt", weights_only=True)

    def distance(policy: Any) -> float:
        state = policy.state_dict()
        pairs = [(state[f"network.{name}"], one) for name, one in lessons["network"].items()]
        return sum(float((a - b).square().sum()) for a, b in pairs) ** 0.5

    trained = distance(load_agent(tmp_path / "run").policy)
    assert 0 < trained < 0.1 * distance(made(config))


def test_the_planner_alone_teaches_an_agent(tmp_path: Path) -> None:
    result = train(taught(Phase.PLANNER), tmp_path / "run", pictures=False)
    assert (result.steps, result.steps_per_s) == (0, 0.0)
    assert result.before == result.after
    policy = lasergym.Policy.load(tmp_path / "run" / "planner" / "policy.safetensors")
    target = lasergym.targets.random_shape(1)
    agent = load_agent(tmp_path / "run")
    (by_torch,) = run_agent(agent, [TaskTarget("random-shapes", "1", target, 5)])
    by_runner = lasergym.plan(target, "policy", policy=policy, max_pulses=5)
    assert by_torch.reward == pytest.approx(by_runner.reward)


def test_a_run_that_is_stopped_in_a_lesson_goes_on(tmp_path: Path) -> None:
    def stop(_: LessonProgress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(taught(Phase.PLANNER, Phase.PPO), tmp_path / "run", pictures=False, lessons=stop)
    assert resume(tmp_path / "run", pictures=False).steps == 64


def test_one_network_has_one_width() -> None:
    with pytest.raises(ConfigError, match="they are one network"):
        taught(Phase.PLANNER, channels=8)
