"""Panels of lessons that draw their own pictures of configuration spaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rr1plan.collision import CollisionChecker
from rr1plan.lessons.lesson_panel import lesson_panel
from rr1plan.playback.cspace.cspace_grid import compute_grid, joint_symbol
from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.view_options import Panel
from rr1plan.scene import Scene


def picture_panel(name: str, title: str, scripts: Sequence[str], data: object) -> Panel:
    """The `lesson_panel` of a name, with the style and the scripts of pictures of two joints.

    Args:
        name: Name of the panel.
        title: Its headline.
        scripts: Other files in `page` that its script needs.
        data: Data for the scripts, with the axes of that picture (`slice_axes`).
    """
    own = lesson_panel(name, title, data, ("picture_sketch.js", *scripts))
    css, script = page_asset("picture_panel.css", "rr1plan.lessons"), page_asset("cspace_picture.js")
    return replace(own, css=css + own.css, script=f"{script}\n{own.script}", width=520)


def slice_axes(scene: Scene, arm: str) -> dict[str, object]:
    """The axes of the picture of an arm's first two joints, as data for `cspace_picture.js`.

    Args:
        scene: The scene.
        arm: The arm.
    """
    robot, grid = scene.arms[arm].robot, compute_grid(scene, arm, resolution=8)
    return {
        "columns": [0, 1],
        "joints": [
            {"name": name, "straight": robot.joint(name).kind == "prismatic", "symbol": joint_symbol(robot, name)}
            for name in grid.joint_names
        ],
        "low": [low for low, _ in grid.ranges],
        "high": [high for _, high in grid.ranges],
        "periodic": list(grid.periodic),
    }


def pair_layers(checker: CollisionChecker, arm: str, layers: Sequence[str]) -> list[int]:
    """For each pair of solids its layer in an arm's slice: the index of a name, or -1.

    Args:
        checker: Checker of all arms of its scene.
        arm: The arm whose slice it is.
        layers: Names of obstacles and of other arms; self pairs of the arm belong to the layer "self-collision".
    """
    found = []
    for a, b in checker.pairs:
        owners = [name if name in checker.scene.obstacles else checker.scene.owner(name) for name in (a, b)]
        other = owners[1] if owners[0] == arm else owners[0]
        name = "self-collision" if other == arm else other
        found.append(layers.index(name) if arm in owners and name in layers else -1)
    return [found[owner] for owner in checker.solid_owner.tolist()]
