import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lasergym.cli import main

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "training" / "compare_planners.py"
FAST = ("--planners", "raster,raster-fine,greedy", "--no-pictures", "--jobs", "1")


def results_in(folder: str) -> list[dict[str, str]]:
    with Path(folder, "results.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(autouse=True)
def _inside_a_new_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_the_star_is_compared_unless_told_otherwise(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", *FAST]) == 0
    captured = capsys.readouterr()
    assert "star (1)" in captured.out
    assert "target machined %" in captured.out
    assert "1/1" in captured.out
    assert captured.err.splitlines() == [
        "wrote comparison/table1.md",
        "wrote comparison/table1.csv",
    ]
    names = {path.name for path in Path("comparison").iterdir()}
    assert names == {"results.csv", "settings.json", "table1.md", "table1.csv"}


def test_json_holds_the_table_and_the_settings(capsys: pytest.CaptureFixture[str]) -> None:
    tasks = ("--task", "star", "--task", "rotated-star", "--angles", "3")
    assert main(["compare", *tasks, *FAST, "--seed", "5", "--json", "-o", "out"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["settings"]["seed"] == 5
    assert [group["targets"] for group in report["groups"]] == [1, 3]
    figures = report["groups"][1]["planners"]["greedy"]
    rows = results_in("out")
    assert len(rows) == 12
    rewards = [
        float(row["reward"])
        for row in rows
        if (row["task"], row["planner"]) == ("rotated-star", "greedy")
    ]
    assert figures["reward"]["mean"] == pytest.approx(sum(rewards) / 3)
    wins = report["groups"][0]["paired_wins"]
    assert {(one["planner"], one["other"]) for one in wins} >= {("greedy", "raster")}


@pytest.mark.parametrize("task", [(), ("--task", "folder")])
def test_a_folder_follows_its_task_or_stands_alone(
    task: tuple[str, ...], assets: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *task, str(assets), *FAST, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["settings"]["tasks"] == ["folder:assets"]
    assert report["groups"][0]["targets"] == 5


def test_random_shapes_have_budgets_by_area() -> None:
    shapes = ("--task", "random-shapes", "--shapes", "1")
    assert main(["compare", *shapes, *FAST, "-o", "by-area"]) == 0
    assert main(["compare", *shapes, *FAST, "--max-pulses", "45", "-o", "fixed"]) == 0
    for name, budget in (("by-area", lambda area_px: -(-area_px // 125)), ("fixed", lambda _: 45)):
        rows = results_in(name)
        assert len(rows) == 21
        for row in rows:
            assert int(row["max_pulses"]) == budget(int(row["area_px"]))


def test_the_same_command_goes_on_and_another_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["compare", *FAST]) == 0
    results = Path("comparison/results.csv")
    whole = results.read_bytes()
    assert main(["compare", *FAST]) == 0
    assert results.read_bytes() == whole
    capsys.readouterr()
    assert main(["compare", *FAST, "--seed", "1"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "seed was 0 and is 1" in captured.err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("--planners", "simplex"), "'simplex' is no planner"),
        (("--planners", ""), "'' is no planner"),
        (("--task", "moon"), "'moon' is no task"),
        (("--task", "folder"), "needs a folder of drawings"),
        (("--task", "folder", "nowhere"), "nowhere is no folder"),
        (("--max-pulses", "0"), "max_pulses is 0"),
        (("--max-pulses", "area/0"), "max_pulses is area/0"),
        (("--max-pulses", "few"), "must be like 45 or area/125"),
        (("--anneal-s", "0"), "anneal_s is 0"),
        (("--cma-es-s", "-1"), "cma_es_s is -1"),
        (("--angles", "0"), "angles is 0"),
        (("--shapes", "0"), "shapes is 0"),
        (("--jobs", "0"), "jobs is 0"),
        (("--show", "moon"), "no target is named 'moon'"),
        (("-o", "table.md"), "looks like a file"),
        (("--seed", "-1"), "seed is -1"),
    ],
)
def test_bad_input_has_a_clear_error(
    arguments: tuple[str, ...], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", "--no-pictures", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert reason in captured.err
    assert not Path("comparison").exists()


def test_an_empty_folder_has_a_clear_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "drawings").mkdir()
    assert main(["compare", "--task", "folder", "drawings", *FAST]) == 2
    assert "drawings holds no drawing" in capsys.readouterr().err


def test_an_output_that_is_a_file_has_a_clear_error(capsys: pytest.CaptureFixture[str]) -> None:
    Path("out").write_text("")
    assert main(["compare", *FAST, "-o", "out"]) == 2
    assert "out is a file" in capsys.readouterr().err


def test_an_interrupt_leaves_what_is_done_and_the_rest_follows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    options = ("--task", "rotated-star", "--angles", "9", "--planners", "greedy,anneal")
    effort = ("--anneal-s", "0.5", "--jobs", "2", "--no-pictures", "-o", "out")
    arguments = [*options, *effort]
    command = [sys.executable, str(SCRIPT), *arguments]
    results = Path("out/results.csv")
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Background jobs of a shell ignore interrupts, and hand that on.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        while process.poll() is None and not (
            results.exists() and results.read_bytes().count(b"\n") >= 3
        ):
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)  # As Ctrl-C does.
        out, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert out == ""
    assert "Traceback" not in err
    assert "of 18 results are in out, and the same command goes on from there" in err
    kept = results.read_bytes()
    assert kept.endswith(b"\n")
    assert 3 <= kept.count(b"\n") < 19
    assert main(["compare", *arguments]) == 0
    assert results.read_bytes().startswith(kept)
    assert results.read_bytes().count(b"\n") == 19
    assert "anneal" in capsys.readouterr().out
