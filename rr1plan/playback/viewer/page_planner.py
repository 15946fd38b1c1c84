"""Data with which a page plans by itself: the modules of the kernels, and the tables of its scene.

`page/planner.js` runs the same kernels as `plan_motion` in the same order, with the same constants, and the referee
proves the motion (`page/referee.js`). Up to twelve arms are planned in their joint space. If more arms move, a page
plans for one arm after the other while all others rest (`arm_templates.py`, `page/many_arms_planner.js`), and any arm
of the scene can move. A page without a planner contains the reason instead:

- More than twelve arms move, and a contact rule concerns two particular arms.
- A joint that moves has no limit of position, velocity or acceleration.
- The scene cannot be checked for collisions, or stationary objects are in contact.
- The convex decomposition of its moving meshes takes longer than a second (it is cached once a motion was planned), or
  its tables exceed 4 MB.
- The modules are not built.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Sequence
from functools import cache
from time import perf_counter
from typing import Any

import numpy as np

from rr1plan.binding.memory_image import Root
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.collision.convex.convex_bodies import cut_meshes
from rr1plan.errors import CancelledError, InputError, InstallationError
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.kernels.random_state import random_state
from rr1plan.kernels.wasm_core import core_module
from rr1plan.model.ik_descent import METERS_PER_RADIAN
from rr1plan.model.ik_search import NEAR, SHARE, WHOLE, IkSearch, separation
from rr1plan.model.joint_space import Space, joint_space
from rr1plan.model.kinematic_chain import chain_of
from rr1plan.planning_constants import BLENDS, MARGINS, SHORTCUTS, TIMING, TREES
from rr1plan.playback.viewer.arm_templates import (
    ARM,
    arm_kinds,
    arm_templates,
    has_rules_between_arms,
    neighbors_of,
)
from rr1plan.playback.viewer.page_kinematics import scene_kinematics
from rr1plan.scene import Scene
from rr1plan.scene.problem import PoseGoal
from rr1plan.shapes import Mesh
from rr1plan.validation.wasm_referee import referee_image, referee_module

_MOST_TOGETHER = 12  # arms that are planned in their joint space
_NEAR = 0.1  # a template omits elements that stay farther away than this in addition to the padding [m]
_MOST_SECONDS = 1.0  # of convex decomposition
_MOST_BYTES = 4_000_000  # of the compressed tables
_MOST_TRIANGLES = 100_000  # of all meshes of the surroundings: the tables of more are always larger


def page_planner(scene: Scene, arms: Sequence[str] | None = None, margin: float = 0.0) -> dict[str, Any]:
    """The data of `loadPlanner` in `page/planner.js` without the modules; cached with the scene.

    Args:
        scene: The scene.
        arms: The arms that the page plans for (default: all).
        margin: Distance to keep beyond the scene's padding, at most [m] (0: the default of `plan_motion`).

    Returns:
        Plain values that JSON can represent; `{"missing": reason}` if the page cannot plan.

    Raises:
        UnknownNameError: no such arm.
    """
    names = scene.arm_names(arms) if scene.arms and (arms is None or len(arms)) else ()
    if len(names) > _MOST_TOGETHER:
        names = scene.arm_names()
    margin = margin or MARGINS.default
    key = "page planner", names, margin
    if key not in scene.kept:
        reason = _why_missing(scene, names)
        try:
            page_modules()
            scene.kept[key] = {"missing": reason} if reason else _planner_data(scene, names, margin)
        except CancelledError:
            return {"missing": f"convex decomposition of the moving meshes takes longer than {_MOST_SECONDS:g} s"}
        except (InputError, InstallationError) as error:
            scene.kept[key] = {"missing": str(error)}
    data: dict[str, Any] = scene.kept[key]
    return data


@cache
def page_modules() -> dict[str, str]:
    """The modules of the kernels, compressed, as base64.

    Raises:
        InstallationError: the modules are not built.
    """
    return {"core": _packed(core_module()), "referee": _packed(referee_module())}


def _packed(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data)).decode("ascii")


def _why_missing(scene: Scene, arms: tuple[str, ...]) -> str:
    """Why a page cannot plan for these arms; empty if it can."""
    if not arms:
        return "no arm moves"
    if len(arms) > _MOST_TOGETHER and has_rules_between_arms(scene):
        return f"more than {_MOST_TOGETHER} arms move, and a rule of contact concerns two of them"
    limits, space = scene.limits(arms), joint_space(scene, arms)
    for kind, limited in (
        ("position", np.isfinite(space.extent) | space.wraps),
        ("velocity", np.isfinite(limits.velocity)),
        ("acceleration", np.isfinite(limits.acceleration)),
    ):
        if not limited.all():
            return f"joint {scene.joint_names(arms)[int(np.argmin(limited))]!r} has no {kind} limit"
    shapes = [g.shape for o in scene.obstacles.values() for g in o.geometries]
    triangles = sum(len(shape.faces) for shape in shapes if isinstance(shape, Mesh))
    return f"the obstacles have {triangles:,} triangles" if triangles > _MOST_TRIANGLES else ""


def _planner_data(scene: Scene, arms: tuple[str, ...], margin: float) -> dict[str, Any]:
    began = perf_counter()
    cut_meshes(scene, lambda _: perf_counter() - began < _MOST_SECONDS)
    if len(arms) > _MOST_TOGETHER:
        data = _many_arms(scene, margin)
        images = [template["image"] for template in data["templates"]]
    else:
        with checker_from_pool(scene, arms, margin) as checker:
            data = _tables(checker, margin)
        images = [data["image"]]
    known = scene.joint_names()
    columns = scene.joint_names(arms)
    referee, names = referee_image(scene, columns)
    data |= {"columns": [known.index(name) for name in columns], "referee": {"image": _packed(referee), **names}}
    size = sum(map(len, (*images, data["referee"]["image"])))
    return data if size <= _MOST_BYTES else {"missing": f"the tables of the scene have {size / 1e6:.1f} MB"}


def _tables(checker: CollisionChecker, margin: float) -> dict[str, Any]:
    """The data with which a page plans in the joint space of a checker's arms."""
    scene, space = checker.scene, joint_space(checker.scene, checker.arms)
    searches = _searches(checker)
    image = checker.memory_image(
        **_rows(checker, space), **{frame["search"]: search.struct for frame, search in searches}
    )
    rules = checker.geometry.rules
    reach = checker.omitted_clearance + checker.margin
    return {
        "image": _packed(image),
        "joints": list(checker.joint_names),
        "elements": list(rules.names),
        "pairs": rules.checked.tolist(),
        "obstacles": {
            name: {"object": number, "pose": scene.obstacles[name].pose.ravel().tolist()}
            for name, number in checker.object_numbers.items()
        },
        "frames": [frame for frame, _ in searches],
        "margin": margin,
        "reach": reach if np.isfinite(reach) else None,
        "tree_step": TREES.step * space.diagonal,
        "tree_domain": TREES.domain * space.diagonal,
        "margins": MARGINS._asdict(),
        "shortcuts": SHORTCUTS._asdict(),
        "blends": BLENDS._asdict(),
        "timing": TIMING._asdict(),
    }


def _many_arms(scene: Scene, margin: float) -> dict[str, Any]:
    """The data with which a page plans for one arm after the other."""

    def numbers(T: Array) -> list[float]:
        values: list[float] = T.T.ravel().tolist()
        return values

    kinds, near = arm_kinds(scene), neighbors_of(scene, margin + _NEAR)
    _, robots, arms = scene_kinematics(scene, numbers)
    place = {name: i for i, name in enumerate(scene.arms)}
    templates = []
    for template in arm_templates(scene, margin + _NEAR):
        checker = CollisionChecker(template.scene, margin=margin).complete()
        link_of = {name: i for i, name in enumerate(template.scene.arms[ARM].robot.link_names)}
        data = _tables(checker, margin)
        del data["obstacles"], data["elements"], data["pairs"]
        templates.append(
            data
            | {
                "columns": list(range(checker.nq)),
                "first_object": min(checker.object_numbers.values(), default=0),
                "parts": [{"link": link_of[part.link], "pose": numbers(part.pose)} for part in template.parts],
                "neighbors": [[kind, count] for kind, count in template.neighbors.items()],
            }
        )
    return {
        "robots": robots,
        "arms": [
            row | {"template": kinds[row["name"]], "near": [place[other] for other in near[row["name"]]]}
            for row in arms
        ],
        "templates": templates,
        "obstacles": {name: numbers(obstacle.pose) for name, obstacle in scene.obstacles.items()},
        "joints": list(scene.joint_names()),
        "reach": _NEAR if any(len(others) + 1 < len(arms) for others in near.values()) else None,
    }


def _rows(checker: CollisionChecker, space: Space) -> dict[str, Root]:
    """Bounds of the joint space, and the limits of timing."""
    velocity, acceleration = (
        np.ascontiguousarray(row) for row in (checker.limits.velocity, checker.limits.acceleration)
    )
    rates = CStruct(
        "RateLimits",
        velocity=velocity,
        acceleration=acceleration,
        inverse_velocity=1.0 / velocity,
        inverse_acceleration=1.0 / acceleration,
    )
    rows: dict[str, Root] = {
        name: ("double", np.ascontiguousarray(getattr(space, name))) for name in ("lower", "upper", "extent")
    }
    return rows | {"can_move": ("uint8_t", np.array([space.can_move], np.uint8)), "rates": rates}


def _searches(checker: CollisionChecker) -> list[tuple[dict[str, Any], IkSearch]]:
    """The tool of each arm, with the parameters for each kind of target, and its inverse kinematics search."""
    scene, first, searches = checker.scene, 0, []
    goal = PoseGoal("tool", np.eye(4))
    tolerances = np.array([goal.position_tolerance, goal.orientation_tolerance])
    for arm in checker.arms:
        robot = scene.arms[arm].robot
        chain = chain_of(checker.model.arm_model, f"{arm}/{robot.tool}", first)
        seeds = np.clip(scene.arms[arm].q, robot.limits.lower, robot.limits.upper)[None]
        search = IkSearch(chain, robot, goal, seeds, random_state(0))
        for name in ("solutions", "nearest", "memory"):
            search.struct.part(name)[:] = 0.0  # so that equal scenes have equal images
        frame = {
            "name": f"{arm}/{robot.tool}",
            "arm": arm,
            "search": f"tool of {arm}",
            "first": first,
            "weight": METERS_PER_RADIAN,
            "tolerances": [(share * tolerances).tolist() for share in (SHARE, WHOLE)],
            "separations": [separation(chain, fixed) for fixed in (3, 6)],
            "near": NEAR**2,
        }
        searches.append((frame, search))
        first += robot.nq
    return searches
