"""``lasergym machine``: simulated and real machines, resuming, what it prints and refuses."""

import json
from pathlib import Path

import pytest

from lasergym.cli import main
from lasergym.machine import SimulatedMachine, SimulatedRig, read_report
from synthetic_job import REPORT_KEYS

QUICK = ("--planner", "greedy", "--max-pulses", "4")

DRIVERS = """
from lasergym.machine import SimulatedRig

def connect():
    rig = SimulatedRig("machine.json")
    return rig, rig, rig
"""


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def rig() -> SimulatedRig:
    """A machine that the file ``lab.py`` connects to, and its calibration ``camera.json``."""
    made = SimulatedRig("machine.json", SimulatedMachine(preset="ideal"))
    made.drivers().calibration.save("camera.json")
    Path("lab.py").write_text(DRIVERS, encoding="utf-8")
    return made


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The message of a run that ends with exit code 2, an error and a hint."""
    assert main(["machine", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    error, hint = captured.err.splitlines()
    assert error.startswith("error: ")
    assert hint.startswith("hint: ")
    return error


def test_it_prints_one_json_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["machine", "star", "-o", "job", *QUICK, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) >= REPORT_KEYS
    assert printed == json.loads(Path("job/report.json").read_text(encoding="utf-8"))
    assert printed["pulses"] == 4
    for name in ("report.html", "job.png", "job.gif", "journal.jsonl", "frames/0004.png"):
        assert (Path("job") / name).is_file()


def test_it_prints_a_table(capsys: pytest.CaptureFixture[str], assets: Path) -> None:
    drawing = str(assets / "thumbs_up.svg")
    assert main(["machine", drawing, "-o", "job", *QUICK, "--effect", "backlash_um=0"]) == 0
    captured = capsys.readouterr()
    assert "machined" in captured.out
    assert "move" in captured.out
    assert "wrote job/report.html" in captured.err
    drivers = read_report("job").begin.drivers
    assert (drivers["preset"], drivers["backlash_um"]) == ("lab", 0)


def test_a_finished_job_is_only_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["machine", "star", "-o", "job", *QUICK, "--json"]) == 0
    first = capsys.readouterr().out
    assert main(["machine", "--resume", "job", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(first)


def test_a_machine_that_fails_is_an_error_with_advice(capsys: pytest.CaptureFixture[str]) -> None:
    strict = ("--tolerance-um", "0.0001")
    assert main(["machine", "star", "-o", "job", *QUICK, *strict]) == 1
    err = capsys.readouterr().err
    assert "out_of_tolerance" in err
    assert "the laser is off" in err
    assert "lasergym machine --resume job" in err


def test_real_drivers_make_a_dry_run(capsys: pytest.CaptureFixture[str], rig: SimulatedRig) -> None:
    real = ("--drivers", "lab.py", "--calibration", "camera.json")
    assert main(["machine", "star", "-o", "job", *QUICK, *real]) == 0
    assert "dry run" in capsys.readouterr().err
    assert len(SimulatedRig("machine.json").true_marks()) == 0
    assert len(rig.true_marks()) == 0


@pytest.mark.usefixtures("rig")
def test_arm_fires() -> None:
    real = ("--drivers", "lab.py", "--calibration", "camera.json", "--arm")
    assert main(["machine", "star", "-o", "job", *QUICK, *real]) == 0
    assert len(SimulatedRig("machine.json").true_marks()) == 4


def test_wrong_usage_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("none.py").write_text("x = 1\n", encoding="utf-8")
    Path("camera.json").write_text("[]", encoding="utf-8")
    assert "TARGET" in refused(capsys)
    assert "TARGET" in refused(capsys, "star", "--resume", "job")
    assert "-o" in refused(capsys, "star")
    assert "preset" in refused(capsys, "star", "-o", "job", "--preset", "factory")
    assert "--effect" in refused(capsys, "star", "-o", "job", "--effect", "backlash_um")
    assert "backslash_um" in refused(capsys, "star", "-o", "job", "--effect", "backslash_um=1")
    assert "planner" in refused(capsys, "star", "-o", "job", "--planner", "raster")
    assert "together" in refused(capsys, "star", "-o", "job", "--drivers", "none.py")
    assert "calibration" in refused(
        capsys, "star", "-o", "job", "--drivers", "none.py", "--calibration", "camera.json"
    )
    assert "no folder of a job" in refused(capsys, "--resume", "nowhere")
    assert not Path("job").exists()


def test_a_folder_with_a_job_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["machine", "star", "-o", "job", *QUICK]) == 0
    capsys.readouterr()
    assert "holds a job already" in refused(capsys, "star", "-o", "job", *QUICK)
