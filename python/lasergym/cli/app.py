"""The program ``lasergym``: its commands, exit codes and how errors reach the user.

Exit codes: 0 done, 1 failed, 2 wrong usage or bad input; a job that a signal stopped: 128 and the
number of the signal.
"""

import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from lasergym import __version__
from lasergym.cli.bench import bench
from lasergym.cli.compare import compare
from lasergym.cli.demo import demo
from lasergym.cli.disturb import disturb
from lasergym.cli.envs import envs
from lasergym.cli.evaluate import evaluate
from lasergym.cli.export import export
from lasergym.cli.galvo import galvo
from lasergym.cli.hints import hint_for
from lasergym.cli.machine import machine
from lasergym.cli.mill import mill
from lasergym.cli.output import report_error
from lasergym.cli.plan import plan
from lasergym.cli.remote import remote
from lasergym.cli.train import train
from lasergym.errors import LasergymError

__all__ = ["main"]

_FAILED = 1
_BAD_INPUT = 2

# The base of the errors that typer raises for wrong arguments; typer itself does not export it.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]

app = typer.Typer(
    name="lasergym",
    help="Decide where, when and how long a laser acts on a workpiece.",
    no_args_is_help=True,
    add_completion=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
_COMMANDS = (
    plan,
    machine,
    mill,
    remote,
    envs,
    bench,
    compare,
    disturb,
    train,
    evaluate,
    export,
    demo,
)
for _command in _COMMANDS:
    app.command(_command.__name__)(_command)
app.add_typer(galvo, name="galvo")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"lasergym {__version__}")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version"),
    ] = False,
) -> None:
    pass


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the program.

    Args:
        arguments: What follows the program's name; by default that of the process.

    Returns:
        The exit code.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    command = typer.main.get_command(app)
    try:
        code = command.main(_with_report_file(given), prog_name="lasergym", standalone_mode=False)
    except _UsageError as error:
        return _report_usage(error)
    except LasergymError as error:
        report_error(str(error), hint_for(error))
        return _BAD_INPUT if isinstance(error, ValueError) else _FAILED
    except OSError as error:
        report_error(_reason(error), "check the path, its permissions and the space left")
        return _FAILED
    except (KeyboardInterrupt, typer.Abort):
        report_error("interrupted", None)
        return _FAILED
    return code if isinstance(code, int) else 0


def _with_report_file(arguments: list[str]) -> list[str]:
    """``--json FILE.json`` as ``--output FILE.json``; ``--json`` alone prints the report."""
    rewritten: list[str] = []
    for argument in arguments:
        if argument.startswith("--json="):
            rewritten += ["--output", argument.removeprefix("--json=")]
        elif argument.lower().endswith(".json") and rewritten[-1:] == ["--json"]:
            rewritten[-1:] = ["--output", argument]
        else:
            rewritten.append(argument)
    return rewritten


def _report_usage(error: Exception) -> int:
    context = getattr(error, "ctx", None)
    path = "lasergym" if context is None else context.command_path
    message = str(getattr(error, "format_message", error.__str__)())
    if message:  # Without one, the help has been printed instead.
        report_error(message[0].lower() + message[1:], f"see {path} --help")
    return _BAD_INPUT


def _reason(error: OSError) -> str:
    if error.filename is None:
        return str(error)
    return f"cannot write or read {error.filename}: {error.strerror}"
