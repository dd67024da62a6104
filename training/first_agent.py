"""A first PPO agent on ``lasergym/Star-v0``: train, judge, draw.

Run ``python training/first_agent.py --steps 1000000``; it needs ``pip install "lasergym[train]"``.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

import lasergym

ENV_ID = "lasergym/Star-v0"
N_ENVS = 64
EVALUATION_SEED = 1_000_000


class EveryFifthPixel(VecEnvWrapper):
    """Observations of 20 × 20 px instead of 100 × 100: every fifth row and column.

    A pulse is 18 px wide, so little is lost, and a network needs a twenty-fifth of the inputs.
    """

    def __init__(self, venv: VecEnv) -> None:
        """Wraps ``venv``, whose observations are images, channel first."""
        channels, height, width = venv.observation_space.shape  # type: ignore[misc]
        super().__init__(venv, Box(0, 255, (channels, height // 5, width // 5), np.uint8))

    def reset(self) -> NDArray[np.uint8]:
        """The first observations."""
        return _thin(self.venv.reset())

    def step_wait(self) -> VecEnvStepReturn:
        """The next observations; terminal ones are thinned alike."""
        observations, rewards, dones, infos = self.venv.step_wait()
        for index in np.flatnonzero(dones):
            infos[index]["terminal_observation"] = _thin(infos[index]["terminal_observation"])
        return _thin(observations), rewards, dones, infos


def _thin(observations: Any) -> NDArray[np.uint8]:
    return np.ascontiguousarray(observations[..., 2::5, 2::5])


def make_envs(n_envs: int, seed: int) -> VecEnv:
    """Native environments with thinned observations."""
    return EveryFifthPixel(lasergym.sb3.make_vec_env(ENV_ID, n_envs, seed, observation="layers"))


def make_agent(seed: int) -> PPO:
    """PPO with a small perceptron.

    A rollout is one episode of each environment. With gamma = 0.5 the agent plans a pulse or two
    ahead, and what it is to learn comes through less noise. It begins with actions of standard
    deviation exp(-1.5), 11 px.
    """
    return PPO(
        "MlpPolicy",
        make_envs(N_ENVS, seed),
        n_steps=45,
        batch_size=576,
        n_epochs=4,
        gamma=0.5,
        learning_rate=1e-3,
        policy_kwargs={"log_std_init": -1.5, "activation_fn": torch.nn.ReLU},
        seed=seed,
    )


def judge(name: str, agent: PPO, episodes: int) -> None:
    """Prints the return of the agent as it acts in training, and without its exploration."""
    envs = make_envs(8, EVALUATION_SEED)
    mean, spread = evaluate_policy(agent, envs, episodes, deterministic=False)
    steady, _ = evaluate_policy(agent, envs, 8, deterministic=True)
    print(f"{name:22} {mean:7.4f} ± {spread:.4f} ({episodes} episodes), mean action {steady:.4f}")


def judge_random(episodes: int) -> None:
    """Prints the return of actions uniform in [-1, 1]²."""
    envs = make_envs(episodes, EVALUATION_SEED)
    envs.reset()
    generator = np.random.default_rng(EVALUATION_SEED)
    returns = np.zeros(episodes)
    for _ in range(45):
        _, rewards, _, _ = envs.step(generator.uniform(-1, 1, (episodes, 2)).astype(np.float32))
        returns += rewards
    spread = returns.std()
    print(f"{'uniform actions':22} {returns.mean():7.4f} ± {spread:.4f} ({episodes} episodes)")


def draw(agent: PPO, path: Path) -> None:
    """Draws one episode as the agent acts in training."""
    envs = make_envs(1, EVALUATION_SEED)
    observations: Any = envs.reset()
    actions, done = [], False
    while not done:
        action, _ = agent.predict(observations)
        observations, _, dones, _ = envs.step(action)
        actions.append(action[0])
        done = bool(dones[0])
    pulses = 50.0 * (1.0 + np.array(actions, np.float64))
    target = lasergym.targets.star()
    score = lasergym.score(target, pulses)
    caption = f"PPO: {score.pulses} pulses, reward {score.reward:.3f}"
    lasergym.render.render_trajectory(target, pulses, path, width_px=480, caption=caption)


def main() -> None:
    """Trains, judges and draws."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000, help="pulses to train with")
    parser.add_argument("--episodes", type=int, default=64, help="episodes of each judgement")
    parser.add_argument("--seed", type=int, default=0, help="seed of network and environments")
    parser.add_argument("--picture", type=Path, default=Path("first_agent.png"))
    arguments = parser.parse_args()
    judge_random(arguments.episodes)
    for planner in ("raster", "raster-fine", "greedy"):
        plan = lasergym.plan(lasergym.targets.star(), planner)
        print(f"{planner:22} {plan.reward:7.4f} ({plan.pulses} pulses)")
    agent = make_agent(arguments.seed)
    judge("PPO before training", agent, arguments.episodes)
    started_s, started_cpu_s = time.perf_counter(), time.process_time()
    agent.learn(arguments.steps)
    elapsed_s, cpu_s = time.perf_counter() - started_s, time.process_time() - started_cpu_s
    judge("PPO after training", agent, arguments.episodes)
    print(f"{agent.num_timesteps} steps, {elapsed_s:.0f} s, {cpu_s:.0f} s of CPU time")
    draw(agent, arguments.picture)


if __name__ == "__main__":
    main()
