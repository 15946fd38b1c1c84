"""The configuration space of two joints on a grid: each obstacle's image, free space and its components.

`cspace_raster.py` computes the images. Components of free space are connected across the seams of the torus.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array, Value, finite_array, items_of, known_name, read_only, whole_number
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.playback.cspace.cspace_cells import Mask, label_components, shortest_way, widest_spot
from rr1plan.playback.cspace.cspace_raster import CSpaceRaster
from rr1plan.robot import Joint, Robot
from rr1plan.scene import Scene

LIMITS = "joint limits"
# Cells along each axis.
FEWEST_CELLS, MOST_CELLS = 8, 2000
# Half the width and half the height of a short name, as shares of the picture.
_HALF_NAME, _ROOM = 0.07, 0.02
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def joint_symbol(robot: Robot, name: str) -> str:
    """The symbol of a joint's variable, with the number of the joint in its arm: θ₁, or d₁ for a prismatic joint."""
    number = str(robot.joint_names.index(name) + 1).translate(_SUBSCRIPTS)
    return f"{'d' if robot.joint(name).kind == 'prismatic' else 'θ'}{number}"


@dataclass(frozen=True, eq=False, repr=False)
class CSpaceGrid(Value):
    """Configuration space of two joints, cell by cell; index [i, j] is (first joint, second joint).

    Args:
        scene: The scene, which fixes everything except the two joints.
        arm: The arm the joints belong to.
        joint_names: The two joints.
        axes: Values at the cell centers of each joint [rad or m], shapes (n,) and (m,).
        periodic: Whether each axis is a full turn whose ends are the same place.
        layers: For each obstacle (and "self-collision", "joint limits") the cells it blocks, shape (n, m).
        labels: Number of the component of free space of each cell, 0 if it is not free.
    """

    scene: Scene
    arm: str
    joint_names: tuple[str, str]
    axes: tuple[Array, Array]
    periodic: tuple[bool, bool]
    layers: Mapping[str, Mask]
    labels: NDArray[np.int32]

    def __repr__(self) -> str:
        cells = " x ".join(str(n) for n in self.labels.shape)
        return f"CSpaceGrid({self.scene.name!r}, {self.joint_names[0]} x {self.joint_names[1]}, {cells} cells)"

    @property
    def free(self) -> Mask:
        """The free cells, shape (n, m)."""
        return self.labels > 0

    @property
    def turns(self) -> tuple[bool, bool]:
        """Whether each joint is revolute; otherwise it is prismatic."""
        first, second = (self.scene.arms[self.arm].robot.joint(name).kind != "prismatic" for name in self.joint_names)
        return first, second

    @property
    def ranges(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lowest and highest value of each joint, at the edges of the outermost cells [rad or m]."""
        steps = [0.5 * float(centers[1] - centers[0]) for centers in self.axes]
        first, second = ((float(c[0]) - s, float(c[-1]) + s) for c, s in zip(self.axes, steps, strict=True))
        return first, second

    @property
    def components(self) -> int:
        """Number of components of free space on the grid."""
        return int(self.labels.max(initial=0))

    def cell(self, q: ArrayLike) -> tuple[int, int]:
        """Indices of the cell that contains a configuration, along the first and the second joint.

        Args:
            q: Values of the two joints [rad or m], shape (2,). Periodic joints are wrapped.

        Raises:
            InputError: not two finite numbers, or outside the picture.
        """
        pair = finite_array("q", q, (2,))
        i, j = (self._index(axis, float(value)) for axis, value in enumerate(pair))
        return i, j

    def _index(self, axis: int, value: float) -> int:
        centers = self.axes[axis]
        step = float(centers[1] - centers[0])
        index = int(np.floor((value - centers[0]) / step + 0.5))
        if self.periodic[axis]:
            return index % len(centers)
        # A joint at its limit is in the outermost cell, whatever the rounding.
        if index in (-1, len(centers)) and abs(value - centers).min() <= step * (0.5 + 1e-9):
            index = int(np.clip(index, 0, len(centers) - 1))
        if not 0 <= index < len(centers):
            raise InputError(f"{self.joint_names[axis]} = {value} is outside the picture")
        return index

    def wrapped(self, q: ArrayLike) -> Array:
        """A configuration without the whole turns of periodic joints, so that it is inside the picture, shape (2,).

        Args:
            q: Values of the two joints [rad or m], shape (2,).

        Raises:
            InputError: not two finite numbers, or outside the picture.
        """
        pair = np.array(finite_array("q", q, (2,)))
        self.cell(pair)
        for axis, centers in enumerate(self.axes):
            if self.periodic[axis]:
                low = 0.5 * (3.0 * centers[0] - centers[1])
                pair[axis] = low + (pair[axis] - low) % (2.0 * np.pi)
        return pair

    def holds(self, q: ArrayLike) -> bool:
        """Whether a configuration is inside the picture.

        Args:
            q: Values of the two joints [rad or m], shape (2,).

        Raises:
            InputError: not two finite numbers.
        """
        pair = finite_array("q", q, (2,))
        try:
            self.cell(pair)
        except InputError:
            return False
        return True

    def component_of(self, q: ArrayLike) -> int:
        """Number of the component of free space that contains a configuration, from 1; 0 if it is not free or outside.

        Args:
            q: Values of the two joints [rad or m], shape (2,).

        Raises:
            InputError: not two finite numbers.
        """
        return int(self.labels[self.cell(q)]) if self.holds(q) else 0

    def connected(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Whether two configurations are free and in the same component of free space on the grid.

        Args:
            a: Values of the two joints [rad or m], shape (2,).
            b: Other values.

        Raises:
            InputError: not two finite numbers.
        """
        first, second = self.component_of(a), self.component_of(b)
        return first > 0 and first == second

    def shortest_path(self, a: ArrayLike, b: ArrayLike) -> Array | None:
        """A shortest path over free cells (8 neighbors), unwrapped across the seams.

        Args:
            a: Start [rad or m], shape (2,).
            b: Goal [rad or m], shape (2,).

        Returns:
            Cell centers from the cell of a to that of b [rad or m], shape (k, 2), or None if there is no path.

        Raises:
            InputError: not two finite numbers.
        """
        if not self.connected(a, b):
            return None
        return self._unwrapped(shortest_way(self.free, self.periodic, self.cell(a), self.cell(b)))

    def _unwrapped(self, cells: list[tuple[int, int]]) -> Array:
        points = np.array([[self.axes[0][i], self.axes[1][j]] for i, j in cells])
        for axis in (0, 1):
            if self.periodic[axis]:
                points[:, axis] = np.unwrap(points[:, axis])
        return points


def whole_configurations(grid: CSpaceGrid, q: Array) -> Array:
    """Configurations of the arm, shape (..., nq), from values of the two joints, shape (..., 2)."""
    arm = grid.scene.arms[grid.arm]
    full = np.broadcast_to(arm.q, (*q.shape[:-1], arm.robot.nq)).copy()
    full[..., [arm.robot.joint_names.index(name) for name in grid.joint_names]] = q
    return full


def compute_grid(
    scene: Scene,
    arm: str | None = None,
    joints: Sequence[str] | None = None,
    resolution: int = 360,
    progress: Callable[[float], None] | None = None,
) -> CSpaceGrid:
    """The configuration space of two joints of an arm.

    Args:
        scene: The scene.
        arm: The arm (default: the only one).
        joints: Two of its planning joints (default: the first two).
        resolution: Cells along each axis.
        progress: Called with the fraction done, 0 to 1.

    Raises:
        UnknownNameError: no such arm or joint.
        InputError: fewer than two joints, the same joint twice, or a resolution outside 8 to 2000.
    """
    arm = scene.only_arm(arm)
    names = two_joints(scene, arm, joints)
    resolution = whole_number("resolution", resolution, FEWEST_CELLS, MOST_CELLS)
    columns = (scene.arms[arm].robot.joint_names.index(names[0]), scene.arms[arm].robot.joint_names.index(names[1]))
    robot, limits = scene.arms[arm].robot, scene.arms[arm].robot.limits
    spans = [(robot.joint(robot.joint_names[c]), float(limits.lower[c]), float(limits.upper[c])) for c in columns]
    axes, periodic, inside = zip(*(_axis(*span, resolution) for span in spans), strict=True)
    checker = CollisionChecker(scene, (arm,))
    layers = CSpaceRaster(checker, scene.arms[arm].q, columns, axes).images(progress)
    outside = ~(inside[0][:, None] & inside[1][None, :])
    if outside.any():
        layers[LIMITS] = outside
    blocked = np.zeros((resolution, resolution), dtype=bool)
    for mask in layers.values():
        blocked |= mask
        read_only(mask)
    labels = label_components(~blocked, (periodic[0], periodic[1]))
    return CSpaceGrid(scene, arm, names, (axes[0], axes[1]), (periodic[0], periodic[1]), layers, labels)


def two_joints(scene: Scene, arm: str, joints: Sequence[str] | None) -> tuple[str, str]:
    """The names of two planning joints of an arm (default: its first two).

    Raises:
        UnknownNameError: no such joint.
        InputError: not two different names, or an arm with one joint.
    """
    known = scene.arms[arm].robot.joint_names
    if joints is None:
        if len(known) < 2:
            raise InputError(f"arm {arm!r} has {len(known)} joint, a picture of its configuration space needs two")
        return known[0], known[1]
    names = [known_name("joint", name, known) for name in items_of("joints", joints, "two names")]
    if len(names) != 2 or names[0] == names[1]:
        raise InputError(f"the joints are {' and '.join(names) or 'none'}, expected two different ones")
    return names[0], names[1]


def _axis(joint: Joint, lower: float, upper: float, resolution: int) -> tuple[Array, bool, Mask]:
    """Cell centers, whether the axis is periodic, and which centers are within the limits.

    The axis of a revolute joint is the full turn around zero if the joint's limits lie within it and cover at least
    half of it; other axes are the range between the limits.
    """
    unlimited, slides = not np.isfinite(lower) or not np.isfinite(upper), joint.kind == "prismatic"
    if unlimited and slides:
        raise InputError(f"joint {joint.name!r} slides without limits, a picture needs limits")
    low, high = lower, upper
    nearly_all = upper - lower >= np.pi - 1e-9 and lower >= -np.pi - 1e-9 and upper <= np.pi + 1e-9
    if unlimited or (nearly_all and not slides):
        low, high = -np.pi, np.pi
    if not low < high:
        raise InputError(f"joint {joint.name!r} has one value, {low}, a picture needs a range")
    centers = low + (np.arange(resolution) + 0.5) * ((high - low) / resolution)
    return read_only(centers), unlimited, (centers >= lower) & (centers <= upper)


def name_spots(
    grid: CSpaceGrid, window: tuple[slice, slice] = (slice(None), slice(None))
) -> dict[str, tuple[float, float]]:
    """For each layer with room for its name, the configuration [rad] in the middle of its widest part.

    Args:
        grid: The grid.
        window: The cells to which the picture is cropped; only axes that are not periodic may be cropped.
    """
    layers = {name: mask[window] for name, mask in grid.layers.items()}
    first, second = grid.axes[0][window[0]], grid.axes[1][window[1]]
    n, m = len(first), len(second)
    count = sum((mask.astype(int) for mask in layers.values()), np.zeros((n, m), dtype=int))
    rim, room = (int(_HALF_NAME * n), int(_ROOM * m)), _ROOM * max(n, m)
    found = {name: widest_spot(mask & (count == 1), grid.periodic, rim) for name, mask in layers.items()}
    # The distance to a cell outside is half a cell longer than the one to the edge.
    return {name: (float(first[i]), float(second[j])) for name, (i, j, far) in found.items() if far - 0.5 > room}
