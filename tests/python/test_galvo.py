"""Scan heads: calibration, postprocessor, simulation, tuning and their commands."""

import json
from pathlib import Path

import numpy as np
import pytest

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
        measured, acceleration = galvo.measure_line(head, speed_m_s=speed, length_um=4000)
        measured += 1.5 * noise.standard_normal()
        acceleration += 1.5 * noise.standard_normal()
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
        measured, _ = galvo.measure_line(speed_m_s=speed, angle_deg=30)
        assert 2000 - measured == pytest.approx(short_um, rel=0.02)
    _, acceleration = galvo.measure_line(speed_m_s=2.0, tolerance=0.063)
    assert acceleration == pytest.approx(350, rel=0.03)


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


def test_tuning_is_never_worse_than_the_formulas() -> None:
    for head in ("bessel", "second-order"):
        found = galvo.tune(head, speed_m_s=2.0, evaluations=300)
        assert found.cost <= found.formula_cost
    delays = galvo.tune("second-order", speed_m_s=2.0, delays_only=True, evaluations=200)
    assert delays.run_in_um == 0
    assert delays.cost <= delays.formula_cost


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


def test_the_commands_refuse_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    job = star_of_lines(tmp_path / "job.apt")
    for arguments, words in (
        (("calibrate",), "--pattern"),
        (("calibrate", "--pattern", "--speeds-m-s", "x"), "commas"),
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
