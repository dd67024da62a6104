"""``lasergym envs``: the environments that are registered with Gymnasium."""

import inspect
from dataclasses import dataclass
from typing import Annotated, Any

import gymnasium as gym
import typer

import lasergym
from lasergym.cli.output import print_data, print_json, table

__all__ = ["envs"]


@dataclass(frozen=True)
class _Family:
    """Environments of one process, which share spaces and arguments."""

    title: str
    ids: tuple[str, ...]
    base: type[gym.Env[Any, Any]]
    observations: tuple[str, ...] = ()


_FAMILIES = (
    _Family(
        "pulse ablation",
        lasergym.envs.ABLATION_IDS,
        lasergym.envs.AblationEnv,
        ("remaining", "layers"),
    ),
    _Family(
        "depth milling",
        lasergym.envs.MILLING_IDS,
        lasergym.envs.MillingEnv,
        ("residual", "layers"),
    ),
    _Family("scan head", lasergym.envs.GALVO_IDS, lasergym.envs.GalvoLineEnv),
    _Family("robot and scanner", lasergym.envs.REMOTE_IDS, lasergym.envs.RemoteScanEnv),
)


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
    for family in _FAMILIES:
        print_data("")
        print_data(family.title)
        _print_family(next(entry for entry in described if entry["id"] in family.ids))


def _print_family(entry: dict[str, Any]) -> None:
    """Spaces and arguments, which the environments of a process share."""
    print_data(f"  action       {entry['action_space']}")
    for mode, space in entry["observation_spaces"].items():
        print_data(f"  observation  {space}  {mode}".rstrip())
    print_data("  arguments")
    for name, value in entry["arguments"].items():
        print_data(f"    {name}={value!r}")


def _describe(env_id: str) -> dict[str, Any]:
    family = next(family for family in _FAMILIES if env_id in family.ids)
    env = gym.make(env_id).unwrapped
    spaces = {"": str(env.observation_space)}
    if family.observations:
        spaces = {
            mode: str(gym.make(env_id, observation=mode).observation_space)
            for mode in family.observations
        }
    fixed_target = family.ids is lasergym.envs.ABLATION_IDS and not env_id.endswith("/Pattern-v0")
    arguments = {
        name: parameter.default
        for name, parameter in inspect.signature(family.base).parameters.items()
        if name != "target" or not fixed_target
    }
    return {
        "id": env_id,
        "description": (inspect.getdoc(type(env)) or "").splitlines()[0],
        "action_space": str(env.action_space),
        "observation_spaces": spaces,
        "arguments": arguments,
        "vector": True,
    }
