"""CMA-ES, the optimiser that Xie et al. (2022) compare their agent with, as ask and tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lasergym import _native
from lasergym.errors import OptimiserError
from lasergym.options import LARGEST_SEED, integer_in

__all__ = ["CmaEs"]


class CmaEs:
    """Minimises a function of n variables by sampling and ranking candidates.

    Covariance matrix adaptation evolution strategy after N. Hansen, "The CMA Evolution Strategy: A
    Tutorial" (arXiv:1604.00772), with active covariance update.

    >>> optimiser = CmaEs([3.0, 3.0], 1.0, seed=1, max_evaluations=600)
    >>> while optimiser.termination is None:
    ...     optimiser.tell([float(x @ x) for x in optimiser.ask()])
    >>> optimiser.best_cost < 1e-9
    True
    """

    def __init__(
        self,
        mean: ArrayLike,
        sigma: float,
        *,
        population_size: int | None = None,
        seed: int = 0,
        bounds: tuple[ArrayLike, ArrayLike] | None = None,
        max_evaluations: int | None = None,
    ) -> None:
        """Prepares a run.

        Args:
            mean: Where to start, n finite numbers.
            sigma: Initial step size, above 0; the minimum should lie within about 3 sigma.
            population_size: Candidates per generation, at least 4; by default 4 + ⌊3 ln n⌋.
            seed: Seed of the random stream, from 0 to 2⁶⁴ − 1.
            bounds: (lower, upper), n numbers each, between which candidates stay.
            max_evaluations: Evaluations that are never exceeded.

        Raises:
            OptimiserError: The settings do not fit together; the message says which.
        """
        integer_in("seed", seed, 0, LARGEST_SEED)
        box = None
        if bounds is not None:
            lower, upper = (_numbers("bounds", side).tolist() for side in bounds)
            box = (lower, upper)
        for name, size in (
            ("population_size", population_size),
            ("max_evaluations", max_evaluations),
        ):
            if size is not None:
                integer_in(name, size, 1, 2**63 - 1)
        self._native = _native.CmaEs(
            _numbers("mean", mean), sigma, population_size, seed, box, max_evaluations
        )

    def ask(self) -> NDArray[np.float64]:
        """The candidates of the next generation, shape (population, n)."""
        return self._native.ask()

    def tell(self, costs: ArrayLike) -> None:
        """Takes the costs of the candidates that :meth:`ask` gave; lower is better.

        Args:
            costs: One cost per candidate, in their order; NaN counts as infinitely bad.

        Raises:
            OptimiserError: Wrong number of costs, only NaN, or no candidates were asked for.
        """
        self._native.tell(_numbers("costs", costs))

    @property
    def best_x(self) -> NDArray[np.float64]:
        """The best candidate so far, shape (n,); the start before the first costs."""
        best = self._native.best()
        return self._native.mean() if best is None else best[0]

    @property
    def best_cost(self) -> float:
        """Its cost; infinite before the first costs."""
        best = self._native.best()
        return float("inf") if best is None else best[1]

    @property
    def mean(self) -> NDArray[np.float64]:
        """The centre of the distribution, shape (n,)."""
        return self._native.mean()

    @property
    def sigma(self) -> float:
        """The step size."""
        return self._native.progress()[2]

    @property
    def evaluations(self) -> int:
        """Costs taken so far."""
        return self._native.progress()[0]

    @property
    def generation(self) -> int:
        """Generations so far."""
        return self._native.progress()[1]

    @property
    def termination(self) -> str | None:
        """Why the run has ended, for instance ``"tol-fun"``; None while it goes on."""
        reason = self._native.termination()
        return None if reason is None else reason[0]


def _numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """``values`` as a one-dimensional array of float64."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OptimiserError(f"{name} must be numbers: {error}") from error
    if array.ndim != 1:
        raise OptimiserError(f"{name} has shape {array.shape}, but must be one-dimensional")
    return np.ascontiguousarray(array)
