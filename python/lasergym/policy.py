"""Trained policies, run by the native runner: no torch, no ONNX."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lasergym import _native
from lasergym.errors import PolicyError
from lasergym.options import integer_in

__all__ = ["Policy"]


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
    def load(cls, path: str | Path) -> Policy:
        """Loads a policy.

        Args:
            path: A ``.safetensors`` file that :mod:`lasergym.export` wrote.

        Raises:
            PolicyError: The file cannot be read, is damaged or is not a policy.
        """
        if not Path(path).is_file():
            raise PolicyError(f"there is no policy file {str(path)!r}")
        return cls(_native.Policy.load(Path(path)))

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
