"""The tables of solids that do not move: what they are as rows, put in place by compiled code (`place_solids.c`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.arm_geometry import ArmGeometry
from rr1plan.collision.arm_instances import ArmInstances
from rr1plan.collision.convex.convex_bodies import is_concave
from rr1plan.collision.convex.convex_cores import CoreTables, joined_cores, shape_core
from rr1plan.collision.convex.mesh_trees import MeshTree, joined_trees, mesh_tree
from rr1plan.collision.obstacle_geometry import ObstacleGeometry
from rr1plan.collision.tables.arm_tables import arm_tables
from rr1plan.collision.tables.body_tables import BodyTables, body_core, neighbors
from rr1plan.collision.tables.link_spheres import matrix
from rr1plan.collision.tables.solid_rows import solid_rows
from rr1plan.kernels.planner_kernels import CStruct, constants, load_library
from rr1plan.object_cache import kept_in
from rr1plan.shapes import Shape

_INTS = NDArray[np.int64]
LANES = constants()["LANES"]
_CLOSED_FORM = constants()["CORE_CLOSED_FORM"]


class FixedSolids:
    """Solids of objects that do not move, as `fixed_solids.h` has them.

    Args:
        things: The objects.
        first_body: Row of the exact kernel's tables of the first solid that has one.
        links: How many objects, the first ones, are links of arms that move: their rows and cores are with the arms'.

    Attributes:
        solids: A `FixedSolid` of each, shape (n, 8).
        struct: All as C reads it.
    """

    def __init__(self, things: Sequence[ObstacleGeometry], first_body: int = 0, links: int = 0) -> None:
        counts = [len(thing.rows.shapes) for thing in things]
        total, before = sum(counts), sum(counts[:links])
        kinds = np.frombuffer(b"".join([thing.rows.kinds for thing in things]), np.int64).reshape(-1, 4)
        self.exact_kinds = kinds[before:, 0]
        self.solids = np.zeros((total, 8), np.int64)
        self.solids[:, 0] = np.repeat(np.arange(len(things)), counts)
        self.solids[:before, 1] = -1
        self.solids[before:, 1] = np.arange(first_body, first_body + total - before)
        self.solids[:, 2] = np.arange(total)
        self.solids[:, 3], self.solids[:, 6:] = kinds[:, 3], kinds[:, 1:3]
        # Those with tables of their own, but for links, numbered among all solids, and their shapes.
        self.special: list[tuple[int, Shape]] = []
        first = before
        for thing, count in zip(things[links:], counts[links:], strict=True):
            self.special += [(first + i, thing.rows.shapes[i]) for i in thing.rows.special]
            first += count
        self._before = before
        self.solids[:before, 4] = -1
        self._cores = [(i, shape_core(shape)) for i, shape in self.special if kinds[i, 3] == 0]
        points, blocks = np.zeros((0, 3)), np.zeros((0, 4))
        if self._cores:
            parts = [core for _, core in self._cores]
            points = np.concatenate([part.points for part in parts])
            blocks = np.concatenate([part.blocks for part in parts])
            rows = [i for i, _ in self._cores]
            for column, sizes in ((4, [len(p.points) for p in parts]), (5, [len(p.blocks) for p in parts])):
                self.solids[rows, column] = np.cumsum([0, *sizes[:-1]])
        self.struct = CStruct(
            "FixedSolids",
            count=total,
            solids=self.solids,
            shapes=np.frombuffer(b"".join([thing.rows.values for thing in things])).reshape(-1, 23),
            frames=np.frombuffer(b"".join([thing.frames for thing in things])).reshape(-1, 16),
            objects=np.array([thing.pose for thing in things]).reshape(-1, 16),
            points=points,
            blocks=blocks,
        )

    def add_bodies(self, bodies: BodyTables, links: int) -> tuple[BodyTables, MeshTree]:
        """Rows for the exact kernel after those of the arms, and the triangles of concave meshes.

        Args:
            bodies: Those of the arms.
            links: How many entries their chains have; what does not move has none.
        """
        first, total = len(bodies.bodies), len(bodies.bodies) + len(self.exact_kinds)
        rows, values = np.zeros((total, 6), np.int64), np.empty((total, 27))
        poses, centers = np.empty((total, 12)), np.empty((total, 3))
        rows[:first], values[:first], poses[:first], centers[:first] = (
            bodies.bodies,
            bodies.values,
            bodies.poses,
            bodies.centers,
        )
        rows[first:, 0], rows[first:, 4:] = self.exact_kinds, links
        self.place_bodies(values, poses, centers)
        corners, degrees, to = [bodies.corners], [bodies.degrees], [bodies.neighbors]
        meshes: list[MeshTree] = []
        count = len(bodies.corners)
        for i, shape in self.special:
            row = rows[first + i - self._before]
            if is_concave(shape):
                row[2] = len(meshes)
                meshes.append(mesh_tree(shape))
                continue
            own, (each, others) = body_core(shape).points, neighbors(shape)
            row[2:4] = count, count + len(own)
            corners.append(own)
            degrees.append(each)
            to.append(others + count)
            count += len(own)
        if len(corners) == 1:
            joined = bodies.corners, bodies.degrees, bodies.neighbors
        else:
            joined = np.concatenate(corners), np.concatenate(degrees), np.concatenate(to)
        return BodyTables(rows, values, *joined, poses, centers), joined_trees(meshes)

    def place_bodies(self, values: Array, poses: Array, centers: Array) -> None:
        """Write the rows of `body_values`, `poses` and `centers` of `ExactTables` of all that have some."""
        load_library().rr1_place_bodies(self.struct, values, poses, centers)

    def placed_shapes(self, places: _INTS, count: int) -> tuple[_INTS, Array, Array]:
        """The `obstacles`, `obstacle_values` and `boxes` of `EdgeTables`; places that nothing has are nowhere.

        Args:
            places: Where each solid is there, -1: it is not, shape (n,).
            count: How many places there are.
        """
        self.solids[:, 2] = places
        there = places >= 0
        kinds, values, boxes = np.zeros((count, 2), np.int64), np.zeros((count, 17)), np.empty((6, count))
        kinds[places[there]] = self.solids[there, 6:]
        boxes[:3], boxes[3:] = np.inf, -np.inf
        load_library().rr1_place_shapes(self.struct, values, boxes, count)
        return kinds, values, boxes

    def placed_cores(self, bodies: CoreTables, places: _INTS, count: int) -> tuple[CoreTables, _INTS]:
        """The cores of moving bodies followed by those of the obstacles, and `core_of` of `EdgeTables`.

        Args:
            bodies: The cores of moving bodies.
            places: See `placed_shapes`.
            count: See `placed_shapes`.
        """
        tables = bodies
        if self._cores:
            tables, (_, *before) = joined_cores([bodies, *(core for _, core in self._cores)])
            tables = tables._replace(
                values=tables.values.copy(), points=tables.points.copy(), blocks=tables.blocks.copy()
            )
            self.solids[[i for i, _ in self._cores], 3] = before
            load_library().rr1_place_cores(self.struct, tables.rows, tables.values, tables.points, tables.blocks)
        core_of = np.full(count, _CLOSED_FORM, np.int64)
        there = places >= 0
        core_of[places[there]] = self.solids[there, 3]
        return tables, core_of


def link_cores(instances: ArmInstances, bodies: CoreTables) -> tuple[CoreTables, _INTS]:
    """Cores of the arms' bodies and of links that no joint moves, and the `core` of each solid of these; cached."""
    return kept_in(instances.kept, "link cores", lambda: _link_cores(instances, bodies))


def _link_cores(instances: ArmInstances, bodies: CoreTables) -> tuple[CoreTables, _INTS]:
    if not any(fixed_links_of(geometry).rows.special for geometry in instances.geometries):
        # No core of such a link has corners that would have to be put in place.
        kinds = b"".join([fixed_links_of(geometry).rows.kinds for geometry in instances.geometries])
        return bodies, np.frombuffer(kinds, np.int64).reshape(-1, 4)[:, 3]
    links = FixedSolids(fixed_links(instances))
    count = len(links.solids)
    tables, _ = links.placed_cores(bodies, np.arange(count), count)
    return tables, links.solids[:, 3].copy()


def boxes_of(things: Sequence[ObstacleGeometry]) -> Array:
    """Low and high corner of the box around each solid of some objects [m], infinite for a half-space, shape (n, 6)."""
    fixed = FixedSolids(things)
    count = len(fixed.solids)
    return np.ascontiguousarray(fixed.placed_shapes(np.arange(count), count)[2].T)


def balls_of(things: Sequence[ObstacleGeometry]) -> Array:
    """A ball around each solid of some objects: center and radius [m], shape (n, 4)."""
    fixed = FixedSolids(things)
    count = len(fixed.solids)
    values, poses, centers = np.empty((count, 27)), np.empty((count, 12)), np.empty((count, 3))
    fixed.place_bodies(values, poses, centers)
    return np.column_stack([centers, values[:, 15]])


def fixed_links(instances: ArmInstances) -> tuple[ObstacleGeometry, ...]:
    """The solids of the arms that no joint moves, an object for each arm; cached."""
    return kept_in(instances.kept, "fixed links", lambda: _fixed_links(instances))


def _fixed_links(instances: ArmInstances) -> tuple[ObstacleGeometry, ...]:
    arms = zip(instances.geometries, instances.bases, strict=True)
    return tuple(replace(fixed_links_of(geometry), pose=base) for geometry, base in arms)


def fixed_links_of(geometry: ArmGeometry) -> ObstacleGeometry:
    """The solids of an arm that no joint moves, its base at the origin; cached."""
    return kept_in(geometry.kept, "fixed links", lambda: _fixed_links_of(geometry))


def _fixed_links_of(geometry: ArmGeometry) -> ObstacleGeometry:
    fixed = np.flatnonzero(geometry.groups == 0).tolist()
    # A joint that nothing drives may carry them.
    frames = b"".join([matrix(pose).tobytes() for pose in arm_tables(geometry).bodies.poses[fixed]])
    solids = [geometry.solids[i] for i in fixed]
    rows = solid_rows(tuple(solid.shape for solid in solids))
    return ObstacleGeometry([solid.element for solid in solids], rows, frames, np.eye(4))
