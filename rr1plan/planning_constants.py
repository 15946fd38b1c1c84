"""Constants of the default pipeline: RRT-Connect, shortcuts, blends, timing.

They are in one place because two programs follow them, `plan_motion` and pages that plan by themselves
(`playback/viewer/page/planner.js`), and the same seed has to give both the same motion.
"""

from __future__ import annotations

from typing import NamedTuple


class PlanningConstants(NamedTuple):
    """Constants of the default pipeline.

    Args:
        margin: Distance to keep beyond the scene's padding [m].
        margin_halvings: Number of halvings of a margin that start and goal do not afford, before it becomes zero.
        tree_step: Longest edge of a tree, as a share of the diagonal of the joint space.
        tree_domain: Sampling radius around vertices with a blocked edge, as a share of the diagonal.
        shortcuts: Shortcuts tried on a path: milliseconds of computation save seconds of motion.
        shortcut_patience: Consecutive shortcuts without gain after which the search stops.
        shortcut_stream: Separates the random numbers of shortcuts from those of the planner with the same seed.
        max_blend: Largest distance from a corner to the beginning of its blend [rad].
        blend_halvings: Number of halvings of a blend after which the motion stops at its corner.
        blend_reversal: The motion stops at corners where the sum of both unit directions is shorter than this.
        smallest_blend: Smallest blend, as a share of the length of the polyline.
        duplicate: Waypoints closer than this to another one or to the line between their neighbors are dropped [rad].
        time_step: Largest relative change of the derivative in an interval of the grid.
        shortest_piece: Shorter pieces are dropped: their durations are below the rounding error of the breaks [s].
    """

    margin: float = 0.002
    margin_halvings: int = 5
    tree_step: float = 0.06
    tree_domain: float = 0.3
    shortcuts: int = 48
    shortcut_patience: int = 30
    shortcut_stream: int = 0x5851F42D4C95
    max_blend: float = 1.0
    blend_halvings: int = 8
    blend_reversal: float = 1e-3
    smallest_blend: float = 1e-8
    duplicate: float = 1e-9
    time_step: float = 0.2
    shortest_piece: float = 1e-11


CONSTANTS = PlanningConstants()
"""The constants of `plan_motion` and of pages."""
