"""The study of disturbances: what is disturbed, what goes on after a stop, what it finds."""

import json
from pathlib import Path

import numpy as np
import pytest

import lasergym
from lasergym import _native
from lasergym.cli import main
from lasergym.comparison import Progress
from lasergym.disturbances import StudyOptions, run_study
from lasergym.disturbances.trials import DISPLACED_PULSE, Trial, grid_position_px, run_trial
from lasergym.errors import OptionError
from lasergym.machine import Deciding

TARGET = lasergym.targets.star()
CALM = {
    "displaced": None,
    "vibration_px": 0.0,
    "backlash_px": 0.0,
    "drift_px_per_pulse": 0.0,
    "misfire_probability": 0.0,
}
SMALL = StudyOptions(
    planner="greedy",
    positions=12,
    seeds=2,
    first_iterations=2000,
    moves=200,
    completion_iterations=2000,
    cma_es_evaluations=300,
    shapes=("star",),
)


def test_a_calm_job_is_its_plan() -> None:
    plan = lasergym.plan(TARGET, "greedy", max_pulses=20)
    aimed, landed, score = _native.disturbed_job(
        TARGET, 9.0, 20, Deciding(planner="greedy").settings(), CALM, 0
    )
    np.testing.assert_array_equal(aimed, plan.xy_px)
    np.testing.assert_array_equal(landed, aimed)
    assert lasergym.Score(*score) == plan.score


def test_figures_are_the_score_of_where_the_pulses_landed() -> None:
    disturbance = CALM | {"vibration_px": 2.0, "misfire_probability": 0.2}
    _, landed, score = _native.disturbed_job(
        TARGET, 9.0, 30, Deciding(planner="greedy").settings(), disturbance, 3
    )
    hits = landed[np.isfinite(landed[:, 0])]
    assert 0 < len(hits) < len(landed)
    assert lasergym.score(TARGET, hits).reward == score[0]


@pytest.mark.parametrize(
    "wrong",
    [{"vibration_px": -1.0}, {"misfire_probability": 1.5}, {"backlash_px": float("nan")}],
)
def test_a_disturbance_out_of_range_is_refused(wrong: dict[str, float]) -> None:
    settings = Deciding(planner="greedy").settings()
    with pytest.raises(OptionError, match=next(iter(wrong))):
        _native.disturbed_job(TARGET, 9.0, 20, settings, CALM | wrong, 0)


@pytest.mark.parametrize("number", [0, 24, 312, 624])
def test_a_greedy_loop_gets_over_a_displaced_pulse(number: int) -> None:
    result = run_trial(
        Trial("displaced", "star", "closed", number, 0),
        TARGET,
        lambda: Deciding(planner="greedy"),
        max_pulses=45,
        completion_iterations=20_000,
    )
    assert result.score.reward <= result.best_reward
    assert result.best_reward - result.score.reward < 0.02
    assert result.score.machined_fraction > 0.94


def test_positions_of_the_grid_cover_the_workpiece() -> None:
    places = np.array([grid_position_px(number) for number in range(625)])
    assert places.min() == 2.0
    assert places.max() == 98.0
    assert len({tuple(place) for place in places.tolist()}) == 625
    assert DISPLACED_PULSE == 5


def test_a_study_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    class StoppedError(Exception):
        pass

    def stop(progress: Progress) -> None:
        if progress.done == 7:
            raise StoppedError

    with pytest.raises(StoppedError):
        run_study(SMALL, tmp_path / "cut", stop)
    path = tmp_path / "cut" / "results.csv"
    path.write_bytes(path.read_bytes()[:-9])  # a line that was cut off
    first: list[Progress] = []
    study = run_study(SMALL, tmp_path / "cut", first.append)
    assert first[0].done == 6
    whole = run_study(SMALL, tmp_path / "whole")
    by_trial = {one.trial: one.score for one in whole.results}
    assert {one.trial: one.score for one in study.results} == by_trial
    closed, opened = whole.displaced("closed"), whole.displaced("open")
    assert closed["positions"] == 9
    assert closed["reward"] > opened["reward"]


def test_results_of_other_options_are_refused(tmp_path: Path) -> None:
    (tmp_path / "settings.txt").write_text("something else", encoding="utf-8")
    with pytest.raises(OptionError, match="other options"):
        run_study(SMALL, tmp_path)


@pytest.mark.parametrize("wrong", [{"positions": 0}, {"seeds": 0}, {"shapes": ("heart",)}])
def test_options_out_of_range_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(OptionError):
        StudyOptions(**wrong)  # type: ignore[arg-type]


def test_the_command_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    few = ("--positions", "24", "--seeds", "1", "--shape", "star", "--planner", "greedy")
    quick = ("--moves", "100", "--max-pulses", "8", "-o", str(tmp_path))
    assert main(["disturb", *few, *quick, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["displaced"]["closed"]["positions"] == 4
    assert set(summary["misfire"]["open"]) == {"0.0", "0.02", "0.04", "0.06", "0.08", "0.1"}
    assert main(["disturb", *few, *quick]) == 0
    assert "5th pulse displaced" in capsys.readouterr().out
    for name in ("displaced.png", "disturbances.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
