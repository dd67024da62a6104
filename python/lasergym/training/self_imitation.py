"""Settings of self-imitation learning, which can be read without torch."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lasergym.errors import OptionError
from lasergym.options import integer_in

__all__ = ["SelfImitationOptions"]


@dataclass(frozen=True, kw_only=True)
class SelfImitationOptions:
    """Settings of self-imitation.

    Attributes:
        updates: Gradient steps after each update of the algorithm; 0 switches self-imitation off.
            The authors take 10 with PPO and 4 with A2C.
        batch_size: Samples of each gradient step.
        capacity: Samples that are remembered; the oldest go first. The authors take 50 000 with
            PPO and 100 000 with A2C.
        alpha: How much the priorities count, in [0, 1].
        beta: How much importance weights correct for the priorities, in [0, 1].
        loss_weight: Factor of the whole loss beside that of the algorithm. The authors take 0.1
            with PPO and 1 with A2C.
        value_weight: Factor of the value's part, β of the paper.
        entropy_weight: Factor of the entropy of the samples that are imitated, in the authors'
            code that of the algorithm itself.
        clip: Largest advantage that counts, in units of the value function.
        least_samples: The loss is divided by the number of samples with a positive advantage, or
            by this where it is more, so that few samples do not weigh too much.
        begin_samples: Samples to remember before the first gradient step.
    """

    updates: int = 10
    batch_size: int = 512
    capacity: int = 100_000
    alpha: float = 0.6
    beta: float = 0.1
    loss_weight: float = 0.1
    value_weight: float = 0.01
    entropy_weight: float = 0.0
    clip: float = 1.0
    least_samples: int = 64
    begin_samples: int = 100

    def __post_init__(self) -> None:
        """Checks the ranges.

        Raises:
            OptionError: A setting is outside its range.
        """
        integer_in("updates", self.updates, 0, 1_000_000)
        for name in ("batch_size", "capacity", "least_samples", "begin_samples"):
            integer_in(name, getattr(self, name), 1, 2**31 - 1)
        for name in ("alpha", "beta"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise OptionError(f"{name} is {getattr(self, name)}, but must be from 0 to 1")
        for name in ("loss_weight", "value_weight", "entropy_weight"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise OptionError(f"{name} is {getattr(self, name)}, but must not be negative")
        if not 0.0 < self.clip < math.inf:
            raise OptionError(f"clip is {self.clip}, but must be positive and finite")
