"""Robot with laser scanner: time-optimal robot lines and the scanner's program for them.

Source: Hatwig, Minnerup, Zaeh and Reinhart, "An automated path planning system for a robot with a
laser scanner for remote laser cutting and welding" (2012).
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.errors import RemoteError

__all__ = [
    "Choice",
    "Line",
    "LineOfCircles",
    "Plane",
    "Programs",
    "RemotePlan",
    "Simulation",
    "Stop",
    "best_line",
    "plan",
    "plan_file",
]

Choice: TypeAlias = Literal["joint", "greedy", "greedy-any-direction", "initial"]
"""How subtasks are shared out among lines; see :func:`plan`."""

Points: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True)
class Plane:
    """A plane of the workpiece.

    Attributes:
        name: Its name.
        origin_mm: Its origin in the frame of the robot, mm.
        abc_deg: Its turn about z, then y, then x, °.
    """

    name: str
    origin_mm: tuple[float, float, float]
    abc_deg: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Stop:
    """A subtask, or a piece of one that was split.

    Attributes:
        subtask: Index of the subtask in the task.
        name: Its name.
        plane: Index of its plane.
        path_mm: Points along its path, mm; shape (n, 2).
        center_mm: Centre of its scan circle, mm.
        enclosing_radius_mm: Radius of the smallest circle round it, mm.
        scan_radius_mm: Radius of its scan circle, mm.
        time_s: Time of its process, s.
    """

    subtask: int
    name: str
    plane: int
    path_mm: Points
    center_mm: tuple[float, float]
    enclosing_radius_mm: float
    scan_radius_mm: float
    time_s: float


@dataclass(frozen=True)
class Line:
    """A line of the robot.

    Attributes:
        plane: Index of its plane.
        direction_deg: Direction from x towards y, °.
        speed_mm_s: Speed, mm/s.
        start_mm: Where the first process begins, mm.
        end_mm: Where the last one ends, mm.
        sections_mm: Where each process begins and ends, mm from the start.
        stops: Indices of its stops, in order.
        time_s: Time from ``start_mm`` to ``end_mm``, s.
        whole_time_s: The same with restart, lead-in and lead-out, s.
        approach_s: Time of the way from the line before, s.
    """

    plane: int
    direction_deg: float
    speed_mm_s: float
    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    sections_mm: tuple[tuple[float, float], ...]
    stops: range
    time_s: float
    whole_time_s: float
    approach_s: float

    @property
    def length_mm(self) -> float:
        """Length from ``start_mm`` to ``end_mm``, mm."""
        return float(np.hypot(*np.subtract(self.end_mm, self.start_mm)))

    def place_mm(self, way_mm: float) -> tuple[float, float]:
        """The place ``way_mm`` after the start, mm."""
        angle = np.radians(self.direction_deg)
        x, y = self.start_mm
        return float(x + way_mm * np.cos(angle)), float(y + way_mm * np.sin(angle))


@dataclass(frozen=True, eq=False)
class Simulation:
    """What the programs do on the workpiece, as an independent simulation sees it.

    Attributes:
        total_s: Time of everything, s.
        laser_s: Time with the laser on, s.
        max_seam_error_mm: Largest distance of the beam from its seam, mm.
        max_speed_error: Largest difference of the speed on the workpiece, as a part of it.
        max_field_mm: Largest distance of the switched-on beam from the centre of the field, mm.
        max_robot_speed_mm_s: Highest speed of the robot on a line, mm/s.
        problems: What is not as it should be; empty where the programs are good.
        time_s: Times of the samples, s; shape (n,).
        robot_mm: Centre of the working field in the frame of the robot, mm; shape (n, 3).
        beam_mm: The beam on the workpiece, mm; shape (n, 3).
        field_mm: The beam in the working field, mm; shape (n, 2).
        laser: Whether the laser is on; shape (n,).
    """

    total_s: float
    laser_s: float
    max_seam_error_mm: float
    max_speed_error: float
    max_field_mm: float
    max_robot_speed_mm_s: float
    problems: tuple[str, ...]
    time_s: NDArray[np.float64]
    robot_mm: Points
    beam_mm: Points
    field_mm: Points
    laser: NDArray[np.bool_]


@dataclass(frozen=True)
class Programs:
    """Programs of robot and scanner.

    Attributes:
        krl_name: Name of the KRL module.
        krl_src: Its source file.
        krl_dat: Its data list.
        robot_csv: The robot's moves as CSV.
        scanner_csv: The scanner's vectors as CSV.
        scanner_rtc: The same as commands of an RTC board.
    """

    krl_name: str
    krl_src: str
    krl_dat: str
    robot_csv: str
    scanner_csv: str
    scanner_rtc: str


@dataclass(frozen=True, eq=False)
class RemotePlan:
    """The plan of a task.

    Attributes:
        name: Name of the task.
        choice: How lines were chosen.
        field_radius_mm: Radius of the scanner's working field, mm.
        planes: The planes of the workpiece.
        stops: The subtasks in the order in which they are processed.
        lines: The lines of the robot in order.
        cycle_time_s: Time from the first restart to the end of the last line, s.
        tour_mm: Length of the tour through the scan circles, mm.
        laser_s: Time with the laser on, s.
        line_s: Time on the lines alone, s.
        elapsed_s: Time that planning took, s.
    """

    name: str
    choice: Choice
    field_radius_mm: float
    planes: tuple[Plane, ...]
    stops: tuple[Stop, ...]
    lines: tuple[Line, ...]
    cycle_time_s: float
    tour_mm: float
    laser_s: float
    line_s: float
    elapsed_s: float
    _job: _native.RemoteJob

    def simulate(self, sample_s: float = 0.0) -> Simulation:
        """Writes the programs, reads them back and plays them.

        Args:
            sample_s: Time between recorded states, s; 0 records none.
        """
        figures, problems, rows = self._job.simulate(sample_s)
        return Simulation(
            *figures,
            problems=tuple(problems),
            time_s=rows[:, 0],
            robot_mm=rows[:, 1:4],
            beam_mm=rows[:, 4:7],
            field_mm=rows[:, 7:9],
            laser=rows[:, 9] > 0.5,
        )

    def programs(self) -> Programs:
        """The programs of robot and scanner."""
        src, dat, robot_csv, scanner_csv, scanner_rtc = self._job.programs()
        name = re.search(r"^DEF (\w+)", src, re.MULTILINE)
        krl_name = "TASK" if name is None else name[1]
        return Programs(krl_name, src, dat, robot_csv, scanner_csv, scanner_rtc)

    def as_dict(self) -> dict[str, Any]:
        """The plan as JSON holds it."""
        return {
            "name": self.name,
            "choice": self.choice,
            "subtasks": 1 + max((stop.subtask for stop in self.stops), default=-1),
            "lines": len(self.lines),
            "cycle_time_s": self.cycle_time_s,
            "line_time_s": self.line_s,
            "laser_s": self.laser_s,
            "tour_mm": self.tour_mm,
            "elapsed_s": self.elapsed_s,
            "robot_lines": [
                {
                    "plane": self.planes[line.plane].name,
                    "direction_deg": line.direction_deg,
                    "speed_mm_s": line.speed_mm_s,
                    "start_mm": line.start_mm,
                    "end_mm": line.end_mm,
                    "length_mm": line.length_mm,
                    "time_s": line.time_s,
                    "sections": [
                        {
                            "subtask": self.stops[stop].name,
                            "begin_mm": begin,
                            "end_mm": end,
                            "time_s": self.stops[stop].time_s,
                        }
                        for stop, (begin, end) in zip(line.stops, line.sections_mm, strict=True)
                    ],
                }
                for line in self.lines
            ],
        }


@dataclass(frozen=True)
class LineOfCircles:
    """The best line through scan circles; see :func:`best_line`.

    Attributes:
        direction_deg: Its direction, °.
        offset_mm: Its distance from the origin, to the right of the direction, mm.
        speed_mm_s: Speed of the robot, mm/s.
        start_mm: Start Function there, mm along the direction.
        end_mm: End Function there, mm along the direction.
        sections_mm: Where each process begins and ends, mm along the direction.
    """

    direction_deg: float
    offset_mm: float
    speed_mm_s: float
    start_mm: float
    end_mm: float
    sections_mm: tuple[tuple[float, float], ...]

    @property
    def length_mm(self) -> float:
        """Length Function there, mm."""
        return self.end_mm - self.start_mm


def plan(
    task: str,
    *,
    folder: str | Path | None = None,
    choice: Choice = "joint",
    directions: int = 360,
    keep_order: bool = False,
) -> RemotePlan:
    """Plans a task.

    Args:
        task: The task as TOML text.
        folder: Where its drawings are.
        choice: ``"joint"`` chooses by dynamic programming which subtasks share a line;
            ``"greedy"`` and ``"greedy-any-direction"`` take up one after the other, the first as
            the paper does; ``"initial"`` is the paper's path before optimisation.
        directions: Directions of a full turn that are tried for each line, from 4 to 36 000.
        keep_order: Keep the order of the task instead of a short tour.

    Raises:
        InfeasibleTaskError: A subtask cannot be processed; the message says which, why, and what
            would help.
        RemoteError: The text is no task.
        OptionError: A value is outside its range.
        DrawingError: A drawing cannot be used.
    """
    started_s = time.perf_counter()
    job = _native.RemoteJob(task, folder, choice, directions, keep_order)
    elapsed_s = time.perf_counter() - started_s
    name, field_radius_mm, cycle_time_s, tour_mm, laser_s, line_s = job.figures()
    return RemotePlan(
        name=name,
        choice=choice,
        field_radius_mm=field_radius_mm,
        planes=tuple(
            Plane(plane, (origin[0], origin[1], origin[2]), (abc[0], abc[1], abc[2]))
            for plane, origin, abc in job.planes()
        ),
        stops=tuple(
            Stop(subtask, stop, plane, job.path(index), (x, y), enclosing, scan, time_s)
            for index, (subtask, stop, plane, x, y, enclosing, scan, time_s) in enumerate(
                job.stops()
            )
        ),
        lines=tuple(
            Line(
                plane=plane,
                direction_deg=direction,
                speed_mm_s=speed,
                start_mm=start,
                end_mm=end,
                sections_mm=tuple(sections),
                stops=range(first, first + len(sections)),
                time_s=sections[-1][1] / speed,
                whole_time_s=whole,
                approach_s=approach,
            )
            for plane, direction, speed, start, end, sections, first, whole, approach in job.lines()
        ),
        cycle_time_s=cycle_time_s,
        tour_mm=tour_mm,
        laser_s=laser_s,
        line_s=line_s,
        elapsed_s=elapsed_s,
        _job=job,
    )


def plan_file(
    path: str | Path,
    *,
    choice: Choice = "joint",
    directions: int = 360,
    keep_order: bool = False,
) -> RemotePlan:
    """Plans the task in a TOML file; drawings are looked for beside it. See :func:`plan`."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise RemoteError(f"{file} is not UTF-8 text: {error}") from error
    return plan(
        text, folder=file.parent, choice=choice, directions=directions, keep_order=keep_order
    )


def best_line(
    circles: ArrayLike,
    *,
    direction_deg: float | None = None,
    slowest_mm_s: float = 1.0,
    fastest_mm_s: float = 200.0,
    jump_s: float = 0.0,
) -> LineOfCircles | None:
    """The fastest line through scan circles in their order.

    Args:
        circles: Rows of (x mm, y mm, radius mm, time s); shape (n, 4).
        direction_deg: Direction of the line, °; by default the best one.
        slowest_mm_s: Lowest speed of the robot, mm/s.
        fastest_mm_s: Highest speed of the robot, mm/s.
        jump_s: Time between two processes, s.

    Returns:
        The line, or None where there is none for all of them.
    """
    array = np.ascontiguousarray(circles, dtype=np.float64)
    found = _native.best_robot_line(array, direction_deg, (slowest_mm_s, fastest_mm_s), jump_s)
    if found is None:
        return None
    figures, sections = found
    return LineOfCircles(*figures, sections_mm=tuple(sections))
