"""The report of a job's folder: the same figures in JSON, pictures and HTML."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import lasergym
from lasergym.errors import JournalError
from lasergym.machine import read_report, write_report
from lasergym.machine.journal import JOURNAL_NAME
from synthetic_job import REPORT_KEYS, write_job

TARGET = lasergym.targets.star()


def test_the_figures_are_those_of_where_the_pulses_landed(tmp_path: Path) -> None:
    landed = write_job(tmp_path, TARGET, pulses=10)
    report = read_report(tmp_path)
    score = lasergym.score(TARGET, landed)
    assert report.reward == score.reward
    assert report.machined_fraction == score.machined_fraction
    assert report.off_target_fraction == score.off_target_fraction
    assert report.pulses == 10
    assert report.complete
    np.testing.assert_allclose(report.trajectory()[:, :2], landed)
    errors_px = [step.error_px for step in report.steps]
    aimed = lasergym.plan(TARGET, "greedy", max_pulses=10).xy_px
    np.testing.assert_allclose(errors_px, np.hypot(*(landed - aimed).T))


def test_times_of_a_job_that_was_resumed_add_up(tmp_path: Path) -> None:
    write_job(tmp_path, TARGET)
    report = read_report(tmp_path)
    assert report.resumed == 1
    assert report.elapsed_s == pytest.approx(2 * 8.34)
    assert sum(report.phases.values()) == pytest.approx(report.elapsed_s)
    assert [(fault.device, fault.fault) for fault in report.faults] == [("camera", "timeout")]


def test_a_job_under_way_has_a_report(tmp_path: Path) -> None:
    landed = write_job(tmp_path, TARGET, pulses=6, faults=False, ended=False)
    path = tmp_path / JOURNAL_NAME
    content = path.read_bytes()
    path.write_bytes(content[: content.rindex(b'{"n"') + 20])  # in the middle of the last record
    report = write_report(tmp_path)
    assert report.status == "unfinished"
    assert not report.complete
    assert report.damage is not None
    assert report.steps[-1].observed is None
    assert report.reward == lasergym.score(TARGET, landed[:5]).reward


def test_a_job_without_a_pulse_has_a_report(tmp_path: Path) -> None:
    write_job(tmp_path, TARGET, pulses=1)
    path = tmp_path / JOURNAL_NAME
    path.write_bytes(path.read_bytes().splitlines(keepends=True)[0])
    report = write_report(tmp_path)
    assert (report.pulses, report.reward, report.first_frame) == (0, 0.0, None)


def test_all_files_are_written(tmp_path: Path) -> None:
    write_job(tmp_path, TARGET)
    written = write_report(tmp_path)
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert set(report) >= REPORT_KEYS
    assert report["reward"] == written.reward
    assert report["resumed"] == 1
    assert report["faults"][0]["device"] == "camera"
    assert (tmp_path / "job.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "job.gif").read_bytes().startswith(b"GIF89a")


def test_the_animation_has_a_frame_for_every_pulse(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    write_job(tmp_path, TARGET, pulses=5)
    write_report(tmp_path)
    with image.open(tmp_path / "job.gif") as animation:
        assert animation.n_frames == 6


def test_the_page_needs_nothing_else(tmp_path: Path) -> None:
    write_job(tmp_path, TARGET, pulses=3)
    write_report(tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    links = re.findall(r"(?:src|href)\s*=\s*[\"']([^\"']*)", page)
    assert [link for link in links if not link.startswith(("data:", "#"))] == []
    addresses = set(re.findall(r"https?://[\w./-]+", page))
    assert addresses <= {"http://www.w3.org/2000/svg"}  # a name, never asked for
    assert page.count("</script>") == 2


def test_a_folder_without_a_job_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JournalError):
        write_report(tmp_path)
