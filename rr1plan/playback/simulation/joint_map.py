"""The movable joints of a scene, independent and mimicking, and the set-points of all of them for a motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, known_name
from rr1plan.errors import InputError
from rr1plan.robot.robot import independent_joint
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory


class JointMap:
    """The movable joints of all arms of a scene: planned, locked and mimicking ones.

    Args:
        scene: The scene.

    Attributes:
        names: "arm/joint" of each, in the order of the arms and of their descriptions.
        index: Index of each name.
        slides: Whether each is prismatic.
        followers: For each mimicking joint, the independent joint that it follows.
        lower, upper: Position limits [rad or m], shape (n,).
        velocity: Highest speeds [rad/s or m/s], shape (n,).
        effort: Largest efforts [Nm or N], shape (n,).
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        movable = [(a, j) for a, arm in scene.arms.items() for j in arm.robot.limited_joints if j.kind != "fixed"]
        self.names = tuple(f"{a}/{j.name}" for a, j in movable)
        self.index = {name: i for i, name in enumerate(self.names)}
        self.slides = tuple(j.kind == "prismatic" for _, j in movable)
        self.lower = np.array([j.lower for _, j in movable])
        self.upper = np.array([j.upper for _, j in movable])
        self.velocity = np.array([j.velocity for _, j in movable])
        self.effort = np.array([j.effort for _, j in movable])
        self.followers: dict[str, str] = {}
        self._source: NDArray[np.int64] = np.arange(len(movable))
        self._factor, self._offset = np.ones(len(movable)), np.zeros(len(movable))
        for row, (arm, joint) in enumerate(movable):
            source, factor, offset = independent_joint(scene.arms[arm].robot, joint)
            if source.name != joint.name:
                self.followers[self.names[row]] = f"{arm}/{source.name}"
            self._source[row] = self.index[f"{arm}/{source.name}"]
            self._factor[row], self._offset[row] = factor, offset
        following = self.indices(tuple(self.followers))
        self._following, self._followed = following, self._source[following]
        self._followed_factor, self._followed_offset = self._factor[following], self._offset[following]

    def indices(self, names: Sequence[str]) -> NDArray[np.int64]:
        """Indices of some joints, shape (n,).

        Raises:
            UnknownNameError: an unknown joint.
        """
        return np.array([self.index[known_name("joint", name, self.index)] for name in names], dtype=np.int64)

    def follow(self, values: Array, *, rates: bool = False) -> Array:
        """Values of all joints, where mimicking joints are computed from the joints that they follow.

        Args:
            values: Positions of all joints, or their rates, shape (..., n).
            rates: Whether they are rates, to which offsets do not apply.
        """
        followed = values[..., self._source] * self._factor
        return np.asarray(followed if rates else followed + self._offset)

    def leads(self, indices: NDArray[np.int64]) -> bool:
        """Whether other joints mimic any of these."""
        return not set(self._followed.tolist()).isdisjoint(indices.tolist())

    def follow_all(self, rows: Array) -> None:
        """Update positions, velocities and accelerations of mimicking joints in place.

        Args:
            rows: Positions, velocities, accelerations and efforts of all joints, shape (..., 4, n).
        """
        for k in range(3):
            values = rows[..., k, self._followed] * self._followed_factor
            rows[..., k, self._following] = values + self._followed_offset if k == 0 else values

    def expand(self, q: Array) -> Array:
        """Positions of all joints when the planning joints of all arms are at q (nq,); locked joints stay locked."""
        split = self._scene.split(q)
        values = {name: arm.robot.joint_values(split[name]) for name, arm in self._scene.arms.items()}
        return np.array([values[arm][joint] for arm, joint in (name.split("/", 1) for name in self.names)])


class JointTargets:
    """Set-points of all movable joints of a scene: planned, locked, mimic and stationary ones.

    Args:
        trajectory: The motion of some arms.
        scene: The scene.

    Attributes:
        trajectory: The motion.
        names: "arm/joint" of the movable joints.
        columns: Index of each joint of the trajectory among them.

    Raises:
        UnknownNameError: a column of the trajectory is not a joint of the scene.
        InputError: only some joints of an arm have columns.
    """

    def __init__(self, trajectory: Trajectory, scene: Scene) -> None:
        known = scene.joint_names() if scene.arms else ()
        for name in trajectory.joint_names:
            known_name("joint", name, known)
        missing = [n for a in trajectory.arms for n in scene.joint_names([a]) if n not in trajectory.joint_names]
        if missing:
            raise InputError(f"the trajectory moves {', '.join(trajectory.arms)} but has no column for {missing[0]!r}")
        self.trajectory = trajectory
        self._map = JointMap(scene)
        self.names = self._map.names
        self._rest = self._map.expand(scene.configuration() if scene.arms else np.zeros(0))
        self.columns = self._map.indices(trajectory.joint_names)

    def __call__(self, times: Array, derivative: int = 0) -> Array:
        """Positions (or rates) of all movable joints at `times`, shape (n, joints)."""
        values = np.zeros((len(times), len(self.names)))
        if derivative == 0:
            values[:] = self._rest
        values[:, self.columns] = self.trajectory(times, derivative)
        return self._map.follow(values, rates=derivative > 0)
