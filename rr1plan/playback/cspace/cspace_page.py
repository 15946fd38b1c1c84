"""The lesson page: the arm in 3-D next to its configuration space, linked by sliders, clicks and the clock.

The page draws the configuration space from the cells of the grid, as a panel of the 3-D page, so one offline file
contains everything. If the arm is planar and the page has a planner, it recomputes the cells when obstacles are dragged
(`page/cspace_edits.js`, `page/cspace_query.js`), and replans.
"""

from __future__ import annotations

import base64
import os
import zlib
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, of_kind
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.files.file_access import check_writable, write_text
from rr1plan.model.flat_arm import flat_arm
from rr1plan.path import Path
from rr1plan.playback.cspace.cspace_colors import SELF_COLOR, layer_colors
from rr1plan.playback.cspace.cspace_grid import LIMITS, CSpaceGrid, joint_symbol, name_spots, whole_configurations
from rr1plan.playback.cspace.cspace_raster import SELF, CSpaceRaster
from rr1plan.playback.cspace.cspace_verdict import tone, verdict
from rr1plan.playback.cspace.reach_outline import reach_of
from rr1plan.playback.outlines import silhouette
from rr1plan.playback.search_trees import DrawnTree
from rr1plan.playback.simulation.replay import Replay
from rr1plan.playback.viewer.html_page import page_html, plans_by_itself
from rr1plan.playback.viewer.page_arrays import pack_array, pack_bytes
from rr1plan.playback.viewer.page_asset import page_asset
from rr1plan.playback.viewer.page_document import Document, first_camera, view_document
from rr1plan.playback.viewer.page_planner import page_planner
from rr1plan.playback.viewer.view_options import Panel, ViewOptions, with_panel
from rr1plan.report import Report
from rr1plan.shapes import HalfSpace
from rr1plan.trajectory import Trajectory

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery

_SCRIPTS = (
    "cspace_picture", "cspace_components", "cspace_raster", "cspace_query", "phase_plane", "torus_view",
    "flat_arm", "cspace_workspace", "planar_drags", "cspace_chart", "cspace_edits", "cspace",
)  # fmt: skip
_CRUMB = 255  # label of all components too small to have a color of their own


def save_page(
    cspace: CSpaceQuery,
    file: str | os.PathLike[str],
    *,
    trajectory: Trajectory | None = None,
    options: ViewOptions | None = None,
) -> FilePath:
    """Write the lesson as one self-contained page.

    Args:
        cspace: The configuration space, with a query and its result if it has one.
        file: The file (.html), written atomically.
        trajectory: The timed motion to play; None plays the path at a steady speed.
        options: How the page looks (default: `ViewOptions()`).

    Returns:
        The file.

    Raises:
        InputError: the trajectory moves other joints than the two shown, another suffix, or a file that cannot be
            written.
        MissingPackageError: Meshcat is not installed.
    """
    target = check_writable(file, ".html")
    document, panel = page_parts(cspace, trajectory=trajectory, options=options)
    return write_text(target, page_html(document, with_panel(options, panel)))


def page_parts(
    cspace: CSpaceQuery,
    *,
    trajectory: Trajectory | None = None,
    report: Report | None = None,
    replay: Replay | None = None,
    options: ViewOptions | None = None,
) -> tuple[Document, Panel]:
    """The document of the page, and its panel.

    Args:
        cspace: The configuration space.
        trajectory: The timed motion to play, or None.
        report: The referee's verdict on the trajectory, or None.
        replay: The simulated trajectory, or None.
        options: Title and spheres.

    Raises:
        InputError: the trajectory moves other joints than the two shown.
    """
    of_kind("trajectory", trajectory, Trajectory, optional=True)
    grid = cspace.grid
    names = (f"{grid.arm}/{grid.joint_names[0]}", f"{grid.arm}/{grid.joint_names[1]}")
    if trajectory is not None and set(trajectory.joint_names) != set(names):
        raise InputError(
            f"the trajectory moves {', '.join(trajectory.joint_names)}, expected the joints shown: {', '.join(names)}"
        )
    path = None if cspace.path is None else Path(names, cspace.path)
    start = None if cspace.start is None else whole_configurations(grid, cspace.start)
    scene = grid.scene if start is None else grid.scene.with_configuration(grid.arm, start)
    document = view_document(scene, trajectory=trajectory, path=path, report=report, replay=replay, options=options)
    document["ghosts"] = _ghosts(cspace)
    if document["planner"] is not None:
        document["planner"] = page_planner(scene, (grid.arm,))
    if document["track"] is None:
        document["camera"] = first_camera(scene, None, document["ghosts"])
    _color_obstacles(document, layer_colors(grid))
    panel = Panel(
        "cspace",
        "Configuration space",
        html=page_asset("cspace.html"),
        css=page_asset("cspace.css"),
        script="".join(page_asset(f"{name}.js") for name in _SCRIPTS),
        data=_data(cspace, names, document),
        width=520,
    )
    return document, panel


def _color_obstacles(document: Document, colors: Mapping[str, str]) -> None:
    """Give obstacles without a color the color of their images, so that both can be matched."""
    for row in document["obstacles"]:
        for part in row["parts"]:
            if part["color"] is None and row["name"] in colors:
                part["color"] = [int(colors[row["name"]][i : i + 2], 16) / 255 for i in (1, 3, 5)] + [1.0]


# ---- the data of the panel ---------------------------------------------------------------------


def _data(cspace: CSpaceQuery, names: tuple[str, str], document: Document) -> dict[str, Any]:
    grid = cspace.grid
    robot = grid.scene.arms[grid.arm].robot
    joints = [robot.joint(name) for name in grid.joint_names]
    columns = grid.scene.joint_names()
    planar, others = _planar(grid), _other_joints(grid)
    return {
        "arm": grid.arm,
        "columns": [columns.index(name) for name in names],
        "joints": [
            {"name": joint.name, "straight": joint.kind == "prismatic", "symbol": joint_symbol(robot, joint.name)}
            for joint in joints
        ],
        "low": [low for low, _ in grid.ranges],
        "high": [high for _, high in grid.ranges],
        "periodic": list(grid.periodic),
        "size": list(grid.free.shape),
        "layers": _layers(grid, bool(others)),
        "labels": pack_bytes(_ranked_components(cspace)),
        "start": None if cspace.start is None else cspace.start.tolist(),
        "goals": [goal.tolist() for goal in cspace.goals],
        "goalNames": list(cspace.goal_names),
        "tree": None if cspace.drawn_tree is None else _tree(cspace.drawn_tree),
        "verdict": verdict(cspace),
        "tone": tone(cspace),
        "planar": planar,
        "limits": [[_finite(low), _finite(high)] for low, high in _limits(grid)],
        "others": others,
        "live": _live(grid, planar) if (planar is not None or others) and plans_by_itself(document) else None,
    }


def _limits(grid: CSpaceGrid) -> list[tuple[float, float]]:
    robot = grid.scene.arms[grid.arm].robot
    columns = [robot.joint_names.index(name) for name in grid.joint_names]
    return [(float(robot.limits.lower[c]), float(robot.limits.upper[c])) for c in columns]


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _other_joints(grid: CSpaceGrid) -> list[dict[str, object]]:
    """The joints of the arm that the picture does not show."""
    robot, columns = grid.scene.arms[grid.arm].robot, grid.scene.joint_names()
    bounds = zip(robot.joint_names, robot.limits.lower.tolist(), robot.limits.upper.tolist(), strict=True)
    return [
        {
            "name": name,
            "column": columns.index(f"{grid.arm}/{name}"),
            "low": lower if np.isfinite(lower) else -np.pi,
            "high": upper if np.isfinite(upper) else np.pi,
            "straight": robot.joint(name).kind == "prismatic",
        }
        for name, lower, upper in bounds
        if name not in grid.joint_names
    ]


def _live(grid: CSpaceGrid, planar: dict[str, object] | None) -> dict[str, object] | None:
    """The tables with which the page computes images of moved obstacles; None if it cannot."""
    arm = grid.scene.arms[grid.arm]
    checker = CollisionChecker(grid.scene, (grid.arm,))
    if not checker.object_numbers:
        return None
    first, second = (arm.robot.joint_names.index(name) for name in grid.joint_names)
    raster = CSpaceRaster(checker, arm.q, (first, second), grid.axes)
    return {
        "raster": base64.b64encode(zlib.compress(raster.memory_image(), 9)).decode("ascii"),
        "ranges": raster.ranges,
        "outlines": {}
        if planar is None
        else {name: [o.round(9).tolist() for o in _outlines(grid, name)] for name in checker.object_numbers},
    }


def _outlines(grid: CSpaceGrid, name: str) -> list[Array]:
    """The silhouettes of an obstacle's parts from above, around its origin [m], each (n, 2)."""
    thing = grid.scene.obstacles[name]
    solid = [g for g in thing.geometries if not isinstance(g.shape, HalfSpace)]
    return [silhouette(g.shape, thing.pose @ g.pose) - thing.pose[:2, 3] for g in solid]


def _layers(grid: CSpaceGrid, is_slice: bool) -> list[dict[str, object]]:
    """The layers; in a slice also an empty layer of self-collision, because other slices of the page may have some."""
    kinds, spots, colors, masks = {SELF: "self", LIMITS: "limits"}, name_spots(grid), layer_colors(grid), grid.layers
    if is_slice and SELF not in masks:
        colors, masks = {**colors, SELF: SELF_COLOR}, {**masks, SELF: np.zeros(grid.free.shape, np.bool_)}
    return [
        {
            "name": name,
            "spot": spots.get(name),
            "color": color,
            "kind": kinds.get(name, "thing"),
            "cells": pack_bytes(np.packbits(masks[name].ravel(), bitorder="little")),
        }
        for name, color in colors.items()
    ]


def _ranked_components(cspace: CSpaceQuery) -> NDArray[np.uint8]:
    """Components in the order of the page's colors: the start's, then the goals', then by size."""
    grid = cspace.grid
    counts = np.bincount(grid.labels.ravel(), minlength=grid.components + 1)
    ends = [grid.component_of(q) for q in ([] if cspace.start is None else [cspace.start]) + list(cspace.goals)]
    by_size = (np.argsort(-counts[1:], kind="stable") + 1).tolist()
    order = [k for k in dict.fromkeys([*ends, *by_size]) if k > 0]
    rank = np.zeros(grid.components + 1, dtype=np.uint8)
    rank[order] = np.minimum(np.arange(1, len(order) + 1), _CRUMB)
    return rank[grid.labels]


def _tree(tree: DrawnTree) -> dict[str, object]:
    """The drawn edges, those nearer to their root first, and the tree of each."""
    return {
        "vertices": pack_array(tree.vertices),
        "edges": pack_array(tree.edges, "u4"),
        "sides": pack_array(tree.sides, "u4"),
        "explored": tree.explored,
    }


def _ghosts(cspace: CSpaceQuery) -> list[dict[str, Any]]:
    """The arm at the start and at every goal configuration, as the 3-D page draws ghosts."""
    grid = cspace.grid
    standing = [] if cspace.start is None else [("start", cspace.start)]
    standing += [("goal", goal) for goal in cspace.goals]
    return [{"kind": kind, "arm": grid.arm, "q": whole_configurations(grid, q).tolist()} for kind, q in standing]


def _planar(grid: CSpaceGrid) -> dict[str, object] | None:
    """The arm as two joints in a horizontal plane (see `FlatArm`) and its reach, or None if it is not planar."""
    arm = grid.scene.arms[grid.arm]
    flat = flat_arm(arm) if arm.robot.joint_names == grid.joint_names else None
    if flat is None:
        return None
    reach = reach_of(flat, arm.robot.limits)
    return {
        "kinds": flat.kinds,
        "base": [flat.base.real, flat.base.imag, flat.height],
        "bars": [[bar.real, bar.imag] for bar in flat.bars],
        "senses": list(flat.senses),
        "slides": [[slide.real, slide.imag] for slide in flat.slides],
        "height": flat.height,
        "rims": [rim.round(6).tolist() for rim in reach.rims],
        "center": reach.center.tolist(),
        "radius": reach.radius,
        "names": _names(grid, flat.height),
    }


def _names(grid: CSpaceGrid, height: float) -> list[dict[str, Any]]:
    """Positions of the obstacles' names: the centers of the obstacles, seen from above."""
    colors, named = layer_colors(grid), []
    for name, thing in grid.scene.obstacles.items():
        shadows = [
            silhouette(g.shape, thing.pose @ g.pose) for g in thing.geometries if not isinstance(g.shape, HalfSpace)
        ]
        if shadows and name in colors:
            middle = np.mean([shadow.mean(axis=0) for shadow in shadows], axis=0)
            named.append({"name": name, "color": colors[name], "place": [*middle.tolist(), height]})
    return named
