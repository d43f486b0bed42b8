"""What an environment shows: the last hop, and a window."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import DependencyNotInstalled

from spring_leg import picture

# Length of the leg in flight, m; that of the trainer's leg.
LEG_M = 1.0


class Scene:
    """The leg at a point of its way."""

    def __init__(self, y_m: float, density_ratio: float = 0.0) -> None:
        self.body = (0.0, y_m)
        self.foot = (0.0, y_m - LEG_M)
        self.ground_m = 0.0
        self.density_ratio = density_ratio
        self.trail: list[picture.Point] = []

    def follow(
        self, path: npt.NDArray[np.float64], leg_angle_rad: float, each: Callable[[], None]
    ) -> None:
        """Moves along the way of a hop, and calls `each` at every point of it."""
        start_m = self.body[0]
        self.trail = []
        for x_m, y_m, foot_x_m, foot_y_m, ground_m in path.tolist():
            self.body = (start_m + x_m, y_m)
            self.ground_m = ground_m
            if math.isnan(foot_x_m):
                reach = LEG_M * math.cos(leg_angle_rad), LEG_M * math.sin(leg_angle_rad)
                self.foot = (self.body[0] - reach[0], y_m - reach[1])
            else:
                self.foot = (start_m + foot_x_m, foot_y_m)
            self.trail.append(self.body)
            each()

    def drawn(self) -> picture.Image:
        """Returns the picture."""
        return picture.draw(self.body, self.foot, self.ground_m, self.density_ratio, self.trail)


class Window:
    """A window of pygame."""

    def __init__(self, frames_per_s: int) -> None:
        try:
            import pygame
        except ModuleNotFoundError as missing:
            raise DependencyNotInstalled(
                'render_mode "human" needs pygame: pip install "spring-leg[render]"'
            ) from missing
        self._pygame: Any = pygame
        pygame.init()
        pygame.display.set_caption("spring_leg")
        self._surface = pygame.display.set_mode((picture.WIDTH, picture.HEIGHT))
        self._clock = pygame.time.Clock()
        self._frames_per_s = frames_per_s

    def show(self, image: picture.Image) -> None:
        """Shows a picture for its time."""
        pygame = self._pygame
        pygame.surfarray.blit_array(self._surface, image.swapaxes(0, 1))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(self._frames_per_s)

    def close(self) -> None:
        """Closes the window."""
        self._pygame.display.quit()
        self._pygame.quit()
