"""The torus of two angles in space, with the images of the obstacles on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rr1plan.checks import Array
from rr1plan.playback.cspace.configuration_space import CSpace
from rr1plan.playback.cspace.cspace_torus import layer_image

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_RADIUS, _TUBE = 1.0, 0.45
_PIXELS = 700
_RISE = 0.75  # elevation of the camera [rad]


def draw_torus_surface(axes: Axes, cspace: CSpace) -> None:
    """Draw it; the first angle goes around the torus, the second around its tube."""
    axes.imshow(torus_image(layer_image(cspace.grid)), interpolation="antialiased")
    axes.set_title("the same as a torus", loc="left")
    axes.set_axis_off()


def torus_image(colors: Array, pixels: int = _PIXELS) -> Array:
    """The torus as a picture with transparent surroundings, seen from above at an angle.

    Args:
        colors: Colors of its cells, rows: second angle, columns: first angle, shape (m, n, 3), 0 to 1.
        pixels: Width of the picture.

    Returns:
        Shape (pixels * 0.8, pixels, 4).
    """
    m, n = colors.shape[:2]
    reach = 1.02 * (_RADIUS + _TUBE)
    height = int(0.8 * pixels)
    # Points dense enough to hit each pixel of the surface, drawn from the farthest to the nearest.
    u = np.linspace(-np.pi, np.pi, int(5.0 * pixels), endpoint=False)
    v = np.linspace(-np.pi, np.pi, int(2.4 * pixels), endpoint=False)
    tone = np.array([np.cos(_RISE), np.sin(_RISE)])
    image = np.zeros((height, pixels, 4))
    depth = np.full((height, pixels), -np.inf)
    # On each circle around the axis the depth rises with cos(u): one order serves all circles.
    u = u[np.argsort(np.cos(u))]
    sine, cosine = np.sin(u), np.cos(u)
    column = np.floor((u + np.pi) / (2 * np.pi) * n).astype(int)
    for angle in v:
        normal = np.cos(angle) * cosine * tone[0] + np.sin(angle) * tone[1]
        k = np.flatnonzero(normal > 0.0)
        out, up = _RADIUS + _TUBE * np.cos(angle), _TUBE * np.sin(angle)
        # The camera looks along -y, from above: x to the right, `across` up in the picture, `near` towards it.
        x, y = out * sine[k], -out * cosine[k]
        across, near = y * tone[1] + up * tone[0], -y * tone[0] + up * tone[1]
        j = np.clip(((x / reach + 1.0) / 2.0 * pixels).astype(int), 0, pixels - 1)
        i = np.clip(((0.8 - across / reach) / 2.0 * pixels).astype(int), 0, height - 1)
        seen = near > depth[i, j]
        i, j, k = i[seen], j[seen], k[seen]
        row = int((angle + np.pi) / (2 * np.pi) * m)
        shade = 0.55 + 0.45 * np.clip(normal[k], 0.0, 1.0)
        image[i, j, :3] = colors[row, column[k]] * shade[:, None]
        image[i, j, 3] = 1.0
        depth[i, j] = near[seen]
    return image
