"""Contacts of bodies by python-fcl, by Coal and by MuJoCo, each from the shapes of the description only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import MissingPackageError
from rr1plan.playback.simulation.joint_map import JointTargets
from rr1plan.playback.simulation.mujoco_model import build_mujoco
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, HalfSpace, Mesh, Sphere
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.testing.closed_meshes import is_inside
from rr1plan.testing.scene_bodies import SceneBodies, SceneBody, is_surface
from rr1plan.trajectory import Trajectory

ElementPair = tuple[str, str]


# ---- python-fcl ----------------------------------------------------------------------------------


class FclChecker:
    """python-fcl, whose code base separated from Coal's long ago and has a different narrow phase.

    Args:
        bodies: The bodies.

    Raises:
        MissingPackageError: python-fcl is not installed.
    """

    def __init__(self, bodies: Sequence[SceneBody]) -> None:
        self._fcl = _fcl()
        self._objects = [self._fcl.CollisionObject(fcl_geometry(body.shape)) for body in bodies]

    def touches(self, a: int, T_a: Array, b: int, T_b: Array) -> bool:
        """Whether two bodies touch at these poses, each (4, 4)."""
        fcl = self._fcl
        one, two = self._placed(a, T_a, b, T_b)
        return bool(fcl.collide(one, two, fcl.CollisionRequest(), fcl.CollisionResult()) > 0)

    def _placed(self, a: int, T_a: Array, b: int, T_b: Array) -> list[Any]:
        things = [self._objects[a], self._objects[b]]
        for thing, T in zip(things, (T_a, T_b), strict=True):
            thing.setTransform(self._fcl.Transform(np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3])))
        return things


def fcl_geometry(shape: Box | Sphere | Cylinder | Capsule | HalfSpace | Mesh) -> Any:
    """A shape in python-fcl.

    Raises:
        MissingPackageError: python-fcl is not installed.
    """
    fcl = _fcl()
    if not isinstance(shape, Mesh):
        return _primitive(fcl, shape)
    if is_surface(shape):
        surface = fcl.BVHModel()
        surface.beginModel(len(shape.vertices), len(shape.faces))
        surface.addSubModel(np.array(shape.vertices), np.array(shape.faces))
        surface.endModel()
        return surface
    hull = convex_hull(shape.vertices)
    corners = np.concatenate([np.full((len(hull.faces), 1), 3), hull.faces], axis=1).astype(np.int32)
    return fcl.Convex(np.array(hull.vertices), len(hull.faces), corners.ravel())


def _primitive(library: Any, shape: Box | Sphere | Cylinder | Capsule | HalfSpace) -> Any:
    """A shape in FCL or Coal, which use the same names."""
    match shape:
        case Box(size):
            return library.Box(*size)
        case Sphere(radius):
            return library.Sphere(radius)
        case HalfSpace(normal, offset):
            return library.Halfspace(np.array(normal), offset)
    return getattr(library, type(shape).__name__)(shape.radius, shape.length)


def _fcl() -> Any:
    try:
        import fcl
    except ImportError as error:
        raise MissingPackageError("python-fcl", "the opinion of python-fcl") from error
    return fcl


# ---- Coal ----------------------------------------------------------------------------------------


class CoalOnlyChecker:
    """Coal alone, without a broad phase and without guesses cached between queries.

    Args:
        bodies: The bodies.
    """

    def __init__(self, bodies: Sequence[SceneBody]) -> None:
        import coal

        self._coal = coal
        self._geometries = [_geometry(body.shape) for body in bodies]
        # Without contacts, Coal misses some shapes whose core lies in the other's surface.
        self._request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)
        self._surfaces = [body.is_surface for body in bodies]

    def touches(self, a: int, T_a: Array, b: int, T_b: Array) -> bool:
        """Whether two bodies touch at these poses, each (4, 4)."""
        if self._surfaces[a] or self._surfaces[b]:
            # Coal's collision test of a surface misses a ball that penetrates by a tenth of a millimeter.
            return self.distance(a, T_a, b, T_b) <= 0.0
        result = self._coal.CollisionResult()
        return bool(self._coal.collide(*self._placed(a, T_a, b, T_b), self._request, result) > 0)

    def distance(self, a: int, T_a: Array, b: int, T_b: Array) -> float:
        """Signed distance of two bodies at these poses [m]; for surfaces not below about zero."""
        coal = self._coal
        placed = self._placed(a, T_a, b, T_b)
        return float(coal.distance(*placed, coal.DistanceRequest(), coal.DistanceResult()))

    def _placed(self, a: int, T_a: Array, b: int, T_b: Array) -> list[Any]:
        one, two = (self._coal.Transform3s(T[:3, :3], T[:3, 3]) for T in (T_a, T_b))
        return [self._geometries[a], one, self._geometries[b], two]


def _geometry(shape: Box | Sphere | Cylinder | Capsule | HalfSpace | Mesh) -> Any:
    """A shape in Coal."""
    import coal

    if not isinstance(shape, Mesh):
        return _primitive(coal, shape)
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    if not is_surface(shape):
        # Coal's own hull fails if many faces meet at a corner.
        hull = convex_hull(shape.vertices)
        points.extend(list(np.array(hull.vertices)))
        triangles.extend([coal.Triangle(*face) for face in hull.faces.tolist()])
        return coal.Convex(points, triangles)
    points.extend(list(np.array(shape.vertices)))
    corners = shape.vertices[shape.faces]
    # A triangle without area touches every ball.
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    triangles.extend([coal.Triangle(*face) for face in shape.faces[areas > 0.0].tolist()])
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(triangles), len(points))
    surface.addSubModel(points, triangles)
    surface.endModel()
    return surface


# ---- MuJoCo --------------------------------------------------------------------------------------


class MujocoChecker:
    """MuJoCo's contacts at poses from MuJoCo's own kinematics.

    Args:
        scene: The scene.
        motion: A motion of some of its arms, which defines the columns of configurations.
    """

    def __init__(self, scene: Scene, motion: Trajectory) -> None:
        import mujoco

        self._mujoco = mujoco
        self._world = build_mujoco(scene)
        self._data = mujoco.MjData(self._world.model)
        self._targets = JointTargets(motion, scene)
        self._checked = {frozenset(pair): pair for pair in scene.checked_pairs}
        self._rigid = self._rigid_contacts()

    def contacts(self, time: float) -> dict[ElementPair, float]:
        """Forbidden contacts at a time of the motion: pairs of elements in the scene's order, with their depth [m]."""
        data, model = self._data, self._world.model
        q = self._targets(np.array([time]))[0]
        data.qpos[: len(q)] = q  # loose bodies keep their initial poses
        self._mujoco.mj_kinematics(model, data)
        self._mujoco.mj_collision(model, data)
        found = dict(self._rigid)
        for (first, second), distance in zip(data.contact.geom, data.contact.dist, strict=True):
            elements = self._world.geom_elements[first], self._world.geom_elements[second]
            pair = self._checked.get(frozenset(elements))
            if distance <= 0.0 and pair is not None:
                found[pair] = max(found.get(pair, 0.0), -float(distance))
        return found

    def _rigid_contacts(self) -> dict[ElementPair, float]:
        """Contacts of held objects with the links of the body that holds them, which MuJoCo's collision search omits.

        They are the same at all configurations.
        """
        model, elements = self._world.model, self._world.geom_elements
        by_element: dict[str, list[int]] = {}
        for geom, element in enumerate(elements):
            by_element.setdefault(element, []).append(geom)
        self._mujoco.mj_kinematics(model, self._data)
        found = {}
        for pair in self._checked.values():
            first, second = (by_element.get(element, []) for element in pair)
            bodies = {int(model.body_weldid[model.geom_bodyid[geom]]) for geom in (*first, *second)}
            if len(bodies) != 1:
                continue
            distances = [
                self._mujoco.mj_geomDistance(model, self._data, a, b, 0.0, None) for a in first for b in second
            ]
            if min(distances, default=1.0) < 0.0:
                found[pair] = -min(distances)
        return found


# ---- cases that the libraries do not cover -------------------------------------------------------


def encloses(body: SceneBody, T: Array, other: SceneBody, T_other: Array) -> bool:
    """Whether a closed surface encloses another body without contact, which tests of surfaces do not detect.

    Args:
        body: A body; the result is False for shapes other than surfaces.
        T: Its pose, shape (4, 4).
        other: The other body.
        T_other: Its pose, shape (4, 4).
    """
    if not isinstance(body.shape, Mesh) or not body.is_surface or isinstance(other.shape, HalfSpace):
        return False
    point = other.shape.vertices[0] if isinstance(other.shape, Mesh) else np.zeros(3)
    in_world = T_other[:3, :3] @ point + T_other[:3, 3]
    return is_inside(body.shape, T[:3, :3].T @ (in_world - T[:3, 3]))


def height_above(plane: SceneBody, T: Array, other: SceneBody, T_other: Array) -> float | None:
    """Signed distance of a surface from a half-space [m], which no library computes; None for other shapes.

    Args:
        plane: A body, either of the two.
        T: Its pose, shape (4, 4).
        other: The other body.
        T_other: Its pose, shape (4, 4).
    """
    if isinstance(other.shape, HalfSpace):
        plane, T, other, T_other = other, T_other, plane, T
    half_space, mesh = plane.shape, other.shape
    if not isinstance(half_space, HalfSpace) or not isinstance(mesh, Mesh) or not other.is_surface:
        return None
    normal = T[:3, :3] @ np.array(half_space.normal)
    points = mesh.vertices[np.unique(mesh.faces)] @ T_other[:3, :3].T + T_other[:3, 3]
    return float((points @ normal).min() - normal @ T[:3, 3] - half_space.offset)


# ---- elements ------------------------------------------------------------------------------------


class ElementChecker:
    """Elements of a scene in contact at given configurations, by python-fcl and Coal.

    Args:
        scene: The scene.
        joint_names: Columns of the configurations, "arm/joint"; arms without columns rest.
        checkers: Names of checkers, of which FCL and Coal are used here; bodies inside closed meshes count for all.

    Attributes:
        bodies: The bodies of the elements.
        queries: Number of pairs of bodies that each library has checked.

    Raises:
        UnknownNameError: a column that is not a joint of the scene.
        InputError: only some joints of an arm have columns.
        MissingPackageError: python-fcl is not installed.
    """

    def __init__(self, scene: Scene, joint_names: Sequence[str], checkers: Sequence[str] = ("FCL", "Coal")) -> None:
        self.bodies = SceneBodies(scene, joint_names)
        self.queries = 0
        parts = self.bodies.bodies
        self._coal = CoalOnlyChecker(parts)
        self._names = frozenset(checkers)
        self._libraries: dict[str, FclChecker | CoalOnlyChecker] = {}
        if "FCL" in self._names:
            self._libraries["FCL"] = FclChecker(parts)
        if "Coal" in self._names:
            self._libraries["Coal"] = self._coal

    def contacts(self, q: Array, pairs: NDArray[np.int64] | None = None) -> list[dict[ElementPair, set[str]]]:
        """The pairs of elements in contact at each configuration, and the checkers that find the contact.

        Args:
            q: Configurations, shape (n, nq).
            pairs: Indices of the bodies to check, shape (m, 2) (default: all pairs that must not touch).
        """
        pairs = self.bodies.pairs if pairs is None else pairs
        frames = self.bodies.frames(q)
        found: list[dict[ElementPair, set[str]]] = [{} for _ in q]
        for n, k in zip(*self.bodies.nearby_pairs(frames, pairs), strict=True):
            a, b = pairs[k].tolist()
            self.queries += 1
            names = self._touching(a, frames[n, a], b, frames[n, b])
            if names:
                elements = self.bodies.bodies[a].element, self.bodies.bodies[b].element
                found[n].setdefault(elements, set()).update(names)
        return found

    def distance(self, q: Array, pair: ElementPair) -> float:
        """Signed distance of two elements at a configuration (nq,) by Coal [m]."""
        frames = self.bodies.frames(q[None])[0]
        bodies = self.bodies.bodies
        own = [(a, b) for a, b in self.bodies.pairs.tolist() if (bodies[a].element, bodies[b].element) == pair]
        return min(self._distance(a, frames[a], b, frames[b]) for a, b in own)

    def _distance(self, a: int, T_a: Array, b: int, T_b: Array) -> float:
        height = height_above(self.bodies.bodies[a], T_a, self.bodies.bodies[b], T_b)
        return self._coal.distance(a, T_a, b, T_b) if height is None else height

    def _touching(self, a: int, T_a: Array, b: int, T_b: Array) -> frozenset[str]:
        """Checkers that find two bodies in contact."""
        one, two = self.bodies.bodies[a], self.bodies.bodies[b]
        height = height_above(one, T_a, two, T_b)
        if height is not None:
            return frozenset(self._libraries) if height <= 0.0 else frozenset()
        found = frozenset(name for name, library in self._libraries.items() if library.touches(a, T_a, b, T_b))
        if found and len(found) == len(self._libraries):
            return found
        return self._names if encloses(one, T_a, two, T_b) or encloses(two, T_b, one, T_a) else found
