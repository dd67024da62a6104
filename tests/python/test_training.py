"""Training: configurations, checkpoints, histories, evaluation and the recipes for other tools."""

import json
import math
import os
import subprocess
import sys
from dataclasses import asdict, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lasergym
from lasergym.comparison import CompareOptions
from lasergym.comparison.tasks import FIRST_HELD_OUT_SEED, TaskTarget, task_targets
from lasergym.errors import OptionError
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
    preset,
)

pytest.importorskip("stable_baselines3")

import torch
from stable_baselines3.common.vec_env import VecNormalize

from lasergym.training.agents import Agent, AgentError, load_agent
from lasergym.training.checkpoints import (
    CheckpointError,
    RunState,
    latest_checkpoint,
    read_state,
    save_checkpoint,
)
from lasergym.training.config import Observation
from lasergym.training.environments import make_environments
from lasergym.training.evaluation import compare_agent, judge_rows, run_agent
from lasergym.training.held_out import held_out_targets
from lasergym.training.history import Evaluated, HistoryError, Log, Updated
from lasergym.training.run import make_model, resume, train

ROOT = Path(__file__).resolve().parents[2]
CONFIGS = sorted((ROOT / "training" / "configs").glob("*.toml"))


def small(**changes: Any) -> TrainingConfig:
    """A run of a second."""
    config = TrainingConfig(
        task=TaskConfig(environments=4, thinning=10, max_pulses=8, normalise_rewards=True),
        policy=PolicyConfig(kind=PolicyKind.MLP, hidden_layers=(16,)),
        method=MethodConfig(
            ppo=PpoConfig(steps_per_environment=16, batch_size=32, epochs=1, gamma=0.5),
            self_imitation=SelfImitationOptions(updates=2, capacity=1000, begin_samples=16),
        ),
        run=RunConfig(steps=256, checkpoint_steps=64, tensorboard=False),
        evaluation=EvaluationConfig(every_steps=128, targets=2, planners=("greedy",)),
    )
    return replace(config, **changes)


# Configurations


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_shipped_configuration_is_valid_and_survives_json(path: Path) -> None:
    config = TrainingConfig.load(path)
    table = json.loads(json.dumps(config.as_table()))
    assert TrainingConfig.from_table(table) == config


@pytest.mark.parametrize(
    ("name", "env_id"),
    [
        ("star", "lasergym/Star-v0"),
        ("rotated-star", "lasergym/RotatedStar-v0"),
        ("random-shape", "lasergym/RandomShape-v0"),
    ],
)
def test_an_id_means_the_shipped_file(name: str, env_id: str) -> None:
    assert preset(env_id) == TrainingConfig.load(ROOT / "training" / "configs" / f"{name}.toml")
    assert preset(env_id.removeprefix("lasergym/").removesuffix("-v0")) == preset(env_id)
    assert preset(env_id, quick=True).task.env_id == env_id


def test_the_recipe_of_the_paper_is_what_the_paper_tells() -> None:
    config = TrainingConfig.load(ROOT / "training" / "configs" / "paper-star.toml")
    assert config.task.observation.value == "remaining"
    assert config.task.normalise_observations
    assert config.task.normalise_rewards
    assert config.policy.kind is PolicyKind.CNN
    assert config.method.phases == (Phase.PPO,)
    assert config.method.self_imitation is not None
    assert config.run.steps == 36_000_000


@pytest.mark.parametrize(
    ("table", "reason"),
    [
        ({"tsak": {}}, "tsak is unknown: did you mean task"),
        ({"task": {"max_pulse": 4}}, "task.max_pulse is unknown: did you mean max_pulses"),
        ({"task": 4}, "task is 4, but must be a table"),
        ({"task": {"env_id": "lasergym/Star-v1"}}, "did you mean lasergym/Star-v0"),
        ({"task": {"max_pulses": 4.5}}, "max_pulses is 4.5, but must be an integer"),
        ({"task": {"max_pulses": True}}, "max_pulses is True, but must be an integer"),
        ({"task": {"completion": "all"}}, "completion is 'all', but must be a number"),
        ({"task": {"stop_on_miss": 1}}, "stop_on_miss is 1, but must be true or false"),
        ({"task": {"thinning": 3}}, "thinning is 3"),
        ({"task": {"observation": "layer"}}, "did you mean layers"),
        ({"task": {"target": "a.png"}}, "task.target is for lasergym/Pattern-v0"),
        ({"policy": {"kind": "cnm"}}, "policy.kind is 'cnm': did you mean cnn"),
        ({"policy": {"hidden_layers": 64}}, "must be a list"),
        ({"policy": {"hidden_layers": ["64"]}}, r"hidden_layers\[0\] is '64'"),
        ({"policy": {"initial_log_std": 5.0}}, "initial_log_std is 5.0"),
        ({"policy": {"arguments": []}}, "policy.arguments is"),
        ({"method": {"phases": []}}, r"phases is \[\]"),
        ({"method": {"phases": ["ppo", "a2c"]}}, "or planner and then another"),
        ({"method": {"phases": ["planner", "planner"]}}, "or planner and then another"),
        ({"method": {"phases": ["planner"]}}, 'teaches policy.kind "spatial"'),
        ({"method": {"phases": ["pop"]}}, r"phases\[0\] is 'pop'"),
        ({"method": {"ppo": {"batch_size": 1000}}}, "must divide"),
        ({"evaluation": {"planners": ["gredy"]}}, "did you mean greedy"),
        ({"evaluation": {"planners": ["greedy", "greedy"]}}, "evaluation.planners: .*twice"),
        ({"evaluation": {"anneal_s": 0.0}}, "anneal_s is 0"),
        ({"run": {"checkpoint_min": 0.0}}, "checkpoint_min is 0"),
        ({"task": {"pulse_radius_px": 5.0}}, "evaluation.planners fire pulses of 9 px"),
    ],
)
def test_a_bad_table_is_refused(table: dict[str, Any], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        TrainingConfig.from_table(table)


@pytest.mark.parametrize(
    "table",
    [
        {"task": {"environments": 0}},
        {"task": {"max_pulses": 0}},
        {"task": {"completion": 0.0}},
        {"task": {"pointing_error_px": -1.0}},
        {"policy": {"hidden_layers": [0]}},
        {"method": {"ppo": {"gamma": 1.5}}},
        {"method": {"ppo": {"learning_rate": float("nan")}}},
        {"method": {"ppo": {"epochs": 0}}},
        {"method": {"a2c": {"steps_per_environment": 0}}},
        {"method": {"self_imitation": {"clip": -1.0}}},
        {"run": {"steps": 0}},
        {"run": {"seed": -1}},
        {"run": {"seed": 2**32}},
        {"run": {"checkpoints_kept": 0}},
        {"evaluation": {"targets": 0}},
    ],
)
def test_a_figure_outside_its_range_is_refused(table: dict[str, Any]) -> None:
    with pytest.raises(OptionError):
        TrainingConfig.from_table(table)


@pytest.mark.parametrize(
    ("content", "reason"),
    [(None, "there is no"), ("[task", "cannot be read"), ("\xff", "cannot be read")],
)
def test_a_file_that_is_no_toml_is_refused(
    content: str | None, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / "config.toml"
    if content is not None:
        path.write_bytes(content.encode("latin-1"))
    with pytest.raises(ConfigError, match=reason):
        TrainingConfig.load(path)


def test_an_unknown_environment_is_refused() -> None:
    with pytest.raises(ConfigError, match="did you mean lasergym/Star-v0"):
        preset("lasergym/Star-v1")


def test_configurations_and_the_program_need_no_torch() -> None:
    code = "import lasergym.cli, lasergym.training, sys; sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


# Agents and runs


class _Ring:
    """A policy that aims at places on a ring, one after the other, whatever it sees."""

    def __init__(self) -> None:
        self.calls = 0

    def predict(self, observations: Any, deterministic: bool) -> tuple[Any, None]:
        assert deterministic
        self.calls += 1
        count = len(observations)
        angle = 2.4 * self.calls + np.arange(count)
        return 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1), None


def ring(observation: str = "layers", thinning: int = 1) -> Agent:
    return Agent(_Ring(), Observation(observation), thinning)  # type: ignore[arg-type]


@settings(max_examples=10, deadline=None)
@given(
    seeds=st.lists(st.integers(0, 1000), min_size=1, max_size=5, unique=True),
    budgets=st.lists(st.integers(1, 12), min_size=5, max_size=5),
    batch=st.integers(1, 4),
)
def test_an_agent_is_scored_as_its_pulses_are(
    seeds: list[int], budgets: list[int], batch: int
) -> None:
    made = [
        TaskTarget("random-shapes", f"random-shape:{seed}", lasergym.targets.random_shape(seed), n)
        for seed, n in zip(seeds, budgets, strict=False)
    ]
    rows = run_agent(ring(thinning=5), made, batch=batch)
    assert [row.target for row in rows] == [one.name for one in made]
    for row, one in zip(rows, made, strict=True):
        figures = lasergym.score(one.target, row.xy_px)
        assert row.reward == pytest.approx(figures.reward)
        assert row.machined_fraction == pytest.approx(figures.machined_fraction)
        assert row.pulses == len(row.xy_px) == one.max_pulses


def test_an_episode_ends_when_the_target_is_machined() -> None:
    (row,) = run_agent(ring(), list(task_targets(CompareOptions())), completion=0.05)
    assert row.pulses < 45
    assert row.machined_fraction >= 0.05


def test_an_agent_stands_beside_planners_on_the_same_targets() -> None:
    options = CompareOptions(
        tasks=("star", "rotated-star"),
        angles=3,
        planners=("greedy", "anneal"),
        anneal_iterations=1000,
    )
    comparison = compare_agent(ring(), options)
    assert comparison.table.planners == ("agent", "greedy", "anneal")
    report = comparison.as_dict()
    assert [group["targets"] for group in report["groups"]] == [1, 3]
    stars = comparison.rows_of("rotated-star", "agent")
    figures = report["groups"][1]["planners"]["agent"]
    assert figures["reward"]["mean"] == pytest.approx(np.mean([row.reward for row in stars]))
    assert figures["well_machined_percent"] == 0.0
    assert report["groups"][1]["planners"]["greedy"]["well_machined_percent"] == 100.0
    judgement = judge_rows(stars)
    assert judgement.reward.spread == pytest.approx(np.std([one.reward for one in stars], ddof=1))


def test_held_out_shapes_have_held_out_seeds() -> None:
    config = replace(small(), task=TaskConfig(env_id="lasergym/RandomShape-v0", environments=4))
    made = held_out_targets(config)
    assert [one.name for one in made] == [
        f"random-shape:{FIRST_HELD_OUT_SEED + index}" for index in range(2)
    ]
    environments = make_environments(config.task, 0)
    seen = environments.reset()[:, 0] > 0
    assert not any((shape == one.target).all() for shape in seen for one in made)


def test_a_history_goes_on_from_its_steps_and_drops_a_torn_line(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    log = Log(path, Updated)
    lines = [Updated(steps, 0.5, 2, 0.1, float("nan"), 8.0, 1e3, 0.1) for steps in (10, 20, 30)]
    for line in lines:
        log.append(line)
    with path.open("a") as file:
        file.write("40,0.5")
    again = Log(path, Updated, until_steps=20)
    assert [line.steps for line in again.lines] == [10, 20]
    assert [asdict(line)["training_s"] for line in again.lines] == [0.5, 0.5]
    assert all(math.isnan(line.return_spread) for line in again.lines)
    assert path.read_text().count("\n") == 3


def test_a_damaged_history_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "evaluations.csv"
    Log(path, Evaluated).append(Evaluated(1, 0.0, 1, 0.1, 0.0, 1.0, 1.0, 8.0, 0.0))
    path.write_text(path.read_text().replace("0.1", "much"))
    with pytest.raises(HistoryError, match="line 2"):
        Log(path, Evaluated, until_steps=5)


def weights(model: Any) -> dict[str, Any]:
    return dict(model.policy.state_dict())


def test_a_run_leaves_all_it_promises_and_goes_on(tmp_path: Path) -> None:
    told: list[Any] = []
    config = small()
    result = train(config, tmp_path / "run", pictures=False, progress=told.append)
    assert result.steps == 256
    assert [line.steps for line in _lines(tmp_path / "run" / "evaluations.csv", Evaluated)] == [
        0,
        128,
        256,
    ]
    history = _lines(tmp_path / "run" / "history.csv", Updated)
    assert [line.steps for line in history] == [64, 128, 192, 256]
    assert all(0 < line.environment_fraction < 1 for line in history)
    assert sum(line.episodes for line in history) == 32
    assert [one.evaluated.steps for one in told if one.evaluated] == [0, 128, 256]
    assert set(result.planners) == {"greedy"}
    assert all(path.exists() for path in result.files)
    report = json.loads((tmp_path / "run" / "result.json").read_text())
    assert report["after"]["steps"] == 256
    assert report["before"]["return_spread"] is None
    checkpoint = latest_checkpoint(tmp_path / "run")
    kept = sorted(path.name for path in checkpoint.parent.iterdir())
    assert kept == ["step-000000000192", "step-000000000256"]

    again = resume(tmp_path / "run", steps=384, pictures=False)
    assert again.steps == 384
    assert str(again.before) == str(result.before)  # Its spread is nan.
    steps = [line.steps for line in _lines(tmp_path / "run" / "history.csv", Updated)]
    assert steps == [64, 128, 192, 256, 320, 384]
    assert read_state(latest_checkpoint(tmp_path / "run")).steps == 384
    assert again.training_s > result.training_s


def test_a_resumed_run_has_all_of_its_checkpoint(tmp_path: Path) -> None:
    from lasergym.training.run import _Run

    train(small(), tmp_path / "run", pictures=False)
    checkpoint = latest_checkpoint(tmp_path / "run")
    first = _Run(small(), tmp_path / "run", checkpoint, None)
    drawn = torch.rand(3), np.random.rand(3)  # noqa: NPY002 - what SB3 draws from
    second = _Run(small(), tmp_path / "run", checkpoint, None)
    assert torch.equal(torch.rand(3), drawn[0])
    np.testing.assert_array_equal(np.random.rand(3), drawn[1])  # noqa: NPY002
    for one, other in zip(
        weights(first.model).values(), weights(second.model).values(), strict=True
    ):
        assert torch.equal(one, other)
    assert first.model.num_timesteps == 256
    assert first.model.policy.optimizer.state_dict()["state"]
    normaliser = first.model.get_vec_normalize_env()
    assert isinstance(normaliser, VecNormalize)
    assert normaliser.ret_rms.count > 200
    imitation = first.recorder._imitation
    assert imitation is not None
    assert len(imitation.replay) == 256


def test_the_same_configuration_gives_the_same_agent(tmp_path: Path) -> None:
    agents = []
    for name in ("one", "two"):
        train(small(), tmp_path / name, pictures=False)
        agents.append(load_agent(tmp_path / name))
    one, other = (weights(agent) for agent in agents)
    for name, tensor in one.items():
        assert torch.equal(tensor, other[name])


def test_a2c_and_normalised_images_train_and_load(tmp_path: Path) -> None:
    config = TrainingConfig(
        task=TaskConfig(
            environments=2,
            thinning=2,
            observation=Observation.REMAINING,
            max_pulses=4,
            normalise_observations=True,
        ),
        policy=PolicyConfig(
            kind=PolicyKind.CNN,
            arguments={"features_extractor_kwargs": {"features_dim": 8}},
        ),
        method=MethodConfig(phases=(Phase.A2C,)),
        run=RunConfig(steps=20, tensorboard=False),
        evaluation=EvaluationConfig(planners=()),
    )
    result = train(config, tmp_path / "run", pictures=False)
    assert [path.name for path in result.files[:2]] == ["model.zip", "vec_normalize.pkl"]
    of_run, of_model = load_agent(tmp_path / "run"), load_agent(tmp_path / "run" / "model.zip")
    images = np.random.default_rng(0).integers(0, 2, (3, 1, 100, 100), dtype=np.uint8) * 255
    np.testing.assert_array_equal(of_run.act(images), of_model.act(images))
    assert of_model.thinning == 2
    assert of_run.act(images).dtype == np.float32


def test_a_run_does_not_overwrite_another(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("")
    with pytest.raises(ConfigError, match="not empty"):
        train(small(), tmp_path, pictures=False)


def test_a_checkpoint_of_other_networks_is_refused(tmp_path: Path) -> None:
    train(small(run=replace(small().run, steps=64)), tmp_path / "run", pictures=False)
    path = tmp_path / "run" / "config.json"
    path.write_text(
        path.read_text().replace('"hidden_layers": [\n      16', '"hidden_layers": [\n      17')
    )
    with pytest.raises(CheckpointError, match="cannot be loaded"):
        resume(tmp_path / "run", steps=128, pictures=False)


def test_a_torn_checkpoint_is_not_looked_at(tmp_path: Path) -> None:
    config = small()
    venv = make_environments(config.task, 0)
    model = make_model(config, venv)
    first = save_checkpoint(tmp_path, model, RunState(10, 0, 0.0, 0.0, 0), None, 1)
    (tmp_path / "checkpoints" / ".step-000000000020.7").mkdir()
    assert latest_checkpoint(tmp_path) == first
    second = save_checkpoint(tmp_path, model, RunState(30, 0, 0.0, 0.0, 0), None, 1)
    assert list((tmp_path / "checkpoints").iterdir()) == [second]


@pytest.mark.parametrize("name", ["model.zip", "vec_normalize.pkl", "self_imitation.npz"])
def test_a_damaged_file_of_a_checkpoint_is_refused(name: str, tmp_path: Path) -> None:
    task = replace(small().task, normalise_rewards=True)
    train(small(task=task, run=replace(small().run, steps=64)), tmp_path / "run", pictures=False)
    path = latest_checkpoint(tmp_path / "run") / name
    content = path.read_bytes()
    for damaged in (content[: len(content) // 2], b""):
        path.write_bytes(damaged)
        with pytest.raises(CheckpointError, match="cannot be loaded"):
            resume(tmp_path / "run", steps=128, pictures=False)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"steps": 1}'])
def test_a_damaged_state_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "state.json").write_text(content)
    with pytest.raises(CheckpointError, match="is damaged"):
        read_state(tmp_path)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="holds no run"):
        resume(tmp_path, pictures=False)
    with pytest.raises(AgentError, match="holds no run"):
        load_agent(tmp_path)
    (tmp_path / "config.json").write_text(json.dumps(small().as_table()))
    with pytest.raises(CheckpointError, match="holds no checkpoint"):
        resume(tmp_path, pictures=False)
    with pytest.raises(AgentError, match="no checkpoint yet"):
        load_agent(tmp_path)


def test_a_model_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AgentError, match="there is no model"):
        load_agent(tmp_path / "model.zip")
    (tmp_path / "model.zip").write_bytes(b"PK\x03\x04 nothing")
    with pytest.raises(AgentError, match="cannot be read"):
        load_agent(tmp_path / "model.zip")


def test_the_curve_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from lasergym.training.curves import draw_curve

    updated = [Updated(n, 1.0, n % 2, n / 5000, 0.0, 8.0, 1e3, 0.1) for n in range(1, 2000)]
    evaluated = [Evaluated(0, 0.0, 1, 0.1, float("nan"), 1.0, 1.0, 8.0, 0.0)]
    draw_curve(tmp_path / "curve.png", "a run", updated, evaluated, {"greedy": 0.4, "mine": 0.3})
    assert (tmp_path / "curve.png").read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] == ["curve.png"]


def _lines(path: Path, kind: Any) -> list[Any]:
    return Log(path, kind, until_steps=10**9).lines


# Recipes for other tools

ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1"}


def test_the_zoo_trains_with_our_hyperparameters(tmp_path: Path) -> None:
    if find_spec("rl_zoo3") is None:
        pytest.skip("rl_zoo3 is not installed")
    command = [sys.executable, "-m", "rl_zoo3.train", "--algo", "ppo"]
    command += ["--env", "lasergym/Star-v0", "--gym-packages", "lasergym"]
    command += ["--conf-file", str(ROOT / "training" / "rl_zoo" / "ppo.yml"), "-n", "90"]
    command += ["--hyperparams", "n_steps:45", "n_envs:1", "batch_size:45", "n_epochs:1"]
    command += ["--eval-freq", "-1", "--num-threads", "1", "-f", str(tmp_path)]
    subprocess.run(command, check=True, env=ONE_THREAD, timeout=300, capture_output=True)
    assert list(tmp_path.rglob("*.zip"))


def test_rllib_trains_on_the_native_environments() -> None:
    missing = [name for name in ("ray", "tree", "lz4", "torch") if find_spec(name) is None]
    if missing:
        pytest.skip(f"ray[rllib] is not installed: {', '.join(missing)} missing")
    command = [sys.executable, str(ROOT / "training" / "rllib_recipe.py"), "--iterations", "1"]
    command += ["--environments", "4", "--batch", "180"]
    done = subprocess.run(
        command, check=True, env=ONE_THREAD, timeout=300, capture_output=True, text=True
    )
    assert "180 pulses: mean return" in done.stdout
