"""Constants of the default pipeline: margins, RRT-Connect, shortcuts, blends, timing.

They are in one place because two programs use them, `plan_motion` and pages with their own planner
(`playback/viewer/page/planner.js`), and the same seed has to give the same motion in both.
"""

from __future__ import annotations

from typing import NamedTuple


class MarginConstants(NamedTuple):
    """Constants of margins.

    Args:
        default: Distance to keep beyond the scene's padding [m].
        halvings: Number of halvings below the default of a margin that cannot be kept, before it becomes zero.
        samples: Samples of RRT-Connect with a margin before the first brief search without it.
        growth: Factor from the samples before a brief search to those before the next one.
        ratio: Samples of the search with the margin for one sample of a brief search.
    """

    default: float = 0.002
    halvings: int = 7
    samples: int = 16_000
    growth: int = 4
    ratio: int = 16


class TreeConstants(NamedTuple):
    """Constants of RRT-Connect.

    Args:
        step: Longest edge of a tree, as a share of the diagonal of the joint space.
        domain: Sampling radius around vertices with a blocked edge, as a share of the diagonal.
    """

    step: float = 0.06
    domain: float = 0.3


class ShortcutConstants(NamedTuple):
    """Constants of shortcuts.

    Args:
        tries: Shortcuts tried on a path: milliseconds of computation save seconds of motion.
        patience: Consecutive shortcuts without gain after which the search stops.
        stream: Separates the random numbers of shortcuts from those of the planner with the same seed.
    """

    tries: int = 48
    patience: int = 30
    stream: int = 0x5851F42D4C95


class BlendConstants(NamedTuple):
    """Constants of rounded corners.

    Args:
        largest: Largest distance from a corner to the beginning of its blend [rad or m].
        halvings: Number of halvings of a blend after which the motion stops at its corner.
        reversal: The motion stops at corners where the sum of both unit directions is shorter than this.
        smallest: Smallest blend, as a share of the length of the polyline.
        duplicate: Waypoints closer than this to another one or to the line between their neighbors are dropped
            [rad or m].
    """

    largest: float = 1.0
    halvings: int = 8
    reversal: float = 1e-3
    smallest: float = 1e-8
    duplicate: float = 1e-9


class TimingConstants(NamedTuple):
    """Constants of the path parameterization.

    Args:
        step: Largest relative change of the derivative in an interval of the grid.
        shortest_piece: Shorter pieces are dropped: their durations are below the rounding error of the breaks [s].
    """

    step: float = 0.2
    shortest_piece: float = 1e-11


MARGINS = MarginConstants()
TREES = TreeConstants()
SHORTCUTS = ShortcutConstants()
BLENDS = BlendConstants()
TIMING = TimingConstants()
