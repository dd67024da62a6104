"""The command line: data on stdout, the rest on stderr, exit codes, errors with hints."""

import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import lasergym
from lasergym.cli import main

GREEDY = ("--planner", "greedy")

REPORT_KEYS = {
    "target",
    "target_px",
    "max_pulses",
    "planner",
    "reward",
    "machined_fraction",
    "off_target_fraction",
    "pulses",
    "elapsed_s",
    "partial",
    "pulse_radius_px",
    "pixel_um",
    "travel_um",
    "travel_time_s",
    "baselines",
    "version",
    "xy_px",
}


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def failure(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str]]:
    """The exit code and the lines on stderr of a run that prints no data."""
    code = main(arguments)
    captured = capsys.readouterr()
    assert captured.out == ""
    return code, captured.err.splitlines()


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The message of a run that ends with exit code 2, an error and a hint, a line each."""
    code, lines = failure(capsys, *arguments)
    assert code == 2
    assert len(lines) == 2
    assert lines[0].startswith("error: ")
    assert lines[1].startswith("hint: ")
    return lines[0]


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"lasergym {lasergym.__version__}\n"


@pytest.mark.parametrize("command", ["plan", "machine", "envs", "bench", "compare", "demo"])
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    assert "Usage: lasergym" in capsys.readouterr().out


def test_plan_prints_one_json_object(capsys: pytest.CaptureFixture[str], assets: Path) -> None:
    assert (
        main(["plan", str(assets / "thumbs_up.svg"), *GREEDY, "--max-pulses", "40", "--json"]) == 0
    )
    captured = capsys.readouterr()
    report = json.loads(captured.out)
    assert captured.err == ""
    assert set(report) == REPORT_KEYS
    assert report["max_pulses"] == 40
    assert report["pulses"] == len(report["xy_px"]) <= 40
    assert [one["planner"] for one in report["baselines"]] == ["raster", "raster-fine"]


def test_the_report_agrees_with_the_score(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "star:30", *GREEDY, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    target = lasergym.targets.star(30.0)
    score = lasergym.score(target, report["xy_px"]).as_dict()
    assert score == {name: report[name] for name in score}
    assert report["target_px"] == int(target.sum())


def test_the_search_options_reach_the_planner(capsys: pytest.CaptureFixture[str]) -> None:
    search = ("--planner", "anneal", "--iterations", "2000", "--seed", "3", "--keep-order")
    assert main(["plan", "random-shape:7", *search, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    target = lasergym.targets.random_shape(7)
    plan = lasergym.plan(target, "anneal", iterations=2000, seed=3)
    assert report["xy_px"] == plan.xy_px.tolist()


def test_plan_writes_every_kind_of_file(capsys: pytest.CaptureFixture[str]) -> None:
    names = ("a.csv", "a.nc", "a.gcode", "a.svg", "a.png", "a.json")
    outputs = [part for name in names for part in ("-o", name)]
    assert main(["plan", "star", *GREEDY, *outputs]) == 0
    assert capsys.readouterr().err.splitlines() == [f"wrote {name}" for name in names]
    report = json.loads(Path("a.json").read_text(encoding="utf-8"))
    assert set(report) == REPORT_KEYS
    planned = np.array(report["xy_px"])
    read = lasergym.programs.from_csv(Path("a.csv").read_text(encoding="utf-8"))
    np.testing.assert_array_equal(read, planned)
    program = Path("a.nc").read_text(encoding="utf-8")
    assert program == Path("a.gcode").read_text(encoding="utf-8")
    np.testing.assert_allclose(lasergym.programs.from_gcode(program), planned, atol=1e-6)
    assert Path("a.png").read_bytes().startswith(b"\x89PNG\r\n")
    assert Path("a.svg").read_text(encoding="utf-8").startswith("<svg")


def test_a_file_behind_json_takes_the_report(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "star", *GREEDY, "--json", "report.json"]) == 0
    assert set(json.loads(Path("report.json").read_text(encoding="utf-8"))) == REPORT_KEYS
    assert "planner" in capsys.readouterr().out


def test_preview_is_a_picture() -> None:
    assert main(["plan", "star", *GREEDY, "--preview", "plan.png"]) == 0
    assert Path("plan.png").read_bytes().startswith(b"\x89PNG\r\n")


def test_larger_pixels_enlarge_programs_and_travel(capsys: pytest.CaptureFixture[str]) -> None:
    enlarged = ("--pixel-um", "2", "--pulse-radius-um", "18", "-o", "a.nc", "-o", "a.csv")
    reports = []
    for options in ((), enlarged):
        assert main(["plan", "star", *GREEDY, *options, "--json"]) == 0
        reports.append(json.loads(capsys.readouterr().out))
    small, large = reports
    assert large["xy_px"] == small["xy_px"]
    assert large["travel_um"] == pytest.approx(2 * small["travel_um"])
    frame = lasergym.programs.WorkpieceFrame(pixel_um=2.0)
    program = Path("a.nc").read_text(encoding="utf-8")
    read = lasergym.programs.from_gcode(program, frame=frame)
    np.testing.assert_allclose(read, small["xy_px"], atol=1e-6)
    read_um = lasergym.programs.from_csv(Path("a.csv").read_text(encoding="utf-8"))
    np.testing.assert_allclose(read_um, 2 * np.array(small["xy_px"]))


def test_machine_options_reach_the_program() -> None:
    machine = ("--power", "300", "--dwell-s", "0.2", "--settling-s", "0.1", "--feed-mm-min", "120")
    origin = ("--origin-x-mm", "10", "--origin-y-mm", "-5", "--y-axis", "down")
    assert main(["plan", "star", *GREEDY, "-o", "a.nc", *machine, *origin]) == 0
    program = Path("a.nc").read_text(encoding="utf-8")
    for word in ("S300", "G4 P0.2", "G4 P0.1", "F120", "X10.0", "Y-4."):
        assert word in program


def test_drawing_options_reach_the_reader(capsys: pytest.CaptureFixture[str], assets: Path) -> None:
    drawing = assets / "logo.svg"
    options = ("--margin-px", "10", "--threshold", "0.7", "--invert")
    assert main(["plan", str(drawing), *GREEDY, *options, "--json"]) == 0
    target = lasergym.targets.load(drawing, margin_px=10, threshold=0.7, invert=True)
    assert json.loads(capsys.readouterr().out)["target_px"] == int(target.sum())


@pytest.mark.parametrize("name", ["thumbs_up.png", "thumbs_up.svg", "bracket.dxf", "ellipse.svg"])
def test_every_drawing_format_is_planned(name: str, assets: Path) -> None:
    assert main(["plan", str(assets / name), *GREEDY, "-o", "a.nc"]) == 0


def test_tables_fit_a_narrow_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    quick = ("--envs", "2", "--seconds", "0", "--repetitions", "1", "--memory-envs", "0")
    for arguments in (["plan", "star", *GREEDY], ["envs"], ["bench", *quick]):
        assert main(arguments) == 0
        out = capsys.readouterr().out
        tables = out.split("\nratio:")[0].splitlines()
        assert max(map(len, tables)) <= 60
        assert "…" not in out


def test_nothing_but_data_reaches_a_pipe(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from lasergym.cli import main; raise SystemExit(main())"]
    run = subprocess.run(
        [*command, "plan", "star", *GREEDY, "--json", "-o", "a.csv"],
        capture_output=True,
        check=True,
        cwd=tmp_path,
        env={**os.environ, "NO_COLOR": ""},
        text=True,
    )
    assert json.loads(run.stdout)["planner"] == "greedy"
    assert run.stderr == "wrote a.csv\n"


def test_a_missing_file_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "no such file: heart.png" in refused(capsys, "plan", "heart.png")


def test_a_folder_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "cannot read" in refused(capsys, "plan", str(tmp_path))


def test_a_file_that_is_no_drawing_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("notes.txt").write_text("buy milk", encoding="utf-8")
    assert "format of notes.txt is not known" in refused(capsys, "plan", "notes.txt")


def test_a_file_that_is_no_image_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("a.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    refused(capsys, "plan", "a.png")


def test_a_full_target_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("a.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9">'
        '<rect width="9" height="9"/></svg>',
        encoding="utf-8",
    )
    assert "all of the workpiece is ink" in refused(capsys, "plan", "a.svg", "--margin-px", "0")


def test_no_pulses_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "max_pulses is 0" in refused(capsys, "plan", "star", "--max-pulses", "0")


def test_text_for_a_number_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--max-pulses" in refused(capsys, "plan", "star", "--max-pulses", "many")


def test_an_unknown_planner_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    message = refused(capsys, "plan", "star", "--planner", "magic")
    assert "magic" in message
    assert "greedy" in message


@pytest.mark.parametrize("radius_um", ["0", "-1", "nan", "51"])
def test_a_wrong_radius_is_refused(radius_um: str, capsys: pytest.CaptureFixture[str]) -> None:
    refused(capsys, "plan", "star", "--pulse-radius-um", radius_um)


@pytest.mark.parametrize("pixel_um", ["0", "-1", "nan", "inf"])
def test_a_wrong_pixel_is_refused(pixel_um: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "pixel_um" in refused(capsys, "plan", "star", "--pixel-um", pixel_um)


@pytest.mark.parametrize("name", ["star:north", "star:nan", "random-shape:x", "random-shape:-1"])
def test_a_wrong_parameter_of_a_built_in_target_is_refused(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, "plan", name)


@pytest.mark.parametrize(
    ("option", "value"), [("--ink", "blood"), ("--fit", "tight"), ("--threshold", "2")]
)
def test_a_wrong_drawing_option_is_refused(
    option: str, value: str, capsys: pytest.CaptureFixture[str], assets: Path
) -> None:
    assert value in refused(capsys, "plan", str(assets / "logo.svg"), option, value)


def test_an_unknown_ending_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert ".gcode" in refused(capsys, "plan", "star", "-o", "a.doc")


def test_a_missing_folder_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "folder" in refused(capsys, "plan", "star", "-o", "nowhere/a.csv")


def test_a_folder_in_the_way_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("a.csv").mkdir()
    assert "is a folder" in refused(capsys, "plan", "star", "-o", "a.csv")


def test_a_file_given_twice_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "twice" in refused(capsys, "plan", "star", "-o", "a.png", "--preview", "a.png")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
def test_an_unwritable_output_fails(capsys: pytest.CaptureFixture[str]) -> None:
    Path("a.csv").symlink_to("/dev/full")
    code, lines = failure(capsys, "plan", "star", *GREEDY, "-o", "a.csv")
    assert code == 1
    assert [line.partition(":")[0] for line in lines] == ["error", "hint"]


def test_an_unknown_option_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--speed" in refused(capsys, "plan", "star", "--speed", "9")


def test_an_unknown_command_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "engrave" in refused(capsys, "engrave")


def test_a_missing_target_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert "TARGET" in refused(capsys, "plan")


def test_envs_lists_every_environment(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["envs", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["environments"]
    registered = {env_id for env_id in gym.registry if env_id.startswith("lasergym/")}
    assert {entry["id"] for entry in listed} == registered
    assert set(listed[0]["observation_spaces"]) == {"remaining", "layers"}
    assert listed[0]["arguments"]["max_pulses"] == 45
    assert main(["envs"]) == 0
    out = capsys.readouterr().out
    assert all(env_id in out for env_id in registered)


def test_bench_compares_the_same_work(capsys: pytest.CaptureFixture[str], assets: Path) -> None:
    oracle = assets.parent / "python" / "numpy_ablation.py"
    arguments = ["bench", "--envs", "1,3", "--seconds", "0", "--repetitions", "1", "--threads", "2"]
    arguments += ["--numpy-oracle", str(oracle), "--memory-envs", "8", "--json", "-o", "a.md"]
    assert main(arguments) == 0
    report = json.loads(capsys.readouterr().out)
    contestants = [
        *("lasergym", "lasergym", "lasergym, copy=True"),
        *("NumPy, window", "NumPy, whole grid", "SyncVectorEnv"),
    ]
    rows = report["throughput"]
    assert [row["contestant"] for row in rows] == contestants * 4
    assert all(row["steps_per_s"] > 0 and row["step_ns"] > 0 for row in rows)
    assert all(
        row["ratio"] == 1 for row in rows if row["contestant"] == "lasergym" and row["threads"] == 1
    )
    assert set(report["bytes_per_step"]) == {"Star", "RandomShape"}
    assert report["random_shape_us"] > 0
    markdown = Path("a.md").read_text(encoding="utf-8")
    assert markdown.count("\n| Star |") == markdown.count("\n| RandomShape |") == 12


def test_bench_goes_on_without_the_numpy_oracle(capsys: pytest.CaptureFixture[str]) -> None:
    quick = ["--envs", "1", "--seconds", "0", "--repetitions", "1", "--memory-envs", "0"]
    assert main(["bench", *quick, "--numpy-oracle", "none.py", "--markdown"]) == 0
    captured = capsys.readouterr()
    assert "none.py is not found" in captured.err
    assert "| NumPy" not in captured.out


@pytest.mark.parametrize("envs", ["", "a", "0", "1,,2", "-4"])
def test_a_wrong_list_of_environments_is_refused(
    envs: str, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(capsys, "bench", "--envs", envs)


def test_demo_leaves_plan_job_and_report(capsys: pytest.CaptureFixture[str], assets: Path) -> None:
    folder = Path("out/demo")
    for _ in range(2):  # a second demo begins anew
        assert main(["demo", str(assets / "thumbs_up.svg"), "-o", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "raster" in out
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    target = lasergym.targets.load(assets / "thumbs_up.svg")
    assert lasergym.score(target, plan["xy_px"]).reward == plan["reward"]
    program = (folder / "toolpath.nc").read_text(encoding="utf-8")
    assert len(lasergym.programs.from_gcode(program)) == plan["pulses"]
    job = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert job["machined_fraction"] > 0.94
    assert job["off_target_fraction"] < 0.05
    assert job["faults"] == []
    assert (folder / "report.html").is_file()


def test_demo_never_deletes_a_real_job(capsys: pytest.CaptureFixture[str], assets: Path) -> None:
    Path("job").mkdir()
    journal = Path("job/journal.jsonl")
    journal.write_text("precious", encoding="utf-8")
    assert main(["demo", str(assets / "thumbs_up.svg"), "-o", "job"]) == 2
    assert "holds a job already" in capsys.readouterr().err
    assert journal.read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize("planner", ["raster", "raster-fine", "greedy"])
@pytest.mark.parametrize("seed", range(5))
def test_playing_a_plan_gives_the_score_of_where_its_pulses_landed(
    planner: lasergym.PlannerName, seed: int
) -> None:
    target = lasergym.targets.random_shape(seed)
    plan = lasergym.plan(target, planner)
    env = gym.make(
        "lasergym/Pattern-v0", target=target, max_pulses=len(plan.actions), completion=1.0
    )
    env.reset(seed=0)
    reward, pulses, terminated = 0.0, 0, False
    while not terminated:
        _, gain, terminated, _, info = env.step(plan.actions[pulses])
        reward += float(gain)
        pulses += 1
    landed_px = plan.xy_px[:pulses].clip(0, 100)
    score = lasergym.score(target, 50 * (plan.actions[:pulses].astype(np.float64).clip(-1, 1) + 1))
    assert reward == pytest.approx(score.reward, abs=1e-9)
    assert info["machined_fraction"] == score.machined_fraction
    assert info["off_target_fraction"] == score.off_target_fraction
    assert score.reward == pytest.approx(lasergym.score(target, landed_px).reward, abs=0.003)
