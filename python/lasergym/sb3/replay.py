"""Prioritised replay of observations, actions and returns, in little memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lasergym.errors import LasergymError, OptionError
from lasergym.options import integer_in

__all__ = ["PrioritisedReplay", "ReplayBatch", "ReplayError"]

_LEAST_PRIORITY = 1e-6
"""What a sample without any advantage keeps, so that it can be drawn again."""


class ReplayError(LasergymError, ValueError):
    """What is added to or loaded into a replay does not fit it."""


@dataclass(frozen=True)
class ReplayBatch:
    """Samples drawn from a replay.

    Attributes:
        indices: Where they lie, for :meth:`PrioritisedReplay.set_priorities`; shape (batch,).
        observations: Shape (batch, *observation), with the dtype they were added with.
        actions: Shape (batch, *action).
        returns: Discounted returns, shape (batch,), float64.
        weights: Importance weights in (0, 1], shape (batch,), float32.
    """

    indices: NDArray[np.int64]
    observations: NDArray[Any]
    actions: NDArray[Any]
    returns: NDArray[np.float64]
    weights: NDArray[np.float32]


class PrioritisedReplay:
    """A ring of samples that are drawn in proportion to priority^α.

    Schaul et al. (2016), "Prioritized Experience Replay", proportional variant. Images in uint8
    whose channels have at most two values each, as those of lasergym, take one bit a pixel; the
    first image with more values makes the ring keep all of them plainly.
    """

    def __init__(self, capacity: int, alpha: float) -> None:
        """Makes an empty ring.

        Args:
            capacity: Most samples; later ones replace the oldest.
            alpha: How much priorities count, in [0, 1]; with 0 all samples are equal.
        """
        self.capacity = integer_in("capacity", capacity, 1, 2**31 - 1)
        if not 0.0 <= alpha <= 1.0:
            raise OptionError(f"alpha is {alpha}, but must be from 0 to 1")
        self.alpha = alpha
        self._size = 0
        self._next = 0
        self._highest = 1.0
        self._images: _PackedImages | _PlainArrays | None = None
        self._actions: NDArray[Any] | None = None
        self._returns = np.zeros(self.capacity)
        self._priorities = np.zeros(self.capacity)

    def __len__(self) -> int:
        """Samples that it holds."""
        return self._size

    @property
    def memory_bytes(self) -> int:
        """Bytes of a full ring; what is not used yet takes no memory on most systems."""
        images = 0 if self._images is None else self._images.memory_bytes
        actions = 0 if self._actions is None else self._actions.nbytes
        return images + actions + self._returns.nbytes + self._priorities.nbytes

    def add(
        self, observations: NDArray[Any], actions: NDArray[Any], returns: NDArray[np.float64]
    ) -> None:
        """Adds samples with the highest priority so far.

        Args:
            observations: Shape (samples, *observation).
            actions: Shape (samples, *action).
            returns: Shape (samples,), finite.

        Raises:
            ReplayError: Shapes do not fit each other or earlier samples, or a return is not finite.
        """
        if not len(observations) == len(actions) == len(returns):
            raise ReplayError(
                f"{len(observations)} observations, {len(actions)} actions and {len(returns)} "
                "returns are given, but must be as many"
            )
        if not np.isfinite(returns).all():
            raise ReplayError("a return is not finite")
        if self._images is None or self._actions is None:
            self._images = _storage(self.capacity, observations)
            self._actions = np.zeros((self.capacity, *actions.shape[1:]), actions.dtype)
        if self._actions.shape[1:] != actions.shape[1:]:
            raise ReplayError(
                f"actions have shape {actions.shape[1:]}, but were {self._actions.shape[1:]}"
            )
        if self._images.shape != observations.shape[1:]:
            raise ReplayError(
                f"observations have shape {observations.shape[1:]}, but were {self._images.shape}"
            )
        observations, actions = observations[-self.capacity :], actions[-self.capacity :]
        returns = returns[-self.capacity :]
        if isinstance(self._images, _PackedImages) and not _two_levels(observations):
            self._images = self._images.plain()
        indices = (self._next + np.arange(len(returns))) % self.capacity
        self._images.write(indices, observations)
        self._actions[indices] = actions
        self._returns[indices] = returns
        self._priorities[indices] = self._highest
        self._next = int(self._next + len(returns)) % self.capacity
        self._size = min(self.capacity, self._size + len(returns))

    def probabilities(self) -> NDArray[np.float64]:
        """The chance of each sample to be drawn, shape (len,)."""
        powers: NDArray[np.float64] = self._priorities[: self._size] ** self.alpha
        powers /= powers.sum()
        return powers

    def sample(self, size: int, beta: float, generator: np.random.Generator) -> ReplayBatch:
        """Draws samples, with replacement.

        Args:
            size: Number of samples, at least 1.
            beta: How much importance weights correct for the priorities, in [0, 1].
            generator: Where the randomness comes from.

        Raises:
            ReplayError: The ring is empty.
        """
        if self._images is None or self._actions is None or self._size == 0:
            raise ReplayError("nothing can be drawn from an empty replay")
        probabilities = self.probabilities()
        bounds = np.cumsum(probabilities)
        drawn = generator.random(size) * bounds[-1]
        indices = np.minimum(np.searchsorted(bounds, drawn, side="right"), self._size - 1)
        weights = (probabilities[indices] / probabilities.min()) ** -beta
        return ReplayBatch(
            indices.astype(np.int64),
            self._images.read(indices),
            self._actions[indices],
            self._returns[indices],
            weights.astype(np.float32),
        )

    def set_priorities(self, indices: NDArray[np.int64], priorities: NDArray[Any]) -> None:
        """Sets the priorities of samples; what is below 10⁻⁶ becomes 10⁻⁶."""
        if len(indices) != len(priorities):
            raise ReplayError(f"{len(priorities)} priorities are given for {len(indices)} samples")
        raised = np.maximum(priorities, _LEAST_PRIORITY)
        self._priorities[indices] = raised
        self._highest = max(self._highest, float(raised.max(initial=0.0)))

    def state(self) -> dict[str, NDArray[Any]]:
        """All that :meth:`load_state` needs, as arrays."""
        arrays: dict[str, NDArray[Any]] = {
            "counters": np.array([self._size, self._next]),
            "highest": np.array(self._highest),
            "returns": self._returns[: self._size],
            "priorities": self._priorities[: self._size],
        }
        if self._images is not None and self._actions is not None:
            arrays["actions"] = self._actions[: self._size]
            arrays["observations"] = self._images.read(np.arange(0))
            arrays |= self._images.state(self._size)
        return arrays

    def load_state(self, arrays: dict[str, NDArray[Any]]) -> None:
        """Goes back to a state of :meth:`state`.

        Raises:
            ReplayError: The state is damaged or of a ring of another capacity.
        """
        try:
            size, following = (int(count) for count in arrays["counters"])
            if not (0 <= size <= self.capacity and 0 <= following < self.capacity):
                raise ReplayError(f"{size} samples do not fit a replay of {self.capacity}")
            self._size, self._next = size, following
            self._highest = float(arrays["highest"])
            self._returns[:size] = arrays["returns"]
            self._priorities[:size] = arrays["priorities"]
            if "actions" in arrays:
                actions = arrays["actions"]
                self._actions = np.zeros((self.capacity, *actions.shape[1:]), actions.dtype)
                self._actions[:size] = actions
                self._images = _stored(self.capacity, size, arrays)
        except (KeyError, ValueError, IndexError) as error:
            raise ReplayError(f"the state of a replay is damaged: {error}") from error


class _PlainArrays:
    """Observations as they are."""

    def __init__(self, capacity: int, shape: tuple[int, ...], dtype: Any) -> None:
        self.shape = shape
        self._arrays = np.zeros((capacity, *shape), dtype)

    @property
    def memory_bytes(self) -> int:
        return self._arrays.nbytes

    def write(self, indices: NDArray[np.int64], observations: NDArray[Any]) -> None:
        self._arrays[indices] = observations

    def read(self, indices: NDArray[np.int64]) -> NDArray[Any]:
        return self._arrays[indices]

    def state(self, size: int) -> dict[str, NDArray[Any]]:
        return {"plain": self._arrays[:size]}


class _PackedImages:
    """Images of uint8, channel first, whose channels have at most two values: a bit a pixel."""

    def __init__(self, capacity: int, shape: tuple[int, ...]) -> None:
        self.shape = shape
        self._pixels = int(np.prod(shape[1:]))
        self._bits = np.zeros((capacity, shape[0], -(-self._pixels // 8)), np.uint8)
        self._levels = np.zeros((capacity, shape[0], 2), np.uint8)

    @property
    def memory_bytes(self) -> int:
        return self._bits.nbytes + self._levels.nbytes

    def write(self, indices: NDArray[np.int64], observations: NDArray[np.uint8]) -> None:
        flat = observations.reshape(len(observations), self.shape[0], self._pixels)
        low, high = flat.min(axis=2), flat.max(axis=2)
        self._levels[indices] = np.stack([low, high], axis=2)
        self._bits[indices] = np.packbits(flat == high[..., None], axis=2)

    def read(self, indices: NDArray[np.int64]) -> NDArray[np.uint8]:
        set_bits = np.unpackbits(self._bits[indices], axis=2, count=self._pixels) > 0
        low, high = self._levels[indices, :, 0, None], self._levels[indices, :, 1, None]
        return np.where(set_bits, high, low).reshape(-1, *self.shape)

    def plain(self) -> _PlainArrays:
        plain = _PlainArrays(len(self._bits), self.shape, np.uint8)
        for start in range(0, len(self._bits), 1024):
            indices = np.arange(start, min(start + 1024, len(self._bits)))
            plain.write(indices, self.read(indices))
        return plain

    def state(self, size: int) -> dict[str, NDArray[Any]]:
        return {"bits": self._bits[:size], "levels": self._levels[:size]}

    def load(self, size: int, arrays: dict[str, NDArray[Any]]) -> None:
        self._bits[:size] = arrays["bits"]
        self._levels[:size] = arrays["levels"]


def _two_levels(observations: NDArray[Any]) -> bool:
    """Whether every channel of every image has at most two values."""
    flat = observations.reshape(*observations.shape[:2], -1)
    low, high = flat.min(axis=2, keepdims=True), flat.max(axis=2, keepdims=True)
    return bool(((flat == low) | (flat == high)).all())


def _storage(capacity: int, observations: NDArray[Any]) -> _PackedImages | _PlainArrays:
    shape = observations.shape[1:]
    if observations.dtype == np.uint8 and len(shape) == 3 and _two_levels(observations):
        return _PackedImages(capacity, shape)
    return _PlainArrays(capacity, shape, observations.dtype)


def _stored(
    capacity: int, size: int, arrays: dict[str, NDArray[Any]]
) -> _PackedImages | _PlainArrays:
    """The observations of a state; its ``observations`` is empty and tells their shape."""
    shape = arrays["observations"].shape[1:]
    if "bits" in arrays:
        packed = _PackedImages(capacity, shape)
        packed.load(size, arrays)
        return packed
    plain = _PlainArrays(capacity, shape, arrays["plain"].dtype)
    plain.write(np.arange(size), arrays["plain"])
    return plain
