"""``lasergym train``: an agent from a configuration or the id of an environment."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lasergym.cli.output import (
    note,
    print_data,
    print_json,
    progress_bar,
    rounded_time,
    table,
)
from lasergym.errors import OptionError
from lasergym.training import TrainingConfig, preset

if TYPE_CHECKING:
    from lasergym.training.correction_options import LessonProgress
    from lasergym.training.recorder import TrainingProgress
    from lasergym.training.run import TrainingResult

__all__ = ["train"]


def train(
    task: Annotated[
        str | None,
        typer.Argument(
            metavar="[CONFIG_OR_ENV_ID]",
            help="A TOML file, or an id such as lasergym/Star-v0.",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A small agent that learns within minutes.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder of the run. Default: runs/NAME."),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option("--resume", help="Folder of a run to go on with, instead of a new one."),
    ] = None,
    steps: Annotated[
        int | None, typer.Option("--steps", help="Pulses to train with, in all.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Everything random derives from it.")
    ] = None,
    pictures: Annotated[
        bool,
        typer.Option("--pictures/--no-pictures", help="Draw the curve (needs Matplotlib)."),
    ] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Train an agent with Stable-Baselines3; it goes on after a crash.

    The run's folder holds model, checkpoints, history, logs for TensorBoard and the training curve.
    """
    if resume is not None:
        if task is not None or output is not None or quick or seed is not None:
            raise OptionError("--resume takes all from its run, except --steps")
        folder = resume
    else:
        if task is None:
            raise OptionError("train needs a TOML file, the id of an environment, or --resume")
        if output is not None and output.suffix.lower() in (".json", ".csv", ".zip"):
            raise OptionError(f"{output} looks like a file, but -o takes a folder")
        config = _config(task, quick=quick).with_run(steps=steps, seed=seed)
        folder = output or Path("runs") / _name(task, quick=quick)
    shows = _Display()
    try:
        with progress_bar("training") as bar:
            shows.bar = bar
            import lasergym.sb3  # noqa: F401 - first, since it says what to install
            from lasergym.training import run  # Imports torch.

            if resume is None:
                result = run.train(
                    config, folder, pictures=pictures, progress=shows.show, lessons=shows.teach
                )
            else:
                result = run.resume(
                    folder,
                    steps=steps,
                    pictures=pictures,
                    progress=shows.show,
                    lessons=shows.teach,
                )
    except KeyboardInterrupt:
        saved = any((folder / name).is_dir() for name in ("checkpoints", "planner"))
        note(
            f"interrupted: lasergym train --resume {folder} goes on from there"
            if saved
            else "interrupted"
        )
        raise typer.Exit(1) from None
    if as_json:
        print_json(result.as_dict())
    else:
        _print(result)
    note(
        f"{result.steps} pulses in {rounded_time(result.training_s)}: {result.steps_per_s:.0f} per "
        f"second, {result.environment_fraction:.0%} of the time in the environment"
    )
    for path in result.files:
        note(f"wrote {path}")


class _Display:
    """Shows progress on the bar, and each evaluation as a line."""

    bar: Any = None

    def teach(self, progress: "LessonProgress") -> None:
        self._advance(
            "updates from the planner",
            progress.updates,
            progress.total_updates,
            progress.remaining_s,
        )

    def show(self, progress: "TrainingProgress") -> None:
        self._advance("pulses", progress.steps, progress.total_steps, progress.remaining_s)
        line = progress.evaluated
        if line is not None:
            note(
                f"{line.steps} pulses: return {line.return_mean:.4f} on {line.targets} held-out "
                f"{'target' if line.targets == 1 else 'targets'}, {line.machined_percent:.1f} % "
                f"machined, {line.off_target_percent:.1f} % beside"
            )

    def _advance(self, what: str, done: int, total: int, remaining_s: float | None) -> None:
        text = f"training: {_short(done)} of {_short(total)} {what}"
        if remaining_s is not None:
            text += f", {rounded_time(remaining_s)} left"
        self.bar.show(min(1.0, done / total), text)


def _config(task: str, *, quick: bool) -> TrainingConfig:
    if not task.endswith(".toml"):
        return preset(task, quick=quick)
    if quick:
        raise OptionError("--quick is for the id of an environment: a file has its own settings")
    return TrainingConfig.load(task)


def _name(task: str, *, quick: bool) -> str:
    stem = Path(task).stem if task.endswith(".toml") else task.split("/")[-1].removesuffix("-v0")
    return f"{stem}-quick" if quick else stem


def _print(result: "TrainingResult") -> None:
    made = table("", "return", "machined %", "off-target %", "pulses")
    for title, line in (("before training", result.before), ("after training", result.after)):
        figures = (line.machined_percent, line.off_target_percent, line.pulses)
        made.add_row(title, f"{line.return_mean:.4f}", *(f"{figure:.1f}" for figure in figures))
    for planner, reward in result.planners.items():
        made.add_row(planner, f"{reward:.4f}", "", "", "")
    print_data(made)
    print_data(
        f"with exploration: {result.first_return:.4f} at first, {result.last_return:.4f} at last"
    )


def _short(number: int) -> str:
    if number < 10_000:
        return str(number)
    if number < 1_000_000:
        return f"{number / 1e3:.0f} k"
    return f"{number / 1e6:.1f} M"
