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
    described = [_describe(env_id) for env_id in lasergym.envs.ABLATION_IDS]
    if as_json:
        print_json({"environments": described})
        return
    made = table("id", "target", texts=2)
    for entry in described:
        made.add_row(entry["id"], entry["description"])
    print_data(made)
    first = described[0]
    print_data("")
    print_data(f"action       {first['action_space']}")
    for mode, space in first["observation_spaces"].items():
        print_data(f"observation  {space}  {mode}")
    defaults = (f"{name}={value!r}" for name, value in first["arguments"].items())
    print_data("")
    print_data("arguments")
    for line in defaults:
        print_data(f"  {line}")


def _describe(env_id: str) -> dict[str, Any]:
    env = gym.make(env_id).unwrapped
    modes = ("remaining", "layers")
    spaces = {mode: str(gym.make(env_id, observation=mode).observation_space) for mode in modes}
    arguments = {
        name: parameter.default
        for name, parameter in inspect.signature(lasergym.envs.AblationEnv).parameters.items()
        if name != "target" or env_id.endswith("/Pattern-v0")
    }
    return {
        "id": env_id,
        "description": (inspect.getdoc(type(env)) or "").splitlines()[0],
        "action_space": str(env.action_space),
        "observation_spaces": spaces,
        "arguments": arguments,
        "vector": True,
    }
