"""Planners from Python: their figures, budgets, order, and what they refuse."""

import math
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lasergym
from lasergym import errors

FAST: dict[str, dict[str, Any]] = {
    "raster": {},
    "raster-fine": {},
    "greedy": {},
    "anneal": {"iterations": 20_000},
    "cma-es": {"iterations": 2_000},
}


@settings(max_examples=25, deadline=None)
@given(
    planner=st.sampled_from(sorted(FAST)),
    seed=st.integers(0, 10_000),
    max_pulses=st.integers(1, 50),
    radius=st.one_of(st.just(9.0), st.floats(3.0, 20.0)),
)
def test_a_plan_scores_what_it_says_and_what_the_environment_says(
    planner: Any, seed: int, max_pulses: int, radius: float
) -> None:
    target = lasergym.targets.random_shape(seed)
    plan = lasergym.plan(
        target, planner, max_pulses=max_pulses, pulse_radius_px=radius, **FAST[planner]
    )
    assert plan.score == lasergym.score(target, plan.xy_px, radius)
    assert plan.pulses == len(plan.xy_px)
    assert planner.startswith("raster") or plan.pulses <= max_pulses
    env = gym.make(
        "lasergym/Pattern-v0",
        target=target,
        pulse_radius_px=radius,
        max_pulses=max(plan.pulses, 1),
        completion=1.0,
        disable_env_checker=True,
    )
    env.reset(seed=0)
    rewards, fired = 0.0, 0
    terminated = False
    for action in plan.actions:
        if terminated:  # A raster goes on where nothing of the target is left.
            break
        _, reward, terminated, _, _ = env.step(action)
        rewards, fired = rewards + float(reward), fired + 1
    done = lasergym.score(target, plan.xy_px[:fired], radius)
    assert rewards == pytest.approx(done.reward, abs=1e-12)
    assert done.reward >= plan.reward - 1e-12


@pytest.mark.parametrize("planner", ["anneal", "cma-es"])
def test_a_seed_gives_the_same_plan_on_any_number_of_threads(planner: Any) -> None:
    target = lasergym.targets.star(12.0)
    plans = [
        lasergym.plan(target, planner, seed=seed, threads=threads, **FAST[planner])
        for seed, threads in ((3, 1), (3, 2), (4, 1))
    ]
    np.testing.assert_array_equal(plans[0].xy_px, plans[1].xy_px)
    assert not np.array_equal(plans[0].xy_px, plans[2].xy_px)


def test_annealing_is_never_worse_than_its_start() -> None:
    target = lasergym.targets.random_shape(5)
    start = lasergym.plan(target, "greedy", max_pulses=30)
    plan = lasergym.plan(target, "anneal", max_pulses=30, start=start.xy_px, iterations=1000)
    assert plan.reward >= start.reward


def test_a_partly_machined_workpiece_is_completed() -> None:
    env: Any = gym.make("lasergym/Star-v0").unwrapped
    env.reset(seed=0)
    env.step(np.zeros(2, np.float32))
    env.step(np.full(2, -0.9, np.float32))
    plan = lasergym.plan(
        env.remaining(), "anneal", forbidden=env.forbidden(), max_pulses=43, iterations=20_000
    )
    rewards = sum(env.step(action)[1] for action in plan.actions)
    assert rewards == pytest.approx(plan.reward, abs=1e-12)


def test_progress_can_stop_a_planner() -> None:
    seen: list[tuple[float, float]] = []

    def stop(fraction: float, reward: float) -> bool:
        seen.append((fraction, reward))
        return len(seen) == 3

    plan = lasergym.plan(lasergym.targets.star(), "anneal", budget_s=60.0, progress=stop)
    assert plan.partial
    assert len(seen) == 3
    assert plan.reward > 0.4
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)


def test_an_error_in_the_callback_comes_back() -> None:
    def fail(_fraction: float, _reward: float) -> bool:
        raise RuntimeError("mine")

    with pytest.raises(RuntimeError, match="mine"):
        lasergym.plan(lasergym.targets.star(), "anneal", budget_s=60.0, progress=fail)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"max_pulses": 0}, errors.OptionError),
        ({"max_pulses": 10_001}, errors.OptionError),
        ({"max_pulses": 10**25}, errors.OptionError),
        ({"planner": "guess"}, errors.OptionError),
        ({"budget_s": 0.0}, errors.OptionError),
        ({"budget_s": -1.0}, errors.OptionError),
        ({"budget_s": math.nan}, errors.OptionError),
        ({"iterations": 0}, errors.OptionError),
        ({"iterations": 5, "budget_s": 1.0}, errors.OptionError),
        ({"threads": 0}, errors.OptionError),
        ({"seed": -1}, errors.OptionError),
        ({"pulse_radius_px": 0.0}, errors.OptionError),
        ({"start": [[1.0, 2.0, 3.0]]}, errors.PositionError),
        ({"start": np.zeros((46, 2))}, errors.PlanError),
        ({"target": np.zeros((100, 100), bool)}, errors.EmptyTargetError),
        ({"target": np.ones((100, 100), bool)}, errors.FullTargetError),
    ],
)
def test_bad_arguments_are_named(arguments: dict[str, Any], error: type[Exception]) -> None:
    with pytest.raises(error) as caught:
        lasergym.plan(**({"target": lasergym.targets.star(), "planner": "anneal"} | arguments))
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("xy_px", [[[1.0]], [[1.0, math.nan]], [["a", "b"]], np.zeros((2, 2, 2))])
def test_bad_positions_are_named(xy_px: Any) -> None:
    with pytest.raises(errors.PositionError):
        lasergym.score(lasergym.targets.star(), xy_px)


def test_no_pulse_scores_nothing() -> None:
    score = lasergym.score(lasergym.targets.star(), [])
    assert score == lasergym.Score(0.0, 0.0, 0.0, 0)


def test_travel_is_as_short_as_a_solver_finds_it() -> None:
    fast_tsp = pytest.importorskip("fast_tsp")
    generator = np.random.default_rng(1)
    for _ in range(5):
        xy = generator.uniform(0, 100, (40, 2))
        order = lasergym.shortest_order(xy)
        assert sorted(order.tolist()) == list(range(40))
        ours = np.linalg.norm(np.diff(xy[order], axis=0), axis=1).sum()
        # An open tour is a closed one through a stop that is at distance 0 from all others.
        distance = np.zeros((41, 41))
        distance[:40, :40] = np.linalg.norm(xy[:, None] - xy[None], axis=-1)
        tour = fast_tsp.find_tour((400 * distance).astype(int).tolist(), duration_seconds=0.3)
        start = tour.index(40)
        path = [stop for stop in tour[start:] + tour[:start] if stop < 40]
        best = np.linalg.norm(np.diff(xy[path], axis=0), axis=1).sum()
        assert ours <= 1.05 * best


def test_ordering_changes_the_way_and_not_the_work(assets: Path) -> None:
    target = lasergym.targets.load(assets / "logo.svg")
    plan = lasergym.plan(target, "greedy")
    ordered = plan.ordered()
    assert lasergym.score(target, ordered.xy_px) == plan.score
    before, after = (lasergym.programs.travel(p.xy_px).length_um for p in (plan, ordered))
    assert after < before
