"""``lasergym demo``: a drawing planned, machined in the environment and judged."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import gymnasium as gym
import numpy as np
import typer
from numpy.typing import NDArray

import lasergym
from lasergym import targets
from lasergym.cli.output import note, print_data, print_json, progress_bar
from lasergym.cli.plan_files import write_file
from lasergym.cli.plan_report import judge
from lasergym.errors import LasergymError
from lasergym.planners import Plan, PlannerName, Score
from lasergym.programs import GcodeOptions, StageDynamics
from lasergym.targets import SIZE_PX, Target

__all__ = ["demo", "play"]

_BEST_PLANNER: PlannerName = "anneal"
_ITERATIONS = 2_000_000
"""Work of the planner: the demo gives the same plan on every machine."""


def demo(
    target: Annotated[
        Path, typer.Argument(metavar="TARGET", help="A PNG, JPEG, SVG or DXF drawing.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the files.")] = Path(
        "demo"
    ),
    max_pulses: Annotated[int, typer.Option(help="Most pulses that may be used.")] = 45,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Plan a drawing, machine it in lasergym/Pattern-v0 and leave picture, program and report."""
    pattern = targets.load(target)
    with progress_bar(f"planning ({_BEST_PLANNER})") as bar:
        planned = lasergym.plan(
            pattern,
            _BEST_PLANNER,
            max_pulses=max_pulses,
            iterations=_ITERATIONS,
            progress=lambda fraction, _reward: bar.show(fraction),
        ).ordered()
    played = play(pattern, planned)
    gcode = GcodeOptions()
    dynamics = StageDynamics(settling_s=gcode.settling_s, pulse_s=gcode.dwell_s)
    report = judge(
        str(target), pattern, played, max_pulses=max_pulses, pixel_um=1.0, dynamics=dynamics
    )
    output.mkdir(parents=True, exist_ok=True)
    for name in ("plan.png", "plan.svg", "toolpath.nc", "toolpath.csv", "report.json"):
        write_file(output / name, report, pattern, gcode=gcode)
        note(f"wrote {output / name}")
    if as_json:
        print_json(report.as_dict())
        return
    print_data(report.table())
    print_data(report.travel_line())


def play(target: Target, plan: Plan) -> Plan:
    """Machines a plan in the environment, pulse by pulse.

    Args:
        target: Boolean array of shape (100, 100).
        plan: The plan.

    Returns:
        The plan up to the pulse that completes the target, with the score of the environment.

    Raises:
        LasergymError: The environment's score is not that of :func:`lasergym.score`.
    """
    machined = _machine(target, plan.actions, plan.pulse_radius_px)
    fired_px = plan.xy_px[: machined.pulses]
    expected = lasergym.score(target, fired_px, plan.pulse_radius_px)
    # A return is a sum of rounded rewards, the score one quotient; both stand for whole pixels.
    gain_px = round(machined.reward * SIZE_PX**2)
    agreed = replace(machined, reward=gain_px / SIZE_PX**2)
    if agreed != expected:
        raise LasergymError(f"the environment gave {machined}, but the score is {expected}")
    return replace(plan, xy_px=fired_px, score=agreed)


def _machine(target: Target, actions: NDArray[np.float32], pulse_radius_px: float) -> Score:
    """What the environment says of the actions, up to the one that completes the target."""
    env = gym.make(
        "lasergym/Pattern-v0",
        target=target,
        pulse_radius_px=pulse_radius_px,
        max_pulses=len(actions),
        completion=1.0,
    )
    _, info = env.reset(seed=0)
    episode_return, pulses = 0.0, 0
    for action in actions:
        _, reward, terminated, _, info = env.step(action)
        episode_return += float(reward)
        pulses += 1
        if terminated:
            break
    env.close()
    return Score(
        episode_return,
        float(info["machined_fraction"]),
        float(info["off_target_fraction"]),
        pulses,
    )
