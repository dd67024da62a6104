import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lasergym
from lasergym import targets
from lasergym.comparison import CompareOptions, Progress, PulseBudget, compare
from lasergym.comparison.farm import FarmError, run_local
from lasergym.comparison.options import Effort
from lasergym.comparison.statistics import group_rows, summarise
from lasergym.comparison.store import ResultsError, ResultStore
from lasergym.comparison.table import ResultTable
from lasergym.comparison.tasks import (
    AREA_CLASSES_PX,
    FIRST_HELD_OUT_SEED,
    TaskTarget,
    area_class_px,
    task_targets,
)
from lasergym.comparison.work import Row, WorkItem, derive_seed, run_item, work_items
from lasergym.errors import MissingExtraError, OptionError, PlanError

FAST = ("raster", "raster-fine", "greedy")


def without_time(rows: tuple[Row, ...]) -> list[Row]:
    return [replace(row, elapsed_s=0.0) for row in rows]


def row(target: str, planner: str, reward: float, area_px: int = 5000, **figures: float) -> Row:
    defaults = {"machined_fraction": 0.9, "off_target_fraction": 0.1, "elapsed_s": 1.0}
    return Row(
        task="star",
        target=target,
        planner=planner,
        seed=1,
        area_px=area_px,
        max_pulses=45,
        pulses=1,
        reward=reward,
        xy_px=((50.0, 50.0),),
        **{**defaults, **figures},
    )


# Tasks and budgets


def test_area_classes_are_those_of_the_paper() -> None:
    assert AREA_CLASSES_PX == (
        (3000, 3500),
        (3500, 4000),
        (4000, 4500),
        (4500, 5000),
        (5000, 5500),
        (5500, 6000),
        (6000, 6500),
    )
    assert area_class_px(2999) is None
    assert area_class_px(3000) == (3000, 3500)
    assert area_class_px(3499) == (3000, 3500)
    assert area_class_px(3500) == (3500, 4000)
    assert area_class_px(6500) is None


def test_random_shapes_are_the_first_held_out_ones_of_each_class() -> None:
    made = list(task_targets(CompareOptions(tasks=("random-shapes",), shapes=2)))
    assert len(made) == 14
    chosen: dict[tuple[int, int], list[int]] = {bounds_px: [] for bounds_px in AREA_CLASSES_PX}
    seed = FIRST_HELD_OUT_SEED
    while any(len(seeds) < 2 for seeds in chosen.values()):
        bounds_px = area_class_px(int(targets.random_shape(seed).sum()))
        if bounds_px is not None and len(chosen[bounds_px]) < 2:
            chosen[bounds_px].append(seed)
        seed += 1
    expected = sorted(seed for seeds in chosen.values() for seed in seeds)
    assert [one.name for one in made] == [f"random-shape:{seed}" for seed in expected]
    for one, seed in zip(made, expected, strict=True):
        assert np.array_equal(one.target, targets.random_shape(seed))
        assert one.max_pulses == math.ceil(one.area_px / 125)


@pytest.mark.parametrize(("angles", "third_deg"), [(360, 2), (4, 180), (7, 102)])
def test_angles_are_whole_degrees_spread_over_the_circle(angles: int, third_deg: int) -> None:
    made = list(task_targets(CompareOptions(tasks=("rotated-star",), angles=angles)))
    assert len({one.name for one in made}) == angles
    assert made[0].name == "star:0"
    assert made[2].name == f"star:{third_deg}"
    assert np.array_equal(made[2].target, targets.star(third_deg))
    assert {one.max_pulses for one in made} == {45}


def test_a_folder_gives_its_drawings_in_order(assets: Path) -> None:
    made = list(task_targets(CompareOptions(tasks=("folder",), folders=(assets,))))
    assert [one.name for one in made] == [
        "bracket.dxf",
        "ellipse.svg",
        "logo.svg",
        "thumbs_up.png",
        "thumbs_up.svg",
    ]
    assert {one.task for one in made} == {"folder:assets"}


@pytest.mark.parametrize(
    ("text", "area_px", "pulses"),
    [("45", 3000, 45), ("area/125", 3000, 24), ("area/125", 3001, 25), ("area/62.5", 125, 2)],
)
def test_a_budget_is_a_number_or_grows_with_the_area(text: str, area_px: int, pulses: int) -> None:
    budget = PulseBudget.parse(text)
    assert budget.pulses_for(area_px) == pulses
    assert PulseBudget.parse(str(budget)) == budget


@pytest.mark.parametrize("text", ["0", "-3", "10001", "area/0", "area/", "area/-1", "many", ""])
def test_an_impossible_budget_is_refused(text: str) -> None:
    with pytest.raises(OptionError, match="max_pulses is"):
        PulseBudget.parse(text)


# Options


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"planners": ("simplex",)}, "'simplex' is no planner"),
        ({"planners": ()}, "no planner is given"),
        ({"planners": ("greedy", "greedy")}, "given twice"),
        ({"tasks": ("moon",)}, "'moon' is no task"),
        ({"tasks": ("folder",)}, "needs a folder"),
        ({"anneal_s": 0.0}, "anneal_s is 0"),
        ({"cma_es_s": math.nan}, "cma_es_s is nan"),
        ({"anneal_iterations": 0}, "anneal_iterations is 0"),
        ({"angles": 0}, "angles is 0"),
        ({"angles": 361}, "angles is 361"),
        ({"shapes": 0}, "shapes is 0"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_impossible_options_are_refused(options: dict[str, object], reason: str) -> None:
    with pytest.raises(OptionError, match=reason):
        CompareOptions(**options)  # type: ignore[arg-type]


def test_a_folder_without_drawings_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing to machine")
    with pytest.raises(OptionError, match="holds no drawing"):
        list(task_targets(CompareOptions(tasks=("folder",), folders=(tmp_path,))))


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="is no folder"):
        list(task_targets(CompareOptions(tasks=("folder",), folders=(tmp_path / "none",))))


def test_two_folders_of_one_name_are_refused(assets: Path) -> None:
    with pytest.raises(OptionError, match="two folders"):
        list(task_targets(CompareOptions(tasks=("folder",), folders=(assets, assets))))


def test_a_broken_drawing_is_named(tmp_path: Path) -> None:
    (tmp_path / "broken.svg").write_text("<svg")
    with pytest.raises(lasergym.errors.DrawingError, match=r"broken\.svg"):
        list(task_targets(CompareOptions(tasks=("folder",), folders=(tmp_path,))))


# Work items


def test_an_item_does_what_plan_does() -> None:
    options = CompareOptions(planners=FAST, max_pulses=PulseBudget(20))
    (made,) = task_targets(options)
    for item in work_items(options, made):
        result = run_item(item)
        plan = lasergym.plan(targets.star(), item.planner, max_pulses=20)  # type: ignore[arg-type]
        assert result is not None
        assert result.xy_px == tuple(map(tuple, plan.xy_px.tolist()))
        assert (result.reward, result.pulses) == (plan.reward, plan.pulses)
        rescored = lasergym.score(targets.star(), result.xy_px)
        assert rescored.reward == result.reward
        assert result.reward_per_area == pytest.approx(plan.reward * 1e4 / 4842)


def test_seeds_depend_on_every_name_and_on_the_seed() -> None:
    names = [("star", "star", "anneal"), ("star", "star", "cma-es"), ("rotated-star", "star:0", "")]
    seeds = {derive_seed(seed, *name) for seed in (0, 1) for name in names}
    assert len(seeds) == 6
    assert derive_seed(0, "a", "bc", "d") != derive_seed(0, "ab", "c", "d")


def test_seed_and_iterations_reach_a_planner_that_takes_them() -> None:
    options = CompareOptions(planners=("anneal",), anneal_iterations=2000)
    (made,) = task_targets(options)
    (item,) = work_items(options, made)
    first, again = run_item(item), run_item(item)
    other = run_item(replace(item, seed=item.seed + 1))
    assert first is not None
    assert again is not None
    assert other is not None
    assert without_time((first,)) == without_time((again,))
    assert first.xy_px != other.xy_px


def test_efforts_are_for_planners_with_a_budget() -> None:
    options = CompareOptions(anneal_s=2.0, cma_es_iterations=500)
    efforts = {planner: options.effort(planner) for planner in options.planners}
    assert efforts["greedy"] == Effort(None, None)
    assert efforts["anneal"] == Effort(2.0, None)
    assert efforts["cma-es"] == Effort(None, 500)


def test_an_item_that_is_stopped_has_no_result() -> None:
    options = CompareOptions(planners=("anneal",), anneal_s=60.0)
    (made,) = task_targets(options)
    (item,) = work_items(options, made)
    assert run_item(item, lambda: True) is None


def test_an_item_that_cannot_be_planned_is_named() -> None:
    empty = TaskTarget("folder:x", "empty.png", np.zeros((100, 100), dtype=np.bool_), 45)
    (item,) = work_items(CompareOptions(planners=("greedy",)), empty)
    with pytest.raises(PlanError, match=r"greedy on empty\.png"):
        run_item(item)


# Statistics and tables


def test_means_and_spreads_match_figures_made_by_hand() -> None:
    summary = summarise([1.0, 2.0, 3.0, 6.0])
    assert summary.mean == 3.0
    assert summary.spread == pytest.approx(math.sqrt(14 / 3))
    assert summarise([2.5]).spread is None


def test_groups_and_wins_match_figures_made_by_hand() -> None:
    rows = [
        row("a", "greedy", 0.40, machined_fraction=0.90, off_target_fraction=0.10, elapsed_s=1.0),
        row("b", "greedy", 0.45, machined_fraction=0.96, off_target_fraction=0.06, elapsed_s=3.0),
        row("c", "greedy", 0.20, area_px=2500, machined_fraction=0.84, off_target_fraction=0.04),
        row("a", "anneal", 0.42),
        row("b", "anneal", 0.45),
        row("c", "anneal", 0.19, area_px=2500),
    ]
    (group,) = group_rows(rows, ("greedy", "anneal"))
    greedy = group.figures["greedy"]
    assert group.targets == 3
    assert greedy["machined_percent"].mean == pytest.approx(90.0)
    assert greedy["machined_percent"].spread == pytest.approx(6.0)
    assert greedy["off_target_percent"].mean == pytest.approx(20 / 3)
    assert greedy["reward"].mean == pytest.approx(0.35)
    assert greedy["reward"].spread == pytest.approx(math.sqrt(0.0175))
    assert greedy["reward_per_area"].mean == pytest.approx((0.8 + 0.9 + 0.8) / 3)
    assert greedy["elapsed_s"].mean == pytest.approx(5 / 3)
    wins = {(pair.planner, pair.other): pair for pair in group.wins}
    assert set(wins) == {("greedy", "anneal"), ("anneal", "greedy")}
    anneal = wins["anneal", "greedy"]
    assert (anneal.at_least, anneal.better, anneal.targets) == (2, 1, 3)
    assert (wins["greedy", "anneal"].at_least, wins["greedy", "anneal"].better) == (2, 1)
    # Differences of reward · 10⁴ / area are 0.04, 0 and −0.04.
    assert anneal.difference.mean == pytest.approx(0.0)
    assert anneal.standard_error == pytest.approx(0.04 / math.sqrt(3))


def test_wins_count_only_targets_that_both_have_done() -> None:
    rows = [row("a", "greedy", 0.4), row("b", "greedy", 0.4), row("b", "anneal", 0.5)]
    (group,) = group_rows(rows, ("greedy", "anneal"))
    assert {(pair.at_least, pair.targets) for pair in group.wins} == {(0, 1), (1, 1)}


def test_random_shapes_are_summed_up_by_area_class_too() -> None:
    rows = [
        replace(row(name, "greedy", 0.3, area_px=area_px), task="random-shapes")
        for name, area_px in (("a", 3100), ("b", 3499), ("c", 6000))
    ]
    groups = group_rows(rows, ("greedy",))
    assert [(group.name, group.targets) for group in groups] == [
        ("random-shapes", 3),
        ("random-shapes, 3000–3500 px", 2),
        ("random-shapes, 6000–6500 px", 1),
    ]


def test_tables_hold_means_spreads_wins_and_settings() -> None:
    rows = [row("a", "greedy", 0.40), row("b", "greedy", 0.44), row("a", "anneal", 0.45)]
    planners = ("greedy", "anneal")
    table = ResultTable(planners, group_rows(rows, planners), {"seed": 7})
    lines = table.markdown().splitlines()
    assert "|  | greedy | anneal | RL / CMA-ES of Xie et al. (2022) |" in lines
    assert "| total reward | 0.4200 ± 0.0283 | 0.4500 | 0.462 / 0.465 |" in lines
    assert "| anneal | 1/1 |  |" in lines
    assert "- seed: 7" in lines
    cells = [line.split(",") for line in table.csv().splitlines()]
    assert ["star", "anneal", "reward", "1", "0.45", ""] in cells
    assert all(len(line) == 6 for line in cells)


# Results on disk


def test_rows_come_back_bit_for_bit(tmp_path: Path) -> None:
    written = replace(
        row('a "strange", name.svg', "greedy", 1 / 3, elapsed_s=1e-7),
        pulses=2,
        xy_px=((0.1 + 0.2, 1e-17), (99.99999999999999, 5.0)),
    )
    with ResultStore(tmp_path, {}) as store:
        store.append(written)
    with ResultStore(tmp_path, {}) as store:
        assert store.rows == {written.key: written}


def test_a_torn_last_line_is_dropped_wherever_it_is_torn(tmp_path: Path) -> None:
    first, second = row("a", "greedy", 0.4), row("b", "greedy", 0.5)
    with ResultStore(tmp_path, {}) as store:
        store.append(first)
        store.append(second)
    path = tmp_path / "results.csv"
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with ResultStore(tmp_path, {}) as store:
            for missing in (first, second):
                if missing.key not in store.rows:
                    store.append(missing)
        assert path.read_bytes() == whole


def test_other_settings_are_refused_and_named(tmp_path: Path) -> None:
    ResultStore(tmp_path, {"seed": 0, "planners": ["greedy"]}).close()
    with pytest.raises(ResultsError, match="seed was 0 and is 1") as caught:
        ResultStore(tmp_path, {"seed": 1, "planners": ["greedy"]})
    assert "planners" not in str(caught.value)


@pytest.mark.parametrize("line", ["star,a,greedy,1", "star,a,greedy,1,5000,45,2,1,0,1,1,5 5", "x"])
def test_a_damaged_line_is_named(tmp_path: Path, line: str) -> None:
    ResultStore(tmp_path, {}).close()
    with (tmp_path / "results.csv").open("a") as file:
        file.write(line + "\n")
    with pytest.raises(ResultsError, match="line 2"):
        ResultStore(tmp_path, {})


def test_results_without_settings_are_refused(tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_text("something\n")
    with pytest.raises(ResultsError, match=r"no settings\.json"):
        ResultStore(tmp_path, {})


def test_settings_that_are_no_json_are_refused(tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_text("{")
    with pytest.raises(ResultsError, match="is no JSON"):
        ResultStore(tmp_path, {})


def test_results_of_other_columns_are_refused(tmp_path: Path) -> None:
    ResultStore(tmp_path, {}).close()
    (tmp_path / "results.csv").write_text("a,b\n")
    with pytest.raises(ResultsError, match="other columns"):
        ResultStore(tmp_path, {})


# The whole


def small(**changes: object) -> CompareOptions:
    settings: dict[str, object] = {
        "tasks": ("rotated-star",),
        "angles": 4,
        "planners": (*FAST, "anneal"),
        "anneal_iterations": 2000,
    }
    return CompareOptions(**{**settings, **changes})  # type: ignore[arg-type]


def test_a_killed_run_goes_on_where_it_stopped(tmp_path: Path) -> None:
    whole = compare(small(), tmp_path, jobs=1, pictures=False)
    results = tmp_path / "results.csv"
    lines = results.read_bytes().splitlines(keepends=True)
    results.write_bytes(b"".join(lines[:6]) + lines[6][:20])
    seen: list[Progress] = []
    again = compare(small(), tmp_path, jobs=1, pictures=False, progress=seen.append)
    assert (seen[0].done, seen[0].total) == (5, 16)
    assert [progress.done for progress in seen] == list(range(5, 17))
    assert seen[-1].remaining_s == 0.0
    assert again.rows[:5] == whole.rows[:5]
    assert without_time(again.rows) == without_time(whole.rows)
    finished = results.read_bytes()
    compare(small(), tmp_path, jobs=1, pictures=False)
    assert results.read_bytes() == finished


def test_an_interrupted_run_keeps_what_is_done(tmp_path: Path) -> None:
    def interrupt(progress: Progress) -> None:
        if progress.done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        compare(small(), tmp_path, jobs=1, pictures=False, progress=interrupt)
    seen: list[Progress] = []
    compare(small(), tmp_path, jobs=1, pictures=False, progress=seen.append)
    assert seen[0].done == 3


def test_two_workers_find_what_one_finds(tmp_path: Path) -> None:
    alone = compare(small(), tmp_path / "1", jobs=1, pictures=False)
    together = compare(small(), tmp_path / "2", jobs=2, pictures=False)
    assert without_time(alone.rows) == without_time(together.rows)


def test_an_error_in_a_worker_process_reaches_the_caller() -> None:
    bits = bytes(1250)
    items = [WorkItem("task", name, "greedy", 0, 45, Effort(), bits) for name in ("a.png", "b.png")]
    with pytest.raises(PlanError, match=r"greedy on .\.png"):
        list(run_local(items, 2))


def test_ray_finds_what_one_process_finds(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    options = small(angles=2)
    alone = compare(options, tmp_path / "local", jobs=1, pictures=False)
    on_ray = compare(options, tmp_path / "ray", jobs=1, ray_address="local", pictures=False)
    assert without_time(alone.rows) == without_time(on_ray.rows)


def test_a_ray_cluster_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    pytest.importorskip("ray")
    with pytest.raises(FarmError, match="cannot be reached"):
        compare(small(), tmp_path, ray_address="auto", pictures=False)


def test_drawings_may_move_but_not_change(tmp_path: Path) -> None:
    output = tmp_path / "out"
    for place in ("here", "there"):
        folder = tmp_path / place / "parts"
        folder.mkdir(parents=True)
        targets.save(targets.star(), folder / "star.png")
        options = small(tasks=("folder",), folders=(folder,), planners=("raster",))
        compare(options, output, jobs=1, pictures=False)
    targets.save(targets.star(20), folder / "star.png")
    with pytest.raises(ResultsError, match="targets was"):
        compare(options, output, jobs=1, pictures=False)


def test_pictures_show_what_was_compared(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    options = CompareOptions(tasks=("star", "rotated-star"), angles=4, planners=FAST)
    made = compare(options, tmp_path, jobs=1, shown=("star:90",))
    names = {path.name for path in made.files}
    assert {"rotated_star.png", "cost_quality.svg", "trajectories_rotated_star.svg"} <= names
    for path in made.files:
        start = path.read_bytes()[:100]
        if path.suffix == ".png":
            assert start.startswith(b"\x89PNG")
        elif path.suffix == ".svg":
            assert b"<svg" in start or b"<?xml" in start
    svg = (tmp_path / "trajectories_rotated_star.svg").read_text(encoding="utf-8")
    assert ">star:90<" in svg
    assert ">star:0<" not in svg
    assert svg.count("<clipPath") == len(FAST) == len(set(svg.split('<clipPath id="')[1:]))


def test_an_unknown_shown_target_is_refused_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match="no target is named 'moon'"):
        compare(small(), tmp_path / "out", jobs=1, pictures=False, shown=("moon",))
    assert not (tmp_path / "out").exists()


def test_missing_matplotlib_is_said_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"lasergym\[plots\]"):
        compare(small(), tmp_path / "out", jobs=1)
    assert not (tmp_path / "out").exists()


def test_missing_ray_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    with pytest.raises(MissingExtraError, match=r"lasergym\[ray\]"):
        compare(small(), tmp_path, ray_address="local", pictures=False)


@pytest.mark.parametrize("jobs", [0, -1, 1025])
def test_an_impossible_number_of_jobs_is_refused(tmp_path: Path, jobs: int) -> None:
    with pytest.raises(OptionError, match="jobs is"):
        compare(small(), tmp_path, jobs=jobs, pictures=False)
