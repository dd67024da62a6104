"""``lasergym export``: a trained agent as a policy file for the runner."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from lasergym.cli.output import note, print_data, print_json
from lasergym.errors import OptionError

__all__ = ["export"]


def export(
    model: Annotated[
        Path, typer.Argument(metavar="RUN_OR_MODEL", help="Folder of a run, or a model's .zip.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The .safetensors file to write.")
    ] = Path("policy.safetensors"),
    storage: Annotated[
        Literal["float32", "float16", "bfloat16"],
        typer.Option("--storage", help="Type of the stored weights."),
    ] = "float32",
    observations: Annotated[
        int, typer.Option("--observations", help="Observations on which torch is compared.")
    ] = 1000,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the observations.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Write a trained agent for the runner, which needs neither Python nor torch.

    Torch and the runner decide about the same observations; where they differ by more than 10⁻⁴ no
    file is written.
    """
    if not output.parent.is_dir():
        raise OptionError(f"there is no folder {output.parent} for the policy file")
    import lasergym.sb3  # noqa: F401 - first, since it says what to install
    from lasergym.training.agents import load_agent  # Imports torch.
    from lasergym.training.export import export_agent

    exported = export_agent(
        load_agent(model), output, storage=storage, observations=observations, seed=seed
    )
    file, parity = exported.file, exported.parity
    report: dict[str, Any] = {
        "model": str(model),
        "path": str(output),
        "file_bytes": file.file_bytes,
        "parameters": file.parameters,
        "storage": file.storage,
        "observations": parity.observations,
        "largest_difference": parity.largest_difference,
        "mean_difference": parity.mean_difference,
        "tolerance": parity.tolerance,
    }
    if as_json:
        print_json(report)
    else:
        print_data(
            f"{file.parameters} weights, {file.file_bytes / 1000:.0f} kB; on "
            f"{parity.observations} observations the actions of torch and of the runner differ by "
            f"at most {parity.largest_difference:.1e} ({parity.tolerance:.0e} is allowed)"
        )
    note(f"wrote {output}")
