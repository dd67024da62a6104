"""What the teacher says about candidates, and learning from it."""

from __future__ import annotations

import copy
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lasergym
from lasergym.training.spatial_decision import CORRECTION_REACH_PX
from lasergym.training.teacher import FIRST_VALIDATION_SEED, Teacher, TeacherTask

NOTHING = np.zeros((4, 17, 17), np.float32)


def teacher(task: TeacherTask = TeacherTask.RANDOM_SHAPE, seed: int = 3) -> Teacher:
    return Teacher(task, 4, seed, moves=600)


def test_candidates_begin_with_the_heuristic_the_policy_and_the_plan() -> None:
    corrections = NOTHING.copy()
    corrections[:, 3, 12] = 1e4
    lesson = teacher().teach(corrections)
    assert lesson.offsets.shape == (4, 14, 2)
    assert np.abs(lesson.offsets).max() <= CORRECTION_REACH_PX
    assert (lesson.offsets[:, 0] == 0).all()
    assert (lesson.offsets[:, 1] == [3 - 8, 12 - 8]).all()
    assert (lesson.scores_px[:, 0] >= lesson.scores_px[:, 1]).all()


def test_no_policy_chooses_what_gains_nothing() -> None:
    room = Teacher(TeacherTask.STAR, 1, 3, moves=1)
    generator = np.random.default_rng(0)
    refused = 0
    for _ in range(40):
        wanted = generator.integers(17, size=2)
        corrections = np.zeros((1, 17, 17), np.float32)
        corrections[0, wanted[0], wanted[1]] = 1e4
        lesson = room.teach(corrections)
        own = lesson.offsets[0, 1]
        row, column = 28 + own
        gain = lesson.views[0, 8 + 2 * (row % 2) + column % 2, row // 2, column // 2]
        assert gain > 0 or not own.any()
        refused += int((own != wanted - CORRECTION_REACH_PX).any())
        room.fire(NOTHING[:1], lesson, explore=0.0)
    assert refused > 0


def test_values_are_bounded_by_the_area_and_the_plan_is_nearly_best() -> None:
    room = teacher(TeacherTask.STAR)
    lesson = room.teach(NOTHING)
    area_px = int(lasergym.targets.star().sum())
    assert (lesson.values_px <= area_px).all()
    assert (lesson.values_px[:, 2] > 0.94 * area_px).all()
    assert (lesson.values_px.max(1) - lesson.values_px[:, 2] < 15).all()


def test_jobs_go_on_and_end_with_their_gain() -> None:
    room = teacher()
    ended: list[float] = []
    for _ in range(60):
        lesson = room.teach(NOTHING)
        gains = room.fire(NOTHING, lesson, explore=0.0)
        ended += gains[~np.isnan(gains)].tolist()
    assert len(ended) >= 4
    assert all(0.8 < gain < 1.0 for gain in ended)


def test_the_same_seed_says_the_same() -> None:
    one, other = (teacher(seed=9).teach(NOTHING) for _ in range(2))
    assert (one.values_px == other.values_px).all()
    assert (one.offsets == other.offsets).all()


def test_held_out_seeds_are_refused() -> None:
    Teacher(TeacherTask.RANDOM_SHAPE, 4, FIRST_VALIDATION_SEED - 4)
    with pytest.raises(lasergym.errors.OptionError, match="held out"):
        Teacher(TeacherTask.RANDOM_SHAPE, 4, FIRST_VALIDATION_SEED - 3)


def test_too_few_jobs_and_candidates_are_refused() -> None:
    with pytest.raises(lasergym.errors.OptionError, match="jobs"):
        Teacher(TeacherTask.STAR, 0, 3)
    with pytest.raises(lasergym.errors.OptionError, match="candidates"):
        teacher().teach(NOTHING, candidates=7)


def test_scores_are_those_of_the_observation() -> None:
    """Gain and ring counted pixel by pixel about the places of the upright star."""
    room = teacher(TeacherTask.STAR)
    lesson = room.teach(NOTHING)
    remaining = lasergym.targets.star()
    ((row, column), *_) = room._native.observe()[1]
    rows, columns = np.indices(remaining.shape)
    for (down, right), score_px in zip(lesson.offsets[0], lesson.scores_px[0], strict=True):
        squares = (rows - row - down) ** 2 + (columns - column - right) ** 2
        hits = (remaining & (squares <= 81)).sum()
        misses = (~remaining & (squares <= 81)).sum()
        ring = (remaining & (squares > 81) & (squares <= 144)).sum()
        assert score_px == pytest.approx(hits - misses - 0.35 * ring, abs=1e-3)


torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from lasergym.sb3 import CorrectionNet  # noqa: E402
from lasergym.training.checkpoints import CheckpointError  # noqa: E402
from lasergym.training.correction_options import CorrectionOptions, LessonProgress  # noqa: E402
from lasergym.training.corrections import (  # noqa: E402
    CorrectionLearner,
    lesson_loss,
    symmetric,
)
from lasergym.training.validation import mean_gain, validation_targets  # noqa: E402

SMALL = CorrectionOptions(
    updates=4, updates_per_lesson=2, jobs=4, batch_size=4, moves=100, lessons_per_judgement=1
)


@pytest.mark.parametrize("symmetry", range(8))
def test_symmetries_move_pixels_as_they_move_offsets(symmetry: int) -> None:
    views = torch.zeros(1, 18, 28, 28)
    offset = torch.tensor([[[3, -6], [0, 0]]])

    def channel(row: int, column: int) -> int:
        return 8 + 2 * (row % 2) + column % 2

    for row, column in offset[0]:
        j, i = 28 + int(row), 28 + int(column)
        views[0, channel(j, i), j // 2, i // 2] = 5 + abs(int(row))
    turned, moved = symmetric(views, offset, symmetry)
    for (row, column), (first, _) in zip(moved[0].tolist(), offset[0].tolist(), strict=True):
        j, i = 28 + row, 28 + column
        assert turned[0, channel(j, i), j // 2, i // 2] == 5 + abs(first)
    assert turned.sum() == views.sum()


def test_the_loss_is_zero_where_corrected_scores_differ_from_values_by_a_constant() -> None:
    offsets = torch.tensor([[[0, 0], [2, 1], [-8, 8]]])
    scores, values = torch.tensor([[10.0, 20.0, 5.0]]), torch.tensor([[4000.0, 4003.0, 3990.0]])
    corrections = torch.zeros(1, 17, 17)
    assert lesson_loss(corrections, offsets, scores, values) > 0
    for (row, column), correction in zip(offsets[0].tolist(), values[0] - scores[0], strict=True):
        corrections[0, row + 8, column + 8] = correction - 77.0
    assert lesson_loss(corrections, offsets, scores, values) == 0


def test_the_network_learns_what_a_lesson_says() -> None:
    lesson = teacher().teach(NOTHING)
    views, offsets, scores, values = (torch.from_numpy(array) for array in vars(lesson).values())
    torch.manual_seed(0)
    network = CorrectionNet(8)
    optimiser = torch.optim.Adam(network.parameters(), lr=5e-3)
    losses = []
    for _ in range(60):
        loss = lesson_loss(network(views), offsets, scores, values)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[-1] < 0.8 * losses[0]


def test_learning_goes_on_after_a_kill(tmp_path: Path) -> None:
    reports: list[LessonProgress] = []
    learner = CorrectionLearner(SMALL)
    learner.learn(lambda _: 0.5, reports.append, tmp_path / "checkpoint.pt")
    assert sorted({report.updates for report in reports}) == [0, 2, 4]
    longer = replace(SMALL, updates=6)
    again = CorrectionLearner(longer)
    again.load(tmp_path / "checkpoint.pt")
    assert again.updates == 4
    assert again.best_gain == 0.5
    for one, other in ((learner.network, again.network), (learner.best, again.best)):
        for name, value in one.state_dict().items():
            assert torch.equal(value, other.state_dict()[name])
    again.learn(lambda _: 0.4, reports.append)
    assert reports[-1].updates == 6
    assert (reports[-1].validation_gain, reports[-1].best_validation_gain) == (0.4, 0.5)
    assert [report.samples for report in reports] == [4 * (k + 1) for k in range(len(reports))]
    learnt_from = [report.samples for report in reports if report.updates > 0]
    assert learnt_from[0] == 16 * SMALL.batch_size


def test_the_network_that_was_judged_best_is_kept() -> None:
    judged: list[tuple[float, dict[str, torch.Tensor]]] = []
    gains = itertools.chain([0.1, 0.3], itertools.repeat(0.2))

    def judge(network: CorrectionNet) -> float:
        judged.append((next(gains), copy.deepcopy(network.state_dict())))
        return judged[-1][0]

    learner = CorrectionLearner(replace(SMALL, updates=6))
    learner.learn(judge, lambda _: None)
    assert learner.best_gain == 0.3
    best = judged[1][1]
    assert all(torch.equal(value, best[name]) for name, value in learner.best.state_dict().items())


def test_no_lesson_or_evaluation_has_a_target_of_the_validation() -> None:
    shapes = list(validation_targets(TeacherTask.RANDOM_SHAPE, 3))
    for index, (target, pulses) in enumerate(shapes):
        assert (target == lasergym.targets.random_shape(seed=FIRST_VALIDATION_SEED + index)).all()
        assert pulses == -(-int(target.sum()) // 125)
    turned = [target for target, _ in validation_targets(TeacherTask.ROTATED_STAR, 60)]
    for angle_deg in range(360):
        star = lasergym.targets.star(float(angle_deg))
        assert not any((star == target).all() for target in turned)
    upright = list(validation_targets(TeacherTask.STAR, 1))
    assert [pulses for _, pulses in upright] == [40, 41, 42, 43, 44, 45]


def test_the_mean_gain_is_that_of_the_plans() -> None:
    policy = lasergym.Policy.load("star")
    gains = [
        lasergym.plan(target, "policy", policy=policy, max_pulses=pulses).reward
        * 1e4
        / target.sum()
        for target, pulses in validation_targets(TeacherTask.STAR, 1)
    ]
    assert mean_gain(policy, TeacherTask.STAR, 1) == pytest.approx(np.mean(gains))


def test_a_checkpoint_of_other_options_is_refused(tmp_path: Path) -> None:
    CorrectionLearner(SMALL).save(tmp_path / "checkpoint.pt")
    other = CorrectionLearner(replace(SMALL, seed=1))
    with pytest.raises(CheckpointError, match="seed = 0, not 1"):
        other.load(tmp_path / "checkpoint.pt")


def test_a_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    learner = CorrectionLearner(SMALL)
    learner.save(tmp_path / "checkpoint.pt")
    content = (tmp_path / "checkpoint.pt").read_bytes()
    (tmp_path / "checkpoint.pt").write_bytes(content[: len(content) // 2])
    for name in ("checkpoint.pt", "none.pt"):
        with pytest.raises(CheckpointError, match="cannot be loaded"):
            learner.load(tmp_path / name)


def test_any_seed_learns_from_shapes_that_are_not_held_out() -> None:
    for seed in (0, 40, 2_000_000_000):
        CorrectionLearner(replace(SMALL, seed=seed))


def test_options_out_of_range_are_refused() -> None:
    for name in ("updates", "jobs", "batch_size", "capacity", "channels", "learning_rate"):
        with pytest.raises(lasergym.errors.OptionError, match=name):
            CorrectionOptions(**{name: 0})
    with pytest.raises(lasergym.errors.OptionError, match="candidates"):
        CorrectionOptions(candidates=7)
    with pytest.raises(lasergym.errors.OptionError, match="tasks"):
        CorrectionOptions(tasks=())
