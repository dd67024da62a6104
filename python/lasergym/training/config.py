"""What a training run is told: task, policy, method, run and evaluation.

The defaults are those of ``lasergym train``; a TOML file names what differs.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym

from lasergym import planners
from lasergym.comparison.options import CompareOptions
from lasergym.comparison.work import PULSE_RADIUS_PX
from lasergym.envs import ABLATION_IDS
from lasergym.envs.settings import Settings
from lasergym.errors import MissingExtraError, OptionError
from lasergym.options import LARGEST_SEED, integer_in
from lasergym.targets import SIZE_PX
from lasergym.training.correction_options import CorrectionOptions
from lasergym.training.self_imitation import SelfImitationOptions
from lasergym.training.tables import ConfigError, from_table, nearest, to_table

__all__ = [
    "A2cConfig",
    "Activation",
    "ConfigError",
    "EvaluationConfig",
    "MethodConfig",
    "Observation",
    "Phase",
    "PolicyConfig",
    "PolicyKind",
    "PpoConfig",
    "RunConfig",
    "TaskConfig",
    "TrainingConfig",
]

_LONGEST_FILE = 1_000_000
_MOST = 2**31 - 1


class Observation(Enum):
    """What the agent sees: one channel as in Xie et al. (2022), or three."""

    REMAINING = "remaining"
    LAYERS = "layers"


class PolicyKind(Enum):
    """The network of the agent; :mod:`lasergym.training.policies` makes it."""

    MLP = "mlp"
    CNN = "cnn"
    SPATIAL = "spatial"


class Activation(Enum):
    """What follows each hidden layer."""

    TANH = "tanh"
    RELU = "relu"


class Phase(Enum):
    """A way to train; a run does its phases one after the other."""

    PLANNER = "planner"
    PPO = "ppo"
    A2C = "a2c"


@dataclass(frozen=True, kw_only=True)
class TaskConfig:
    """What is trained on.

    Attributes:
        env_id: Id of the environment.
        environments: Environments stepped at once, at least 1.
        threads: Native threads that step them.
        observation: ``"remaining"`` or ``"layers"``.
        thinning: Only every such row and column is seen; a divisor of 100, 1 shows all.
        max_pulses: Pulse budget of an episode.
        pulse_radius_px: Radius of the disc that a pulse machines, px.
        completion: Machined fraction that ends an episode, in (0, 1].
        pointing_error_px: Standard deviation of each pulse's displacement, px.
        radius_error: Relative standard deviation of the pulse radius.
        stop_on_miss: Whether a pulse that machines no target ends the episode.
        target: Drawing to machine, for ``lasergym/Pattern-v0`` only.
        normalise_observations: Whether inputs are normalised by their running mean and deviation.
        normalise_rewards: Whether rewards are scaled by the running deviation of the return.
    """

    env_id: str = "lasergym/Star-v0"
    environments: int = 64
    threads: int = 1
    observation: Observation = Observation.LAYERS
    thinning: int = 1
    max_pulses: int = 45
    pulse_radius_px: float = 9.0
    completion: float = 0.99
    pointing_error_px: float = 0.0
    radius_error: float = 0.0
    stop_on_miss: bool = False
    target: str | None = None
    normalise_observations: bool = False
    normalise_rewards: bool = False

    def __post_init__(self) -> None:
        """Checks the ranges, those of the process by making an environment."""
        if self.env_id not in ABLATION_IDS:
            raise ConfigError(
                f"task.env_id is {self.env_id!r}{nearest(self.env_id, [*ABLATION_IDS])}"
            )
        integer_in("task.environments", self.environments, 1, 65_536)
        integer_in("task.threads", self.threads, 1, 1024)
        if self.thinning < 1 or SIZE_PX % self.thinning:
            raise ConfigError(
                f"task.thinning is {self.thinning}, but must be a divisor of {SIZE_PX}"
            )
        if self.target is not None and self.env_id != "lasergym/Pattern-v0":
            raise ConfigError(f"task.target is for lasergym/Pattern-v0, not for {self.env_id}")
        environment = gym.make(self.env_id, disable_env_checker=True, **self.process())
        environment.close()

    def process(self) -> dict[str, Any]:
        """The arguments of the environment."""
        names = set(Settings.__dataclass_fields__) - {"task", "target", "observation"}
        process = {name: getattr(self, name) for name in sorted(names)}
        process["observation"] = self.observation.value
        if self.target is not None:
            process["target"] = self.target
        return process


@dataclass(frozen=True, kw_only=True)
class PolicyConfig:
    """The agent's network.

    Attributes:
        kind: ``"mlp"``, ``"cnn"`` or ``"spatial"``.
        hidden_layers: Widths of the hidden layers; of ``"cnn"`` those after its convolutions. Not
            for ``"spatial"``.
        activation: What follows each hidden layer. Not for ``"spatial"``.
        initial_log_std: Logarithm of the standard deviation that the actions begin with; −1.5 is
            11 px. Not for ``"spatial"``.
        initial_policy: Weights that training begins with: the folder of a run or the ``.zip`` of a
            model with the same networks; for ``"spatial"`` also an exported ``.safetensors``, which
            leaves value and temperature as they are. None begins anew.
        arguments: Further keyword arguments of the policy class, as they are.
    """

    kind: PolicyKind = PolicyKind.CNN
    hidden_layers: tuple[int, ...] = ()
    activation: Activation = Activation.RELU
    initial_log_std: float = -1.5
    initial_policy: str | None = None
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Checks the ranges."""
        for width in self.hidden_layers:
            integer_in("policy.hidden_layers", width, 1, 65_536)
        if not -20.0 <= self.initial_log_std <= 2.0:
            raise ConfigError(
                f"policy.initial_log_std is {self.initial_log_std}, but must be from -20 to 2"
            )
        if self.kind is PolicyKind.SPATIAL and self.hidden_layers:
            raise ConfigError('policy.hidden_layers is not for "spatial": leave it out')


@dataclass(frozen=True, kw_only=True)
class A2cConfig:
    """Settings of A2C; the names of Stable-Baselines3 where they differ stand in brackets.

    Attributes:
        steps_per_environment: Steps of each environment between two updates (n_steps).
        gamma: Discount factor, in [0, 1].
        gae_lambda: λ of the generalised advantage estimate, in [0, 1].
        entropy_weight: Factor of the entropy (ent_coef).
        value_weight: Factor of the value's loss (vf_coef).
        max_gradient_norm: Longest gradient of an update (max_grad_norm).
        learning_rate: Learning rate at the start.
        final_learning_rate: Learning rate that is reached linearly at the end; None keeps it.
    """

    where: ClassVar[str] = "method.a2c"

    steps_per_environment: int = 5
    gamma: float = 0.9
    gae_lambda: float = 1.0
    entropy_weight: float = 0.0
    value_weight: float = 0.5
    max_gradient_norm: float = 0.5
    learning_rate: float = 7e-4
    final_learning_rate: float | None = None

    def __post_init__(self) -> None:
        """Checks the ranges."""
        where = self.where
        integer_in(f"{where}.steps_per_environment", self.steps_per_environment, 1, _MOST)
        for key in ("gamma", "gae_lambda"):
            _check_range(f"{where}.{key}", getattr(self, key), 0.0, 1.0)
        for key in ("entropy_weight", "value_weight", "max_gradient_norm", "learning_rate"):
            _check_range(f"{where}.{key}", getattr(self, key), 0.0, 1e6)
        if self.final_learning_rate is not None:
            _check_range(f"{where}.final_learning_rate", self.final_learning_rate, 0.0, 1e6)


@dataclass(frozen=True, kw_only=True)
class PpoConfig(A2cConfig):
    """Settings of PPO, those of A2C included.

    Attributes:
        batch_size: Samples of a gradient step; divides the samples between two updates.
        epochs: How often each sample is used (n_epochs).
        clip_range: How far the probability of an action may change, as a ratio less one.
        target_kl: Divergence of the policy above which an update ends early; None never ends it.
    """

    where: ClassVar[str] = "method.ppo"

    steps_per_environment: int = 45
    gae_lambda: float = 0.95
    learning_rate: float = 3e-4
    batch_size: int = 576
    epochs: int = 4
    clip_range: float = 0.2
    target_kl: float | None = None

    def __post_init__(self) -> None:
        """Checks the ranges."""
        super().__post_init__()
        integer_in("method.ppo.batch_size", self.batch_size, 2, _MOST)
        integer_in("method.ppo.epochs", self.epochs, 1, 10_000)
        _check_range("method.ppo.clip_range", self.clip_range, 0.0, 1e6)
        if self.target_kl is not None:
            _check_range("method.ppo.target_kl", self.target_kl, 0.0, 1e6)


@dataclass(frozen=True, kw_only=True)
class MethodConfig:
    """How the agent learns.

    Attributes:
        phases: The phases in their order; each has a table of its own name. ``"planner"`` comes
            first, alone or before ``"ppo"`` or ``"a2c"``.
        planner: Settings of the phase ``"planner"``: learning from the annealing planner.
        ppo: Settings of the phase ``"ppo"``.
        a2c: Settings of the phase ``"a2c"``.
        self_imitation: Self-imitation beside PPO or A2C; None leaves it out.
    """

    phases: tuple[Phase, ...] = (Phase.PPO,)
    planner: CorrectionOptions = field(default_factory=CorrectionOptions)
    ppo: PpoConfig = field(default_factory=PpoConfig)
    a2c: A2cConfig = field(default_factory=A2cConfig)
    self_imitation: SelfImitationOptions | None = None

    def __post_init__(self) -> None:
        """Checks the order of the phases."""
        first, *rest = self.phases or (None,)
        at_most = 1 if first is Phase.PLANNER else 0
        if first is None or len(rest) > at_most or Phase.PLANNER in rest:
            raise ConfigError(
                f"method.phases is {[phase.value for phase in self.phases]}, but must be one of "
                f"{', '.join(phase.value for phase in Phase)}, or planner and then another"
            )

    @property
    def learning(self) -> A2cConfig:
        """The settings of the phase of reinforcement learning."""
        return self.a2c if self.phases[-1] is Phase.A2C else self.ppo

    @property
    def has_reinforcement(self) -> bool:
        """Whether there is a phase of reinforcement learning."""
        return self.phases[-1] is not Phase.PLANNER


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """How long the run is and what it leaves.

    Attributes:
        steps: Pulses to train with, over all environments.
        seed: Everything random derives from it, from 0 to 2³² − 1.
        torch_threads: Threads of torch.
        device: Device of torch, such as ``"cpu"``, ``"cuda"`` or ``"auto"``.
        checkpoint_min: A checkpoint is written when this time has passed since the last, minutes.
        checkpoint_steps: A checkpoint is written after so many steps too; None goes by time alone.
        checkpoints_kept: Older ones are deleted.
        tensorboard: Whether logs for TensorBoard are written.
    """

    steps: int = 10_000_000
    seed: int = 0
    torch_threads: int = 1
    device: str = "cpu"
    checkpoint_min: float = 5.0
    checkpoint_steps: int | None = None
    checkpoints_kept: int = 2
    tensorboard: bool = True

    def __post_init__(self) -> None:
        """Checks the ranges."""
        integer_in("run.steps", self.steps, 1, 10**15)
        integer_in("run.seed", self.seed, 0, min(2**32 - 1, LARGEST_SEED))
        integer_in("run.torch_threads", self.torch_threads, 1, 1024)
        integer_in("run.checkpoints_kept", self.checkpoints_kept, 1, 1_000_000)
        if self.checkpoint_steps is not None:
            integer_in("run.checkpoint_steps", self.checkpoint_steps, 1, 10**15)
        if not 0.0 < self.checkpoint_min < math.inf:
            raise ConfigError(f"run.checkpoint_min is {self.checkpoint_min}, but must be positive")


@dataclass(frozen=True, kw_only=True)
class EvaluationConfig:
    """How the agent is judged while it trains: without exploration, on held-out targets.

    Attributes:
        every_steps: Steps between two evaluations.
        targets: Held-out targets: angles of the rotated star, or random shapes of the seeds from
            2 000 000 000 up, which no training sees. The star and a pattern are one target.
        planners: Planners that are judged on the same targets once, as lines of the curve; none
            that needs a policy file.
        anneal_s: Time of ``"anneal"`` on a target, s.
        cma_es_s: Time of ``"cma-es"`` on a target, s.
    """

    every_steps: int = 200_000
    targets: int = 32
    planners: tuple[str, ...] = ("greedy", "anneal")
    anneal_s: float = 1.0
    cma_es_s: float = 10.0

    def __post_init__(self) -> None:
        """Checks the ranges."""
        integer_in("evaluation.every_steps", self.every_steps, 1, 10**15)
        integer_in("evaluation.targets", self.targets, 1, 20_000)
        for name in self.planners:
            if name not in planners.PLANNERS:
                raise ConfigError(
                    f"evaluation.planners has {name!r}{nearest(name, list(planners.PLANNERS))}"
                )
        for key in ("anneal_s", "cma_es_s"):
            value = getattr(self, key)
            if not 0.0 < value <= 86_400.0:
                raise ConfigError(f"evaluation.{key} is {value}, but must be above 0 s")
        if self.planners:
            try:
                CompareOptions(planners=self.planners)
            except OptionError as error:
                raise ConfigError(f"evaluation.planners: {error}") from error


@dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """A whole configuration; the tables of the TOML file have the names of its attributes."""

    task: TaskConfig = field(default_factory=TaskConfig)
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    method: MethodConfig = field(default_factory=MethodConfig)
    run: RunConfig = field(default_factory=RunConfig)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)

    def __post_init__(self) -> None:
        """Checks what tables say together."""
        if self.evaluation.planners and self.task.pulse_radius_px != PULSE_RADIUS_PX:
            raise ConfigError(
                f"evaluation.planners fire pulses of {PULSE_RADIUS_PX:g} px, but "
                f"task.pulse_radius_px is {self.task.pulse_radius_px:g}: leave them out"
            )
        if self.policy.kind is PolicyKind.SPATIAL:
            task = self.task
            if (task.observation, task.thinning) != (Observation.LAYERS, 1):
                raise ConfigError(
                    'policy.kind "spatial" sees task.observation "layers" with task.thinning 1, '
                    f'but they are "{task.observation.value}" and {task.thinning}'
                )
            if task.normalise_observations:
                raise ConfigError(
                    'policy.kind "spatial" counts pixels: leave out task.normalise_observations'
                )
        if Phase.PLANNER in self.method.phases:
            self._check_lessons()
        if self.method.phases[-1] is Phase.PPO:
            ppo = self.method.ppo
            samples = ppo.steps_per_environment * self.task.environments
            if samples % ppo.batch_size:
                raise ConfigError(
                    f"method.ppo.batch_size is {ppo.batch_size}, but must divide "
                    f"steps_per_environment × environments = {samples}"
                )

    def _check_lessons(self) -> None:
        """Checks that the planner can teach the policy."""
        if self.policy.kind is not PolicyKind.SPATIAL:
            raise ConfigError(
                'the phase "planner" of method.phases teaches policy.kind "spatial", but it is '
                f'"{self.policy.kind.value}"'
            )
        channels = self.policy.arguments.get("channels", self.method.planner.channels)
        if channels != self.method.planner.channels:
            raise ConfigError(
                f"policy.arguments.channels is {channels}, but method.planner.channels is "
                f"{self.method.planner.channels}: they are one network"
            )

    @classmethod
    def load(cls, path: str | Path) -> TrainingConfig:
        """Reads a TOML file.

        Raises:
            ConfigError: It is missing, no TOML, or has unknown keys or wrong values.
            OptionError: A value is outside its range.
        """
        return cls.from_table(_read_toml(Path(path)))

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> TrainingConfig:
        """Takes what TOML or JSON holds; see :meth:`load` for the errors."""
        return from_table(cls, table)

    @classmethod
    def from_json(cls, path: Path) -> TrainingConfig:
        """Reads what :meth:`as_table` gave."""
        try:
            return cls.from_table(json.loads(path.read_text(encoding="utf-8")))
        except (OSError, json.JSONDecodeError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path} is no configuration of a run: {error}") from error

    def as_table(self) -> dict[str, Any]:
        """All settings as JSON holds them."""
        table: dict[str, Any] = to_table(self)
        return table

    def with_run(self, *, steps: int | None = None, seed: int | None = None) -> TrainingConfig:
        """The same with other steps or another seed."""
        run = self.run
        if steps is not None:
            run = replace(run, steps=steps)
        if seed is not None:
            run = replace(run, seed=seed)
        return replace(self, run=run)


def _check_range(name: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        raise OptionError(f"{name} is {value}, but must be from {least:g} to {most:g}")


def _read_toml(path: Path) -> dict[str, Any]:
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        try:
            import tomli as tomllib
        except ImportError as error:
            raise MissingExtraError(
                'reading TOML needs tomli here: pip install "lasergym[train]"'
            ) from error
    try:
        if path.stat().st_size > _LONGEST_FILE:
            raise ConfigError(f"{path} is longer than {_LONGEST_FILE} bytes")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise ConfigError(f"there is no configuration {path}") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{path} cannot be read as TOML: {error}") from error
