"""The data of a page as one plain value that JSON can represent.

A robot is described once, however many arms are copies of it: its joints, from which the page computes forward
kinematics, and its shapes, so that the page draws all copies of a shape in one call. A motion is sent as polynomials,
not as poses: a hundred times smaller, and exact.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rr1plan.checks import Array, known_name, of_kind
from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.planning import SearchTree
from rr1plan.playback.search_trees import drawn_tree
from rr1plan.playback.simulation.replay import BodyMotion, Replay
from rr1plan.playback.viewer.camera import choose_camera
from rr1plan.playback.viewer.motion_samples import (
    clearance_samples,
    torque_samples,
    tracking_errors,
    violation_places,
)
from rr1plan.playback.viewer.page_arrays import pack_array
from rr1plan.playback.viewer.page_kinematics import scene_kinematics
from rr1plan.playback.viewer.page_planner import page_planner
from rr1plan.playback.viewer.page_shapes import ShapeTable
from rr1plan.playback.viewer.view_options import ViewOptions, checked_options
from rr1plan.report import Report
from rr1plan.robot import Geometry, Robot
from rr1plan.scene import Scene
from rr1plan.scene.problem import JointGoal, PoseGoal, Problem, RegionGoal, frame_link
from rr1plan.trajectory import Trajectory
from rr1plan.transforms import pose

Document = dict[str, Any]

_LARGEST_TRACK = 600_000  # numbers; a longer motion is sent as samples, 60 a second or fewer
_SAMPLE_RATE = 60.0
_PATH_SPEED = 1.0  # [rad/s] at which a path without times is shown
_MOST_GHOSTS = 4
_RATES = ("velocity", "acceleration", "jerk", "effort")


def view_document(
    scene: Scene,
    *,
    trajectory: Trajectory | None = None,
    path: Path | None = None,
    problem: Problem | None = None,
    report: Report | None = None,
    replay: Replay | None = None,
    options: ViewOptions | None = None,
) -> Document:
    """The whole content of the page, as plain values.

    Args:
        scene: As in `save_html`.
        trajectory: As in `save_html`.
        path: As in `save_html`.
        problem: As in `save_html`.
        report: As in `save_html`.
        replay: As in `save_html`.
        options: Used are the title, spheres, the motion to compare, the tree, the clearances and whether the page has a
            planner; the others are for `page_html`.

    Raises:
        UnknownNameError: a column that is not a joint of the scene.
        InputError: no scene, an argument of another type, or a tree of other joints.
    """
    of_kind("scene", scene, Scene)
    of_kind("trajectory", trajectory, Trajectory, optional=True)
    of_kind("path", path, Path, optional=True)
    of_kind("problem", problem, Problem, optional=True)
    of_kind("report", report, Report, optional=True)
    of_kind("replay", replay, Replay, optional=True)
    options = checked_options(options)
    spheres = options.spheres
    shapes = ShapeTable()
    robots, kinematics, arms = scene_kinematics(scene, _numbers)
    motion = trajectory if trajectory is not None or path is None else _steady(path)
    if motion is None and replay is not None:
        motion = _replayed(replay)
    bodies = None if replay is None else replay.record.bodies
    fixed = {name: o for name, o in scene.obstacles.items() if bodies is None or name not in bodies.bodies}
    ghosts = [] if problem is None else _ghosts(problem)
    return {
        "title": scene.name if options.title is None else options.title,
        "description": scene.description,
        "robots": [row | _robot(robot, shapes, spheres) for robot, row in zip(robots, kinematics, strict=True)],
        "arms": arms,
        "columns": list(scene.joint_names()) if scene.arms else [],
        "obstacles": [_object(name, o.geometries, o.pose, shapes) for name, o in fixed.items()],
        "bodies": None if replay is None or bodies is None else _bodies(bodies, replay.record.times, shapes),
        "attachments": [
            _object(name, a.geometries, a.pose, shapes)
            | {"arm": a.arm, "link": a.link, "spheres": _spheres({name: a.geometries}) if spheres else None}
            for name, a in scene.attachments.items()
        ],
        "shapes": shapes.rows,
        "track": None if motion is None else _shown_track(motion, scene, trajectory, path),
        "replay": None if replay is None else _track(_replayed(replay), scene) | {"summary": _summary(replay)},
        "path": None
        if path is None
        else {"columns": _columns(path.joint_names, scene), "waypoints": pack_array(path.waypoints)},
        "ghosts": ghosts,
        "targets": [] if problem is None else _targets(problem),
        "report": None if report is None else _finite(report.to_dict()),
        "compare": [_compared(name, other, scene, options) for name, other in options.compare.items()],
        "samples": _samples(scene, trajectory, options) | _findings(scene, trajectory, report, replay),
        "tree": None if options.tree is None else _tree(options.tree, scene, problem, path),
        "camera": first_camera(scene, motion, ghosts),
        "planner": _planner(scene, problem, motion, bodies) if options.planner else None,
    }


def _planner(
    scene: Scene, problem: Problem | None, motion: Trajectory | None, bodies: BodyMotion | None
) -> dict[str, object]:
    """The planner of the page, for the arms of the problem or of the motion, otherwise for all."""
    if bodies is not None and bodies.bodies:
        return {"missing": "objects move along the replay, and pages plan among objects that stand still"}
    if problem is not None:
        return page_planner(scene, problem.arms, problem.margin)
    return page_planner(scene, None if motion is None else motion.arms)


def with_moving_objects(document: Document, times: Array, poses: Mapping[str, Array]) -> Document:
    """The document with some moving objects, such as loose bodies of a replay.

    Args:
        document: The result of `view_document`.
        times: Instants [s], shape (n,).
        poses: Position [m] and quaternion (wxyz) of each such object at these instants, shape (n, 7).
    """
    things = {thing["name"]: thing for kind in ("obstacles", "attachments") for thing in document[kind]}
    fixed = {kind: [t for t in document[kind] if t["name"] not in poses] for kind in ("obstacles", "attachments")}
    bodies = {
        "objects": [{"name": name, "pose": _numbers(np.eye(4)), "parts": things[name]["parts"]} for name in poses],
        "times": pack_array(times, "f8"),
        "poses": pack_array(np.stack(list(poses.values()), axis=1)),
    }
    return {**document, **fixed, "bodies": bodies}


def first_camera(scene: Scene, motion: Trajectory | None, ghosts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """The initial camera of the page: it looks at the motion or, if there is none, at the ghosts."""
    return choose_camera(scene, motion, [(ghost["arm"], ghost["q"]) for ghost in ghosts])._asdict()


def _finite(value: object) -> Any:
    """Plain values without NaN and infinity, which JSON cannot represent: they become None."""
    if isinstance(value, dict):
        return {name: _finite(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


# ---- robots ------------------------------------------------------------------------------


def _robot(robot: Robot, shapes: ShapeTable, spheres: bool) -> dict[str, Any]:
    index = {name: i for i, name in enumerate(robot.link_names)}
    bounds = zip(robot.limits.lower.tolist(), robot.limits.upper.tolist(), strict=True)
    return {
        "name": robot.name,
        "kinds": [robot.joint(name).kind for name in robot.joint_names],
        "unchecked": list(robot.unchecked_links),
        "limits": [[low if np.isfinite(low) else None, up if np.isfinite(up) else None] for low, up in bounds],
        "rates": {name: _finite(getattr(robot.limits, name).tolist()) for name in _RATES},
        "visuals": _link_parts(robot, index, shapes, "visuals"),
        "collisions": _link_parts(robot, index, shapes, "collisions"),
        "spheres": _spheres({link.name: link.collisions for link in robot.links}) if spheres else None,
    }


def _link_parts(robot: Robot, index: Mapping[str, int], shapes: ShapeTable, kind: str) -> list[dict[str, object]]:
    """The shapes of all links; a link without visual shapes is shown by its collision shapes."""
    parts = []
    for link in robot.links:
        own = getattr(link, kind) or (link.collisions if kind == "visuals" else ())
        parts += [_part(g, shapes) | {"link": index[link.name]} for g in own]
    return parts


def _spheres(links: Mapping[str, Iterable[Geometry]]) -> dict[str, object]:
    """Spheres around the shapes of links: link, level (see `collision.sphere_covers`), center and radius of each."""
    # Imported here because it loads Coal.
    from rr1plan.collision.sphere_covers import cover_geometries

    covers = [cover_geometries(name, geometries) for name, geometries in links.items()]
    rows = [np.column_stack([c.centers, c.radii]) for c in covers]
    return {
        "links": pack_array(np.repeat(np.arange(len(covers)), [len(c.radii) for c in covers]), "u4"),
        "levels": pack_array(np.concatenate([c.levels for c in covers]), "u4"),
        "spheres": pack_array(np.concatenate(rows), "f8"),
    }


# ---- objects -----------------------------------------------------------------------------


def _part(geometry: Geometry, shapes: ShapeTable) -> dict[str, object]:
    color = None if geometry.color is None else [_short(float(c)) for c in geometry.color]
    return {"shape": shapes.index(geometry.shape), "pose": _numbers(geometry.pose), "color": color}


def _object(name: str, geometries: Iterable[Geometry], pose: Array, shapes: ShapeTable) -> dict[str, Any]:
    return {"name": name, "pose": _numbers(pose), "parts": [_part(g, shapes) for g in geometries]}


def _bodies(motion: BodyMotion, times: Array, shapes: ShapeTable) -> dict[str, object]:
    """Loose bodies, and their positions and quaternions along a replay."""
    return {
        "objects": [_object(name, body.geometries, np.eye(4), shapes) for name, body in motion.bodies.items()],
        "times": pack_array(times, "f8"),
        "poses": pack_array(motion.poses),
    }


def _numbers(T: Array) -> list[float]:
    """A transform as 16 numbers in column-major order (as in WebGL), to the nanometer."""
    return [_short(v) for v in T.T.ravel().tolist()]


def _short(value: float) -> float:
    """A number with few digits: no more than a page can show, and no decimals for an integer."""
    rounded = round(value, 9)
    return int(rounded) if rounded.is_integer() else rounded


# ---- motions -----------------------------------------------------------------------------


def _columns(joint_names: Iterable[str], scene: Scene) -> list[int]:
    known = scene.joint_names() if scene.arms else ()
    place = {name: i for i, name in enumerate(known)}
    return [place[known_name("joint of the scene", name, known)] for name in joint_names]


def _track(trajectory: Trajectory, scene: Scene) -> dict[str, object]:
    """A motion as polynomials, or as straight lines between samples if it has very many pieces."""
    columns = _columns(trajectory.joint_names, scene)
    exact = trajectory.coefficients.size <= _LARGEST_TRACK
    sent = trajectory if exact else _sampled(trajectory)
    return {
        "columns": columns,
        "breaks": pack_array(sent.breaks, "f8"),
        "coefficients": pack_array(sent.coefficients),
        "exact": exact,
    }


def _shown_track(
    motion: Trajectory, scene: Scene, trajectory: Trajectory | None, path: Path | None
) -> dict[str, object]:
    """The motion of the page, marked if its pieces do not define velocities (a replay or a path)."""
    track = _track(motion, scene)
    exact = track["exact"] and trajectory is not None
    return track | {"timed": trajectory is not None or path is None, "exact": exact}


def _sampled(trajectory: Trajectory) -> Trajectory:
    most = max(2, _LARGEST_TRACK // (2 * len(trajectory.joint_names)))
    dt = max(1.0 / _SAMPLE_RATE, trajectory.duration / most)
    return Trajectory.from_samples(trajectory.joint_names, *trajectory.sample(dt))


def _steady(path: Path) -> Trajectory:
    """A path as a motion whose fastest joint has a constant speed."""
    steps = np.abs(np.diff(path.waypoints, axis=0)).max(axis=1, initial=0.0) / _PATH_SPEED
    moving = steps > 1e-9
    if not moving.any():
        return Trajectory.rest(path.joint_names, path.waypoints[0])
    starts, ends = path.waypoints[:-1][moving], path.waypoints[1:][moving]
    slopes = (ends - starts) / steps[moving][:, None]
    breaks = np.concatenate([[0.0], np.cumsum(steps[moving])])
    return Trajectory(path.joint_names, breaks, np.stack([starts, slopes], axis=1))


def _replayed(replay: Replay) -> Trajectory:
    """The recorded positions, joined by straight lines."""
    times, positions = replay.record.times, replay.record.actual
    if len(times) < 2:
        return Trajectory.rest(replay.joint_names, positions[0])
    return Trajectory.from_samples(replay.joint_names, times, positions)


def _summary(replay: Replay) -> dict[str, object]:
    return {
        "mode": replay.mode,
        "worst_error": replay.worst_error,
        "worst_joint": replay.joint_names[int(np.argmax(replay.max_error))] if replay.joint_names else None,
        "tracked": replay.tracked,
        "contacts": [{"pair": list(c.pair), "first": c.first, "last": c.last} for c in replay.contacts],
    }


def _compared(name: str, other: Trajectory, scene: Scene, options: ViewOptions) -> dict[str, object]:
    return {"name": name, **_track(other, scene), "samples": _samples(scene, other, options)}


def _samples(scene: Scene, trajectory: Trajectory | None, options: ViewOptions) -> dict[str, object]:
    """The samples that the page plots in addition to the polynomials of a motion."""
    if trajectory is None or not trajectory.duration:
        return {"torque": None, "clearance": None}
    columns = _columns(trajectory.joint_names, scene)
    return {
        "torque": torque_samples(scene, trajectory, columns),
        "clearance": clearance_samples(scene, trajectory, thorough=options.clearances),
    }


def _findings(
    scene: Scene, trajectory: Trajectory | None, report: Report | None, replay: Replay | None
) -> dict[str, object]:
    """Tracking errors of a replay, and positions of the violations of a report."""
    places = []
    if report is not None and trajectory is not None and trajectory.arms:
        places = violation_places(scene, trajectory, report)
    return {
        "error": None if replay is None else tracking_errors(replay, _columns(replay.joint_names, scene)),
        "places": places,
    }


def _tree(tree: SearchTree, scene: Scene, problem: Problem | None, path: Path | None) -> dict[str, object]:
    """The drawn edges of a search tree, and the tree of each: 0 the start's, 1 a goal's."""
    names = scene.joint_names(problem.arms if problem is not None else None)
    if tree.vertices.shape[1] != len(names):
        raise InputError(f"the tree has {tree.vertices.shape[1]} columns, expected one for each of {', '.join(names)}")
    start = None if problem is None else problem.start
    goals = [] if path is None or path.joint_names != names else [path.waypoints[-1]]
    drawn = drawn_tree(tree, start, goals)
    # A roadmap has no start.
    sides = drawn.sides if (drawn.sides == 0).any() else np.zeros_like(drawn.sides)
    return {
        "columns": _columns(names, scene),
        "vertices": pack_array(drawn.vertices),
        "edges": pack_array(drawn.edges, "u4"),
        "sides": pack_array(sides, "u4"),
        "explored": drawn.explored,
    }


# ---- the query ---------------------------------------------------------------------------


def _ghosts(problem: Problem) -> list[dict[str, Any]]:
    """The start, and the goals that are configurations (a few of them), arm by arm."""
    starts = {arm: problem.start[columns].tolist() for arm, columns in problem.columns.items()}
    ghosts: list[dict[str, Any]] = [{"kind": "start", "arm": arm, "q": q} for arm, q in starts.items()]
    for arm, goals in problem.goal.items():
        joint_goals = [g for g in goals if isinstance(g, JointGoal)]
        ghosts += [{"kind": "goal", "arm": arm, "q": np.asarray(g.q).tolist()} for g in joint_goals[:_MOST_GHOSTS]]
    return ghosts


def _targets(problem: Problem) -> list[dict[str, object]]:
    """Every goal that is a pose, position or region in the world."""
    targets: list[dict[str, Any]] = []
    for arm, goals in problem.goal.items():
        for goal in goals:
            if isinstance(goal, PoseGoal):
                T = pose(goal.position, quaternion=goal.quaternion)
                kind = {"kind": "pose", "pose": _numbers(T), "turned": goal.quaternion is not None}
            elif isinstance(goal, RegionGoal):
                kind = {"kind": "region", "lower": goal.lower.tolist(), "upper": goal.upper.tolist()}
            else:
                continue
            link = frame_link(problem.scene.arms[arm].robot, goal.frame)
            targets.append({"arm": arm, "link": link} | kind)
    return targets
