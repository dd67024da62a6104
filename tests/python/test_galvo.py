"""Scan heads: calibration, postprocessor, simulation, tuning and their commands."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lasergym.programs
from lasergym import galvo
from lasergym.cli import main
from lasergym.errors import GalvoError, OptionError, ProgramError

SPEEDS = (0.5, 1.0, 1.5, 2.0)


def noisy_lines(head: str, path: Path, seed: int) -> Path:
    """Four test lines, one at each speed, measured with a noise of 1.5 µm."""
    noise = np.random.default_rng(seed)
    rows = ["speed_m_s,nominal_um,measured_um,acceleration_um"]
    for speed in SPEEDS:
        line = galvo.measure_line(head, speed_m_s=speed, length_um=4000)
        measured = line.measured_um + 1.5 * noise.standard_normal()
        acceleration = line.acceleration_um + 1.5 * noise.standard_normal()
        rows.append(f"{speed},4000,{measured},{acceleration}")
    path.write_text("\n".join(rows))
    return path


def star_of_lines(path: Path, speed_m_s: float = 2.0) -> Path:
    """A cutter-location file of ten lines of 2 mm in ten directions."""
    text = f"UNITS/MM\nFEDRAT/{speed_m_s * 60e3},MMPM\n"
    for k in range(10):
        x, y = np.cos(0.2 * np.pi * k), np.sin(0.2 * np.pi * k)
        text += f"RAPID\nGOTO/{-x:.6f},{-y:.6f},0\nGOTO/{x:.6f},{y:.6f},0\n"
    path.write_text(text + "FINI\n")
    return path


def test_uncompensated_lines_are_as_short_as_the_paper_measured() -> None:
    for speed, short_um in ((0.5, 107.3), (2.0, 431.9)):
        measured_um = galvo.measure_line(speed_m_s=speed, angle_deg=30).measured_um
        assert 2000 - measured_um == pytest.approx(short_um, rel=0.02)
    line = galvo.measure_line(speed_m_s=2.0, tolerance=0.063)
    assert line.acceleration_um == pytest.approx(350, rel=0.03)


@pytest.mark.parametrize("head", galvo.HEADS)
@pytest.mark.parametrize("speed", SPEEDS)
def test_a_calibration_from_four_lines_makes_lines_right(
    head: str, speed: float, tmp_path: Path
) -> None:
    found = galvo.calibrate(noisy_lines(head, tmp_path / "lines.csv", seed=7))
    assert abs(found.lag.slope_us - 216.4) < found.lag.slope_confidence_95 + 3
    known = tmp_path / "head.toml"
    known.write_text(galvo.head_text(head) + found.toml)
    job = star_of_lines(tmp_path / "job.apt", speed)
    program = tmp_path / "job.nc"
    assert galvo.postprocess(job, program, head=known, pitch_um=40) == 10
    judged = galvo.simulate(program, head=head)
    assert judged.figures["strokes"] == 10
    assert np.abs(judged.strokes["length_error_um"]).max() < 10
    assert judged.figures["pitch_min"] is not None
    assert judged.figures["pitch_max"] is not None
    galvo.postprocess(job, program, head=known, pitch_um=40, method="delays")
    delayed = galvo.simulate(program, head=head)
    assert delayed.figures["pitch_min"] is not None
    assert delayed.figures["pitch_min"] < 0.9


@pytest.mark.parametrize("dialect", galvo.DIALECTS)
def test_every_dialect_makes_the_same_lines(dialect: str, tmp_path: Path) -> None:
    job = star_of_lines(tmp_path / "job.apt")
    program = tmp_path / ("job.csv" if dialect.startswith("rtc") else "job.nc")
    galvo.postprocess(job, program, dialect=dialect, pitch_um=40)
    judged = galvo.simulate(program, map_px=200)
    assert judged.figures["pulses"] == 10 * 50
    assert np.abs(judged.strokes["length_error_um"]).max() < 2
    assert judged.energy is not None
    assert judged.energy.shape == (200, 200) or max(judged.energy.shape) == 200
    assert judged.picture is not None
    assert judged.picture.startswith(b"\x89PNG")


def test_micro_vectors_make_what_the_vectors_make(tmp_path: Path) -> None:
    job = star_of_lines(tmp_path / "job.apt")
    vectors, micro = tmp_path / "vectors.csv", tmp_path / "micro.csv"
    galvo.postprocess(job, vectors, dialect="rtc", pitch_um=40)
    galvo.postprocess(job, micro, dialect="rtc-micro-vectors", pitch_um=40, step_us=20)
    rows = [line for line in micro.read_text().splitlines() if not line.startswith("#")]
    assert rows[0] == "x_um,y_um,laser,on_us,off_us"
    expected, found = galvo.simulate(vectors), galvo.simulate(micro)
    assert found.figures["pulses"] == expected.figures["pulses"]
    assert len(rows) == pytest.approx(1 + float(expected.figures["total_s"] or 0) / 20e-6, abs=3)
    for name in ("start_error_um", "end_error_um"):
        assert np.abs(found.strokes[name] - expected.strokes[name]).max() < 0.2
    with pytest.raises(OptionError, match="step_us"):
        galvo.postprocess(job, micro, dialect="rtc-micro-vectors", step_us=15)


def test_our_own_toolpaths_are_jobs(tmp_path: Path) -> None:
    passes, pulses = tmp_path / "passes.csv", tmp_path / "pulses.csv"
    passes.write_text(
        "pass,point,x_um,y_um,speed_mm_s,beam_on\n1,1,0,0,500,0\n1,2,1000,0,500,1\n"
        "2,1,1000,50,500,0\n2,2,0,50,500,1\n"
    )
    xy_px = np.array([[10.0, 10.0], [400.0, 30.0], [80.0, 500.0]])
    pulses.write_text(lasergym.programs.to_csv(xy_px))
    stage = tmp_path / "pulses.nc"
    stage.write_text(lasergym.programs.to_gcode(xy_px, pulse_radius_px=9.0))
    program = tmp_path / "job.nc"
    assert galvo.postprocess(passes, program, pitch_um=20, origin_um=(-500, 0)) == 2
    judged = galvo.simulate(program)
    assert np.abs(judged.strokes["length_error_um"]).max() < 2
    for job in (pulses, stage):
        assert galvo.postprocess(job, program, speed_m_s=1.0) == 3
        assert galvo.simulate(program).strokes["pulses"].tolist() == [1, 1, 1]
        with pytest.raises(GalvoError, match="speed"):
            galvo.postprocess(job, program)
    passes.write_text("pass,point,x_um,y_um,speed_mm_s,beam_on\n1,1,0,zero,500,0\n")
    with pytest.raises(ProgramError, match="line 2, column 7"):
        galvo.postprocess(passes, program)
    program = tmp_path / "list.csv"
    program.write_text("x_um,y_um,laser,on_us,off_us\n0,0,2,,\n")
    with pytest.raises(ProgramError, match="line 2, column 5"):
        galvo.simulate(program)


def test_a_program_that_switches_the_laser_itself_makes_the_same_lines(tmp_path: Path) -> None:
    job = star_of_lines(tmp_path / "job.apt")
    galvo.postprocess(job, tmp_path / "job.nc", control="inline", pitch_um=40)
    judged = galvo.simulate(tmp_path / "job.nc")
    assert np.abs(judged.strokes["length_error_um"]).max() < 2


def test_short_vectors_and_corners_are_handled(tmp_path: Path) -> None:
    job = tmp_path / "job.apt"
    job.write_text(
        "FEDRAT/120000,MMPM\nRAPID\nGOTO/0,0\nGOTO/0.02,0\n"  # shorter than the beam
        "RAPID\nGOTO/1,1\nGOTO/2,1\nGOTO/2,2\nGOTO/1,2\nGOTO/1,1\n"  # four corners
        "RAPID\nGOTO/3,0\nCIRCLE/4,0,0,0,0,1,1\nGOTO/3,0\n"  # a full circle
    )
    galvo.postprocess(job, tmp_path / "job.nc", pitch_um=20)
    judged = galvo.simulate(tmp_path / "job.nc")
    assert judged.figures["strokes"] == 6
    assert judged.strokes["pulses"][0] == 1
    assert np.abs(judged.strokes["length_error_um"][1:5]).max() < 2


def test_foreign_programs_are_simulated(tmp_path: Path) -> None:
    program = tmp_path / "foreign.nc"
    program.write_text("G21 G90\nM4 S0\nG0 X-1 Y0\nG1 X1 F120000 S800\nG0 X-1 Y1\nG1 X1\nM5\n")
    judged = galvo.simulate(program)
    assert judged.strokes["length_error_um"][0] == pytest.approx(-432, abs=45)


@settings(max_examples=12, deadline=None)
@given(
    lag_us=st.floats(120, 320),
    damping=st.floats(0.3, 1.2),
    dead_us=st.floats(0, 80),
    response_us=st.floats(0, 40),
    speed=st.floats(0.3, 2.5),
    known=st.sampled_from(galvo.HEADS),
    delays_only=st.booleans(),
    seed=st.integers(0, 2**32),
)
def test_tuning_is_never_worse_on_what_it_is_tuned_on(
    tmp_path_factory: pytest.TempPathFactory,
    lag_us: float,
    damping: float,
    dead_us: float,
    response_us: float,
    speed: float,
    known: str,
    delays_only: bool,
    seed: int,
) -> None:
    head = tmp_path_factory.mktemp("tuned") / "head.toml"
    head.write_text(
        f'[axis]\nkind = "second-order"\nlag_us = {lag_us}\ndamping = {damping}\n'
        f"dead_time_us = {dead_us}\n[laser]\nresponse_us = {response_us}\n"
    )
    options = {"speed_m_s": speed, "known": known, "delays_only": delays_only}
    found = galvo.tune(head, **options, evaluations=40, seed=seed)
    assert found.cost <= found.formula_cost
    if delays_only:
        assert found.run_in_um == found.run_out_um == 0
    lines = [(length, angle) for length in (80, 400, 2000) for angle in (0, 35, 90)]
    for correction, cost in (((0.0,) * 5, found.formula_cost), (found.correction_us, found.cost)):
        made = galvo.machine_lines(head, **options, lines=lines, correction_us=correction)
        assert made.cost.mean() == pytest.approx(cost)


def test_tuning_finds_a_response_of_the_laser_that_nobody_knew(tmp_path: Path) -> None:
    head = tmp_path / "head.toml"
    head.write_text("[laser]\nresponse_us = 25\n")
    found = galvo.tune(head, speed_m_s=2.0, known="bessel", evaluations=600)
    assert found.cost < 0.3 * found.formula_cost
    lines = [(1234.0, 77.0), (300.0, 200.0)]
    options = {"speed_m_s": 2.0, "lines": lines, "known": "bessel"}
    formulas = galvo.machine_lines(head, **options)
    tuned = galvo.machine_lines(head, **options, correction_us=found.correction_us)
    assert np.abs(formulas.start_error_um).min() > 45
    assert np.abs(tuned.start_error_um).max() < 10
    # The correction goes with the head file, between its speeds too.
    known = tmp_path / "known.toml"
    known.write_text(galvo.head_text("bessel") + found.toml)
    program = tmp_path / "job.nc"
    galvo.postprocess(star_of_lines(tmp_path / "job.apt"), program, head=known, pitch_um=20)
    judged = galvo.simulate(program, head=head)
    assert np.abs(judged.strokes["start_error_um"]).max() < 10


def unequal_head(path: Path) -> Path:
    """A head whose y axis lags 80 µs more than its x axis."""
    path.write_text('[x]\nkind = "bessel"\nlag_us = 200\n[y]\nkind = "bessel"\nlag_us = 280\n')
    return path


@pytest.mark.parametrize("speed", SPEEDS)
def test_axes_that_differ_are_calibrated_apart(speed: float, tmp_path: Path) -> None:
    head = unequal_head(tmp_path / "head.toml")
    noise = np.random.default_rng(3)
    rows = ["speed_m_s,nominal_um,measured_um,acceleration_um,axis,acceleration_time_us"]
    for axis, angle_deg in (("x", 0), ("y", 90)):
        for v in SPEEDS:
            line = galvo.measure_line(head, speed_m_s=v, length_um=4000, angle_deg=angle_deg)
            lengths = np.array(line[:2]) + 1.5 * noise.standard_normal(2)
            rows.append(f"{v},4000,{lengths[0]},{lengths[1]},{axis},{line.acceleration_time_us}")
    lines = tmp_path / "lines.csv"
    lines.write_text("\n".join(rows))
    found = galvo.calibrate(lines)
    assert found.x.lag.slope_us == pytest.approx(200, abs=4)
    assert found.y.lag.slope_us == pytest.approx(280, abs=4)
    known = tmp_path / "known.toml"
    known.write_text(found.toml)
    job, program = star_of_lines(tmp_path / "job.apt", speed), tmp_path / "job.nc"
    for knows in (known, head):
        galvo.postprocess(job, program, head=knows, pitch_um=40)
        judged = galvo.simulate(program, head=head)
        assert np.abs(judged.strokes["length_error_um"]).max() < 10
        assert judged.strokes["lateral_error_um"].max() < 10
        assert judged.figures["lateral_error_um_max"] == judged.strokes["lateral_error_um"].max()
        assert judged.figures["pitch_min"] is not None
        assert judged.figures["pitch_min"] > 0.95
    galvo.postprocess(job, program, head="bessel", pitch_um=40)
    worst = galvo.simulate(program, head=head).strokes["lateral_error_um"].max()
    assert worst > 30 * speed


def test_curves_are_followed_by_axes_that_differ(tmp_path: Path) -> None:
    head = unequal_head(tmp_path / "head.toml")
    job, program = tmp_path / "job.apt", tmp_path / "job.nc"
    job.write_text("RAPID\nGOTO/4,0\nCIRCLE/0,0,0,0,0,1,4\nGOTO/4,0\n")
    radii = []
    for knows in (head, "bessel"):
        galvo.postprocess(job, program, head=knows, pitch_um=20, speed_m_s=1.0)
        judged = galvo.simulate(program, head=head, map_px=800)
        assert judged.energy is not None
        assert judged.box_um is not None
        rows, columns = np.nonzero(judged.energy > 0.5 * judged.energy.max())
        cell_um = (judged.box_um[2] - judged.box_um[0]) / judged.energy.shape[1]
        x = judged.box_um[0] + (columns + 0.5) * cell_um
        y = judged.box_um[1] + (rows + 0.5) * cell_um
        # Unequal lags turn a circle into an ellipse along its diagonals.
        diagonal = [np.abs(x + side * y).max() / np.sqrt(2) for side in (1, -1)]
        radii.append(abs(diagonal[0] - diagonal[1]))
    assert radii[0] < 0.5 * radii[1], radii


def test_a_mirror_of_limited_acceleration_needs_more_than_a_straight_regression(
    tmp_path: Path,
) -> None:
    head = "acceleration-limit"
    found = galvo.calibrate(noisy_lines(head, tmp_path / "lines.csv", seed=7))
    assert not found.lag.means
    assert len(found.acceleration.means) == len(SPEEDS)
    for speed, length, width in found.acceleration.means:
        assert width is None
        line = galvo.measure_line(head, speed_m_s=speed, length_um=4000)
        assert length == pytest.approx(line.acceleration_um, abs=6)
        assert found.acceleration.at_um(speed) == length
    # Its own model meets both ends, jumps included.
    program = tmp_path / "job.nc"
    galvo.postprocess(star_of_lines(tmp_path / "job.apt"), program, head=head, pitch_um=40)
    judged = galvo.simulate(program, head=head)
    assert np.abs(judged.strokes["length_error_um"]).max() < 2
    assert judged.figures["pitch_min"] is not None
    assert judged.figures["pitch_min"] > 0.97


def test_a_recorded_head_is_found(tmp_path: Path) -> None:
    # Constant acceleration for 300 µs, 20 µs late: the mean of the command over that time.
    time_us = np.arange(0.0, 3000.0, 5.0)

    def climbed(t: np.ndarray) -> np.ndarray:
        ramp = np.clip(t, 0, 1500)
        return ramp**2 + 2 * 1500 * np.clip(t - 1500, 0, None)

    position = (climbed(time_us - 20) - climbed(time_us - 320)) / 300
    command = 2 * np.clip(time_us, 0, 1500)
    path = tmp_path / "recorded.csv"
    rows = np.column_stack([time_us, command, position])
    np.savetxt(path, rows, delimiter=",", header="time_us,command_um,position_um", comments="")
    found = galvo.identify(path)
    assert found.family == "acceleration-time"
    values = {name: value for name, value, _ in found.parameters}
    assert values["acceleration_time_us"] == pytest.approx(300, abs=0.1)
    assert values["dead_time_us"] == pytest.approx(20, abs=0.1)
    head = tmp_path / "head.toml"
    assert main(["galvo", "identify", str(path), "-o", str(head), "--json"]) == 0
    assert galvo.compensation(head, speed_m_s=1.0).lag_us == pytest.approx(170, abs=0.2)


def test_mistakes_say_what_to_do(tmp_path: Path) -> None:
    job = tmp_path / "job.apt"
    job.write_text("GOTO/0,0\nGOTO/1,oops\n")
    with pytest.raises(ProgramError, match="line 2, column 8"):
        galvo.postprocess(job, tmp_path / "out.nc")
    job.write_text("GOTO/0,0\nGOTO/1,0\n")
    with pytest.raises(GalvoError, match="FEDRAT"):
        galvo.postprocess(job, tmp_path / "out.nc")
    job.write_text("GOTO/0,0\nGOTO/17.5,0\n")
    with pytest.raises(GalvoError, match="run-in"):
        galvo.postprocess(job, tmp_path / "out.nc", speed_m_s=2.0)
    with pytest.raises(OptionError, match="bessel"):
        galvo.simulate(job, head="axe")
    with pytest.raises(OptionError, match="dialect"):
        galvo.postprocess(job, tmp_path / "out.nc", speed_m_s=1.0, dialect="axe")
    lines = tmp_path / "lines.csv"
    lines.write_text("speed_m_s,nominal_um,measured_um,acceleration_um\n1,2000,x,1\n")
    with pytest.raises(GalvoError, match="line 2, column 8"):
        galvo.calibrate(lines)


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(arguments)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_the_commands_work_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pattern, program = tmp_path / "pattern.apt", tmp_path / "job.nc"
    assert run(capsys, "galvo", "calibrate", "--pattern", "-o", str(pattern))[0] == 0
    lines = noisy_lines("bessel", tmp_path / "lines.csv", seed=1)
    head = tmp_path / "head.toml"
    code, out, _ = run(capsys, "galvo", "calibrate", str(lines), "-o", str(head), "--json")
    assert code == 0
    assert json.loads(out)["lag"]["slope_us"] == pytest.approx(216.4, abs=5)
    code, out, _ = run(
        capsys,
        *("galvo", "post", str(pattern), "--speed-m-s", "2", "--beam-um", "40"),
        *("--calibration", str(head), "-o", str(program), "--json"),
    )
    assert code == 0
    assert json.loads(out)["vectors"] == 80
    job = tmp_path / "job"
    code, out, _ = run(
        capsys, "galvo", "simulate", str(program), "--head", str(head), "-o", str(job), "--json"
    )
    assert code == 0
    report = json.loads(out)
    assert report == json.loads((job / "report.json").read_text())
    assert report["length_error_um_max"] < 10
    for key in ("pitch_min", "pitch_max", "mark_s", "jump_s", "delay_s", "total_s"):
        assert report[key] > 0
    assert (job / "energy.png").stat().st_size > 100
    micro = tmp_path / "micro.csv"
    code, out, _ = run(
        capsys,
        *("galvo", "post", str(pattern), "--speed-m-s", "2", "--head", str(head), "-o", str(micro)),
        *("--dialect", "rtc-micro-vectors", "--step-us", "20", "--origin-um", "-500,250", "--json"),
    )
    assert (code, json.loads(out)["dialect"]) == (0, "rtc-micro-vectors")
    assert run(capsys, "galvo", "simulate", str(micro), "--head", str(head))[0] == 0


def test_tuned_heads_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head, tuned = tmp_path / "head.toml", tmp_path / "tuned.toml"
    head.write_text("[laser]\nresponse_us = 20\n")
    few = ("--evaluations", "60", "--lengths-um", "400", "--json")
    code, out, _ = run(
        capsys,
        *("galvo", "tune", str(head), "--known", "bessel", "--speeds-m-s", "2,1", *few),
        *("-o", str(tuned)),
    )
    assert code == 0
    speeds = json.loads(out)["speeds"]
    assert [row["speed_m_s"] for row in speeds] == [1, 2]
    assert all(row["cost"] < row["formula_cost"] for row in speeds)
    assert tuned.read_text().count("[[correction]]") == 2
    corrected = galvo.compensation(tuned, speed_m_s=2.0)
    plain = galvo.compensation("bessel", speed_m_s=2.0)
    assert corrected.run_in_um == pytest.approx(speeds[1]["run_in_um"])
    assert corrected.on_us == pytest.approx(speeds[1]["on_us"])
    assert corrected != plain
    # Written again, corrections are replaced.
    arguments = ("galvo", "tune", str(head), "--known", str(tuned), "--speeds-m-s", "1", *few)
    assert run(capsys, *arguments, "-o", str(tuned))[0] == 0
    assert tuned.read_text().count("[[correction]]") == 1

    delays = tmp_path / "delays.toml"
    arguments = ("galvo", "tune", str(head), "--delays-only", "--speeds-m-s", "1")
    code, _, _ = run(capsys, *arguments, *few, "-o", str(delays))
    assert code == 0
    assert "[controller.delays]" in delays.read_text()
    program = tmp_path / "foreign.nc"
    program.write_text("G21 G90\nM4 S0\nG0 X-1 Y0\nG1 X1 F60000 S800\nG0 X-1 Y1\nG1 X1\nM5\n")
    without, with_delays = (
        np.abs(galvo.simulate(program, head=of).strokes["length_error_um"]).max()
        for of in (head, delays)
    )
    assert with_delays < 0.5 * without
    code, out, _ = run(capsys, "galvo", "tune", "--speeds-m-s", "1", "--evaluations", "10")
    assert code == 0
    assert "formulas" in out


def test_the_commands_refuse_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    job = star_of_lines(tmp_path / "job.apt")
    for arguments, words in (
        (("calibrate",), "--pattern"),
        (("calibrate", "--pattern", "--speeds-m-s", "x"), "commas"),
        (("tune", "--angles-deg", "x"), "commas"),
        (("tune", "--delays-only", "-o", str(tmp_path / "x.toml")), "one speed"),
        (("post", str(job), "-o", str(job)), "another name"),
        (("post", str(job), "-o", str(tmp_path / "x.nc"), "--method", "axe"), "adaptive"),
        (("post", str(job), "-o", str(tmp_path / "x.nc"), "--origin-um", "1"), "x,y"),
        (("simulate", str(job), "-o", str(job)), "folder"),
        (("simulate", str(tmp_path / "none.nc")), "none.nc"),
    ):
        code, out, err = run(capsys, "galvo", *arguments)
        assert code in (1, 2)
        assert out == ""
        assert "error:" in err
        assert words in err or words == "none.nc"
