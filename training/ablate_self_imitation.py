"""PPO with and without self-imitation: the quick configuration of a task, a few seeds.

Run ``python training/ablate_self_imitation.py -o runs/ablation``; it needs
``pip install "lasergym[train]"``. It prints, for each seed, the return without exploration on
held-out targets and that of the agent as it acts in training, both at the end.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from lasergym.training import SelfImitationOptions, preset
from lasergym.training.run import train


def main() -> None:
    """Trains both agents for each seed in turn."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--task", default="lasergym/Star-v0", help="id of the environment")
    parser.add_argument("--steps", type=int, default=500_000, help="pulses of each training")
    parser.add_argument("--seeds", type=int, default=3, help="trainings of each kind")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the runs")
    arguments = parser.parse_args()
    print("| seed | self-imitation | return without exploration | with exploration |")
    print("|---:|---|---:|---:|")
    for seed in range(arguments.seeds):
        for options in (None, SelfImitationOptions()):
            config = preset(arguments.task, quick=True)
            config = config.with_run(seed=seed, steps=arguments.steps)
            config = replace(
                config,
                run=replace(config.run, tensorboard=False),
                method=replace(config.method, self_imitation=options),
            )
            name = "without" if options is None else "with"
            result = train(config, arguments.output / f"{name}-{seed}", pictures=False)
            after = result.after.return_mean
            print(f"| {seed} | {name} | {after:.4f} | {result.last_return:.4f} |", flush=True)


if __name__ == "__main__":
    main()
