"""CMA-ES against the package ``cma``, to the same reward on the static star.

Run ``python training/race_cma_es.py``; it needs ``pip install cma``. Both start around random
places on the target with steps of 10 px and a population of 40, both are restarted with twice the
population when they have converged, and both are judged by the same scorer: ours inside one call of
``lasergym.plan``, ``cma`` candidate by candidate by ``lasergym.score``. They take turns, seed by
seed.
"""

from __future__ import annotations

import argparse
import statistics
import time
import warnings

import numpy as np
from numpy.typing import NDArray

import lasergym

POPULATION = 40
SIGMA_PX = 10.0


def race_ours(
    target: NDArray[np.bool_], pulses: int, goal: float, seed: int, most_s: float
) -> float:
    """Time in which ``lasergym.plan`` reaches the reward ``goal``, s; infinite if it does not."""
    began_s = time.perf_counter()
    plan = lasergym.plan(
        target,
        "cma-es",
        max_pulses=pulses,
        seed=seed,
        budget_s=most_s,
        progress=lambda _, reward: reward >= goal,
    )
    return time.perf_counter() - began_s if plan.reward >= goal else float("inf")


def race_cma(
    target: NDArray[np.bool_], pulses: int, goal: float, seed: int, most_s: float
) -> float:
    """Time in which ``cma`` reaches the reward ``goal``, s; infinite if it does not."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import cma
    generator = np.random.default_rng(seed)
    rows, columns = np.nonzero(target)
    population = POPULATION
    began_s = time.perf_counter()
    while time.perf_counter() - began_s < most_s:
        places = generator.integers(len(rows), size=pulses)
        start = np.stack([columns[places], rows[places]], axis=1).ravel() + 0.5
        options = {
            "bounds": [0, 100],
            "popsize": population,
            "seed": int(generator.integers(1, 2**31)),
            "verbose": -9,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            search = cma.CMAEvolutionStrategy(start, SIGMA_PX, options)
            while not search.stop():
                plans = search.ask()
                rewards = [lasergym.score(target, plan.reshape(-1, 2)).reward for plan in plans]
                if max(rewards) >= goal:
                    return time.perf_counter() - began_s
                if time.perf_counter() - began_s >= most_s:
                    break
                search.tell(plans, [-reward for reward in rewards])
        population *= 2
    return float("inf")


def main() -> None:
    """Lets them race and prints the times, s."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--goal", type=float, default=0.461, help="reward to reach")
    parser.add_argument("--pulses", type=int, default=45)
    parser.add_argument("--seeds", type=int, default=9, help="races")
    parser.add_argument("--most-s", type=float, default=300.0, help="time after which one gives up")
    arguments = parser.parse_args()
    target = lasergym.targets.star()
    limits = (arguments.pulses, arguments.goal)
    times: list[tuple[float, float]] = []
    print(f"star, {arguments.pulses} pulses, reward {arguments.goal}; s: lasergym, cma")
    for seed in range(arguments.seeds):
        ours_s = race_ours(target, *limits, seed, arguments.most_s)
        cma_s = race_cma(target, *limits, seed, arguments.most_s)
        times.append((ours_s, cma_s))
        print(f"seed {seed}: {ours_s:8.2f} {cma_s:8.2f}", flush=True)
    ours_s, cma_s = (statistics.median(column) for column in zip(*times, strict=True))
    print(f"median: {ours_s:8.2f} {cma_s:8.2f}, ratio {cma_s / ours_s:.1f}")


if __name__ == "__main__":
    main()
