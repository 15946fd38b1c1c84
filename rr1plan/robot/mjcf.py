"""MJCF, MuJoCo's own format: parsed by MuJoCo, and subject to the same rules as URDF.

The base is the file's world frame, bodies are links and named sites are frames. Joints keep MuJoCo's values: one with a
`ref` has that value in the pose that the file describes. Between several joints on a body, and for joints away from its
origin, frames are inserted. Bodies that no driven joint moves (tables, cubes, doors) are not part of the robot, and
neither are the shapes of the world; `read_mjcf` returns them separately.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from rr1plan.checks import Array, file_path, known_name, read_only
from rr1plan.files.file_access import text_stem
from rr1plan.robot import Geometry, Joint, Link
from rr1plan.robot.arm_finder import ArmFinder
from rr1plan.robot.mesh_lookup import MeshLookup
from rr1plan.robot.mjcf_document import read_document
from rr1plan.robot.mjcf_joints import HINGE, SLIDE, JointReader
from rr1plan.robot.mjcf_links import PLANE, MjcfLinkReader
from rr1plan.robot.mjcf_model import CompiledDocument, compile_document
from rr1plan.robot.mjcf_omissions import listed_names, warn_of_omissions
from rr1plan.robot.srdf import Semantics
from rr1plan.robot.urdf import MAX_LINKS, Tree
from rr1plan.shapes.convex_decomposition import CONVEXITIES, Convexity
from rr1plan.transforms import identity, pose

log = logging.getLogger(__name__)

BASE = "world"
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


@dataclass(frozen=True, eq=False)
class Surrounding:
    """A body of the file that is not part of the robot.

    Args:
        name: Its name; for a shape of the world, the name of its geom.
        pose: T_world_body, shape (4, 4).
        geometries: Its collision shapes, in its frame.
        stands: Whether it cannot move.
        mass: Mass of a single body with a free joint [kg]; None for all others.
        friction: Its sliding friction, the largest one of its shapes.
        excluded: Links whose contacts with it the file excludes.
    """

    name: str
    pose: Array
    geometries: tuple[Geometry, ...]
    stands: bool
    mass: float | None = None
    friction: float = 1.0
    excluded: frozenset[str] = frozenset()


@dataclass(frozen=True, eq=False)
class MjcfContent:
    """The content of an MJCF file.

    Args:
        tree: The links and joints of its robots, attached to the world.
        semantics: One group for each of its robots, named after its first body, the configurations of its keyframes,
            and the pairs of bodies that it excludes from contact.
        surroundings: The other bodies with a shape, at their initial poses.
        standing: Links of the robots that have collision shapes and cannot move.
    """

    tree: Tree
    semantics: Semantics
    surroundings: tuple[Surrounding, ...]
    standing: tuple[str, ...]

    def warn_of_surroundings(self) -> None:
        """Log what is lost if only the robots are used."""
        if self.surroundings:
            log.warning(
                "%s: not part of the robot, left out: %s; rr1plan.load_scene of this file reads them as obstacles",
                self.tree.source,
                listed_names([thing.name for thing in self.surroundings]),
            )


def read_mjcf(
    file: str | Path,
    *,
    package_dirs: Sequence[str | Path] = (),
    convex: Convexity = "hull",
    tool: str | None = None,
) -> MjcfContent:
    """Read an MJCF file.

    Args:
        file: The file; its outermost element is <mujoco>.
        package_dirs: Folders with meshes in addition to the file's own.
        convex: Replacement of non-convex collision meshes: their "hull", or convex "pieces".
        tool: The body or site at the end of the first group's chain; by default a site with a tool's name, or the body
            that carries the gripper's fingers.

    Raises:
        FormatError: anything but a valid description of robots with hinges and slides.
        UnknownNameError: an unknown `convex` or `tool`.
    """
    known_name("convex", convex, CONVEXITIES)
    path = file_path(file)
    lookup = MeshLookup(package_dirs, path)
    compiled = compile_document(read_document(path, lookup), lookup)
    return _Reader(compiled, convex, tool).read()


class _Reader:
    """Converts one compiled model into links and joints."""

    def __init__(self, compiled: CompiledDocument, convex: Convexity, tool: str | None) -> None:
        self.compiled = compiled
        self.model = compiled.model
        self.file = compiled.document.file
        self.tool = tool
        self.keyframes = self._keyframes()
        self.rest = self.keyframes.get("home", next(iter(self.keyframes.values()), np.array(self.model.qpos0)))
        self.joints = JointReader(compiled, self.rest)
        self.shapes = MjcfLinkReader(compiled, convex)
        self.roots = self._roots()
        robots = set(self.roots)
        self.bodies = {b: None for b in range(1, self.model.nbody) if int(self.model.body_rootid[b]) in robots}
        self.sites: dict[int, list[int]] = {}
        for site, body in enumerate(self.model.site_bodyid.tolist()):
            if body in self.bodies and self.model.site(site).name:
                self.sites.setdefault(body, []).append(site)
        # The world is shared by all robots and surroundings.
        self.links: list[Link] = [Link(BASE)]
        self.tree_joints: list[Joint] = []
        self.link_of: dict[int, str] = {0: BASE}
        self.site_links: set[str] = set()
        self.taken = {self.model.body(b).name for b in range(self.model.nbody)}

    def read(self) -> MjcfContent:
        self._refuse_what_no_robot_has()
        for body in self.bodies:
            self._add_body(body)
        self._drop_mimics_of_others()
        warn_of_omissions(self.compiled, self.shapes, self.link_of)
        name = self.compiled.document.root.attributes.get("model", "").strip() or text_stem(self.file)
        tree = Tree(name, tuple(self.links), tuple(self.tree_joints), str(self.file))
        solid = {link.name for link in self.links if link.collisions}
        standing = [self.link_of[b] for b in self.bodies if int(self.model.body_weldid[b]) == 0]
        return MjcfContent(
            tree, self._semantics(tree), tuple(self._surroundings()), tuple(n for n in standing if n in solid)
        )

    # ---- robots and other things ----------------------------------------------------------

    def _roots(self) -> list[int]:
        """The first body of each robot: those with driven joints, or with any joints if none is driven."""
        model = self.model
        moved: dict[int, list[int]] = {}
        for joint in range(model.njnt):
            if int(model.jnt_type[joint]) in (HINGE, SLIDE):
                moved.setdefault(int(model.body_rootid[model.jnt_bodyid[joint]]), []).append(joint)
        driven = [root for root, joints in moved.items() if any(map(self.joints.is_driven, joints))]
        roots = driven or list(moved)
        if not roots:
            raise self.compiled.document.root.error("has no body that a hinge or slide joint moves, expected a robot")
        return roots

    def _refuse_what_no_robot_has(self) -> None:
        model = self.model
        frames = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in self.bodies]
        count = len(self.bodies) + len(frames) + sum(map(len, self.sites.values()))
        if count > MAX_LINKS:
            root = self.compiled.document.root
            raise root.error(f"the robot has {count} bodies, joints and named sites, expected at most {MAX_LINKS}")
        for joint in range(model.njnt):
            body = int(model.jnt_bodyid[joint])
            kind = int(model.jnt_type[joint])
            if body not in self.bodies or kind in (HINGE, SLIDE, _FREE):
                continue
            raise self.compiled.error_at(
                self.compiled.spec.joints[joint],
                f"joint {self.joints.names[joint]!r} is a ball joint, which a robot here cannot have; "
                "write three hinge joints instead",
            )
        for body in self.bodies:
            if any(int(model.geom_type[g]) == PLANE for g in self.shapes.geoms(body)):
                raise self.compiled.error_at(
                    self.compiled.spec.bodies[body],
                    f"body {model.body(body).name!r} has a plane, which has no end; take a box",
                )

    def _surroundings(self) -> Iterator[Surrounding]:
        """Shapes that are not part of the robot: geoms of the world one by one, then bodies."""
        model = self.model
        data = mujoco.MjData(model)
        data.qpos[:] = self.rest
        mujoco.mj_kinematics(model, data)
        for body in range(model.nbody):
            if body in self.bodies:
                continue
            # A hidden shape without collisions is a mark here, such as the zone of a task.
            solid = [g for g in self.shapes.colliding_geoms(body) if not self.compiled.uses[g].switched_off]
            geometries = [self.shapes.geometry(geom) for geom in solid]
            excluded = self._excluded_links(body)
            if body == 0:
                yield from (
                    Surrounding(g.name, g.pose, (replace(g, pose=identity()),), True, excluded=excluded)
                    for g in geometries
                )
            elif geometries:
                pose = read_only(self.compiled.pose(data.xpos[body], data.xquat[body]))
                stands = int(model.body_weldid[body]) == 0
                mass = float(model.body_mass[body]) if self._is_loose(body) else None
                friction = float(model.geom_friction[solid, 0].max())
                name = model.body(body).name or f"body{body}"
                yield Surrounding(name, pose, tuple(geometries), stands, mass, friction, excluded)

    def _is_loose(self, body: int) -> bool:
        """Whether a body has a free joint and no other body is attached to it."""
        model = self.model
        free = int(model.body_jntnum[body]) == 1 and int(model.jnt_type[model.body_jntadr[body]]) == _FREE
        return free and int(np.count_nonzero(model.body_rootid == body)) == 1

    # ---- links and joints -----------------------------------------------------------------

    def _add_body(self, body: int) -> None:
        model = self.model
        name = model.body(body).name or self._unused(f"body{body}")
        self.link_of[body] = name
        parent = self.link_of[int(model.body_parentid[body])]
        before = self.compiled.pose(model.body_pos[body], model.body_quat[body])
        start, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = [j for j in range(start, start + count) if int(model.jnt_type[j]) != _FREE]
        if count > len(joints):
            log.warning("%s: body %r is free to move, it is taken as fixed: bases stand still here", self.file, name)
        for joint in joints:
            after = pose(-model.jnt_pos[joint])
            last = joint == joints[-1] and not model.jnt_pos[joint].any()
            child = name if last else self._unused(f"{name}.{self.joints.names[joint]}")
            self.tree_joints.append(self.joints.joint(joint, parent, child, before))
            if not last:
                self.links.append(Link(child))
            parent, before = child, after
        if parent != name:
            self._fix(parent, name, before)
        self.links.append(self.shapes.link(body, name))
        for site in self.sites.get(body, ()):
            self._add_site(site, name)

    def _add_site(self, site: int, body: str) -> None:
        written = self.model.site(site).name
        name = self._unused(written if written not in self.taken else f"{written}_site")
        self.site_links.add(name)
        self._fix(body, name, self.compiled.pose(self.model.site_pos[site], self.model.site_quat[site]))
        self.links.append(Link(name))

    def _fix(self, parent: str, child: str, pose: Array) -> None:
        joint = f"{child}_fixed"
        while joint in self.joints.names.values() or any(joint == j.name for j in self.tree_joints):
            joint += "_"
        self.tree_joints.append(Joint(joint, "fixed", parent, child, read_only(pose)))

    def _drop_mimics_of_others(self) -> None:
        """Lock a joint that follows a joint of a body outside the robot."""
        moving = {joint.name for joint in self.tree_joints if joint.kind != "fixed"}
        for index, joint in enumerate(self.tree_joints):
            if joint.mimic is not None and joint.mimic.joint not in moving:
                leader = joint.mimic.joint
                log.warning("%s: joint %r follows %r, which no robot has; it is held", self.file, joint.name, leader)
                self.tree_joints[index] = replace(joint, mimic=None)

    def _unused(self, name: str) -> str:
        """A name that is not used by a body or a frame."""
        while name in self.taken:
            name += "_"
        self.taken.add(name)
        return name

    # ---- groups, configurations, pairs ----------------------------------------------------

    def _keyframes(self) -> dict[str, Array]:
        """The configurations of the keyframes by name, each (nq,)."""
        keys = self.compiled.spec.keys
        named = {(key.name or f"key{i}"): i for i, key in enumerate(keys) if len(key.qpos)}
        return {name: np.array(self.model.key_qpos[index]) for name, index in named.items()}

    def _semantics(self, tree: Tree) -> Semantics:
        names = self.joints.names
        moving = {joint.name for joint in tree.joints if joint.kind != "fixed"}
        numbers = {j: n for j, n in names.items() if n in moving}
        states = {
            ("", state): {n: self.joints.value(j, qpos) for j, n in numbers.items()}
            for state, qpos in self.keyframes.items()
        }
        arms = self._arms(tree)
        return Semantics(
            groups={name: joints for name, (joints, _) in arms.items()},
            chains={name: (BASE, tip) for name, (_, tip) in arms.items()},
            states=states,
            disabled=self._excluded(),
            default_positions={n: self.joints.rest_value(j) for j, n in numbers.items()},
            is_partial=True,
        )

    def _excluded(self) -> frozenset[frozenset[str]]:
        """The pairs of links that the file excludes from contact."""
        pairs = set()
        for bodies in self._excluded_bodies():
            a, b = map(self.link_of.get, bodies)
            if a is not None and b is not None and a != b and BASE not in (a, b):
                pairs.add(frozenset((a, b)))
        return frozenset(pairs)

    def _excluded_links(self, body: int) -> frozenset[str]:
        """The links whose contacts with a body of the surroundings the file excludes."""
        others = {b if a == body else a for a, b in self._excluded_bodies() if body in (a, b)}
        return frozenset(self.link_of[other] for other in others if other in self.bodies)

    def _excluded_bodies(self) -> list[tuple[int, int]]:
        """The pairs of bodies that the file excludes from contact."""
        return [(signature >> 16, signature & 0xFFFF) for signature in self.model.exclude_signature.tolist()]

    def _arms(self, tree: Tree) -> dict[str, tuple[tuple[str, ...], str]]:
        """For each robot its first body's name, its planning joints and its tool."""
        driven = {name for joint, name in self.joints.names.items() if self.joints.is_driven(joint)}
        finder, tool = ArmFinder(tree, driven, self.site_links), self.tool
        if tool is not None:
            known_name("link", tool, [link.name for link in tree.links])
        # The robot with the chosen tool comes first.
        roots = sorted(
            map(self.link_of.__getitem__, self.roots), key=lambda r: tool is None or not finder.is_below(tool, r)
        )
        held = {self.joints.names[joint] for joint in self.joints.constants}
        found: dict[str, tuple[tuple[str, ...], str]] = {}
        for joints in (finder.driven - held, finder.moving - held):
            finder.driven = joints  # all joints if only grippers are driven
            for root in roots if not found else ():
                wanted = tool if tool is not None and finder.is_below(tool, root) else None
                tip = wanted or finder.named_tool(root) or finder.hand(root)
                if names := finder.arm_joints(tip):
                    found[root] = names, tip
        return found
