"""A training run from its configuration to the trained agent; it goes on after a crash."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import A2C, PPO
from stable_baselines3.common.callbacks import BaseCallback, CallbackList
from stable_baselines3.common.logger import configure
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv

import lasergym
from lasergym.comparison.figures import require_matplotlib
from lasergym.comparison.options import CompareOptions
from lasergym.comparison.work import WorkItem, derive_seed, run_item
from lasergym.errors import MissingExtraError
from lasergym.sb3 import SelfImitation
from lasergym.training.agents import load_weights
from lasergym.training.checkpoints import (
    CONFIG_FILE,
    MODEL_FILE,
    NORMALISER_FILE,
    CheckpointError,
    RunState,
    latest_checkpoint,
    load_checkpoint,
    load_normaliser,
    read_state,
    write_whole,
)
from lasergym.training.config import ConfigError, Phase, PpoConfig, TrainingConfig
from lasergym.training.correction_options import LessonProgress
from lasergym.training.curves import draw_curve
from lasergym.training.environments import make_environments, normalised
from lasergym.training.evaluation import judge_rows
from lasergym.training.held_out import held_out_targets
from lasergym.training.history import Evaluated, Log, Updated
from lasergym.training.lessons import learn_from_planner
from lasergym.training.policies import policy_arguments, policy_class
from lasergym.training.recorder import Recorder, TrainingProgress
from lasergym.training.spatial_decision import POLISH_PX

__all__ = ["TrainingResult", "make_model", "resume", "train"]

_PLANNERS_FILE = "planners.json"

_LESSONS_FOLDER = "planner"

ProgressCallback = Callable[[TrainingProgress], None]
LessonCallback = Callable[[LessonProgress], None]


@dataclass(frozen=True)
class TrainingResult:
    """What a run has come to.

    Attributes:
        folder: Its folder.
        steps: Pulses trained with.
        training_s: Time of training, evaluations and checkpoints left out, s.
        environment_s: Part of it in the environments, s.
        before: The untrained agent on held-out targets, without exploration.
        after: The trained one.
        first_return: Mean return of the agent as it acts in training, first update with episodes.
        last_return: The same, last such update.
        planners: Mean reward of each planner on the same targets.
        files: What was written, the model first.
    """

    folder: Path
    steps: int
    training_s: float
    environment_s: float
    before: Evaluated
    after: Evaluated
    first_return: float
    last_return: float
    planners: dict[str, float]
    files: tuple[Path, ...]

    @property
    def steps_per_s(self) -> float:
        """Pulses per second of training."""
        return self.steps / self.training_s if self.training_s > 0 else 0.0

    @property
    def environment_fraction(self) -> float:
        """Share of training in the environments, in [0, 1]."""
        return self.environment_s / self.training_s if self.training_s > 0 else 0.0

    def as_dict(self) -> dict[str, Any]:
        """The result as a JSON report holds it."""
        return {
            "folder": str(self.folder),
            "steps": self.steps,
            "training_s": self.training_s,
            "steps_per_s": self.steps_per_s,
            "environment_fraction": self.environment_fraction,
            "before": _without_nan(asdict(self.before)),
            "after": _without_nan(asdict(self.after)),
            "training_return": _without_nan({"first": self.first_return, "last": self.last_return}),
            "planners": self.planners,
            "files": [str(path) for path in self.files],
            "version": lasergym.__version__,
        }


def train(
    config: TrainingConfig,
    folder: str | Path,
    *,
    pictures: bool = True,
    progress: ProgressCallback | None = None,
    lessons: LessonCallback | None = None,
) -> TrainingResult:
    """Trains an agent.

    The folder then holds ``config.json``, ``model.zip`` (and ``vec_normalize.pkl`` where something
    is normalised), ``history.csv``, ``evaluations.csv``, ``result.json``, ``training_curve.png``,
    ``tensorboard/`` and ``checkpoints/``. A run that is killed goes on with :func:`resume` and has
    lost what it did since its last checkpoint, no more.

    Args:
        config: The configuration.
        folder: Folder of the run; new or empty.
        pictures: Whether to draw the training curve, for which Matplotlib is needed.
        progress: Told how far it is, and each evaluation.
        lessons: Told how far the phase ``"planner"`` is, whose files lie in the folder ``planner``.

    Raises:
        ConfigError: The folder holds something, or the configuration names what there is not.
        AgentError: The initial policy cannot be read or has other networks.
        MissingExtraError: Matplotlib or TensorBoard is needed and not installed.
        KeyboardInterrupt: Ctrl-C; a checkpoint of the moment is kept.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ConfigError(f"{folder} exists and is not empty: go on with --resume, or give another")
    _check_extras(config, pictures)
    if config.policy.initial_policy is not None and not Path(config.policy.initial_policy).exists():
        raise ConfigError(f"policy.initial_policy: there is no {config.policy.initial_policy}")
    folder.mkdir(parents=True, exist_ok=True)
    _write_json(folder / CONFIG_FILE, config.as_table())
    return _begin(config, folder, pictures, progress, lessons)


def resume(
    folder: str | Path,
    *,
    steps: int | None = None,
    pictures: bool = True,
    progress: ProgressCallback | None = None,
    lessons: LessonCallback | None = None,
) -> TrainingResult:
    """Goes on with a run from its last checkpoint; environments begin new episodes.

    Args:
        folder: Folder of the run.
        steps: Pulses of the whole run; None keeps those of its configuration.
        pictures: Whether to draw the training curve.
        progress: Told how far it is, and each evaluation.
        lessons: Told how far the phase ``"planner"`` is.

    Raises:
        CheckpointError: There is no checkpoint, or it is damaged.
        ConfigError, HistoryError: The folder holds no run, or its files are damaged.
        MissingExtraError, KeyboardInterrupt: As for :func:`train`.
    """
    folder = Path(folder)
    if not (folder / CONFIG_FILE).exists():
        raise CheckpointError(f"{folder} holds no run: {CONFIG_FILE} is missing")
    config = TrainingConfig.from_json(folder / CONFIG_FILE).with_run(steps=steps)
    _check_extras(config, pictures)
    if (folder / _LESSONS_FOLDER).exists() and not (folder / "checkpoints").exists():
        _write_json(folder / CONFIG_FILE, config.as_table())
        return _begin(config, folder, pictures, progress, lessons)
    checkpoint = latest_checkpoint(folder)
    run = _Run(config, folder, checkpoint, progress)
    _write_json(folder / CONFIG_FILE, config.as_table())
    return run.finish(pictures)


def _begin(
    config: TrainingConfig,
    folder: Path,
    pictures: bool,
    progress: ProgressCallback | None,
    lessons: LessonCallback | None,
) -> TrainingResult:
    """Learns from the planner where the configuration says so, and then from reward."""
    if Phase.PLANNER in config.method.phases:
        torch.set_num_threads(config.run.torch_threads)
        policy = config.policy
        path = learn_from_planner(
            config.method.planner,
            folder / _LESSONS_FOLDER,
            lessons or (lambda _: None),
            begin_with=None if policy.initial_policy is None else Path(policy.initial_policy),
            polish_px=float(policy.arguments.get("polish_px", POLISH_PX)),
        )
        config = replace(config, policy=replace(policy, initial_policy=str(path)))
    run = _Run(config, folder, None, progress)
    run.recorder.evaluate()
    run.recorder.save()
    return run.finish(pictures)


def make_model(config: TrainingConfig, venv: VecEnv, seed: int | None = None) -> OnPolicyAlgorithm:
    """The untrained algorithm of a configuration, round the environments ``venv``."""
    settings = config.method.learning
    arguments: dict[str, Any] = {
        "n_steps": settings.steps_per_environment,
        "gamma": settings.gamma,
        "gae_lambda": settings.gae_lambda,
        "ent_coef": settings.entropy_weight,
        "vf_coef": settings.value_weight,
        "max_grad_norm": settings.max_gradient_norm,
        "learning_rate": _schedule(settings.learning_rate, settings.final_learning_rate),
        "policy_kwargs": policy_arguments(config.policy, config.task),
        "seed": config.run.seed if seed is None else seed,
        "device": config.run.device,
    }
    policy = policy_class(config.policy.kind)
    if config.method.phases[-1] is Phase.A2C:
        return A2C(policy, venv, **arguments)
    ppo: PpoConfig = config.method.ppo
    return PPO(
        policy,
        venv,
        batch_size=ppo.batch_size,
        n_epochs=ppo.epochs,
        clip_range=ppo.clip_range,
        target_kl=ppo.target_kl,
        **arguments,
    )


class _Run:
    """The parts of a run, new or brought to a checkpoint."""

    def __init__(
        self,
        config: TrainingConfig,
        folder: Path,
        checkpoint: Path | None,
        progress: ProgressCallback | None,
    ) -> None:
        torch.set_num_threads(config.run.torch_threads)
        self.config = config
        self.folder = folder
        state = RunState(0, 0, 0.0, 0.0, 0) if checkpoint is None else read_state(checkpoint)
        seed = config.run.seed
        if checkpoint is not None:  # New episodes, not those that the run began with.
            words = np.random.SeedSequence([seed, state.steps]).generate_state(1)
            seed = int(words[0]) % 2**31
        stopwatch = make_environments(config.task, seed)
        gamma = config.method.learning.gamma
        venv: VecEnv = normalised(stopwatch, config.task, gamma) or stopwatch
        if checkpoint is not None and venv is not stopwatch:
            venv = load_normaliser(checkpoint, stopwatch)
        self.model = make_model(config, venv, seed)
        if checkpoint is None and config.policy.initial_policy is not None:
            load_weights(self.model.policy, config.policy.initial_policy)
        options = config.method.self_imitation
        imitation = None if options is None else SelfImitation(options, config.run.seed)
        if checkpoint is not None:
            load_checkpoint(checkpoint, self.model, imitation)
        formats = ["tensorboard"] if config.run.tensorboard else []
        self.model.set_logger(configure(str(folder / "tensorboard"), formats))
        until_steps = None if checkpoint is None else state.steps
        logs = (
            Log(folder / "history.csv", Updated, until_steps),
            Log(folder / "evaluations.csv", Evaluated, until_steps),
        )
        self.recorder = Recorder(folder, config, stopwatch, imitation, state, logs, progress)
        self.recorder.init_callback(self.model)
        callbacks: list[BaseCallback] = (
            [self.recorder] if imitation is None else [imitation, self.recorder]
        )
        self._callback = CallbackList(callbacks)

    def finish(self, pictures: bool) -> TrainingResult:
        """Trains to the end and writes what is left to write."""
        planners = _judge_planners(self.config, self.folder)
        recorder = self.recorder
        missing = self.config.run.steps - recorder.state.steps
        if self.config.method.has_reinforcement and missing > 0:
            try:
                self.model.learn(
                    missing, callback=self._callback, log_interval=1, reset_num_timesteps=False
                )
            except KeyboardInterrupt:
                recorder.interrupt()
                raise
            recorder.save()
        files = self._write(pictures, planners)
        result = self._result(planners, files)
        _write_json(self.folder / "result.json", result.as_dict())
        return result

    def _write(self, pictures: bool, planners: dict[str, float]) -> list[Path]:
        checkpoint = latest_checkpoint(self.folder)
        files = []
        for name in (MODEL_FILE, NORMALISER_FILE):
            if (checkpoint / name).exists():
                scratch = self.folder / f".{name}"
                shutil.copyfile(checkpoint / name, scratch)
                scratch.replace(self.folder / name)
                files.append(self.folder / name)
        files += [self.recorder.updated.path, self.recorder.evaluated.path]
        files.append(self.folder / "result.json")
        if pictures:
            title = f"{self.config.task.env_id}, seed {self.config.run.seed}"
            files.append(self.folder / "training_curve.png")
            draw_curve(
                files[-1],
                title,
                self.recorder.updated.lines,
                self.recorder.evaluated.lines,
                planners,
            )
        return files

    def _result(self, planners: dict[str, float], files: list[Path]) -> TrainingResult:
        state = self.recorder.state
        evaluated = self.recorder.evaluated.lines
        lines = [line for line in self.recorder.updated.lines if line.episodes]
        return TrainingResult(
            self.folder,
            state.steps,
            state.training_s,
            state.environment_s,
            evaluated[0],
            evaluated[-1],
            lines[0].return_mean if lines else float("nan"),
            lines[-1].return_mean if lines else float("nan"),
            planners,
            tuple(files),
        )


def _judge_planners(config: TrainingConfig, folder: Path) -> dict[str, float]:
    """Mean reward of the planners on the held-out targets, worked out once for a run."""
    path = folder / _PLANNERS_FILE
    found: dict[str, float] = {}
    if path.exists():
        try:
            found = {str(name): float(one) for name, one in json.loads(path.read_text()).items()}
        except (ValueError, TypeError, AttributeError) as error:
            raise ConfigError(f"{path} is damaged: delete it") from error
    evaluation = config.evaluation
    missing = tuple(name for name in evaluation.planners if name not in found)
    if missing:
        options = CompareOptions(
            planners=missing, anneal_s=evaluation.anneal_s, cma_es_s=evaluation.cma_es_s
        )
        for planner in missing:
            rows = []
            for made in held_out_targets(config):
                seed = derive_seed(config.run.seed, made.task, made.name, planner)
                effort = options.effort(planner)
                item = WorkItem(
                    made.task, made.name, planner, seed, made.max_pulses, effort, made.bits
                )
                row = run_item(item)
                if row is None:  # Ctrl-C
                    raise KeyboardInterrupt
                rows.append(row)
            found[planner] = judge_rows(rows).reward.mean
        _write_json(path, found)
    return {name: found[name] for name in evaluation.planners}


def _schedule(first: float, last: float | None) -> Any:
    """A learning rate that is constant or goes linearly from the first to the last."""
    if last is None:
        return first
    final = last
    return lambda remaining: final + (first - final) * remaining


def _check_extras(config: TrainingConfig, pictures: bool) -> None:
    if pictures:
        require_matplotlib()
    if config.run.tensorboard and find_spec("tensorboard") is None:
        raise MissingExtraError(
            'logs need TensorBoard: pip install "lasergym[train]", or set run.tensorboard = false'
        )


def _without_nan(figures: dict[str, Any]) -> dict[str, Any]:
    """JSON has no nan."""
    return {name: None if value != value else value for name, value in figures.items()}


def _write_json(path: Path, table: dict[str, Any]) -> None:
    write_whole(path, json.dumps(table, indent=2) + "\n")
