"""One color for each arm, the same in figures and on the page (`viewer/page/world.js`)."""

from __future__ import annotations

import colorsys

ARM_COLORS = (
    "#e4500e", "#2173d9", "#086453", "#f7bb4a", "#703190", "#4aadb5", "#ab89fc", "#562c09", "#f58268", "#af5197",
)  # fmt: skip
"""Distinct with protanopia, deuteranopia and tritanopia, too; a test measures that."""

_GOLDEN = 0.381966  # of a turn, between one arm's hue and the next


def arm_color(index: int) -> str:
    """The color of an arm as "#rrggbb".

    Args:
        index: Number of the arm in its scene; beyond ten, colors are spread around the circle of hues.
    """
    if index < len(ARM_COLORS):
        return ARM_COLORS[index]
    hue, lightness = (0.055 + index * _GOLDEN) % 1.0, 0.42 if index % 2 else 0.53
    return "#{:02x}{:02x}{:02x}".format(*(round(255 * c) for c in colorsys.hls_to_rgb(hue, lightness, 0.62)))
