"""``lasergym export``: the file acts as the agent does, and only then it is written."""

import json
from pathlib import Path

import numpy as np
import pytest

from lasergym.cli import main
from lasergym.targets import star

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from safetensors.torch import load  # noqa: E402 - only where it is installed
from stable_baselines3 import PPO  # noqa: E402

import lasergym  # noqa: E402
from lasergym.export import ParityError, parity_report  # noqa: E402
from lasergym.policy import SHIPPED_POLICIES, PolicyName, policy_file  # noqa: E402
from lasergym.sb3 import SpatialPolicy, make_vec_env, thinned  # noqa: E402
from lasergym.training.agents import Agent, load_agent  # noqa: E402
from lasergym.training.config import Observation  # noqa: E402
from lasergym.training.export import export_agent, visited_observations  # noqa: E402


@pytest.fixture(autouse=True)
def _inside_a_new_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def saved_spatial() -> Path:
    venv = make_vec_env("lasergym/RandomShape-v0", n_envs=2, observation="layers")
    model = PPO(SpatialPolicy, venv, n_steps=8, batch_size=16, seed=0)
    with torch.no_grad():
        generator = torch.Generator().manual_seed(1)
        model.policy.network.out.weight.normal_(0, 0.3, generator=generator)
    model.save("spatial.zip")
    return Path("spatial.zip")


@pytest.mark.parametrize("storage", ["float32", "bfloat16"])
def test_the_runner_decides_as_torch_on_a_thousand_observations(
    storage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", str(saved_spatial()), "-o", "policy.safetensors", "--storage", storage]
    assert main([*command, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["observations"] == 1000
    assert report["largest_difference"] <= 1e-4
    assert report["file_bytes"] == Path("policy.safetensors").stat().st_size
    policy = lasergym.Policy.load("policy.safetensors")
    plan = lasergym.plan(star(), "policy", policy=policy, max_pulses=40)
    assert plan.pulses == 40


def test_an_agent_that_sees_every_fifth_pixel_is_run_on_all(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("small.toml").write_text(
        "[task]\nenvironments = 2\nthinning = 5\nmax_pulses = 6\n[policy]\nkind = 'mlp'\n"
        "hidden_layers = [8]\n[method.ppo]\nsteps_per_environment = 8\nbatch_size = 8\n"
        "[run]\nsteps = 16\ntensorboard = false\n[evaluation]\nplanners = []\nevery_steps = 100\n"
    )
    assert main(["train", "small.toml", "--no-pictures"]) == 0
    assert main(["export", "runs/small", "--observations", "64"]) == 0
    assert "differ by at most" in capsys.readouterr().out
    policy = lasergym.Policy.load("policy.safetensors")
    decision = {"kind": "direct", "max_pulses": 6, "thinning": 5}
    assert policy.manifest["decision"] == decision
    agent = load_agent("runs/small")
    seen = visited_observations(agent, 3, 6, seed=4)
    assert thinned(seen, 5).shape == (3, 3, 20, 20)
    for observation, action in zip(seen, agent.act(seen, 6), strict=True):
        assert np.allclose(policy.act(observation, max_pulses=6), action, atol=1e-5)
    assert lasergym.plan(star(), "policy", policy=policy, max_pulses=6).pulses == 6


def test_observations_are_of_all_stages_of_random_shapes() -> None:
    agent = load_agent(saved_spatial())
    seen = visited_observations(agent, 200, 45)
    assert seen.shape == (200, 3, 100, 100)
    left = np.unique(seen[:, 2, 0, 0])
    assert len(left) >= 6
    assert np.array_equal(seen, visited_observations(agent, 200, 45))


def test_no_file_is_left_where_torch_and_runner_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = load_agent(saved_spatial())
    monkeypatch.setattr(
        lasergym.Policy, "act", lambda *_arguments, **_settings: np.ones(2, np.float32)
    )
    with pytest.raises(ParityError):
        export_agent(agent, Path("policy.safetensors"), observations=4)
    assert list(Path().glob("policy*")) == []


def test_a_folder_that_is_missing_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "model.zip", "-o", "nowhere/policy.safetensors"]) == 2
    assert "nowhere" in capsys.readouterr().err


@pytest.mark.parametrize("name", SHIPPED_POLICIES)
def test_shipped_policies_decide_as_torch_does_with_their_weights(name: PolicyName) -> None:
    shipped = lasergym.Policy.load(name)
    venv = make_vec_env("lasergym/RandomShape-v0", n_envs=1, observation="layers")
    policy = SpatialPolicy(
        venv.observation_space,
        venv.action_space,
        lambda _: 0.0,
        polish_px=shipped.manifest["decision"]["polish_px"],
    )
    policy.network.load_exported(load(policy_file(name)))
    agent = Agent(policy, Observation.LAYERS)
    seen = visited_observations(agent, 400, 45, seed=1)
    parity_report(policy, Path(__file__), seen, lambda batch: np.stack([*map(shipped.act, batch)]))
