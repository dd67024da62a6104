"""The pulse-ablation process in vectorised NumPy: a second implementation, pixel by pixel.

It shares no code with the Rust crate and must agree with it bit for bit, so it is an oracle in the
tests and the opponent in the benchmark. Every step handles all environments at once, and only the
window of pixels under each pulse is read and written.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Sequence

Task: TypeAlias = Literal["Star", "RotatedStar", "RandomShape"]
Bools: TypeAlias = NDArray[np.bool_]
Bytes: TypeAlias = NDArray[np.uint8]
Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]
Words: TypeAlias = NDArray[np.uint64]

SIZE_PX = 100
POINTS = 7
PIECES = 16
MIN_AREA_PX = 3000

_MASK_64 = (1 << 64) - 1
_MULTIPLIER_HIGH = np.uint64(0x2360ED051FC65DA4)
_MULTIPLIER_LOW = np.uint64(0x4385DF649FCCF645)


class Streams:
    """One PCG XSL RR 128/64 generator for each environment, all advanced together."""

    def __init__(self, count: int) -> None:
        self.state_high = np.zeros(count, np.uint64)
        self.state_low = np.zeros(count, np.uint64)
        self.increment_high = np.zeros(count, np.uint64)
        self.increment_low = np.zeros(count, np.uint64)

    def seed(self, index: int, seed: int) -> None:
        """Starts one generator as ``SeedableRng::seed_from_u64`` of rand_core 0.10 does."""
        state, words = seed, []
        for _ in range(8):
            state = (state * 0x5851F42D4C957F2D + 0xA17654E46FBE17F3) & _MASK_64
            word = (((state >> 18) ^ state) >> 27) & 0xFFFFFFFF
            turn = state >> 59
            words.append((word >> turn | word << (32 - turn)) & 0xFFFFFFFF)
        start, increment = (
            sum(word << (32 * k) for k, word in enumerate(half)) for half in (words[:4], words[4:])
        )
        increment |= 1
        multiplier = int(_MULTIPLIER_HIGH) << 64 | int(_MULTIPLIER_LOW)
        first = ((start + increment) * multiplier + increment) & ((1 << 128) - 1)
        self.state_high[index], self.state_low[index] = first >> 64, first & _MASK_64
        self.increment_high[index] = increment >> 64
        self.increment_low[index] = increment & _MASK_64

    def next(self, which: Integers) -> Words:
        """The next 64 bits of the generators ``which``."""
        high, low = self.state_high[which], self.state_low[which]
        increment_low = self.increment_low[which]
        # state · multiplier + increment modulo 2¹²⁸.
        high = high * _MULTIPLIER_LOW + low * _MULTIPLIER_HIGH + _high_product(low, _MULTIPLIER_LOW)
        low = low * _MULTIPLIER_LOW + increment_low
        high += self.increment_high[which] + (low < increment_low)
        self.state_high[which], self.state_low[which] = high, low
        word, turn = high ^ low, high >> np.uint64(58)
        back = -turn & np.uint64(63)
        return np.bitwise_or(word >> turn, word << back)

    def uniform(self, which: Integers) -> Floats:
        """Numbers in [0, 1) with 53 random bits."""
        return (self.next(which) >> np.uint64(11)).astype(np.float64) * (1.0 / (1 << 53))

    def integer_pairs_below(self, which: Integers, n: int) -> Integers:
        """Two integers in ``0..n`` from one draw of each generator, shape (len(which), 2)."""
        bits = self.next(which)
        halves = np.stack([bits >> np.uint64(32), bits & np.uint64(0xFFFFFFFF)], axis=1)
        return (halves * np.uint64(n) >> np.uint64(32)).astype(np.int64)


def _high_product(a: Words, b: np.uint64) -> Words:
    """The high 64 bits of the 128-bit product."""
    half, low = np.uint64(32), np.uint64(0xFFFFFFFF)
    a_high, a_low, b_high, b_low = a >> half, a & low, b >> half, b & low
    middle = a_high * b_low + (a_low * b_low >> half)
    other = a_low * b_high + (middle & low)
    product: Words = a_high * b_high + (middle >> half) + (other >> half)
    return product


def fill_even_odd(x: Floats, y: Floats) -> tuple[Bytes, Integers]:
    """Fills closed polygons with vertices (x, y), shape (count, vertices), by the even-odd rule.

    Returns 1 where a pixel centre is inside, shape (count, 100, 100), and the areas, px.
    """
    count = len(x)
    x_end, y_end = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
    swap = y > y_end
    x_upper, y_upper = np.where(swap, x_end, x), np.where(swap, y_end, y)
    x_lower, y_lower = np.where(swap, x, x_end), np.where(swap, y, y_end)
    # Rows with upper.y <= j + 0.5 < lower.y, so that a shared vertex counts once.
    first = np.clip(np.ceil(y_upper - 0.5), 0, SIZE_PX).astype(np.int64)
    crossings = np.clip(np.ceil(y_lower - 0.5), 0, SIZE_PX).astype(np.int64) - first
    edges = np.flatnonzero(crossings)
    repeats = crossings.ravel()[edges]
    slope = (x_lower.ravel()[edges] - x_upper.ravel()[edges]) / (
        y_lower.ravel()[edges] - y_upper.ravel()[edges]
    )
    # One entry for each crossing of an edge with the centre line of a row.
    place = np.repeat(np.arange(len(edges)), repeats)
    edge = edges[place]
    row = np.arange(len(edge)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    row += first.ravel()[edge]
    crossing = x_upper.ravel()[edge] + (row + 0.5 - y_upper.ravel()[edge]) * slope[place]
    column = np.clip(np.ceil(crossing - 0.5), 0, SIZE_PX).astype(np.uint64)
    # Bit k of a row's words: whether the inside begins or ends at column k.
    words = np.zeros(count * SIZE_PX * 2, np.uint64)
    word = (edge // x.shape[1] * SIZE_PX + row) * 2 + (column >> np.uint64(6)).astype(np.int64)
    np.bitwise_xor.at(words, word, np.uint64(1) << (column & np.uint64(63)))
    # The parity of all bits up to and with each: what is inside.
    for shift in (1, 2, 4, 8, 16, 32):
        words ^= words << np.uint64(shift)
    words[1::2] ^= -(words[0::2] >> np.uint64(63))
    octets = words.astype("<u8", copy=False).view(np.uint8).reshape(count, SIZE_PX, 16)
    inside = np.unpackbits(octets, axis=2, count=SIZE_PX, bitorder="little")
    return inside, _count_set(inside)


def _count_set(flags: Bytes) -> Integers:
    """How many bytes of each row are 1, for bytes that are 0 or 1; rows of a multiple of 8."""
    words = flags.reshape(len(flags), -1).view(np.uint64)
    total = np.zeros(len(flags), np.int64)
    # Up to 255 words are added without a carry from byte to byte.
    for start in range(0, words.shape[1], 255):
        sums = np.add.reduce(words[:, start : start + 255], axis=1)
        total += sums.view(np.uint8).reshape(-1, 8).sum(axis=1, dtype=np.int64)
    return total


def star(angle_deg: Floats) -> tuple[Bytes, Integers]:
    """The five-pointed star turned by each angle."""
    outer = 55.28
    turns = [math.pi * k / 5.0 for k in range(10)]
    arms = [-outer * (0.54 if k % 2 else 1.0) for k in range(10)]
    # Each tip: turned about the circumcentre, then about the centre of the workpiece.
    center, circumcenter = SIZE_PX / 2, SIZE_PX / 2 + outer - SIZE_PX / 2
    rows = [(circumcenter + arm) - circumcenter for arm in arms]
    cos, sin = ([f(turn) for turn in turns] for f in (math.cos, math.sin))
    tip_x = np.array([center + (c * 0.0 - s * r) for c, s, r in zip(cos, sin, rows, strict=True)])
    tip_y = np.array(
        [circumcenter + (s * 0.0 + c * r) for c, s, r in zip(cos, sin, rows, strict=True)]
    )
    angles = [angle * (math.pi / 180.0) for angle in angle_deg.tolist()]
    cosines = np.array([[math.cos(angle)] for angle in angles])
    sines = np.array([[math.sin(angle)] for angle in angles])
    arm_x, arm_y = tip_x - center, tip_y - center
    return fill_even_odd(
        center + (cosines * arm_x - sines * arm_y), center + (sines * arm_x + cosines * arm_y)
    )


def random_shapes(streams: Streams, which: Integers) -> tuple[Bytes, Integers]:
    """A random shape of at least 3000 px from each generator of ``which``."""
    shapes = np.empty((len(which), SIZE_PX, SIZE_PX), np.uint8)
    areas = np.empty(len(which), np.int64)
    waiting = np.arange(len(which))
    while len(waiting):
        inside, area = fill_even_odd(*_outlines(_random_points(streams, which[waiting])))
        kept = area >= MIN_AREA_PX
        shapes[waiting[kept]], areas[waiting[kept]] = inside[kept], area[kept]
        waiting = waiting[~kept]
    return shapes, areas


def _random_points(streams: Streams, which: Integers) -> Floats:
    """Seven pixel centres sorted by angle about their centroid, shape (len(which), 7, 2)."""
    drawn = np.stack([streams.integer_pairs_below(which, SIZE_PX) for _ in range(POINTS)], axis=1)
    x, y = np.moveaxis(POINTS * drawn - drawn.sum(axis=1, keepdims=True), 2, 0)
    along = x / np.maximum(np.abs(x) + np.abs(y), 1)
    angle = np.where(y < 0, along - 1.0, 1.0 - along)
    keys = ((angle + 2.0) * (1 << 40)).astype(np.int64) << 3 | np.arange(POINTS)
    order = np.sort(keys, axis=1) & 7
    points: Floats = np.take_along_axis(drawn, order[:, :, None], axis=1) + np.float64(0.5)
    return points


def _outlines(points: Floats) -> tuple[Floats, Floats]:
    """The vertices x and y of the Bézier outlines, shape (count, 112)."""
    following = np.roll(points, -1, axis=1)
    chords = following - points
    lengths = _lengths(chords)
    directions = _directions(chords, lengths)
    bisectors = np.roll(directions, 1, axis=1) + directions
    tangents = _directions(bisectors, _lengths(bisectors))
    handles = (0.2 * lengths)[:, :, None]
    control = (
        points,
        points + tangents * handles,
        following - np.roll(tangents, -1, axis=1) * handles,
        following,
    )
    t = np.arange(PIECES) / PIECES
    s = 1.0 - t
    weights = (s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t)
    x, y = (
        sum_in_order([c[:, :, axis, None] * w for c, w in zip(control, weights, strict=True)])
        for axis in (0, 1)
    )
    return x.reshape(len(points), -1), y.reshape(len(points), -1)


def sum_in_order(terms: list[Floats]) -> Floats:
    """((first + second) + third) + … ."""
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def _lengths(vectors: Floats) -> Floats:
    x, y = vectors[..., 0], vectors[..., 1]
    return np.sqrt(x * x + y * y)


def _directions(vectors: Floats, lengths: Floats) -> Floats:
    inverse = np.divide(1.0, lengths, out=np.zeros_like(lengths), where=lengths > 0)
    return vectors * inverse[..., None]


class NumpyAblation:
    """Environments that step together and reset in the step after the last of an episode.

    ``reset`` and ``step`` return the observation itself, shape (num_envs, 1, 100, 100), a view
    that the next call changes.
    """

    def __init__(
        self,
        task: Task,
        num_envs: int,
        *,
        pulse_radius_px: float = 9.0,
        max_pulses: int = 45,
        completion: float = 0.99,
        part: int = 256,
    ) -> None:
        """Environments before their first reset.

        Args:
            task: Where the targets come from.
            num_envs: Number of environments.
            pulse_radius_px: Radius of the disc that one pulse machines, px.
            max_pulses: Pulses after which an episode terminates.
            completion: Machined fraction at which an episode terminates.
            part: Environments handled by one call of each NumPy function: their windows should
                fit in the cache.
        """
        self.task = task
        self.num_envs = num_envs
        self.max_pulses = max_pulses
        self.completion = completion
        self.pulse_radius_px = pulse_radius_px
        self.streams = Streams(num_envs)
        # A pulse lies in `window` rows and columns from floor(centre − radius) on. The padding
        # takes in the windows of all centres on the workpiece.
        window = math.floor(2 * pulse_radius_px) + 2
        window += -window % 4
        self._padding = math.ceil(pulse_radius_px)
        side = self._padding + SIZE_PX + window
        padded = (num_envs, side, side)
        self._remaining, self._forbidden = np.zeros(padded, np.uint8), np.zeros(padded, np.uint8)
        inner = slice(self._padding, self._padding + SIZE_PX)
        self.observation = self._remaining[:, None, inner, inner]
        self._forbidden_inner = self._forbidden[:, inner, inner]
        self._remaining_windows, self._forbidden_windows = (
            sliding_window_view(pixels, (window, window), axis=(1, 2), writeable=True)
            for pixels in (self._remaining, self._forbidden)
        )
        self._offsets = np.arange(window)[:, None]
        every = np.arange(num_envs)
        self._parts = [every[start : start + part] for start in range(0, num_envs, part)]
        self._star = star(np.zeros(1)) if task == "Star" else None
        self.area_px = np.zeros(num_envs, np.int64)
        self.hit_px = np.zeros(num_envs, np.int64)
        self.miss_px = np.zeros(num_envs, np.int64)
        self.pulses = np.zeros(num_envs, np.int64)
        self.over = np.zeros(num_envs, np.bool_)

    def reset(self, *, seed: int | Sequence[int] | None = None) -> Bytes:
        """Begins an episode in every environment.

        Args:
            seed: Starts the random stream of environment ``i`` anew, from ``seed + i`` or
                ``seed[i]``; without, the streams go on.
        """
        if seed is not None:
            seeds = range(seed, seed + self.num_envs) if isinstance(seed, int) else seed
            for index, one in enumerate(seeds):
                self.streams.seed(index, one)
        self._begin(np.arange(self.num_envs))
        self.over[:] = False
        return self.observation

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[Bytes, Floats, Bools, dict[str, NDArray[Any]]]:
        """Fires a pulse in every environment, or resets it where its episode was over.

        Returns the observation, the rewards, which episodes terminated, and the arrays of
        ``info``: ``machined_fraction``, ``off_target_fraction`` and ``pulses``.
        """
        reward = np.zeros(self.num_envs)
        resetting = np.flatnonzero(self.over)
        if len(resetting):
            self._begin(resetting)
        for part in self._parts:
            running = part[~self.over[part]] if len(resetting) else part
            if len(running):
                reward[running] = self._fire(running, actions[running])
        complete = self.hit_px >= self.completion * self.area_px
        terminated = (complete | (self.pulses >= self.max_pulses)) & ~self.over
        self.over = terminated
        return self.observation, reward, terminated, self.info()

    def info(self) -> dict[str, NDArray[Any]]:
        """How far each episode has come."""
        return {
            "machined_fraction": self.hit_px / self.area_px,
            "off_target_fraction": self.miss_px / self.area_px,
            "pulses": self.pulses.copy(),
        }

    def _fire(self, which: Integers, actions: NDArray[np.float32]) -> Floats:
        """Machines one disc in each environment of ``which`` and returns the rewards."""
        position = 50.0 * (1.0 + np.clip(actions.T, -1.0, 1.0).astype(np.float64, order="C"))
        first = np.floor(position - self.pulse_radius_px)
        # Squared distance of the window's columns and rows, shape (2, len(which), window).
        distance = (first[:, None] + self._offsets) + 0.5 - position[:, None]
        distance *= distance
        dx2, dy2 = np.ascontiguousarray(distance.transpose(0, 2, 1))
        squared = dx2[:, None, :] + dy2[:, :, None]
        inside = (squared <= self.pulse_radius_px**2).view(np.uint8)
        outside = inside - np.uint8(1)  # 0 inside, 255 outside
        column, row = first.astype(np.int64) + self._padding
        windows = (which, row, column)
        remaining, forbidden = self._remaining_windows[windows], self._forbidden_windows[windows]
        hit_px, miss_px = _count_set(remaining & inside), _count_set(forbidden & inside)
        remaining &= outside
        forbidden &= outside
        self._remaining_windows[windows] = remaining
        self._forbidden_windows[windows] = forbidden
        self.hit_px[which] += hit_px
        self.miss_px[which] += miss_px
        self.pulses[which] += 1
        return (hit_px - miss_px) / (SIZE_PX * SIZE_PX)

    def _begin(self, which: Integers) -> None:
        """Begins an episode in the environments ``which``."""
        if self._star is not None:
            target, area = self._star
        elif self.task == "RotatedStar":
            target, area = star(360.0 * self.streams.uniform(which))
        else:
            target, area = random_shapes(self.streams, which)
        self.observation[which, 0] = target * np.uint8(255)
        self._forbidden_inner[which] = target ^ np.uint8(1)
        self.area_px[which] = area
        self.hit_px[which] = 0
        self.miss_px[which] = 0
        self.pulses[which] = 0


class WholeGridNumpyAblation(NumpyAblation):
    """The same process as one would first write it: each pulse is compared with every pixel.

    Several times slower than :class:`NumpyAblation`, which looks only at a window about the pulse.
    """

    def _fire(self, which: Integers, actions: NDArray[np.float32]) -> Floats:
        """Machines one disc in each environment of ``which`` and returns the rewards."""
        centres = np.arange(SIZE_PX) + 0.5
        x, y = 50.0 * (1.0 + np.clip(actions.T, -1.0, 1.0).astype(np.float64))
        dx, dy = centres - x[:, None], centres - y[:, None]
        disc = (dx * dx)[:, None, :] + (dy * dy)[:, :, None] <= self.pulse_radius_px**2
        remaining, forbidden = self.observation[which, 0], self._forbidden_inner[which]
        hit_px = np.count_nonzero(remaining.astype(np.bool_) & disc, axis=(1, 2))
        miss_px = np.count_nonzero(forbidden.astype(np.bool_) & disc, axis=(1, 2))
        self.observation[which, 0] = np.where(disc, 0, remaining)
        self._forbidden_inner[which] = np.where(disc, 0, forbidden)
        self.hit_px[which] += hit_px
        self.miss_px[which] += miss_px
        self.pulses[which] += 1
        return (hit_px - miss_px) / (SIZE_PX * SIZE_PX)
