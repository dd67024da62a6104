"""Trained policies, run by the native runner: no torch, no ONNX."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.errors import PolicyError
from lasergym.options import integer_in

__all__ = ["SHIPPED_POLICIES", "Policy", "PolicyName", "policy_file"]

PolicyName: TypeAlias = Literal["star", "rotated-star", "random-shape"]
"""Names of the policies that are shipped: for the upright star, for stars at any angle, and for any
drawing."""

SHIPPED_POLICIES: tuple[PolicyName, ...] = get_args(PolicyName)
"""All policies that are shipped."""


class Policy:
    """A trained policy: one forward pass of its network decides one pulse.

    Made by :meth:`load` or :meth:`from_bytes`.

    Attributes:
        native: The policy as the planners take it.
        manifest: What the file says about itself: layers, decision, environment, versions and
            training, as JSON values.
    """

    def __init__(self, native: _native.Policy) -> None:
        """Wraps a loaded policy."""
        self.native = native
        self.manifest: dict[str, Any] = json.loads(native.manifest())

    @classmethod
    def load(cls, policy: PolicyName | str | Path) -> Policy:
        """Loads a policy.

        Args:
            policy: Name of a shipped policy (:data:`SHIPPED_POLICIES`), or a ``.safetensors`` file
                that :mod:`lasergym.export` wrote.

        Raises:
            PolicyError: The file cannot be read, is damaged or is not a policy.
        """
        return cls.from_bytes(policy_file(policy))

    @classmethod
    def from_bytes(cls, content: bytes) -> Policy:
        """Loads a policy from the content of a file.

        Raises:
            PolicyError: The content is damaged or not a policy.
        """
        return cls(_native.Policy.from_bytes(content))

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return self.native.parameters()

    def act(self, observation: NDArray[np.uint8], *, max_pulses: int = 45) -> NDArray[np.float32]:
        """The deterministic action on one observation.

        Args:
            observation: uint8, shape (channels, 100, 100), as the environments give it: 3 channels
                (``observation="layers"``) for spatial policies, else those of the training.
            max_pulses: Pulse budget of the environment, at least 1, from which spatial policies
                read the pulses that are left.

        Returns:
            The action in [−1, 1]², shape (2,).

        Raises:
            ShapeError: The observation has another shape.
        """
        pixels = np.ascontiguousarray(observation, dtype=np.uint8)
        return self.native.act(pixels, integer_in("max_pulses", max_pulses, 1, 10_000))


def policy_file(policy: PolicyName | str | Path) -> bytes:
    """Content of the file of a policy.

    Args:
        policy: Name of a shipped policy, or of a ``.safetensors`` file.

    Raises:
        PolicyError: There is no such policy, or the file cannot be read.
    """
    if policy in SHIPPED_POLICIES:
        return _native.shipped_policy(str(policy))
    try:
        return Path(policy).read_bytes()
    except FileNotFoundError:
        names = ", ".join(SHIPPED_POLICIES)
        raise PolicyError(
            f"there is no policy file {str(policy)!r}, and shipped are only {names}"
        ) from None
    except OSError as error:
        raise PolicyError(f"{policy} cannot be read ({error.strerror})") from error
