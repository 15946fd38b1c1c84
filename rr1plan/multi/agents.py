"""Agents of a problem: one arm, or a few arms that move as one (a meta-agent)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.collision.arm_geometry import ArmGeometry, ArmInstances, arm_instances
from rr1plan.collision.collision_geometry import geometries_of
from rr1plan.collision.convex.enclosing_ball import enclosing_ball
from rr1plan.collision.tables.arm_tables import arm_tables
from rr1plan.collision.tables.exact_tables import arm_exact_struct, arm_exact_tables, exact_scratch
from rr1plan.kernels.planner_kernels import CStruct
from rr1plan.model import Kinematics
from rr1plan.multi.paths.hop_timing import BLENDED, HopTiming
from rr1plan.object_cache import kept_in
from rr1plan.retiming.check_limits import check_limits
from rr1plan.retiming.path_blends import clean
from rr1plan.retiming.torque_limits import InverseDynamics
from rr1plan.robot.joint_limits import Limits
from rr1plan.scene import Scene
from rr1plan.scene.problem import JointGoal, Problem, subproblem
from rr1plan.scene.subscene import subscene


class AgentBodies:
    """The bodies of some arms, grouped by the joint that carries them; obstacles are not included.

    Args:
        scene: The scene.
        arms: The arms, in its order.

    Attributes:
        elements: Name of the element to which each body belongs.
        columns: Number of joints of the arms.
        tables: The bodies as the exact kernel's tables.
        exact: The same as a kernel struct.
        group_rows: Joint, first body and end (exclusive) of each group, shape (g, 3).
        group_balls: Enclosing ball of each group, in the frame of its joint: center and radius [m], shape (g, 4).
        is_fixed: Whether no joint moves a body, shape (b,).
        layout: Key of tables that depend only on the groups and on which bodies are fixed.
    """

    def __init__(self, scene: Scene, arms: tuple[str, ...]) -> None:
        geometries = geometries_of(scene, arms)
        instances = arm_instances(tuple(geometries.values()), tuple([scene.arms[name].base.tobytes() for name in arms]))
        self.elements = tuple(element for name, geometry in geometries.items() for element in geometry.elements(name))
        self.columns = sum(scene.arms[name].robot.nq for name in arms)
        self.tables, self.exact = arm_exact_tables(instances), arm_exact_struct(instances)
        groups = [kept_in(one.kept, "groups of bodies", partial(_body_groups, one)) for one in geometries.values()]
        self.is_fixed = np.concatenate([group.is_fixed for group in groups])
        self.group_rows, self.group_balls = _placed_groups(groups, instances)
        self.layout = self.group_rows.tobytes(), self.is_fixed.tobytes()
        self._travel = [scene.arms[name].robot.limits.travel for name in arms]

    @cached_property
    def reach(self) -> Array:
        """Largest displacement of any point of the arms per change of each joint [m/rad, or m/m], shape (nq,)."""
        reach, travel = np.zeros(self.columns), np.concatenate(self._travel)
        for body in range(len(self.tables.bodies)):
            for column, lever in self.tables.levers(body, travel):
                reach[column] = max(reach[column], lever)
        return reach

    def scratch(self) -> CStruct:
        """Memory for the placed bodies, for one thread."""
        return exact_scratch(self.tables, self.columns)


class _BodyGroups(NamedTuple):
    """The groups of bodies of one arm, its base at the origin; see `AgentBodies`."""

    rows: NDArray[np.int64]
    balls: Array
    is_fixed: NDArray[np.bool_]


def _body_groups(geometry: ArmGeometry) -> _BodyGroups:
    bodies = arm_tables(geometry).bodies
    joint, balls = bodies.bodies[:, 1], bodies.values[:, 12:16]
    begins = np.flatnonzero(np.diff(joint, prepend=-1))
    ends = np.append(begins, len(joint))[1:]
    around = [enclosing_ball(balls[a:b]) for a, b in zip(begins, ends, strict=True)]
    return _BodyGroups(
        np.column_stack([joint[begins], begins, ends]).astype(np.int64),
        np.array(around).reshape(-1, 4),
        bodies.bodies[:, 4] == bodies.bodies[:, 5],
    )


def _placed_groups(groups: Sequence[_BodyGroups], instances: ArmInstances) -> tuple[NDArray[np.int64], Array]:
    """The `group_rows` and `group_balls` of several arms."""
    rows, balls, first = [np.zeros((0, 3), np.int64)], [np.zeros((0, 4))], 0
    for group, base, joint in zip(groups, instances.bases, instances.first_joint.tolist(), strict=True):
        fixed = group.rows[:, 0] == 0
        rows.append(group.rows + np.array([joint, first, first]))
        rows[-1][fixed, 0] = 0
        balls.append(group.balls.copy())
        balls[-1][fixed, :3] = balls[-1][fixed, :3] @ base[:3, :3].T + base[:3, 3]
        first += len(group.is_fixed)
    return np.concatenate(rows), np.concatenate(balls)


def _bodies(scene: Scene, arms: tuple[str, ...]) -> AgentBodies:
    """The bodies of some arms of a scene, created once."""
    return kept_in(scene.kept_for_any_padding, ("bodies of agents", arms), lambda: AgentBodies(scene, arms))


class Agent:
    """One arm, or a few that move as one.

    Args:
        problem: The problem that it belongs to.
        arms: Its arms.
        timing: Retiming of its motions.

    Attributes:
        arms: Its arms, in the order of the scene.
        start: Start configuration of all its joints, shape (nq,).
        columns: Columns of each arm among its joints.
    """

    def __init__(self, problem: Problem, arms: Iterable[str], timing: HopTiming = BLENDED) -> None:
        chosen = frozenset(arms)
        self.problem, self.timing = problem, timing
        self.arms = tuple(name for name in problem.arms if name in chosen)
        starts = [problem.start[problem.columns[name]] for name in self.arms]
        self.start = np.concatenate(starts)
        ends = np.cumsum([len(q) for q in starts]).tolist()
        self.columns = {name: slice(a, b) for name, a, b in zip(self.arms, [0, *ends], ends, strict=False)}

    def __repr__(self) -> str:
        return f"Agent({', '.join(self.arms)})"

    def __getstate__(self) -> dict[str, object]:
        """All attributes except the cached ones that hold kernel memory."""
        return {name: value for name, value in self.__dict__.items() if name not in ("bodies", "_alone")}

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names "arm/joint" of its joints."""
        return self.problem.scene.joint_names(self.arms)

    @cached_property
    def limits(self) -> Limits:
        """Limits of its joints."""
        return self.problem.scene.limits(self.arms)

    @cached_property
    def bodies(self) -> AgentBodies:
        """The bodies of its arms."""
        return _bodies(self.problem.scene, self.arms)

    @cached_property
    def reach(self) -> Array:
        """Largest displacement of any point of its arms per change of each joint [m/rad, or m/m], shape (nq,)."""
        return np.concatenate([_bodies(self.problem.scene, (arm,)).reach for arm in self.arms])

    @cached_property
    def inverse_dynamics(self) -> InverseDynamics:
        """Torques of its joints [Nm]."""
        return Kinematics(self.among({}), self.arms).inverse_dynamics

    def split(self, q: Array) -> dict[str, Array]:
        """The configuration of each of its arms: parts of q, shape (nq,)."""
        return {name: q[columns] for name, columns in self.columns.items()}

    def to(self, goal: Array) -> Agent:
        """The same arms with another goal configuration, shape (nq,)."""
        problem = self.problem
        starts = {name: problem.start[columns] for name, columns in problem.columns.items()}
        goals = {**problem.goal, **{name: (JointGoal(q),) for name, q in self.split(goal).items()}}
        return Agent(Problem(problem.scene, starts, goals, arms=problem.arms), self.arms, self.timing)

    def check_limits(self, points: Array) -> None:
        """Check that the joints that move between waypoints (n, nq) have the limits that the timing needs.

        Raises:
            RetimingError: a moving joint without a limit.
        """
        check_limits(self.joint_names, clean(points), self.limits, jerk=self.timing.method == "ruckig")

    @property
    def unlimited_joints(self) -> tuple[str, ...]:
        """Joints that cannot move, because a limit that the timing needs is missing."""
        limits = self.limits
        needed = [limits.velocity, limits.acceleration, *([limits.jerk] if self.timing.method == "ruckig" else [])]
        return tuple(name for name, *most in zip(self.joint_names, *needed, strict=True) if not np.isfinite(most).all())

    def among(self, others: Mapping[str, Array | None]) -> Scene:
        """The scene of these arms, the arms that the problem does not move, and `others` in their configurations."""
        scene, moving = self.problem.scene, set(self.problem.arms)
        still: dict[str, Array | None] = {name: None for name in scene.arms if name not in moving}
        return subscene(scene, {**still, **others, **self.split(self.start)})

    def release(self) -> None:
        """Free the collision tables of its scene; they are rebuilt on demand."""
        self.__dict__.pop("_alone", None)

    @cached_property
    def _alone(self) -> Problem:
        """The query without other moving arms, cached together with the tables of its scene."""
        return self._query_among({})

    def query(self, others: Mapping[str, Array | None], margin: float) -> Problem:
        """The problem of these arms while `others` are stationary.

        Args:
            others: Configurations of moving arms of the problem, shape (nq,); moving arms not named here are ignored.
            margin: Distance to keep in addition to the padding [m].
        """
        return (self._query_among(others) if others else self._alone).with_margin(margin)

    def _query_among(self, others: Mapping[str, Array | None]) -> Problem:
        return subproblem(self.problem, self.arms, self.among(others))
