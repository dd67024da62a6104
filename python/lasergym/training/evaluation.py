"""Agents on the targets of Table 1, beside planners."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from lasergym.comparison.options import CompareOptions
from lasergym.comparison.statistics import Summary, group_rows, summarise
from lasergym.comparison.table import ResultTable
from lasergym.comparison.tasks import TaskTarget, task_targets
from lasergym.comparison.work import PULSE_RADIUS_PX, Row, run_item, work_items
from lasergym.envs import PatternVectorEnv
from lasergym.options import integer_in
from lasergym.planners import score

if TYPE_CHECKING:
    from lasergym.training.agents import Agent

__all__ = [
    "AGENT",
    "WELL_MACHINED",
    "AgentComparison",
    "Judgement",
    "compare_agent",
    "judge_rows",
    "run_agent",
    "well_machined_percent",
]

AGENT = "agent"
"""The agent's column."""

WELL_MACHINED = 0.9
"""Xie et al. (2022), section 3.3: the machined fraction that almost all shapes exceed."""


@dataclass(frozen=True)
class Judgement:
    """What an agent or planner achieves on several targets.

    Attributes:
        targets: Number of targets.
        reward: Return of an episode.
        machined_percent: Machined part of the target.
        off_target_percent: Area machined beside the target over the area of the target.
        pulses: Pulses used.
        well_machined_percent: Share of the targets of which more than 90 % are machined.
    """

    targets: int
    reward: Summary
    machined_percent: Summary
    off_target_percent: Summary
    pulses: Summary
    well_machined_percent: float

    def as_dict(self) -> dict[str, Any]:
        """The figures as a JSON report holds them."""
        named = {
            name: {"mean": summary.mean, "spread": summary.spread}
            for name, summary in (
                ("reward", self.reward),
                ("machined_percent", self.machined_percent),
                ("off_target_percent", self.off_target_percent),
                ("pulses", self.pulses),
            )
        }
        return {
            "targets": self.targets,
            **named,
            "well_machined_percent": self.well_machined_percent,
        }


@dataclass(frozen=True)
class AgentComparison:
    """An agent beside planners.

    Attributes:
        rows: A result for every target, agent and planner.
        table: Means and spreads, as Table 1 has them.
        batch: Targets that the agent worked on at once; its seconds are those of a batch divided
            by their number.
    """

    rows: tuple[Row, ...]
    table: ResultTable
    batch: int

    def as_dict(self) -> dict[str, Any]:
        """The table as JSON holds it, each task with its share of well machined targets."""
        report = self.table.as_dict()
        for group in report["groups"]:
            if group["whole_task"]:
                for planner, figures in group["planners"].items():
                    rows = self.rows_of(group["name"], planner)
                    figures["well_machined_percent"] = well_machined_percent(rows)
        return {**report, "batch": self.batch}

    def rows_of(self, task: str, planner: str) -> tuple[Row, ...]:
        """The results of one column on one task."""
        return tuple(row for row in self.rows if (row.task, row.planner) == (task, planner))


def run_agent(
    agent: Agent, made: Sequence[TaskTarget], *, batch: int = 64, **process: Any
) -> tuple[Row, ...]:
    """Lets an agent machine targets without exploration.

    Args:
        agent: The agent.
        made: The targets; each has a pulse budget of its own.
        batch: Targets at once, at least 1.
        **process: Arguments of the environment, such as ``completion``.

    Returns:
        A row for every target, in their order.
    """
    integer_in("batch", batch, 1, 65_536)
    rows: dict[int, Row] = {}
    budgets: dict[int, list[int]] = {}
    for index, one in enumerate(made):
        budgets.setdefault(one.max_pulses, []).append(index)
    for max_pulses, members in budgets.items():
        for start in range(0, len(members), batch):
            chosen = members[start : start + batch]
            started_s = time.perf_counter()
            trajectories = _machine(agent, [made[index] for index in chosen], max_pulses, process)
            elapsed_s = (time.perf_counter() - started_s) / len(chosen)
            for index, xy_px in zip(chosen, trajectories, strict=True):
                rows[index] = _row(made[index], xy_px, elapsed_s, process)
    return tuple(rows[index] for index in range(len(made)))


def judge_rows(rows: Sequence[Row]) -> Judgement:
    """Sums up at least one result."""
    return Judgement(
        len(rows),
        summarise([row.reward for row in rows]),
        summarise([100 * row.machined_fraction for row in rows]),
        summarise([100 * row.off_target_fraction for row in rows]),
        summarise([row.pulses for row in rows]),
        well_machined_percent(rows),
    )


def well_machined_percent(rows: Sequence[Row]) -> float:
    """Share of the results with more than 90 % of the target machined, percent."""
    return 100.0 * sum(row.machined_fraction > WELL_MACHINED for row in rows) / len(rows)


def compare_agent(
    agent: Agent,
    options: CompareOptions,
    *,
    batch: int = 64,
    progress: Callable[[float], None] | None = None,
) -> AgentComparison:
    """Puts an agent beside planners, on the targets of ``lasergym compare``.

    Args:
        agent: The agent.
        options: Tasks, planners and their budgets.
        batch: Targets that the agent works on at once; 1 measures what one target takes.
        progress: Told the fraction done.

    Raises:
        OptionError: An option is outside its range.
        DrawingError, TargetError: A drawing cannot be read or machined.
        PlanError: A planner refuses a target.
    """
    made = tuple(task_targets(options))
    process: dict[str, Any] = {}
    if agent.task is not None:
        process = {
            "completion": agent.task.completion,
            "stop_on_miss": agent.task.stop_on_miss,
        }
    rows: list[Row] = list(run_agent(agent, made, batch=batch, **process))
    for index, one in enumerate(made):
        if progress is not None:
            progress(index / len(made))
        rows += _planned(options, one)
    columns = (AGENT, *options.planners)
    settings = {
        "tasks": list(dict.fromkeys(one.task for one in made)),
        "planners": list(columns),
        "max_pulses": str(options.max_pulses or "45, random shapes area/125"),
        "effort": {planner: str(options.effort(planner)) for planner in options.planners},
        "seed": options.seed,
    }
    return AgentComparison(
        tuple(rows), ResultTable(columns, group_rows(rows, columns), settings), batch
    )


def _planned(options: CompareOptions, made: TaskTarget) -> Iterable[Row]:
    for item in work_items(options, made):
        row = run_item(item)
        if row is None:  # The planner has been interrupted.
            raise KeyboardInterrupt
        yield row


def _machine(
    agent: Agent, made: Sequence[TaskTarget], max_pulses: int, process: dict[str, Any]
) -> list[NDArray[np.float64]]:
    """The pulses of one episode on each target, px."""
    venv = PatternVectorEnv(
        num_envs=len(made),
        max_pulses=max_pulses,
        observation=agent.observation.value,
        autoreset_mode=AutoresetMode.SAME_STEP,
        **process,
    )
    observations, _ = venv.reset(seed=0, options={"target": [one.target for one in made]})
    over = np.zeros(len(made), np.bool_)
    trajectories: list[list[NDArray[np.float64]]] = [[] for _ in made]
    while not over.all():
        actions = agent.act(observations, max_pulses)
        for index in np.flatnonzero(~over):
            trajectories[index].append(50.0 * (1.0 + actions[index].astype(np.float64)))
        # Those that are over begin another episode, which nobody looks at.
        observations, _, terminated, _, _ = venv.step(actions)
        over |= terminated
    venv.close()
    return [np.array(one) for one in trajectories]


def _row(
    made: TaskTarget, xy_px: NDArray[np.float64], elapsed_s: float, process: dict[str, Any]
) -> Row:
    radius_px = process.get("pulse_radius_px", PULSE_RADIUS_PX)
    figures = score(made.target, xy_px, radius_px)
    return Row(
        made.task,
        made.name,
        AGENT,
        0,
        made.area_px,
        made.max_pulses,
        figures.pulses,
        figures.machined_fraction,
        figures.off_target_fraction,
        figures.reward,
        elapsed_s,
        tuple((x_px, y_px) for x_px, y_px in xy_px.tolist()),
    )
