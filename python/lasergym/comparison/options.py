"""What is compared: tasks, planners and their budgets."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from lasergym import planners
from lasergym.comparison.budget import PulseBudget
from lasergym.comparison.columns import DEFAULT_PLANNERS, column_of, planners_of
from lasergym.comparison.tasks import TaskName
from lasergym.errors import OptionError
from lasergym.milling import SPOT_PLANNERS
from lasergym.policy import PolicyName, policy_file

__all__ = ["CompareOptions", "Effort"]

_SHIPPED_FOR: dict[str, PolicyName] = {"star": "star", "rotated-star": "rotated-star"}
"""Shipped policies of tasks; "random-shape" serves all others."""

_MAX_SHAPES = 20_000
_MAX_BUDGET_S = 86_400.0
_MAX_ITERATIONS = 10**12
_MAX_SEED = 2**63 - 1


@dataclass(frozen=True)
class Effort:
    """How long a planner works on a target; neither where it ends by itself.

    Attributes:
        budget_s: Time, s.
        iterations: Steps of the planner's own kind.
    """

    budget_s: float | None = None
    iterations: int | None = None

    def __str__(self) -> str:
        """As settings and tables name it."""
        if self.iterations is not None:
            return f"{self.iterations} iterations"
        return "none" if self.budget_s is None else f"{self.budget_s:g} s"


@dataclass(frozen=True)
class CompareOptions:
    """Settings of a comparison; each of them changes its results.

    Attributes:
        tasks: Kinds of targets, in the order of the table.
        folders: Folders of drawings, for the task ``"folder"``.
        angles: Number of angles of the rotated star, spread evenly over the 360 integer degrees.
        shapes: Random shapes in each area class, from 1 to 20 000 (as many as in the paper).
        reliefs: Random depth maps of the task ``"milling"``, from 1 to 20 000.
        process: Process of the task ``"milling"``: the name of a shipped profile or of a file.
        planners: Columns of the table; a planner does the tasks that it can.
        max_pulses: Pulse or spot budget of all targets. None: ceil(area / 125) for random shapes,
            200 for depth maps and 45 for all others.
        anneal_s: Time of ``"anneal"`` on a target, s, in (0, 86 400].
        cma_es_s: Time of ``"cma-es"`` on a target, s, in (0, 86 400].
        anneal_iterations: Instead of the time, Metropolis moves of ``"anneal"``, at least 1; then
            its results do not depend on the machine.
        cma_es_iterations: Instead of the time, evaluations of ``"cma-es"``, at least 1.
        policy: Trained policy of ``"policy"`` and ``"agent-mpc"``: the name of a shipped one or of
            a file. None: the shipped one for each task.
        seed: The seed of every work item derives from this one, from 0 to 2⁶³ − 1.
    """

    tasks: tuple[TaskName, ...] = ("star",)
    folders: tuple[Path, ...] = ()
    angles: int = 360
    shapes: int = 100
    reliefs: int = 10
    process: str = "laser-graphite"
    planners: tuple[str, ...] = DEFAULT_PLANNERS
    max_pulses: PulseBudget | None = None
    anneal_s: float = 1.0
    cma_es_s: float = 60.0
    anneal_iterations: int | None = None
    cma_es_iterations: int | None = None
    policy: PolicyName | str | Path | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Checks names and ranges.

        Raises:
            OptionError: A name is unknown or given twice, or a figure is outside its range.
        """
        _check_names("task", self.tasks, get_args(TaskName))
        _check_names("planner", self.planners, (*planners.PLANNERS, *SPOT_PLANNERS))
        for task in self.tasks:
            if not set(planners_of(task)) & set(self.planners):
                names = ", ".join(planners_of(task))
                raise OptionError(f"no planner is given for the task {task}; choose from {names}")
        for planner in self.planners:
            if all(planner not in planners_of(task) for task in self.tasks):
                raise OptionError(f"the planner {planner!r} does none of the tasks")
        if ("folder" in self.tasks) != bool(self.folders):
            raise OptionError("the task folder needs a folder of drawings, as in --task folder DIR")
        if not 1 <= self.angles <= 360:
            raise OptionError(f"angles is {self.angles}, but must be from 1 to 360")
        if not 1 <= self.shapes <= _MAX_SHAPES:
            raise OptionError(f"shapes is {self.shapes}, but must be from 1 to {_MAX_SHAPES}")
        if not 1 <= self.reliefs <= _MAX_SHAPES:
            raise OptionError(f"reliefs is {self.reliefs}, but must be from 1 to {_MAX_SHAPES}")
        for name, budget_s in (("anneal_s", self.anneal_s), ("cma_es_s", self.cma_es_s)):
            if not (math.isfinite(budget_s) and 0 < budget_s <= _MAX_BUDGET_S):
                raise OptionError(
                    f"{name} is {budget_s:g}, but must be above 0 and at most {_MAX_BUDGET_S:g} s"
                )
        for name, iterations in (
            ("anneal_iterations", self.anneal_iterations),
            ("cma_es_iterations", self.cma_es_iterations),
        ):
            if iterations is not None and not 1 <= iterations <= _MAX_ITERATIONS:
                raise OptionError(f"{name} is {iterations}, but must be from 1 to 10**12")
        learned = set(planners.LEARNED_PLANNERS) & set(self.planners)
        if self.policy is not None and not learned:
            raise OptionError(
                f"policy is {self.policy}, but only {' and '.join(planners.LEARNED_PLANNERS)} take "
                "one"
            )
        if not 0 <= self.seed <= _MAX_SEED:
            raise OptionError(f"seed is {self.seed}, but must be from 0 to 2**63 - 1")

    def policy_file(self, task: str) -> bytes | None:
        """The policy for the learned planners on a task; None where there are no such planners.

        Raises:
            PolicyError: The file cannot be read.
        """
        if not set(planners.LEARNED_PLANNERS) & set(self.planners) & set(planners_of(task)):
            return None
        return policy_file(self.policy or _SHIPPED_FOR.get(task, "random-shape"))

    def effort(self, planner: str) -> Effort:
        """How long a planner may work on a target."""
        if not column_of(planner).timed:
            return Effort()
        budget_s, iterations = (
            (self.cma_es_s, self.cma_es_iterations)
            if planner == "cma-es"
            else (self.anneal_s, self.anneal_iterations)
        )
        return Effort(budget_s) if iterations is None else Effort(None, iterations)


def _check_names(kind: str, given: tuple[str, ...], accepted: tuple[str, ...]) -> None:
    if not given:
        raise OptionError(f"no {kind} is given; choose from {', '.join(accepted)}")
    for name in given:
        if name not in accepted:
            raise OptionError(f"{name!r} is no {kind}; choose from {', '.join(accepted)}")
        if given.count(name) > 1:
            raise OptionError(f"the {kind} {name!r} is given twice")
