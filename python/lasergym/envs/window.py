"""A window that shows frames; needs the extra ``lasergym[human]``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lasergym.errors import MissingExtraError

__all__ = ["Window"]


class Window:
    """A pygame window of the size of its first frame."""

    def __init__(self, title: str, frames_per_second: int) -> None:
        """Prepares the window; it opens with the first frame."""
        try:
            import pygame
        except ImportError as error:
            raise MissingExtraError(
                'render_mode="human" needs pygame: pip install "lasergym[human]"'
            ) from error
        self._pygame: Any = pygame
        self._title = title
        self._frames_per_second = frames_per_second
        self._screen: Any = None
        self._clock: Any = None

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Shows a frame, uint8 of shape (height, width, 3), no faster than the frame rate."""
        pygame = self._pygame
        if self._screen is None:
            pygame.init()
            pygame.display.set_caption(self._title)
            self._screen = pygame.display.set_mode((frame.shape[1], frame.shape[0]))
            self._clock = pygame.time.Clock()
        pygame.event.pump()
        surface = pygame.surfarray.make_surface(frame.swapaxes(0, 1))
        self._screen.blit(surface, (0, 0))
        pygame.display.flip()
        self._clock.tick(self._frames_per_second)

    def close(self) -> None:
        """Closes the window."""
        if self._screen is not None:
            self._pygame.quit()
            self._screen = None
