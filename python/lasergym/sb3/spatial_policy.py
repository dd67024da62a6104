"""A policy that knows what a pulse does and learns how to correct the ring score."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor, nn

from lasergym.errors import OptionError
from lasergym.options import integer_in
from lasergym.sb3.spatial_distribution import CellDistribution
from lasergym.sb3.spatial_network import CorrectionNet
from lasergym.sb3.spatial_position import best_actions, corrected_scores
from lasergym.sb3.spatial_scores import RingScores, ring_scores
from lasergym.sb3.spatial_view import views
from lasergym.targets import SIZE_PX
from lasergym.training.spatial_decision import POLISH_PX, RING_WEIGHT

if TYPE_CHECKING:
    from lasergym.export import ExportedNetwork

__all__ = ["SpatialPolicy"]

_NOTHING_GAINED_PX = -128.0
"""Value of a pixel where a pulse gains nothing; less what it would lose. Below all ring scores."""

_AREA_SCALE_PX = 5000.0
_GAIN_SCALE_PX = 256.0
_PULSE_SCALE = 45.0


@dataclass(frozen=True, eq=False)
class _Sight:
    """What one look at a batch of observations gives."""

    scores: RingScores
    features: Tensor
    corrections: Tensor


class SpatialPolicy(ActorCriticPolicy):
    """Ring scores, worked out exactly, that a network corrects about the best place.

    For the observation ``"layers"`` and the action [-1, 1]² of the environments. Gain (hits −
    misses) and ring (target left within 3 px about the mark) of a pulse are known at every pixel
    centre; the network sees 56 × 56 px about the pixel of best gain − ring weight × ring and
    corrects that score within 8 px of it. Untrained it corrects nothing, and the deterministic
    policy fires at the best ring score, as the greedy planner with ring score.

    Without exploration the pulse goes to the best corrected pixel, polished below the pixel by its
    exact gain, as the runner does it with the exported policy. With exploration every pixel is
    drawn with a probability ∝ exp(corrected score / temperature), evenly within the pixel; the
    temperature is learnt. Pixels where a pulse gains nothing are the least probable and are not
    corrected.

    The value comes from remaining target, best gain, pulses left and the mean of the network's last
    features. It leaves these features alone: only actions train the network.
    """

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Space[Any],
        lr_schedule: Schedule,
        *,
        max_pulses: int = 45,
        pulse_radius_px: float = 9.0,
        ring_weight: float = RING_WEIGHT,
        polish_px: float = POLISH_PX,
        inverse_temperature_per_px: float = 0.5,
        channels: int = 32,
        value_channels: int = 64,
        use_sde: bool = False,
        optimizer_class: type[torch.optim.Optimizer] = torch.optim.Adam,
        optimizer_kwargs: dict[str, Any] | None = None,
    ) -> None:
        """Makes an untrained policy.

        Args:
            observation_space: Box of uint8 and shape (3, 100, 100).
            action_space: Box [-1, 1]².
            lr_schedule: Learning rate by the part of training that remains.
            max_pulses: Pulses of a whole episode, as in the environments: what the third layer of
                observations is counted in.
            pulse_radius_px: Radius of a pulse, px, in (0, 50].
            ring_weight: Weight of the ring, in [0, 1].
            polish_px: Range of the polish, px, in [0, 2].
            inverse_temperature_per_px: Initial inverse temperature, 1/px; 0.5 draws places that are
                2 px worse with 1/e of the probability.
            channels: Width of the network's layers.
            value_channels: Width of the value's hidden layer.
            use_sde: Not supported.
            optimizer_class: The optimiser.
            optimizer_kwargs: Its arguments beside the learning rate.

        Raises:
            OptionError: An option is outside its range or a space is another.
        """
        _check_spaces(observation_space, action_space)
        if use_sde:
            raise OptionError("use_sde is not supported by SpatialPolicy: leave it out")
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            net_arch=[],
            normalize_images=False,
            ortho_init=False,
            optimizer_class=optimizer_class,
            optimizer_kwargs=optimizer_kwargs,
        )
        self.max_pulses = integer_in("max_pulses", max_pulses, 1, 2**31 - 1)
        self.pulse_radius_px = _number_in("pulse_radius_px", pulse_radius_px, 1e-6, 50.0)
        self.ring_weight = _number_in("ring_weight", ring_weight, 0.0, 1.0)
        self.polish_px = _number_in("polish_px", polish_px, 0.0, 2.0)
        self.inverse_temperature_per_px = _number_in(
            "inverse_temperature_per_px", inverse_temperature_per_px, 1e-6, 1e6
        )
        self.value_channels = integer_in("value_channels", value_channels, 1, 65_536)
        self.action_dist = CellDistribution()
        self.network = CorrectionNet(integer_in("channels", channels, 1, 65_536))
        self.inverse_temperature = self.action_dist.proba_distribution_net(
            self.inverse_temperature_per_px
        )
        self.value_net = nn.Sequential(  # type: ignore[assignment]
            nn.Linear(3 + channels, value_channels), nn.Tanh(), nn.Linear(value_channels, 1)
        )
        self.optimizer = self.optimizer_class(
            self.parameters(),
            lr=lr_schedule(1),  # type: ignore[call-arg]
            **self.optimizer_kwargs,
        )

    def forward(self, obs: Tensor, deterministic: bool = False) -> tuple[Tensor, Tensor, Tensor]:
        """Actions (batch, 2), values (batch, 1) and log densities (batch,)."""
        sight = self._look(obs)
        distribution = self._distribution(sight)
        actions = distribution.get_actions(deterministic)
        return actions, self._values(sight), distribution.log_prob(actions)

    def evaluate_actions(self, obs: Any, actions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Values (batch, 1), log densities of actions and entropies, both (batch,)."""
        sight = self._look(obs)
        distribution = self._distribution(sight)
        return self._values(sight), distribution.log_prob(actions), distribution.entropy()

    def get_distribution(self, obs: Any) -> CellDistribution:
        """The density of actions."""
        return self._distribution(self._look(obs))

    def predict_values(self, obs: Any) -> Tensor:
        """Values, shape (batch, 1)."""
        return self._values(self._look(obs))

    def exported(self) -> ExportedNetwork:
        """The network for the runner, which works out scores, view and position itself."""
        return self.network.exported(self.ring_weight, self.polish_px)

    def _build(self, lr_schedule: Schedule) -> None:
        """Networks and optimiser are made when the options are known."""

    def _look(self, observations: Tensor) -> _Sight:
        with torch.no_grad():
            scores = ring_scores(
                observations,
                pulse_radius_px=self.pulse_radius_px,
                ring_weight=self.ring_weight,
                max_pulses=self.max_pulses,
            )
            seen = views(scores).to(self.network.stem.weight.dtype)
        features = self.network.features(seen)
        return _Sight(scores, features, self.network.corrections(features))

    def _distribution(self, sight: _Sight) -> CellDistribution:
        gains_px = sight.scores.gains_px
        values_px = torch.where(
            gains_px > 0,
            corrected_scores(sight.scores, sight.corrections),
            gains_px + _NOTHING_GAINED_PX,
        )
        return CellDistribution().proba_distribution(
            self.inverse_temperature(values_px),
            lambda: best_actions(
                sight.scores,
                sight.corrections,
                pulse_radius_px=self.pulse_radius_px,
                ring_weight=self.ring_weight,
                polish_px=self.polish_px,
            ),
        )

    def _values(self, sight: _Sight) -> Tensor:
        scores = sight.scores
        known = [
            scores.layers[:, 0].sum((1, 2)) / _AREA_SCALE_PX,
            scores.gains_px.amax((1, 2)) / _GAIN_SCALE_PX,
            scores.pulses_left / _PULSE_SCALE,
        ]
        learnt = sight.features.detach().mean((2, 3))
        values: Tensor = self.value_net(torch.cat([torch.stack(known, 1), learnt], 1))
        return values

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {
            "observation_space": self.observation_space,
            "action_space": self.action_space,
            "lr_schedule": self._dummy_schedule,
            "max_pulses": self.max_pulses,
            "pulse_radius_px": self.pulse_radius_px,
            "ring_weight": self.ring_weight,
            "polish_px": self.polish_px,
            "inverse_temperature_per_px": self.inverse_temperature_per_px,
            "channels": self.network.channels,
            "value_channels": self.value_channels,
            "optimizer_class": self.optimizer_class,
            "optimizer_kwargs": self.optimizer_kwargs,
        }


def _check_spaces(observation_space: Any, action_space: Any) -> None:
    shape = (3, SIZE_PX, SIZE_PX)
    seen = getattr(observation_space, "shape", None), getattr(observation_space, "dtype", None)
    if seen != (shape, np.uint8):
        raise OptionError(
            f"observations are {observation_space}, but SpatialPolicy sees uint8 of shape {shape}: "
            'take observation="layers", not thinned and not normalised'
        )
    if action_space != spaces.Box(-1.0, 1.0, (2,), np.float32):
        raise OptionError(f"actions are {action_space}, but SpatialPolicy gives [-1, 1]²")


def _number_in(name: str, value: float, least: float, most: float) -> float:
    if not (math.isfinite(value) and least <= value <= most):
        raise OptionError(f"{name} is {value}, but must be from {least:g} to {most:g}")
    return float(value)
