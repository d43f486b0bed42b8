"""Pictures of the hopper, drawn into arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]
Point = tuple[float, float]
Colour = tuple[int, int, int]

WIDTH, HEIGHT = 640, 480
# Metres below the ground that are shown, and the least height above it.
BELOW_M, ABOVE_M = 0.4, 3.2

AIR: Colour = (238, 243, 247)
WATER: Colour = (116, 174, 214)
GROUND: Colour = (150, 126, 96)
STRIPE: Colour = (134, 111, 83)
LEG: Colour = (52, 58, 64)
BODY: Colour = (200, 76, 49)
TRAIL: Colour = (90, 98, 106)


def _mixed(a: Colour, b: Colour, share: float) -> Colour:
    """Returns `a` with a share of `b`."""
    red, green, blue = (round(x + share * (y - x)) for x, y in zip(a, b))
    return red, green, blue


def _near(image: Image, a: Point, b: Point, radius: float, colour: Colour) -> None:
    """Colours what is within `radius` of the segment from `a` to `b`, in pixels."""
    margin = radius + 1
    left, right = sorted((a[0], b[0]))
    top, bottom = sorted((a[1], b[1]))
    x0, x1 = max(0, int(left - margin)), min(WIDTH, math.ceil(right + margin))
    y0, y1 = max(0, int(top - margin)), min(HEIGHT, math.ceil(bottom + margin))
    if x0 >= x1 or y0 >= y1:
        return
    y, x = np.mgrid[y0:y1, x0:x1]
    along = np.subtract(b, a)
    square = float(along @ along)
    share = ((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square if square > 0 else 0 * x
    share = np.clip(share, 0, 1)
    distance = np.hypot(x - a[0] - share * along[0], y - a[1] - share * along[1])
    image[y0:y1, x0:x1][distance <= radius] = colour


def draw(
    body: Point,
    foot: Point,
    ground_m: float,
    density_ratio: float,
    trail: Iterable[Point] = (),
) -> Image:
    """Returns the scene around a body, with places and heights in m, as (height, width, 3)."""
    trail = list(trail)
    highest = max([body[1], *(y for _, y in trail)])
    scale = HEIGHT / (BELOW_M + max(ABOVE_M, highest + 0.4))

    def pixel(point: Point) -> Point:
        return WIDTH / 2 + scale * (point[0] - body[0]), HEIGHT - scale * (point[1] + BELOW_M)

    image = np.empty((HEIGHT, WIDTH, 3), np.uint8)
    image[:] = _mixed(AIR, WATER, min(max(density_ratio, 0.0), 1.0))
    surface = min(max(round(pixel((0, ground_m))[1]), 0), HEIGHT)
    image[surface:] = GROUND
    # Stripes of a metre show how far the body went.
    x_m = body[0] + (np.arange(WIDTH) - WIDTH / 2) / scale
    image[surface:, np.floor(x_m).astype(np.int64) % 2 == 0] = STRIPE
    for point in trail:
        x, y = pixel(point)
        if 0 <= x < WIDTH and 0 <= y < HEIGHT:
            _near(image, (x, y), (x, y), 1.5, TRAIL)
    _near(image, pixel(foot), pixel(body), 3, LEG)
    _near(image, pixel(body), pixel(body), 11, BODY)
    return image
