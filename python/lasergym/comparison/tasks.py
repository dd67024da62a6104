"""The targets of a comparison, and how many pulses each of them may take."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from lasergym import targets
from lasergym.comparison.budget import PulseBudget
from lasergym.errors import DrawingError, OptionError, TargetError
from lasergym.milling import Surface, full_scale_um, random_relief
from lasergym.targets import Target

if TYPE_CHECKING:
    from lasergym.comparison.options import CompareOptions

__all__ = [
    "AREA_CLASSES_PX",
    "FIRST_HELD_OUT_SEED",
    "MILLING",
    "RANDOM_SHAPES",
    "ROTATED_STAR",
    "TaskName",
    "TaskTarget",
    "area_class_px",
    "class_title",
    "task_targets",
]

TaskName: TypeAlias = Literal["star", "rotated-star", "random-shapes", "folder", "milling"]
"""Sections 3.1, 3.2 and 3.3 of Xie et al. (2022), a folder of drawings, and random depth maps."""

ROTATED_STAR: TaskName = "rotated-star"
RANDOM_SHAPES: TaskName = "random-shapes"
MILLING: TaskName = "milling"

AREA_CLASSES_PX: tuple[tuple[int, int], ...] = tuple(pairwise(range(3000, 6501, 500)))
"""The seven area classes of Xie et al. (2022), Fig. 6 b: (least, below) of each, px."""

FIRST_HELD_OUT_SEED = 2_000_000_000
"""Random shapes and reliefs of this and later seeds serve evaluation only."""

_MAX_SPOTS = 200
_ENDINGS = (".png", ".jpg", ".jpeg", ".svg", ".dxf")


@dataclass(frozen=True, eq=False)
class TaskTarget:
    """A target of a task.

    Attributes:
        task: Name of the task; drawings have the task ``folder:NAME``.
        name: Name of the target within its task, such as ``star:30`` or ``random-shape:7``.
        target: Boolean array of shape (100, 100); of the task ``"milling"`` depths in µm.
        max_pulses: Most pulses, or spots, that may be used.
    """

    task: str
    name: str
    target: Target | Surface
    max_pulses: int

    @property
    def area_px(self) -> int:
        """Area of the target, px; of a depth map the whole workpiece."""
        return self.target.size if self.task == MILLING else int(self.target.sum())

    @property
    def bits(self) -> bytes:
        """The target row by row: eight pixels a byte, or a depth in eight bytes."""
        if self.task == MILLING:
            return self.target.tobytes()
        return np.packbits(self.target > 0).tobytes()


def task_targets(options: "CompareOptions") -> Iterator[TaskTarget]:
    """All targets of a comparison, task by task.

    Raises:
        OptionError: A folder is missing or holds no drawing, or two folders have the same name.
        DrawingError, TargetError: A drawing cannot be read or machined; the message names it.
    """
    for task in options.tasks:
        if task == "star":
            budget = options.max_pulses or PulseBudget()
            yield _made(task, "star", targets.star(), budget)
        elif task == "rotated-star":
            budget = options.max_pulses or PulseBudget()
            for index in range(options.angles):
                angle_deg = index * 360 // options.angles
                yield _made(task, f"star:{angle_deg}", targets.star(angle_deg), budget)
        elif task == "random-shapes":
            budget = options.max_pulses or PulseBudget(pulses=None, area_per_pulse_px=125.0)
            for seed, target in _random_shapes(options.shapes):
                yield _made(task, f"random-shape:{seed}", target, budget)
        elif task == MILLING:
            budget = options.max_pulses or PulseBudget(pulses=_MAX_SPOTS)
            for seed in range(FIRST_HELD_OUT_SEED, FIRST_HELD_OUT_SEED + options.reliefs):
                relief = random_relief(seed, depth_um=full_scale_um(options.process))
                spots = budget.pulses_for(relief.size)
                yield TaskTarget(task, f"relief:{seed}", relief, spots)
        else:
            yield from _drawings(options.folders, options.max_pulses or PulseBudget())


def area_class_px(area_px: int) -> tuple[int, int] | None:
    """The area class (least, below), px, in which an area lies; None outside all of them."""
    for least_px, below_px in AREA_CLASSES_PX:
        if least_px <= area_px < below_px:
            return least_px, below_px
    return None


def class_title(bounds_px: tuple[int, int]) -> str:
    """An area class as tables and figures name it."""
    return f"{bounds_px[0]}–{bounds_px[1]} px"


def _made(task: str, name: str, target: Target, budget: PulseBudget) -> TaskTarget:
    return TaskTarget(task, name, target, budget.pulses_for(int(target.sum())))


def _random_shapes(per_class: int) -> Iterator[tuple[int, Target]]:
    """The first held-out shapes that fill every area class, by seed."""
    missing = dict.fromkeys(AREA_CLASSES_PX, per_class)
    for seed in count(FIRST_HELD_OUT_SEED):
        target = targets.random_shape(seed)
        bounds_px = area_class_px(int(target.sum()))
        if bounds_px is None or not missing[bounds_px]:
            continue
        missing[bounds_px] -= 1
        yield seed, target
        if not any(missing.values()):
            return


def _drawings(folders: Sequence[Path], budget: PulseBudget) -> Iterator[TaskTarget]:
    names = [folder.resolve().name for folder in folders]
    for folder, name in zip(folders, names, strict=True):
        if names.count(name) > 1:
            raise OptionError(f"two folders of drawings are named {name!r}: rename one")
        if not folder.is_dir():
            raise OptionError(f"{folder} is no folder of drawings")
        files = sorted(file for file in folder.iterdir() if file.suffix.lower() in _ENDINGS)
        if not files:
            raise OptionError(f"{folder} holds no drawing ({', '.join(_ENDINGS)})")
        for file in files:
            if not file.name.isprintable():
                raise OptionError(f"{str(file)!r} has control characters in its name: rename it")
            yield _made(f"folder:{name}", file.name, _load(file), budget)


def _load(file: Path) -> Target:
    try:
        return targets.load(file)
    except (DrawingError, TargetError) as error:
        if str(file) in str(error):
            raise
        raise type(error)(f"{file}: {error}") from error
