"""What vector environments say about the episodes of a native batch."""

from __future__ import annotations

import time
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lasergym.envs.seeded_vector import ActionT, ObservationT, SeededVectorEnv

__all__ = ["BatchVectorEnv"]


class BatchVectorEnv(SeededVectorEnv[ObservationT, ActionT]):
    """A vector environment whose episodes a native batch counts."""

    progress_keys: ClassVar[tuple[str, ...]]
    """Names of the figures of progress in ``infos``, as the native batch orders them."""

    episode_statistics: bool
    _batch: Any
    _final_observations: NDArray[Any] | None
    _started_s: NDArray[np.float64]

    def _step_infos(self, terminated: NDArray[np.bool_]) -> dict[str, Any]:
        """Infos of a step: progress, and what is known of the episodes that it has ended."""
        infos = self._progress_infos(np.ones(self.num_envs, np.bool_))
        finished, success, episode_return, length = self._batch.finished()
        if finished.any():
            self._add_final_infos(infos, finished, terminated, success)
            if self.episode_statistics:
                now_s = time.perf_counter()
                infos["episode"] = {
                    "r": episode_return,
                    "l": length,
                    "t": np.where(finished, now_s - self._started_s, 0.0),
                }
                infos["_episode"] = finished
                self._started_s[finished] = now_s
        return infos

    def _progress_infos(self, where: NDArray[np.bool_]) -> dict[str, Any]:
        """Progress of the episodes that the observations show."""
        infos: dict[str, Any] = {}
        for key, values in zip(self.progress_keys, self._batch.progress(), strict=True):
            infos[key] = values if where.all() else np.where(where, values, 0)
            infos[f"_{key}"] = where.copy()
        return infos

    def _add_final_infos(
        self,
        infos: dict[str, Any],
        finished: NDArray[np.bool_],
        terminated: NDArray[np.bool_],
        success: NDArray[np.bool_],
    ) -> None:
        """Adds what is known of the episodes that have just ended."""
        if self._final_observations is None:
            if terminated.any():
                infos["is_success"] = success & terminated
                infos["_is_success"] = terminated.copy()
            return
        final: dict[str, Any] = {}
        for key, values in zip(self.progress_keys, self._batch.final_progress(), strict=True):
            final[key] = values
            final[f"_{key}"] = finished.copy()
        if terminated.any():
            final["is_success"] = success & terminated
            final["_is_success"] = terminated.copy()
        observations = np.zeros_like(self._final_observations)
        observations[finished] = self._final_observations[finished]
        infos["final_obs"] = observations
        infos["_final_obs"] = finished.copy()
        infos["final_info"] = final
        infos["_final_info"] = finished.copy()
