"""The tables of solids that do not move: described as rows, and placed by compiled code (`place_solids.c`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.arm_geometry import ArmGeometry, ArmInstances
from rr1plan.collision.convex.convex_bodies import is_concave
from rr1plan.collision.convex.convex_cores import CoreTables, joined_cores, shape_core
from rr1plan.collision.convex.mesh_trees import NO_MESHES, MeshTree, joined_trees, mesh_tree
from rr1plan.collision.obstacle_geometry import ObstacleGeometry, one_object
from rr1plan.collision.tables.arm_tables import arm_tables
from rr1plan.collision.tables.body_tables import BodyTables, body_core, describe_solids, neighbors
from rr1plan.kernels.planner_kernels import CStruct, constants, load_library
from rr1plan.object_cache import kept_in
from rr1plan.shapes import Mesh, Shape

_INTS = NDArray[np.int64]
LANES = constants()["LANES"]
_CORE_MESH, _CORE_LEFT_OUT = constants()["CORE_MESH"], constants()["CORE_LEFT_OUT"]
# Meshes with more corners are left to the exact kernel, which walks along edges instead of testing all corners.
_MOST_POINTS = 2000


class FixedSolids:
    """Solids of objects that do not move, as in `fixed_solids.h`.

    Args:
        objects: The objects.
        first_body: Row of the first solid in the exact kernel's tables.
        links: Links of moving arms, which come first: their rows and cores are with the arms'.

    Attributes:
        count: Number of solids.
        struct: All solids as a C struct.
    """

    def __init__(self, objects: ObstacleGeometry, first_body: int = 0, links: FixedSolids | None = None) -> None:
        self._links: int = 0 if links is None else links.count
        self.count: int = self._links + len(objects.shapes)
        self._exact_kinds = objects.kinds
        self.struct: CStruct
        given = objects.sizes, objects.frames, objects.counts, objects.poses
        self.struct, special = describe_solids(*given, first_body, None if links is None else links.struct)
        # Meshes and point clouds by their number among all solids, except links; and those with cores.
        self._special: list[tuple[int, Shape]] = []
        self._cores: list[tuple[int, CoreTables]] = []
        if special:
            self._describe_special(objects.shapes)

    @property
    def solids(self) -> _INTS:
        """A `FixedSolid` for each, shape (n, 8)."""
        return np.asarray(self.struct.part("solids").view(np.int64))

    def fit(self, objects: ObstacleGeometry) -> bool:
        """Whether other objects can replace these: same kinds of solids, and equal shapes where these have tables."""
        return np.array_equal(objects.kinds, self._exact_kinds) and all(
            objects.shapes[i - self._links] == shape for i, shape in self._special
        )

    def replace(self, objects: ObstacleGeometry, tables: tuple[int, int]) -> None:
        """Replace the objects by others that `fit`.

        Args:
            objects: The objects.
            tables: Addresses of the `SceneTables` and the `Scratch` that contain these solids.
        """
        first = self.struct.value.object_count - len(objects.counts)
        replace = load_library().rr1_replace_solids
        replace(*tables, self._links, first, objects.sizes, objects.frames, objects.poses)

    def _describe_special(self, shapes: Sequence[Shape]) -> None:
        """Describe meshes and point clouds: write their rows of `SolidShape`, their kinds of cores, and the cores."""
        solids, rows = self.solids, self.struct.part("shapes").view(np.float64)
        for number in np.flatnonzero(solids[self._links :, 3] == _CORE_LEFT_OUT).tolist():
            shape, i = shapes[number], self._links + number
            exact = body_core(shape)
            rows[i, :15] = *exact.ball, *exact.values
            self._special.append((i, shape))
            if is_concave(shape):
                solids[i, 3] = _CORE_MESH
            elif isinstance(shape, Mesh) and len(shape.vertices) <= _MOST_POINTS:
                solids[i, 3], rows[i, 19:] = 0, shape_core(shape).values[0, [0, 1, 2, 4]]
                self._cores.append((i, shape_core(shape)))
        if not self._cores:
            return
        numbers, parts = [i for i, _ in self._cores], [core for _, core in self._cores]
        solids[numbers, 4] = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
        solids[numbers, 5] = np.cumsum([0, *(len(part.blocks) for part in parts[:-1])])
        self.struct.set(
            points=np.concatenate([part.points for part in parts]),
            blocks=np.concatenate([part.blocks for part in parts]),
        )

    def add_bodies(self, bodies: BodyTables, links: int) -> tuple[BodyTables, MeshTree]:
        """Rows for the exact kernel after those of the arms, and the triangles of concave meshes.

        Args:
            bodies: Bodies of the arms.
            links: Number of entries in their chains; fixed bodies have none.
        """
        first, total = len(bodies.bodies), len(bodies.bodies) + len(self._exact_kinds)
        rows, values = np.zeros((total, 6), np.int64), np.empty((total, 27))
        poses, centers = np.empty((total, 12)), np.empty((total, 3))
        rows[:first], values[:first] = bodies.bodies, bodies.values
        poses[:first], centers[:first] = bodies.poses, bodies.centers
        rows[first:, 0], rows[first:, 4:] = self._exact_kinds, links
        self.place_bodies(values, poses, centers)
        if not self._special:
            return bodies._replace(bodies=rows, values=values, poses=poses, centers=centers), NO_MESHES
        corners, degrees, to = [bodies.corners], [bodies.degrees], [bodies.neighbors]
        meshes: list[MeshTree] = []
        count = len(bodies.corners)
        for i, shape in self._special:
            row = rows[first + i - self._links]
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
        joined = np.concatenate(corners), np.concatenate(degrees), np.concatenate(to)
        return BodyTables(rows, values, *joined, poses, centers), joined_trees(meshes)

    def place_bodies(self, values: Array, poses: Array, centers: Array) -> None:
        """Write the rows of fixed bodies in `body_values`, `poses` and `centers` of `ExactTables`."""
        load_library().rr1_place_bodies(self.struct, values, poses, centers)

    def place_cores(self, bodies: CoreTables, links: _INTS | None = None) -> CoreTables:
        """The cores of the arms' bodies followed by those of these solids.

        Args:
            bodies: The cores of the arms' bodies.
            links: The `core` of each solid that is a link (default: no links).
        """
        if links is not None and self._links:
            self.solids[: self._links, 3] = links
        if not self._cores:
            return bodies
        tables, (_, *before) = joined_cores([bodies, *(core for _, core in self._cores)])
        tables = tables._replace(values=tables.values.copy(), points=tables.points.copy(), blocks=tables.blocks.copy())
        self.solids[[i for i, _ in self._cores], 3] = before
        load_library().rr1_place_cores(self.struct, tables.rows, tables.values, tables.points, tables.blocks)
        return tables

    def place_obstacles(self, rows: _INTS, count: int) -> tuple[CStruct, float]:
        """The solids as obstacles, placed after their cores, and a bound of the rounding error of gaps to them [m].

        Args:
            rows: Row of each solid in the tables, -1: none, shape (n,). Other rows are empty.
            count: Number of rows.

        Returns:
            Their `ObstacleTables`.
        """
        tables = CStruct("ObstacleTables", count=count)
        tables.give_room(unset=True, kinds=count, shapes=count, boxes=6 * count, core=count)
        at = tables.value
        place = load_library().rr1_place_obstacles
        return tables, place(self.struct, rows, count, at.kinds, at.shapes, at.boxes, at.core)


def boxes_of(objects: ObstacleGeometry) -> Array:
    """Low and high corner of the box around each solid of some objects [m], infinite for a half-space, shape (n, 6)."""
    fixed = FixedSolids(objects)
    boxes = fixed.place_obstacles(np.arange(fixed.count), fixed.count)[0].part("boxes")
    return np.ascontiguousarray(boxes.reshape(6, -1).T)


def balls_of(objects: ObstacleGeometry) -> Array:
    """A ball around each solid of some objects: center and radius [m], shape (n, 4)."""
    fixed = FixedSolids(objects)
    count = fixed.count
    values, poses, centers = np.empty((count, 27)), np.empty((count, 12)), np.empty((count, 3))
    fixed.place_bodies(values, poses, centers)
    return np.column_stack([centers, values[:, 15]])


def fixed_links(instances: ArmInstances) -> FixedSolids:
    """The solids of the arms that no joint moves, one object for each arm; cached."""

    def make() -> FixedSolids:
        arms = zip(instances.geometries, instances.bases, strict=True)
        return FixedSolids(ObstacleGeometry.joined([fixed_links_of(geometry).at(base) for geometry, base in arms]))

    return kept_in(instances.kept, "fixed links", make)


def fixed_links_of(geometry: ArmGeometry) -> ObstacleGeometry:
    """The solids of an arm that no joint moves, its base at the origin; cached."""
    return kept_in(geometry.kept, "fixed links", lambda: _fixed_links_of(geometry))


def _fixed_links_of(geometry: ArmGeometry) -> ObstacleGeometry:
    fixed = np.flatnonzero(geometry.groups == 0).tolist()
    # A joint that is not driven may carry them.
    poses, frames = arm_tables(geometry).bodies.poses[fixed], np.tile(np.eye(4), (len(fixed), 1, 1))
    frames[:, :3, :3], frames[:, :3, 3] = poses[:, :9].reshape(-1, 3, 3), poses[:, 9:]
    solids = [geometry.solids[i] for i in fixed]
    return one_object([s.element for s in solids], [s.shape for s in solids], frames.tobytes())
