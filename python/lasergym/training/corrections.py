"""Learning corrections of the ring score from what a planner says about candidates."""

from __future__ import annotations

import copy
import math
import pickle
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor
from torch.nn import functional

from lasergym.sb3.spatial_network import CorrectionNet
from lasergym.training.checkpoints import CheckpointError
from lasergym.training.correction_options import CorrectionOptions, LessonProgress
from lasergym.training.spatial_decision import CORRECTION_REACH_PX, VIEW_CHANNELS, VIEW_SIZE
from lasergym.training.tables import to_table
from lasergym.training.teacher import FIRST_VALIDATION_SEED, Lesson, Teacher

__all__ = ["CorrectionLearner", "lesson_loss", "symmetric"]

_LEAST_BATCHES = 16
"""Batches that the samples must fill before the network learns from them."""

_LEARNT = ("views", "offsets", "scores_px", "values_px")


def symmetric(views: Tensor, offsets: Tensor, symmetry: int) -> tuple[Tensor, Tensor]:
    """Views and offsets mirrored and turned.

    Args:
        views: Shape (batch, 18, 28, 28).
        offsets: Rows and columns, shape (batch, candidates, 2).
        symmetry: One of the eight symmetries of the square, 0 (none) to 7.

    Returns:
        Both, in the shapes they had. The view's first row or column is 0 where its mirror image
        would lie beyond it.
    """
    pixels = functional.pixel_shuffle(views[:, :16], 2)
    offsets = offsets.clone()
    for axis, bit in ((1, 1), (0, 2)):
        if symmetry & bit:
            # The candidate lies in row and column 28 of 56, one past the middle.
            mirrored = pixels.flip(axis + 2).roll(1, axis + 2)
            mirrored.select(axis + 2, 0).zero_()
            pixels = mirrored
            offsets[..., axis] *= -1
    if symmetry & 4:
        pixels, offsets = pixels.transpose(2, 3), offsets.flip(-1)
    return torch.cat([functional.pixel_unshuffle(pixels, 2), views[:, 16:]], 1), offsets


def lesson_loss(
    corrections_px: Tensor, offsets: Tensor, scores_px: Tensor, values_px: Tensor
) -> Tensor:
    """How far corrected scores are from what candidates are worth, up to a constant for each view.

    Candidates count less the more they cost, exp(−cost / 12 px) + 0.02; errors count by the smooth
    L1 loss with a bend at 4 px, since values are uncertain by a few pixels.

    Args:
        corrections_px: Shape (batch, 17, 17), px.
        offsets: Candidates, shape (batch, candidates, 2).
        scores_px: Their ring scores, shape (batch, candidates), px.
        values_px: Their values, shape (batch, candidates), px.

    Returns:
        The mean loss, a scalar.
    """
    batch = torch.arange(len(offsets))[:, None]
    cells = offsets + CORRECTION_REACH_PX
    corrected_px = scores_px + corrections_px[batch, cells[..., 0], cells[..., 1]]
    weights = torch.exp((values_px - values_px.amax(1, keepdim=True)) / 12.0) + 0.02
    weights = weights / weights.sum(1, keepdim=True)
    errors_px = corrected_px - values_px
    errors_px = errors_px - (weights * errors_px).sum(1, keepdim=True)
    bent = functional.smooth_l1_loss(
        errors_px, torch.zeros_like(errors_px), reduction="none", beta=4.0
    )
    return (weights * bent).sum(1).mean()


class _Samples:
    """The last samples of all lessons."""

    def __init__(self, capacity: int, candidates: int) -> None:
        shapes = {
            "views": ((VIEW_CHANNELS, VIEW_SIZE, VIEW_SIZE), np.float16),
            "offsets": ((candidates, 2), np.int8),
            "scores_px": ((candidates,), np.float32),
            "values_px": ((candidates,), np.float32),
        }
        self._arrays: dict[str, Any] = {
            name: np.empty((capacity, *shape), kind) for name, (shape, kind) in shapes.items()
        }
        self._capacity = capacity
        self.made = 0

    def add(self, lesson: Lesson) -> None:
        places = (self.made + np.arange(len(lesson.views))) % self._capacity
        for name in _LEARNT:
            self._arrays[name][places] = getattr(lesson, name)
        self.made += len(lesson.views)

    def draw(self, generator: np.random.Generator, count: int) -> tuple[Tensor, ...]:
        chosen = generator.integers(min(self.made, self._capacity), size=count)
        views, offsets, scores_px, values_px = (
            torch.from_numpy(self._arrays[name][chosen]) for name in _LEARNT
        )
        return views.float(), offsets.long(), scores_px, values_px


class CorrectionLearner:
    """A network that learns on the jobs that it does itself.

    Attributes:
        options: The settings.
        network: The network as it is now.
        best: The network that was judged best, with gain over area ``best_gain``.
        updates: Updates done.
    """

    def __init__(self, options: CorrectionOptions) -> None:
        """Makes network and jobs."""
        torch.manual_seed(options.seed)
        self.options = options
        self.network = CorrectionNet(options.channels)
        self.network.to(memory_format=torch.channels_last)
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(), lr=options.learning_rate, weight_decay=1e-3
        )
        self.updates = 0
        self.best = copy.deepcopy(self.network)
        self.best_gain = -math.inf
        self._generator = np.random.default_rng(options.seed)
        self._samples = _Samples(options.capacity, options.candidates)
        self._made_before = 0
        self._loss: float | None = None
        self._teaching_s = 0.0
        self._elapsed_s = 0.0
        self._teachers = self._begin_jobs()

    @property
    def samples(self) -> int:
        """Samples made so far, each a pulse of a job with its candidates."""
        return self._made_before + self._samples.made

    @property
    def elapsed_s(self) -> float:
        """Time of training so far, s."""
        return self._elapsed_s

    def learn(
        self,
        judge: Callable[[CorrectionNet], float],
        report: Callable[[LessonProgress], None],
        checkpoint: Path | None = None,
    ) -> None:
        """Trains to the end, and remembers the network that was judged best.

        Args:
            judge: Mean gain over area of the policy of a network, the larger the better; asked
                after every ``lessons_per_judgement`` lessons.
            report: Told after every judgement.
            checkpoint: Written before every report, whole or not at all.
        """
        began_s = time.perf_counter() - self._elapsed_s
        returns: list[float] = []
        lessons = 0
        least = min(self.options.capacity, _LEAST_BATCHES * self.options.batch_size)
        while self.updates < self.options.updates:
            teacher = self._teachers[lessons % len(self._teachers)]
            taught_s = time.perf_counter()
            lesson, ended = self._lesson(teacher)
            self._teaching_s += time.perf_counter() - taught_s
            returns += ended
            left = self.options.updates - self.updates
            if self._samples.made >= least:
                for _ in range(min(self.options.updates_per_lesson, left)):
                    self._update()
            lessons += 1
            self._elapsed_s = time.perf_counter() - began_s
            at_end = self.updates == self.options.updates
            if lessons % self.options.lessons_per_judgement == 0 or at_end:
                gain = self._judge(judge)
                if checkpoint is not None:
                    self.save(checkpoint)
                best_px = lesson.values_px.max(1)
                report(
                    LessonProgress(
                        self.updates,
                        self.options.updates,
                        self.samples,
                        float("nan") if self._loss is None else self._loss,
                        float((best_px - lesson.values_px[:, 1]).mean()),
                        float((best_px - lesson.values_px[:, 0]).mean()),
                        tuple(returns),
                        gain,
                        self.best_gain,
                        self._teaching_s,
                        self._elapsed_s,
                        self._remaining_s(),
                    )
                )
                returns = []

    def save(self, path: Path) -> None:
        """Writes options, network, optimiser and counts; the file is whole or not written."""
        part = path.with_suffix(".part")
        state = {
            "options": to_table(self.options),
            "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "updates": self.updates,
            "made": self.samples,
            "loss": self._loss,
            "best_gain": self.best_gain,
            "best": self.best.state_dict(),
            "teaching_s": self._teaching_s,
            "elapsed_s": self._elapsed_s,
        }
        torch.save(state, part)
        part.replace(path)

    def load(self, path: Path) -> None:
        """Goes on from a checkpoint with fresh jobs; samples are made anew.

        Raises:
            CheckpointError: It is missing, damaged, or of other options; only ``updates`` may
                differ.
        """
        try:
            state = torch.load(path, weights_only=True)
            _check_options(path, state.get("options", {}), to_table(self.options))
            self.network.load_state_dict(state["network"])
            self.optimiser.load_state_dict(state["optimiser"])
            self.updates, self._made_before = state["updates"], state["made"]
            self._loss, self.best_gain = state["loss"], state["best_gain"]
            self.best.load_state_dict(state["best"])
            self._teaching_s, self._elapsed_s = state["teaching_s"], state["elapsed_s"]
        except CheckpointError:
            raise
        except (
            OSError,
            EOFError,
            RuntimeError,
            ValueError,
            KeyError,
            AttributeError,
            pickle.UnpicklingError,
        ) as error:
            raise CheckpointError(f"{path} cannot be loaded: {error}") from error
        self._samples = _Samples(self.options.capacity, self.options.candidates)
        self._generator = np.random.default_rng((self.options.seed, self.updates))
        self._teachers = self._begin_jobs()

    def begin_with(self, policy: Path) -> None:
        """Takes the weights of a policy file of the same shape.

        Raises:
            CheckpointError: It cannot be read or is of another network.
        """
        try:
            self.network.load_exported(load_file(policy))
        except (OSError, SafetensorError, KeyError, RuntimeError) as error:
            raise CheckpointError(f"{policy} cannot be learned from: {error}") from error

    def _judge(self, judge: Callable[[CorrectionNet], float]) -> float:
        gain = judge(self.network)
        if gain > self.best_gain:
            self.best_gain = gain
            self.best.load_state_dict(self.network.state_dict())
        return gain

    def _remaining_s(self) -> float | None:
        if self.updates == 0:
            return None
        return self._elapsed_s / self.updates * (self.options.updates - self.updates)

    def _begin_jobs(self) -> list[Teacher]:
        options = self.options
        # Other seeds for each task, and for each time that a training goes on.
        words = np.random.SeedSequence([options.seed, self.updates]).generate_state(
            len(options.tasks), np.uint64
        )
        seeds = (int(word) % (FIRST_VALIDATION_SEED - options.jobs) for word in words)
        return [
            Teacher(task, options.jobs, seed, options.moves)
            for task, seed in zip(options.tasks, seeds, strict=True)
        ]

    def _lesson(self, teacher: Teacher) -> tuple[Lesson, list[float]]:
        views = torch.from_numpy(teacher.observe())
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
            corrections = self.network(views.contiguous(memory_format=torch.channels_last))
        corrections_px = corrections.float().numpy()
        lesson = teacher.teach(corrections_px, self.options.candidates)
        self._samples.add(lesson)
        ended = teacher.fire(corrections_px, lesson)
        return lesson, ended[~np.isnan(ended)].tolist()

    def _update(self) -> None:
        options = self.options
        done = self.updates / options.updates
        warm = min(1.0, (self.updates + 1) / 100)
        rate = options.learning_rate * warm * (0.01 + 0.99 * 0.5 * (1 + np.cos(np.pi * done)))
        for group in self.optimiser.param_groups:
            group["lr"] = float(rate)
        views, offsets, scores_px, values_px = self._samples.draw(
            self._generator, options.batch_size
        )
        views, offsets = symmetric(views, offsets, int(self._generator.integers(8)))
        with torch.autocast("cpu", torch.bfloat16):
            corrections = self.network(views.contiguous(memory_format=torch.channels_last))
        loss = lesson_loss(corrections.float(), offsets, scores_px, values_px)
        self.optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self.optimiser.step()
        self.updates += 1
        now = loss.item()
        self._loss = now if self._loss is None else 0.98 * self._loss + 0.02 * now


def _check_options(path: Path, kept: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    for name, value in kept.items():
        if name != "updates" and given.get(name) != value:
            raise CheckpointError(
                f"{path} was written with {name} = {value}, not {given.get(name)}: take another "
                "folder, or the same options"
            )
