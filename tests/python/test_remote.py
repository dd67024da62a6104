"""Robot with laser scanner: planning, programs, command, page, environment."""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import lasergym
from headless_browser import HeadlessBrowser, browser_path
from lasergym import remote
from lasergym.cli import main
from lasergym.errors import (
    ActionError,
    DrawingError,
    EpisodeOverError,
    InfeasibleTaskError,
    OptionError,
    RemoteError,
    RenderModeError,
    ShapeError,
)

ASSETS = Path(__file__).parents[1] / "assets"
EXCHANGER = ASSETS / "heat_exchanger.toml"

SMALL = """
name = "small"
[[subtask]]
kind = "circle"
center_mm = [0.0, 0.0]
radius_mm = 10.0
exposures = 3
[[subtask]]
name = "long"
kind = "line"
from_mm = [100.0, 0.0]
to_mm = [130.0, 0.0]
"""


@pytest.fixture(scope="module")
def exchanger() -> remote.RemotePlan:
    return remote.plan_file(EXCHANGER)


def test_the_heat_exchanger_has_two_lines(exchanger: remote.RemotePlan) -> None:
    assert [len(line.stops) for line in exchanger.lines] == [4, 4]
    assert exchanger.tour_mm == pytest.approx(1930)
    assert sorted(stop.subtask for stop in exchanger.stops) == list(range(8))
    for stop in exchanger.stops:
        # 150 - 60 mm, less 2 µm for the scanner's clock.
        assert stop.scan_radius_mm == pytest.approx(89.998)
        distance = np.hypot(*(stop.path_mm - stop.center_mm).T)
        np.testing.assert_allclose(distance, 60, rtol=1e-12)
    total_s = sum(line.whole_time_s + line.approach_s for line in exchanger.lines)
    assert total_s == pytest.approx(exchanger.cycle_time_s)


def test_every_section_lies_in_its_scan_circle(exchanger: remote.RemotePlan) -> None:
    for line in exchanger.lines:
        assert line.length_mm == pytest.approx(line.time_s * line.speed_mm_s)
        for index, section in zip(line.stops, line.sections_mm, strict=True):
            stop = exchanger.stops[index]
            assert section[1] - section[0] == pytest.approx(stop.time_s * line.speed_mm_s)
            for way in section:
                x, y = np.subtract(line.place_mm(way), stop.center_mm)
                assert np.hypot(x, y) <= stop.scan_radius_mm + 1e-6


def test_the_simulation_accepts_every_choice() -> None:
    cycle_s: dict[str, float] = {}
    choices: tuple[remote.Choice, ...] = ("initial", "greedy", "greedy-any-direction", "joint")
    for choice in choices:
        plan = remote.plan_file(EXCHANGER, choice=choice)
        simulation = plan.simulate()
        assert simulation.problems == ()
        assert simulation.max_seam_error_mm < 0.05
        assert simulation.max_speed_error < 0.01
        assert simulation.max_field_mm <= 150
        assert simulation.total_s == pytest.approx(plan.cycle_time_s, abs=0.01)
        assert simulation.laser_s == pytest.approx(plan.laser_s)
        cycle_s[choice] = plan.cycle_time_s
    assert cycle_s["joint"] == min(cycle_s.values())


def test_samples_of_the_simulation_follow_the_beam(exchanger: remote.RemotePlan) -> None:
    simulation = exchanger.simulate(sample_s=0.01)
    assert (np.diff(simulation.time_s) > 0).all()
    np.testing.assert_allclose(
        simulation.robot_mm[:, :2] + simulation.field_mm, simulation.beam_mm[:, :2], atol=1e-9
    )
    centers = np.array([stop.center_mm for stop in exchanger.stops])
    beam = simulation.beam_mm[simulation.laser, None, :2] - centers
    np.testing.assert_allclose(np.hypot(*beam.T).min(axis=0), 60, atol=0.01)


def test_programs_start_the_scanner_once_a_line(exchanger: remote.RemotePlan) -> None:
    programs = exchanger.programs()
    assert programs.krl_name == "HEAT_EXCHANGER"
    assert programs.krl_src.count("TRIGGER WHEN PATH=") == 2
    assert programs.krl_src.count("\nLIN ") == programs.krl_src.count("\nPTP ") == 2
    points = re.findall(r"^DECL FRAME (P\d+)=", programs.krl_dat, re.MULTILINE)
    used = re.findall(r"^(?:PTP|LIN) (P\d+)$", programs.krl_src, re.MULTILINE)
    assert points == used
    assert programs.scanner_rtc.count("set_start_list(") == 2
    assert programs.robot_csv.splitlines()[0].startswith("move,x_mm")
    vectors = [row.split(",") for row in programs.scanner_csv.splitlines()[1:]]
    laser_cycles = sum(int(vector[1]) for vector in vectors if vector[4] == "1")
    assert laser_cycles * 1e-5 == pytest.approx(exchanger.laser_s)


def test_infeasible_tasks_say_which_subtask_why_and_what_helps() -> None:
    large = SMALL.replace("radius_mm = 10.0", "radius_mm = 200.0\nsplit = false")
    with pytest.raises(InfeasibleTaskError, match=r"circle 1 .*200\.0 mm.*150\.0 mm.*split"):
        remote.plan(large)
    slow = SMALL.replace("exposures = 3", "exposures = 90000")
    with pytest.raises(InfeasibleTaskError, match=r"circle 1 takes .*at most \d+ exposures"):
        remote.plan(slow)
    short = SMALL.replace("to_mm = [130.0", "to_mm = [100.5")
    with pytest.raises(InfeasibleTaskError, match=r"of long .*set speed_mm_s to"):
        remote.plan(short)


def test_bad_tasks_and_options_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RemoteError, match="colour"):
        remote.plan(SMALL + "colour = 1\n")
    with pytest.raises(OptionError, match="field_radius_mm"):
        remote.plan("[scanner]\nfield_radius_mm = -1.0\n" + SMALL.replace('name = "small"', ""))
    with pytest.raises(OptionError, match="choice"):
        remote.plan(SMALL, choice="best")  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="directions"):
        remote.plan(SMALL, directions=1)
    with pytest.raises(DrawingError):
        remote.plan('[[drawing]]\nfile = "none.svg"\n', folder=tmp_path)
    (tmp_path / "task.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(RemoteError, match="UTF-8"):
        remote.plan_file(tmp_path / "task.toml")


def test_drawings_are_cut(tmp_path: Path) -> None:
    (tmp_path / "bracket.dxf").write_bytes((ASSETS / "bracket.dxf").read_bytes())
    task = tmp_path / "task.toml"
    task.write_text('[[drawing]]\nfile = "bracket.dxf"\nspeed_mm_s = 500.0\n', encoding="utf-8")
    plan = remote.plan_file(task)
    assert len(plan.stops) == 4
    assert plan.simulate().problems == ()


def test_best_line_of_one_circle_goes_through_its_centre() -> None:
    line = remote.best_line([[3.0, 4.0, 90.0, 0.4]], direction_deg=90)
    assert line is not None
    assert line.offset_mm == pytest.approx(3)
    assert line.length_mm == pytest.approx(80)
    assert remote.best_line([[0, 0, 10, 0.4], [500, 0, 10, 0.4], [250, 90, 10, 0.4]]) is None
    with pytest.raises(ShapeError):
        remote.best_line([[1.0, 2.0, 3.0]])
    with pytest.raises(OptionError):
        remote.best_line([[0, 0, 10, 0.1]], slowest_mm_s=0)
    with pytest.raises(OptionError):
        remote.best_line([[np.nan, 0, 10, 0.1]])


def test_lines_equal_an_independent_linear_program() -> None:
    pytest.importorskip("scipy")
    from remote_linear_program import compare

    feasible, disagreements, largest_mm = compare(20)
    assert feasible > 3
    assert disagreements == 0
    assert largest_mm < 1e-6


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    code = main(arguments)
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_the_command_writes_a_job(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    job = tmp_path / "job"
    code, out, err = run(capsys, "remote", str(EXCHANGER), "-o", str(job), "--json")
    assert code == 0, err
    report = json.loads(out)
    assert report == json.loads((job / "report.json").read_text(encoding="utf-8"))
    assert report["lines"] == 2
    assert report["feasible"] is True
    assert report["max_seam_error_mm"] < 0.05
    assert report["tour_mm"] == pytest.approx(1930)
    assert 0 < report["laser_s"] < report["line_time_s"] < report["cycle_time_s"]
    names = ("heat_exchanger.src", "heat_exchanger.dat", "robot.csv", "scanner.csv", "scanner.rtc")
    for name in (*names, "animation.html"):
        assert (job / name).stat().st_size > 100
    page = (job / "animation.html").read_text(encoding="utf-8")
    assert "{{" not in page
    assert not re.search(r"""(?:src|href)\s*=\s*["']""", page)


def test_the_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capsys, "remote", str(EXCHANGER), "--choice", "greedy")
    assert code == 0
    assert "200.0 mm/s" in out


def test_the_command_refuses_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    task = tmp_path / "task.toml"
    task.write_text(SMALL.replace("center_mm", "centre_mm"), encoding="utf-8")
    for arguments, words in (
        ((str(task),), "centre_mm"),
        ((str(tmp_path / "none.toml"),), "none.toml"),
        ((str(EXCHANGER), "--choice", "best"), "choice"),
        ((str(EXCHANGER), "-o", str(task)), "folder"),
    ):
        code, out, err = run(capsys, "remote", *arguments)
        assert code in (1, 2)
        assert out == ""
        assert "error:" in err
        assert words in err


@pytest.mark.skipif(browser_path() is None, reason="needs a Chromium")
def test_the_page_plays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "remote", str(EXCHANGER), "-o", str(tmp_path))[0] == 0
    url = (tmp_path / "animation.html").as_uri()
    with HeadlessBrowser(url, width_px=1100, height_px=900) as browser:
        browser.click("#play")
        before = browser.evaluate("document.getElementById('now').textContent")
        browser.evaluate(
            "(() => { const t = document.getElementById('time'); t.value = 400;"
            " t.dispatchEvent(new Event('input')); return 0; })()"
        )
        assert browser.evaluate("document.getElementById('now').textContent") != before
        assert browser.evaluate("document.querySelectorAll('dd').length") == 7
        assert browser.problems == []


@pytest.mark.parametrize("render_mode", [None, "rgb_array", "ansi"])
def test_gymnasium_finds_no_fault(render_mode: str | None) -> None:
    env = gym.make("lasergym/RemoteScan-v0", render_mode=render_mode)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=render_mode is None)
    env.close()


def test_stable_baselines3_finds_no_fault() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gym.make("lasergym/RemoteScan-v0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(env, warn=True)


def test_the_return_is_minus_the_cycle_time() -> None:
    env = lasergym.envs.RemoteScanEnv(subtasks=6)
    observation, info = env.reset(seed=3)
    assert observation in env.observation_space
    assert info == {"done": 0, "lines": 0, "cycle_time_s": 0.0}
    total = 0.0
    for subtask in range(6):
        observation, reward, terminated, truncated, info = env.step(np.array([subtask, 0]))
        assert observation in env.observation_space
        total += reward
        assert not truncated
        assert terminated == (subtask == 5)
    assert info["is_success"]
    assert info["done"] == 6
    assert total == pytest.approx(-info["cycle_time_s"])
    with pytest.raises(EpisodeOverError):
        env.step(np.array([0, 0]))


def test_the_planner_is_a_baseline_for_the_environment() -> None:
    env = lasergym.envs.RemoteScanEnv(subtasks=8)
    for seed in range(3):
        env.reset(seed=seed)
        joint_s, greedy_s, actions = env.planned()
        assert joint_s <= greedy_s
        total = 0.0
        for action in actions:
            _, reward, _, _, info = env.step(np.array(action))
            total += reward
        assert info["is_success"]
        # Directions are rounded, and lines take what they find.
        assert -total >= joint_s - 1e-6


def test_bad_actions_are_refused() -> None:
    env = lasergym.envs.RemoteScanEnv(subtasks=4)
    env.reset(seed=0)
    for action in ([4, 0], [0, 17], [-1, 0], [0.5, 1.0], [0], [[0, 0]]):
        with pytest.raises(ActionError):
            env.step(np.array(action))
    with pytest.raises(OptionError):
        lasergym.envs.RemoteScanEnv(subtasks=0)
    with pytest.raises(OptionError):
        lasergym.envs.RemoteScanEnv(welded=2.0)
    with pytest.raises(RenderModeError):
        lasergym.envs.RemoteScanEnv(render_mode="svg")
    with pytest.raises(OptionError, match="there are none"):
        env.reset(options={"target": None})


def test_saved_states_replay() -> None:
    env = lasergym.envs.RemoteScanEnv(subtasks=4)
    env.reset(seed=5)
    env.step(np.array([1, 3]))
    state = env.clone_state()
    first, reward, *_ = env.step(np.array([2, 0]))
    for _ in range(2):
        env.restore_state(state)
        again, same, *_ = env.step(np.array([2, 0]))
        assert (again == first).all()
        assert same == reward


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_vector_environments_equal_single_ones(mode: AutoresetMode) -> None:
    count, settings = 3, {"subtasks": 3}
    envs = gym.make_vec("lasergym/RemoteScan-v0", num_envs=count, autoreset_mode=mode, **settings)
    assert isinstance(envs.unwrapped, lasergym.envs.RemoteScanVectorEnv)
    singles = [lasergym.envs.RemoteScanEnv(subtasks=3) for _ in range(count)]
    observations, _ = envs.reset(seed=5)
    expected = np.stack([env.reset(seed=5 + k)[0] for k, env in enumerate(singles)])
    np.testing.assert_array_equal(observations, expected)
    generator = np.random.default_rng(0)
    over = np.zeros(count, np.bool_)
    for _ in range(30):
        if mode == AutoresetMode.DISABLED and over.any():
            observations, _ = envs.reset(options={"reset_mask": over})
            for k in np.flatnonzero(over):
                np.testing.assert_array_equal(observations[k], singles[k].reset()[0])
            over[:] = False
        actions = generator.integers([3, 17], size=(count, 2))
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        assert not truncated.any()
        for k, env in enumerate(singles):
            if mode == AutoresetMode.NEXT_STEP and over[k]:
                np.testing.assert_array_equal(observations[k], env.reset()[0])
                assert rewards[k] == 0
                over[k] = False
                continue
            observation, reward, ended, _, info = env.step(actions[k])
            assert (rewards[k], terminated[k]) == (reward, ended)
            if ended and mode == AutoresetMode.SAME_STEP:
                np.testing.assert_array_equal(infos["final_obs"][k], observation)
                assert infos["final_info"]["is_success"][k] == info["is_success"]
                observation = env.reset()[0]
            elif ended:
                over[k] = True
            np.testing.assert_array_equal(observations[k], observation)


def test_vector_environments_truncate_and_check() -> None:
    envs = gym.make_vec("lasergym/RemoteScan-v0", num_envs=2, max_episode_steps=2)
    envs.reset(seed=1)
    for step in range(2):
        *_, truncated, infos = envs.step(np.array([[step, 0], [step, 1]]))
    assert truncated.all()
    assert infos["episode"]["l"].tolist() == [2, 2]
    with pytest.raises(ActionError):
        envs.step(np.zeros((2, 3), np.int64))
    with pytest.raises(ShapeError):
        envs.reset(options={"reset_mask": np.zeros(2, np.bool_)})
    with pytest.raises(OptionError):
        envs.reset(options={"target": 1})
