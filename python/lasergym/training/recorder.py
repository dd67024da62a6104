"""What happens between updates: history, evaluations, checkpoints and progress."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from lasergym.sb3 import SelfImitation
from lasergym.training.agents import Agent
from lasergym.training.checkpoints import RunState, save_checkpoint
from lasergym.training.config import TrainingConfig
from lasergym.training.environments import Stopwatch
from lasergym.training.evaluation import judge_rows, run_agent
from lasergym.training.held_out import held_out_targets
from lasergym.training.history import Evaluated, Log, Updated

__all__ = ["Recorder", "TrainingProgress"]

_SHOW_EVERY_S = 0.2


@dataclass(frozen=True)
class TrainingProgress:
    """How far a run is.

    Attributes:
        steps: Pulses so far.
        total_steps: Pulses of the whole run.
        remaining_s: Expected time to the end, s; None before the first pulse.
        evaluated: The evaluation that has just been made; None between evaluations.
    """

    steps: int
    total_steps: int
    remaining_s: float | None
    evaluated: Evaluated | None = None


class Recorder(BaseCallback):
    """Records a run; comes last among the callbacks, so that an update is whole before it acts."""

    def __init__(
        self,
        folder: Path,
        config: TrainingConfig,
        stopwatch: Stopwatch,
        imitation: SelfImitation | None,
        state: RunState,
        logs: tuple[Log[Updated], Log[Evaluated]],
        progress: Callable[[TrainingProgress], None] | None,
    ) -> None:
        """Makes the callback of a run that is as far as ``state``."""
        super().__init__()
        self.state = state
        self.updated, self.evaluated = logs
        self._folder = folder
        self._config = config
        self._stopwatch = stopwatch
        self._imitation = imitation
        self._progress = progress
        self._targets = held_out_targets(config)
        self._begun_steps = state.steps
        self._begun_s = self._shown_s = self._saved_s = time.perf_counter()
        self._saved_steps = state.steps
        self._resumed_s = 0.0
        self._stopwatch_s = 0.0
        self._returns: list[float] = []
        self._pulses: list[int] = []

    def _on_training_start(self) -> None:
        self._resume()

    def _on_step(self) -> bool:
        for index in np.flatnonzero(self.locals["dones"]):
            episode = self.locals["infos"][index]["episode"]
            self._returns.append(episode["r"])
            self._pulses.append(episode["l"])
        now_s = time.perf_counter()
        if now_s - self._shown_s > _SHOW_EVERY_S:
            self._shown_s = now_s
            self._show(None)
        return True

    def _on_rollout_start(self) -> None:
        """The update that follows a rollout is done when the next rollout starts."""
        if self.num_timesteps > self.state.steps:
            self._record()

    def _on_training_end(self) -> None:
        if self.num_timesteps > self.state.steps:
            self._record()
        if self.state.steps > self.state.evaluated_steps:
            self.evaluate()

    def evaluate(self) -> Evaluated:
        """Judges the agent without exploration on held-out targets."""
        task = self._config.task
        normaliser = self.model.get_vec_normalize_env()
        agent = Agent(
            self.model.policy,
            task.observation,
            task.thinning,
            normaliser if task.normalise_observations else None,
        )
        rows = run_agent(
            agent,
            self._targets,
            pulse_radius_px=task.pulse_radius_px,
            completion=task.completion,
            stop_on_miss=task.stop_on_miss,
        )
        judgement = judge_rows(rows)
        spread = judgement.reward.spread
        line = Evaluated(
            self.state.steps,
            self.state.training_s,
            judgement.targets,
            judgement.reward.mean,
            float("nan") if spread is None else spread,
            judgement.machined_percent.mean,
            judgement.off_target_percent.mean,
            judgement.pulses.mean,
            judgement.well_machined_percent,
        )
        self.evaluated.append(line)
        self.logger.record("held_out/return", line.return_mean)
        self.logger.record("held_out/machined_percent", line.machined_percent)
        self.logger.record("held_out/off_target_percent", line.off_target_percent)
        self.state = self._changed(evaluated_steps=self.state.steps)
        self._show(line)
        return line

    def save(self) -> Path:
        """Writes a checkpoint of the moment."""
        model: Any = self.model
        path = save_checkpoint(
            self._folder,
            model,
            self.state,
            self._imitation,
            self._config.run.checkpoints_kept,
        )
        self._saved_s, self._saved_steps = time.perf_counter(), self.state.steps
        return path

    def interrupt(self) -> None:
        """Saves what there is, also within an update."""
        if self.num_timesteps > self.state.steps:
            self._pause()
        self.save()

    def _record(self) -> None:
        self._pause()
        if self.state.steps - self.state.evaluated_steps >= self._config.evaluation.every_steps:
            self.evaluate()
        run = self._config.run
        due_steps = run.checkpoint_steps
        if time.perf_counter() - self._saved_s >= 60.0 * run.checkpoint_min or (
            due_steps is not None and self.state.steps - self._saved_steps >= due_steps
        ):
            self.save()
        self._resume()

    def _resume(self) -> None:
        """Training begins or goes on."""
        self._resumed_s = time.perf_counter()
        self._stopwatch_s = self._stopwatch.elapsed_s

    def _pause(self) -> None:
        """Training makes way for records; what it did since :meth:`_resume` becomes a line."""
        took_s = time.perf_counter() - self._resumed_s
        environment_s = self._stopwatch.elapsed_s - self._stopwatch_s
        steps = self.num_timesteps - self.state.steps
        self.state = self._changed(
            steps=self.num_timesteps,
            updates=int(self.model._n_updates),
            training_s=self.state.training_s + took_s,
            environment_s=self.state.environment_s + environment_s,
        )
        returns, pulses = np.array(self._returns), np.array(self._pulses)
        some = len(returns) > 0
        line = Updated(
            self.state.steps,
            self.state.training_s,
            len(returns),
            float(returns.mean()) if some else float("nan"),
            float(returns.std()) if some else float("nan"),
            float(pulses.mean()) if some else float("nan"),
            steps / took_s,
            environment_s / took_s,
        )
        self._returns, self._pulses = [], []
        self.updated.append(line)
        self.logger.record("run/steps_per_s", line.steps_per_s)
        self.logger.record("run/environment_fraction", line.environment_fraction)

    def _changed(self, **changes: float) -> RunState:
        return RunState(**{**vars(self.state), **changes})

    def _show(self, evaluated: Evaluated | None) -> None:
        if self._progress is None:
            return
        steps, total = self.num_timesteps, self._config.run.steps
        done = steps - self._begun_steps
        remaining_s = None
        if done > 0:
            remaining_s = (time.perf_counter() - self._begun_s) / done * max(0, total - steps)
        self._progress(TrainingProgress(steps, total, remaining_s, evaluated))
