"""Jobs with the simulated machine and with drivers in Python: what they achieve and survive."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lasergym
from lasergym.errors import (
    DisconnectedError,
    InterlockError,
    JobError,
    OptionError,
    OutOfLimitsError,
    ProtocolError,
)
from lasergym.machine import (
    Deciding,
    Drivers,
    JobOptions,
    JobProgress,
    JobReport,
    SimulatedMachine,
    SimulatedRig,
    read_report,
    resume_job,
    run_job,
)
from lasergym.machine.drivers import Frame
from lasergym.machine.journal import JOURNAL_NAME, Fired, Intent, Observed, read_journal

TARGET = lasergym.targets.star()
GREEDY = Deciding(planner="greedy")
FEW = JobOptions(max_pulses=8)


def true_marks(folder: Path) -> np.ndarray[Any, Any]:
    return SimulatedRig(folder / "rig.json").true_marks()


def test_an_ideal_machine_does_what_the_planner_says(tmp_path: Path) -> None:
    options = replace(FEW, correct_pointing=False)
    report = run_job(
        TARGET, tmp_path / "job", SimulatedMachine(preset="ideal"), deciding=GREEDY, options=options
    )
    assert report.status == "pulses_used"
    assert report.pulses == 8
    marks = true_marks(tmp_path / "job")
    np.testing.assert_allclose([step.aimed_px for step in report.steps], marks[:, :2], atol=1e-9)
    np.testing.assert_allclose(report.trajectory(), marks, atol=0.3)
    truth = lasergym.score(TARGET, marks[:, :2])
    assert report.reward == pytest.approx(truth.reward, abs=0.01)


def test_backlash_is_learnt_from_the_marks(tmp_path: Path) -> None:
    def scatter_px(name: str, *, correct_pointing: bool) -> float:
        """How far marks lie from their aims, but for what all of them have in common."""
        worn = SimulatedMachine(preset="ideal", effects={"backlash_um": 1.5}, seed=2)
        options = JobOptions(max_pulses=30, correct_pointing=correct_pointing)
        report = run_job(TARGET, tmp_path / name, worn, deciding=GREEDY, options=options)
        aims = np.array([step.aimed_px for step in report.steps])
        beside_px = (true_marks(tmp_path / name)[:, :2] - aims)[15:]
        apart_px = np.abs(beside_px - np.median(beside_px, axis=0))
        # Where the stage comes from, in the middle, the side may be mistaken.
        return float(np.quantile(apart_px, 0.8))

    assert scatter_px("corrected", correct_pointing=True) < 0.1
    assert scatter_px("uncorrected", correct_pointing=False) > 1.0


@pytest.mark.parametrize("planner", ["greedy", "anneal"])
def test_a_lab_machine_machines_the_star(tmp_path: Path, planner: Any) -> None:
    deciding = Deciding(planner=planner, first_iterations=200_000, moves=10_000)
    report = run_job(TARGET, tmp_path / "job", deciding=deciding)
    assert report.faults == ()
    assert report.machined_fraction > 0.94
    assert report.off_target_fraction < 0.05
    assert report.phases["move_s"] > 1
    assert sum(report.phases.values()) == pytest.approx(report.elapsed_s, rel=0.2)


def test_the_figures_are_the_score_of_the_marks_that_were_seen(tmp_path: Path) -> None:
    report = run_job(TARGET, tmp_path / "job", deciding=GREEDY, options=FEW)
    score = lasergym.score(TARGET, report.trajectory()[:, :2])
    # Marks have radii of their own; this score takes 9 px for all.
    assert report.reward == pytest.approx(score.reward, abs=0.01)
    assert report.as_dict() == read_report(tmp_path / "job").as_dict()


def test_a_job_that_is_stopped_goes_on(tmp_path: Path) -> None:
    def stop(progress: JobProgress) -> bool:
        return progress.pulse == 3

    folder = tmp_path / "job"
    first = run_job(TARGET, folder, deciding=GREEDY, options=FEW, progress=stop)
    assert first.status == "interrupted"
    assert not first.complete
    second = resume_job(folder)
    assert second.status == "pulses_used"
    assert second.resumed == 1
    assert len(true_marks(folder)) == len(read_journal(folder).of(Fired))
    again = resume_job(folder)
    assert again.as_dict() == second.as_dict()


def test_a_callback_that_raises_stops_the_job(tmp_path: Path) -> None:
    def fail(progress: JobProgress) -> None:
        raise RuntimeError(f"after {progress.pulse}")

    with pytest.raises(RuntimeError, match="after 1"):
        run_job(TARGET, tmp_path / "job", deciding=GREEDY, options=FEW, progress=fail)
    assert read_report(tmp_path / "job").status == "interrupted"


def test_a_folder_with_a_job_is_refused(tmp_path: Path) -> None:
    run_job(TARGET, tmp_path, deciding=GREEDY, options=JobOptions(max_pulses=1))
    before = (tmp_path / JOURNAL_NAME).read_bytes()
    with pytest.raises(JobError, match="holds a job already"):
        run_job(TARGET, tmp_path, deciding=GREEDY)
    assert (tmp_path / JOURNAL_NAME).read_bytes() == before


def test_what_is_not_there_cannot_be_resumed(tmp_path: Path) -> None:
    with pytest.raises(JobError):
        resume_job(tmp_path)


def test_an_unknown_effect_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="backlash_um"):
        run_job(TARGET, tmp_path, SimulatedMachine(effects={"backslash_um": 1.0}))
    assert not (tmp_path / JOURNAL_NAME).exists()


@pytest.mark.parametrize(
    "deciding",
    [
        Deciding(planner="greedy", policy="random-shape"),
        Deciding(planner="policy", pointing_error_px=1.0),
        Deciding(planner="fixed"),
        Deciding(planner="greedy", plan=[[1.0, 2.0]]),
        Deciding(planner="raster"),  # type: ignore[arg-type]
    ],
)
def test_deciding_that_does_not_fit_is_refused(tmp_path: Path, deciding: Deciding) -> None:
    with pytest.raises(OptionError):
        run_job(TARGET, tmp_path / "job", deciding=deciding)
    assert not (tmp_path / "job").exists()


def test_deciding_comes_back_from_what_the_journal_has() -> None:
    deciding = Deciding(planner="agent-mpc", seed=4, moves=10, pointing_error_px=1.5)
    again = Deciding.of(deciding.written(), None)
    assert (again.planner, again.seed, again.moves) == ("agent-mpc", 4, 10)
    assert again.pointing_error_px == 1.5
    assert again.written() == deciding.written()


def test_a_plan_is_fired_as_it_is(tmp_path: Path) -> None:
    plan = lasergym.plan(TARGET, "greedy", max_pulses=4)
    report = run_job(TARGET, tmp_path, deciding=Deciding(planner="fixed", plan=plan), options=FEW)
    np.testing.assert_array_equal([step.aimed_px for step in report.steps], plan.xy_px)


class Faulty:
    """The drivers of a rig, of which one method misbehaves at a certain call."""

    def __init__(self, rig: SimulatedRig, method: str, call: int, trouble: Any) -> None:
        self._rig = rig
        self._method = method
        self._calls_left = call
        self._trouble = trouble

    def __getattr__(self, name: str) -> Any:
        real = getattr(self._rig, name)
        if name != self._method:
            return real

        def called(*arguments: float) -> Any:
            self._calls_left -= 1
            if self._calls_left == 0:
                return self._trouble(real, *arguments)
            return real(*arguments)

        return called


def raising(error: BaseException) -> Any:
    def trouble(*_: Any) -> None:
        raise error

    return trouble


def faulty_job(
    tmp_path: Path, method: str, trouble: Any, call: int = 4
) -> tuple[JobReport, SimulatedRig]:
    rig = SimulatedRig(tmp_path / "machine.json", SimulatedMachine(preset="ideal"))
    calibration = rig.drivers().calibration
    faulty: Any = Faulty(rig, method, call, trouble)
    drivers = Drivers(faulty, faulty, faulty, calibration)
    report = run_job(TARGET, tmp_path / "job", drivers, deciding=GREEDY, options=FEW, arm=True)
    assert report.status == "fault", report.status
    with pytest.raises(Exception, match="armed"):
        rig.fire()
    # Whatever it was, the job goes on with drivers that work, and no pulse is lost or doubled.
    done = resume_job(tmp_path / "job", rig.drivers(calibration), arm=True)
    assert done.status == "pulses_used"
    assert done.resumed == 1
    seen = sum(bool(one.marks) for one in read_journal(tmp_path / "job").of(Observed))
    assert seen == len(rig.true_marks()) == 8
    np.testing.assert_allclose(done.trajectory(), rig.true_marks(), atol=0.4)
    return report, rig


@pytest.mark.parametrize(
    ("error", "fault"),
    [
        (OutOfLimitsError("too far"), "out_of_limits"),
        (InterlockError("the door is open"), "interlock"),
        (DisconnectedError("no cable"), "disconnected"),
        (ProtocolError("gibberish"), "protocol"),
        (TimeoutError("slow"), "timeout"),
        (ConnectionResetError("gone"), "disconnected"),
        (ZeroDivisionError("1 / 0"), "other"),
        (SystemExit(3), "other"),
    ],
)
def test_exceptions_of_a_stage_are_faults(tmp_path: Path, error: BaseException, fault: str) -> None:
    report, _ = faulty_job(tmp_path, "move_to", raising(error))
    assert (report.faults[-1].device, report.faults[-1].fault) == ("stage", fault)
    assert str(error) in report.faults[-1].message


@pytest.mark.parametrize(
    ("method", "device"),
    [
        ("position_um", "stage"),
        ("arm", "laser"),
        ("fire", "laser"),
        ("frame", "camera"),
    ],
)
def test_exceptions_of_any_driver_are_faults(tmp_path: Path, method: str, device: str) -> None:
    report, _ = faulty_job(tmp_path, method, raising(RuntimeError("broken")), call=3)
    assert report.faults[-1].device == device


def test_a_pulse_that_was_fired_although_its_driver_failed_is_not_doubled(tmp_path: Path) -> None:
    def fire_and_fail(fire: Any) -> None:
        fire()
        raise TimeoutError("no answer")

    faulty_job(tmp_path, "fire", fire_and_fail, call=3)


@pytest.mark.parametrize(
    "frame",
    [
        lambda real: Frame(real().gray[:100], time.monotonic()),
        lambda real: Frame(real().gray.astype(np.float32), time.monotonic()),  # type: ignore[arg-type]
        lambda real: Frame(real().gray[..., None], time.monotonic()),
        lambda real: Frame(real().gray, float("nan")),
        lambda real: Frame(real().gray, time.monotonic() + 60),
        lambda real: Frame(real().gray, time.monotonic() - 60),
        lambda real: Frame(real().gray, 0.0),
        lambda _: None,
        lambda real: real().gray,
    ],
)
def test_frames_that_are_none_are_faults(tmp_path: Path, frame: Any) -> None:
    faulty_job(tmp_path, "frame", frame)


@pytest.mark.parametrize(
    "position", [(float("nan"), 1.0), (1e9, 0.0), "here", None, (1.0, 2.0, 3.0)]
)
def test_positions_that_lie_are_faults(tmp_path: Path, position: Any) -> None:
    rig = SimulatedRig(tmp_path / "machine.json", SimulatedMachine(preset="ideal"))
    calibration = rig.drivers().calibration
    lying: Any = Faulty(rig, "position_um", 1, None)
    lying.__dict__["position_um"] = lambda: position
    drivers = Drivers(lying, rig, rig, calibration)
    report = run_job(TARGET, tmp_path / "job", drivers, deciding=GREEDY, options=FEW, arm=True)
    assert report.status == "fault"
    assert len(rig.true_marks()) == 0


def test_without_arm_nothing_is_fired(tmp_path: Path) -> None:
    rig = SimulatedRig(tmp_path / "machine.json", SimulatedMachine(preset="ideal"))
    armed: Any = Faulty(rig, "arm", 1, raising(AssertionError("armed")))
    drivers = Drivers(rig, armed, rig, rig.drivers().calibration)
    report = run_job(TARGET, tmp_path / "job", drivers, deciding=GREEDY, options=FEW)
    assert report.begin.dry_run
    assert report.faults == ()
    assert len(rig.true_marks()) == 0
    with pytest.raises(JobError, match="dry_run"):
        resume_job(tmp_path / "job", drivers, arm=True)


def test_what_is_no_driver_is_refused(tmp_path: Path) -> None:
    rig = SimulatedRig(tmp_path / "machine.json", SimulatedMachine(preset="ideal"))
    with pytest.raises(OptionError, match="stage"):
        Drivers(object(), rig, rig, rig.drivers().calibration)  # type: ignore[arg-type]


def test_python_threads_run_while_a_job_runs(tmp_path: Path) -> None:
    ticks = 0
    done = threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not done.wait(0.001):
            ticks += 1

    thread = threading.Thread(target=tick)
    thread.start()
    run_job(TARGET, tmp_path, deciding=GREEDY, options=FEW)
    done.set()
    thread.join()
    assert ticks > 10


RUN = """
import sys
from lasergym.cli import main
raise SystemExit(main(sys.argv[1:]))
"""


def started(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """The program machining, some pulses into its job."""
    command = [sys.executable, "-c", RUN, "machine", *arguments]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    )
    journal = folder / JOURNAL_NAME
    deadline_s = time.monotonic() + 120
    while not journal.exists() or journal.read_bytes().count(b'"kind":"observed"') < 3:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline_s
        time.sleep(0.005)
    return process


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_the_job_in_good_order(tmp_path: Path, number: signal.Signals) -> None:
    folder = tmp_path / "job"
    thinking = ("--planner", "anneal", "--thinking-s", "0.2")
    process = started(folder, "star", "-o", str(folder), *thinking)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert f"lasergym machine --resume {folder}" in err
    assert read_report(folder).status == "interrupted"
    assert not json.loads((folder / "rig.json").read_text(encoding="utf-8"))["armed"]


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_killed_job_goes_on_without_losing_or_doubling_a_pulse(tmp_path: Path) -> None:
    folder = tmp_path / "job"
    exact = ("--preset", "ideal", "--planner", "greedy")
    process = started(folder, "star", "-o", str(folder), *exact)
    process.kill()
    process.communicate()
    assert read_report(folder).status == "unfinished"
    report = resume_job(folder)
    assert report.complete
    assert report.resumed == 1
    journal = read_journal(folder)
    sent = {
        intent.pulse: np.add((intent.x_px, intent.y_px), intent.correction_px)
        for intent in journal.of(Intent)
    }
    fired = {one.pulse for one in journal.of(Fired)}
    marks = true_marks(folder)
    # Of the command under way when the process died nobody wrote down whether it was fired.
    assert len(sent.keys() - fired) <= 1
    commands = [place for pulse, place in sent.items() if pulse in fired or len(marks) > len(fired)]
    np.testing.assert_allclose(marks[:, :2], commands, atol=1e-9)
    truth = lasergym.score(TARGET, marks[:, :2])
    assert report.reward == pytest.approx(truth.reward, abs=0.01)
