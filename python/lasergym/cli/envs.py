"""``lasergym envs``: the environments that are registered with Gymnasium."""

import inspect
from typing import Annotated, Any

import gymnasium as gym
import typer

import lasergym
from lasergym.cli.output import print_data, print_json, table

__all__ = ["envs"]


def envs(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """List the environments, their spaces and their arguments."""
    described = [_describe(env_id) for env_id in lasergym.envs.ENVIRONMENT_IDS]
    if as_json:
        print_json({"environments": described})
        return
    made = table("id", "target", texts=2)
    for entry in described:
        made.add_row(entry["id"], entry["description"])
    print_data(made)
    for title, family in (
        ("pulse ablation", lasergym.envs.ABLATION_IDS),
        ("depth milling", lasergym.envs.MILLING_IDS),
    ):
        members = [entry for entry in described if entry["id"] in family]
        print_data("")
        print_data(title)
        _print_family(members[0])


def _print_family(entry: dict[str, Any]) -> None:
    """Spaces and arguments, which the environments of a process share."""
    print_data(f"  action       {entry['action_space']}")
    for mode, space in entry["observation_spaces"].items():
        print_data(f"  observation  {space}  {mode}")
    print_data("  arguments")
    for name, value in entry["arguments"].items():
        print_data(f"    {name}={value!r}")


def _describe(env_id: str) -> dict[str, Any]:
    env = gym.make(env_id).unwrapped
    is_ablation = env_id in lasergym.envs.ABLATION_IDS
    modes = ("remaining", "layers") if is_ablation else ("residual", "layers")
    spaces = {mode: str(gym.make(env_id, observation=mode).observation_space) for mode in modes}
    base = lasergym.envs.AblationEnv if is_ablation else lasergym.envs.MillingEnv
    arguments = {
        name: parameter.default
        for name, parameter in inspect.signature(base).parameters.items()
        if name != "target" or not is_ablation or env_id.endswith("/Pattern-v0")
    }
    return {
        "id": env_id,
        "description": (inspect.getdoc(type(env)) or "").splitlines()[0],
        "action_space": str(env.action_space),
        "observation_spaces": spaces,
        "arguments": arguments,
        "vector": True,
    }
