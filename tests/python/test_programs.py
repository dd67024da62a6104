"""Machine programs: round trips, the golden files shared with Rust, travel, bad input."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lasergym import programs
from lasergym.errors import OptionError, PositionError, ProgramError
from lasergym.programs import GcodeOptions, StageDynamics, WorkpieceFrame

GOLDEN_XY_PX = np.array(
    [
        [50.0, 50.0],
        [12.5, 87.25],
        [56.1728401184082, 0.6172835826873779],
        [100 / 3, 200 / 3],
        [-2.5, 101.0],
    ]
)

PULSES = st.lists(st.tuples(*[st.floats(-50, 150)] * 2), max_size=30)
FRAMES = st.builds(
    WorkpieceFrame,
    origin_x_mm=st.floats(-100, 100),
    origin_y_mm=st.floats(-100, 100),
    y_axis=st.sampled_from(["up", "down"]),
    pixel_um=st.floats(0.1, 100),
)


@given(PULSES, FRAMES)
def test_gcode_reads_back(pulses: list[tuple[float, float]], frame: WorkpieceFrame) -> None:
    text = programs.to_gcode(pulses, options=GcodeOptions(frame=frame))
    read = programs.from_gcode(text, frame=frame)
    expected = np.array(pulses).reshape(-1, 2)
    # Programs have 12 decimal places of a millimetre; adding an origin of 100 mm costs digits.
    np.testing.assert_allclose(read, expected, rtol=0, atol=1e-7 + 1e-9 / frame.pixel_um)


@given(PULSES)
def test_csv_reads_back_exactly(pulses: list[tuple[float, float]]) -> None:
    read = programs.from_csv(programs.to_csv(pulses))
    np.testing.assert_array_equal(read, np.array(pulses).reshape(-1, 2))


@given(PULSES)
def test_the_laser_is_off_first_and_last(pulses: list[tuple[float, float]]) -> None:
    lines = programs.to_gcode(pulses).splitlines()
    commands = [line for line in lines if not line.startswith(";")]
    assert commands[0] == "M5"
    assert commands[-1].startswith("M5")
    assert sum("M3" in line for line in commands) == len(pulses)


def test_gcode_is_the_golden_file(golden: Path) -> None:
    text = (golden / "pulses.nc").read_text(encoding="utf-8")
    assert programs.to_gcode(GOLDEN_XY_PX) == text
    np.testing.assert_allclose(programs.from_gcode(text), GOLDEN_XY_PX, rtol=0, atol=1e-8)


def test_csv_is_the_golden_file(golden: Path) -> None:
    text = (golden / "pulses.csv").read_text(encoding="utf-8")
    assert programs.to_csv(GOLDEN_XY_PX) == text
    np.testing.assert_array_equal(programs.from_csv(text), GOLDEN_XY_PX)


def test_travel_is_a_trapezoid_of_speed() -> None:
    dynamics = StageDynamics(
        max_speed_um_s=10.0, acceleration_um_s2=10.0, settling_s=0.5, pulse_s=0.25
    )
    # 30 µm: 1 s and 5 µm up to 10 µm/s, 20 µm at it, 1 s and 5 µm down.
    travel = programs.travel([[0, 0], [30, 0]], dynamics)
    assert travel.length_um == pytest.approx(30)
    assert travel.moving_s == pytest.approx(4)
    assert travel.firing_s == pytest.approx(0.5)
    # 2.5 µm: never at full speed; half of it takes √(2 · 1.25 / 10) s.
    assert programs.travel([[0.0, 0.0], [0.0, 2.5]], dynamics).moving_s == pytest.approx(1)


@given(PULSES)
def test_travel_adds_up(pulses: list[tuple[float, float]]) -> None:
    travel = programs.travel(pulses)
    assert travel.time_s == pytest.approx(travel.moving_s + travel.settling_s + travel.firing_s)
    steps = np.diff(np.array(pulses).reshape(-1, 2), axis=0)
    assert travel.length_um == pytest.approx(np.hypot(*steps.T).sum())


@pytest.mark.parametrize(
    "options",
    [
        GcodeOptions(power_s=0.0),
        GcodeOptions(power_s=float("nan")),
        GcodeOptions(dwell_s=0.0),
        GcodeOptions(dwell_s=4000.0),
        GcodeOptions(settling_s=-1.0),
        GcodeOptions(feed_mm_min=0.0),
        GcodeOptions(frame=WorkpieceFrame(origin_x_mm=float("inf"))),
        GcodeOptions(frame=WorkpieceFrame(origin_y_mm=2000.0)),
        GcodeOptions(frame=WorkpieceFrame(pixel_um=0.0)),
        GcodeOptions(frame=WorkpieceFrame(y_axis="left")),  # type: ignore[arg-type]
    ],
)
def test_an_option_outside_its_range_is_refused(options: GcodeOptions) -> None:
    with pytest.raises(OptionError):
        programs.to_gcode([[50, 50]], options=options)


def test_a_wrong_pulse_radius_is_refused() -> None:
    with pytest.raises(OptionError, match="radius"):
        programs.to_gcode([[50, 50]], pulse_radius_px=0.0)


@pytest.mark.parametrize(
    "dynamics",
    [
        StageDynamics(max_speed_um_s=0.0),
        StageDynamics(acceleration_um_s2=-1.0),
        StageDynamics(settling_s=float("nan")),
        StageDynamics(pulse_s=-1.0),
    ],
)
def test_an_impossible_stage_is_refused(dynamics: StageDynamics) -> None:
    with pytest.raises(OptionError):
        programs.travel([[0, 0], [1, 1]], dynamics)


@pytest.mark.parametrize(
    "pulses",
    [[[np.nan, 0.0]], [[np.inf, 0.0]], [[1e9, 0.0]], [[1.0]], [1.0, 2.0], [[1, 2, 3]], "left"],
)
def test_positions_that_are_none_are_refused(pulses: Any) -> None:
    for write in (programs.to_gcode, programs.to_csv, programs.travel):
        with pytest.raises(PositionError):
            write(pulses)


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ("hello", "line 1"),
        ("G21 G90\nX", "line 2"),
        ("G90\nG2 X1 Y1", "line 2"),
        ("G90 G21\nM3 S1\nG4 P1\nM5", "position"),
        ("G90 G21\nG0 X0 Y0\nM3 S1\nG0 X1 Y1\nM5", "laser on"),
        ("G90 G21\nG0 X0 Y0\nG1 M3 S1\nM5", "without having dwelt"),
        ("G90 G21\nG0 X0 Y0\nG1 M3 S1\nG4 P1", "still on at the end"),
        ("G90 G21\nG4", "G4"),
        ("G90 (no end", "comment"),
        ("M2\nG0 X1 Y1", "ended"),
    ],
)
def test_a_program_that_is_none_is_refused(program: str, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        programs.from_gcode(program)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1"),
        ("x,y\n1,2", "header"),
        ("pulse,x_um,y_um\n1,2", "line 2"),
        ("pulse,x_um,y_um\n1,2,north", "line 2"),
        ("pulse,x_um,y_um\n1,nan,2", "line 2"),
        ("pulse,x_um,y_um\n2,1,1", "line 2"),
        ("pulse,x_um,y_um\n1,1e12,1", "line 2"),
    ],
)
def test_a_table_that_is_none_is_refused(text: str, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        programs.from_csv(text)


@pytest.mark.parametrize("read", [programs.from_gcode, programs.from_csv])
@given(text=st.text(max_size=200))
def test_any_text_is_read_or_refused(read: Any, text: str) -> None:
    with suppress(ProgramError):
        assert read(text).shape[1] == 2
