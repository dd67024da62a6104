"""The reader of journals: what it gives back, and what it refuses to trust."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import lasergym
from lasergym.errors import JournalError
from lasergym.machine.journal import (
    JOURNAL_NAME,
    Begin,
    End,
    Fault,
    FrameTaken,
    Intent,
    Observed,
    Resumed,
    Unknown,
    journal_line,
    read_journal,
)
from synthetic_job import write_job, write_journal

TARGET = lasergym.targets.star()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_job(tmp_path, TARGET, pulses=6)
    return tmp_path


def test_all_records_are_read(folder: Path) -> None:
    journal = read_journal(folder)
    assert journal.damage is None
    begin = journal.begin
    np.testing.assert_array_equal(begin.target, TARGET)
    assert (begin.pulse_radius_px, begin.max_pulses, begin.seed) == (9.0, 6, 7)
    assert [intent.pulse for intent in journal.of(Intent)] == [1, 2, 3, 4, 5, 6]
    assert [frame.pulse for frame in journal.of(FrameTaken)] == [0, 1, 2, 3, 4, 5, 6]
    assert journal.of(Fault) == [Fault("timeout", "camera", "no <frame>")]
    assert journal.of(Resumed) == [Resumed(0, None)]
    assert journal.of(Observed)[2].marks[0].radius_px == 9.0
    assert journal.end == journal.of(End)[-1]


def test_the_file_and_its_folder_are_the_same(folder: Path) -> None:
    by_file, by_folder = read_journal(folder / JOURNAL_NAME), read_journal(folder)
    assert by_file.records[1:] == by_folder.records[1:]


def test_the_checksum_covers_the_one_before_as_text() -> None:
    line, crc = journal_line(0, {"kind": "fired", "pulse": 1}, 0)
    # Computed by hand: CRC-32 of 00000000{"n":0,"record":{"kind":"fired","pulse":1}.
    assert line == b'{"n":0,"record":{"kind":"fired","pulse":1},"crc":"%08x"}\n' % crc
    import zlib

    assert crc == zlib.crc32(b'00000000{"n":0,"record":{"kind":"fired","pulse":1}')


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_truncated_journal_is_read_up_to_the_cut(folder: Path, data: st.DataObject) -> None:
    content = (folder / JOURNAL_NAME).read_bytes()
    cut = data.draw(st.integers(0, len(content)))
    path = folder / "cut.jsonl"
    path.write_bytes(content[:cut])
    journal = read_journal(path)
    assert len(journal.records) == content[:cut].count(b"\n")
    assert (journal.damage is None) == (cut == 0 or content[cut - 1 : cut] == b"\n")


@settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_an_altered_byte_ends_what_is_trusted(folder: Path, data: st.DataObject) -> None:
    content = bytearray((folder / JOURNAL_NAME).read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    path = folder / "altered.jsonl"
    path.write_bytes(content)
    journal = read_journal(path)
    assert journal.damage is not None
    assert len(journal.records) == bytes(content[:place]).count(b"\n")


def test_a_record_that_is_left_out_is_noticed(folder: Path) -> None:
    lines = (folder / JOURNAL_NAME).read_bytes().splitlines(keepends=True)
    del lines[4]
    path = folder / "gap.jsonl"
    path.write_bytes(b"".join(lines))
    journal = read_journal(path)
    assert len(journal.records) == 4
    assert journal.damage == "line 5 does not match its checksum"


def test_a_folder_without_a_journal_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JournalError, match="no folder of a job"):
        read_journal(tmp_path)


def test_an_empty_journal_has_no_job(tmp_path: Path) -> None:
    (tmp_path / JOURNAL_NAME).write_bytes(b"")
    journal = read_journal(tmp_path)
    assert journal.end is None
    with pytest.raises(JournalError, match="does not say what the job is"):
        _ = journal.begin


def test_a_record_of_another_version_is_kept_as_it_is(tmp_path: Path) -> None:
    write_journal(tmp_path, [{"kind": "coffee", "cups": 2}])
    assert read_journal(tmp_path).records == (Unknown({"kind": "coffee", "cups": 2}),)


def test_a_field_of_another_version_is_left_out(tmp_path: Path) -> None:
    write_journal(tmp_path, [{"kind": "resumed", "dropped_bytes": 3, "mood": "good"}])
    assert read_journal(tmp_path).records == (Resumed(3),)


@pytest.mark.parametrize(
    "record",
    [
        {"kind": "intent", "pulse": 1},
        {"kind": "observed", "pulse": 1, "verdict": "seen", "marks": 3},
        {"kind": "begin", "target": ["0" * 100] * 99, "pulse_radius_px": 9.0, "max_pulses": 4},
        {"kind": "begin", "pulse_radius_px": 9.0, "max_pulses": 4},
    ],
)
def test_a_record_that_makes_no_sense_is_refused(tmp_path: Path, record: dict[str, object]) -> None:
    write_journal(tmp_path, [record])
    with pytest.raises(JournalError, match="line 1"):
        read_journal(tmp_path)


def test_a_job_begins_with_what_it_is_to_do(tmp_path: Path) -> None:
    write_job(tmp_path, TARGET, pulses=1)
    assert isinstance(read_journal(tmp_path).records[0], Begin)
