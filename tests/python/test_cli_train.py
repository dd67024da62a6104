"""``lasergym train`` and ``lasergym evaluate``: what they print and leave, and crashes."""

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

pytest.importorskip("stable_baselines3")

ROOT = Path(__file__).resolve().parents[2]

SMALL = """
[task]
environments = 4
thinning = 10
max_pulses = 8
normalise_rewards = true

[policy]
kind = "mlp"
hidden_layers = [16]

[method.ppo]
steps_per_environment = 16
batch_size = 32
epochs = 1
gamma = 0.5

[method.self_imitation]
updates = 1
begin_samples = 16

[run]
steps = 128
checkpoint_steps = 64
tensorboard = false

[evaluation]
every_steps = 1000
planners = ["greedy"]
"""


@pytest.fixture(autouse=True)
def _inside_a_new_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(SMALL)


def column(path: str, name: str) -> list[str]:
    with Path(path).open(encoding="utf-8", newline="") as file:
        return [line[name] for line in csv.DictReader(file)]


def test_a_run_prints_before_and_after_and_an_evaluation_follows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["train", "small.toml", "--no-pictures", "--seed", "3"]) == 0
    captured = capsys.readouterr()
    assert [line.split("  ")[0] for line in captured.out.splitlines()[1:4]] == [
        "before training",
        "after training",
        "greedy",
    ]
    assert "with exploration: " in captured.out
    assert "per second" in captured.err
    assert "of the time in the environment" in captured.err
    assert "wrote runs/small/model.zip" in captured.err
    settings = json.loads(Path("runs/small/config.json").read_text())
    assert settings["run"]["seed"] == 3

    options = ("--task", "star", "--task", "rotated-star", "--angles", "2")
    assert main(["evaluate", "runs/small", *options]) == 0
    captured = capsys.readouterr()
    for text in ("star (1)", "rotated-star (2)", "agent", "greedy", "machined over 90 %"):
        assert text in captured.out
    assert main(["evaluate", "runs/small/model.zip", "--json", "report.json"]) == 0
    assert "wrote report.json" in capsys.readouterr().err
    report = json.loads(Path("report.json").read_text())
    assert report["groups"][0]["name"] == "star"
    assert set(report["groups"][0]["planners"]) == {"agent", "greedy"}

    assert main(["train", "--resume", "runs/small", "--steps", "192", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["steps"] == 192
    assert report["steps_per_s"] > 0
    assert 0 < report["environment_fraction"] < 1
    assert Path("runs/small/training_curve.png").exists()
    assert main(["train", "small.toml"]) == 2
    assert "--resume" in capsys.readouterr().err


def test_a_quick_run_logs_for_tensorboard(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("tensorboard")
    arguments = ("--quick", "--steps", "2880", "-o", "run", "--no-pictures", "--json")
    assert main(["train", "lasergym/RandomShape-v0", *arguments]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["steps"] == 2880
    assert report["before"]["targets"] == 16
    assert list(Path("run/tensorboard").iterdir())
    assert main(["evaluate", "run", "--shapes", "1", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["groups"][0]["name"] == "random-shapes"
    assert report["groups"][0]["targets"] == 7


def test_a_killed_run_loses_one_interval_at_most(capsys: pytest.CaptureFixture[str]) -> None:
    Path("long.toml").write_text(SMALL.replace("steps = 128", "steps = 1000000"))
    command = [sys.executable, str(ROOT / "training" / "train.py"), "long.toml", "-o", "run"]
    with subprocess.Popen(
        [*command, "--no-pictures"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    ) as process:
        while process.poll() is None and len(column_of_run()) < 8:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait(timeout=60)
    done = int(column_of_run()[-1])
    assert done >= 8 * 64
    assert main(["train", "--resume", "run", "--steps", "64", "--no-pictures", "--json"]) == 0
    kept = json.loads(capsys.readouterr().out)["steps"]
    assert done - kept <= 64  # The line of history comes before the checkpoint.
    steps = kept + 128
    assert main(["train", "--resume", "run", "--steps", str(steps), "--no-pictures"]) == 0
    assert [int(one) for one in column_of_run()] == list(range(64, steps + 1, 64))


def column_of_run() -> list[str]:
    """The steps in the history of the run so far, whole lines only."""
    try:
        return [one for one in column("run/history.csv", "steps") if one]
    except FileNotFoundError:
        return []


def test_an_interrupted_run_says_how_to_go_on() -> None:
    Path("long.toml").write_text(SMALL.replace("steps = 128", "steps = 1000000"))
    script = str(ROOT / "training" / "train.py")
    with subprocess.Popen(
        [sys.executable, script, "long.toml", "-o", "run", "--no-pictures"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        start_new_session=True,
        # Background jobs of a shell ignore interrupts, and hand that on.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        while process.poll() is None and len(column_of_run()) < 2:
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)  # As Ctrl-C does.
        out, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert out == ""
    assert "Traceback" not in err
    assert "interrupted: lasergym train --resume run goes on from there" in err
    assert main(["train", "--resume", "run", "--steps", "64", "--no-pictures"]) == 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("train",), "needs a TOML file"),
        (("train", "lasergym/Moon-v0"), "is no environment"),
        (("train", "nowhere.toml"), "there is no configuration"),
        (("train", "small.toml", "--quick"), "--quick is for the id"),
        (("train", "small.toml", "--steps", "0"), "run.steps is 0"),
        (("train", "small.toml", "--seed", "-1"), "run.seed is -1"),
        (("train", "small.toml", "--json", "report.json"), "looks like a file"),
        (("train", "small.toml", "--resume", "run"), "--resume takes all from its run"),
        (("train", "--resume", "nowhere"), "holds no run"),
        (("evaluate", "nowhere"), "there is no model"),
        (("evaluate", "."), "holds no run"),
        (("evaluate", ".", "-o", "nowhere/report.json"), "there is no folder nowhere"),
    ],
)
def test_bad_input_has_a_clear_error(
    arguments: tuple[str, ...], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert reason in captured.err
    assert {path.name for path in Path().iterdir()} == {"small.toml"}


@pytest.mark.parametrize("arguments", [("train", "Star"), ("evaluate", "run")])
def test_what_to_install_is_said_where_it_is_missing(arguments: tuple[str, ...]) -> None:
    code = (
        "import sys; sys.modules['stable_baselines3'] = sys.modules['torch'] = None; "
        f"from lasergym.cli import main; sys.exit(main({list(arguments)}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 1
    assert 'pip install "lasergym[train]"' in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("name", ["train", "evaluate"])
def test_the_script_is_the_command(name: str) -> None:
    command = [sys.executable, str(ROOT / "training" / f"{name}.py"), "--help"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert f"lasergym {name}" in done.stdout
