"""The schema of motion, trajectory and path files: every entry, its type and its bounds.

A document is converted to these structures first, so that errors about a value of another type, an
unknown key or a number out of bounds name the entry. Constraints between entries (a
joint that names a link, a face that names a vertex) are checked by the constructors of the values.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct, field

VERSION = 2

Text = Annotated[str, Meta(max_length=100_000)]
Name = Annotated[str, Meta(min_length=1, max_length=1000)]
Digest = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]
Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Index = Annotated[int, Meta(ge=0, lt=2**31)]
# JSON has no infinity.
Bound = float | Literal["inf", "-inf"]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Row = tuple[float, float, float, float]
Pose = tuple[Row, Row, Row, Row]
Pair = tuple[Name, Name]
Unit = Literal["rad", "m"]


class Entry(Struct, forbid_unknown_fields=True):
    """A table of a document; a key that it does not have is an error."""


# ---- shapes --------------------------------------------------------------------------------


class Tagged(Entry, tag_field="type"):
    """One of several kinds of entry, distinguished by its `type`."""


class Box(Tagged, tag="box"):
    size: Vector


class Sphere(Tagged, tag="sphere"):
    radius: Positive


class Cylinder(Tagged, tag="cylinder"):
    radius: Positive
    length: Positive


class Capsule(Tagged, tag="capsule"):
    radius: Positive
    length: Positive


class HalfSpace(Tagged, tag="half_space"):
    normal: Vector
    offset: float


class Mesh(Tagged, tag="mesh"):
    vertices: list[Vector]
    faces: list[tuple[Index, Index, Index]]
    convex: bool


class PointCloud(Tagged, tag="points"):
    points: list[Vector]
    resolution: Positive


class Stored(Tagged, tag="stored"):
    """A mesh or point cloud whose numbers are in a file next to the document, named by their hash."""

    sha256: Digest


Shape = Box | Sphere | Cylinder | Capsule | HalfSpace | Mesh | PointCloud | Stored


class Geometry(Entry):
    name: Text
    shape: Shape
    pose: Pose
    color: tuple[Share, Share, Share, Share] | None


# ---- robots --------------------------------------------------------------------------------


class Inertial(Entry):
    mass: Positive
    com: Vector
    inertia: tuple[Vector, Vector, Vector]
    assumed: bool = False


class Link(Entry):
    name: Name
    inertial: Inertial | None
    visuals: list[Geometry]
    collisions: list[Geometry]


class Mimic(Entry):
    joint: Name
    multiplier: float
    offset: float


class Joint(Entry):
    name: Name
    kind: Literal["revolute", "continuous", "prismatic", "fixed"]
    parent: Name
    child: Name
    origin: Pose
    axis: Vector
    lower: Bound
    upper: Bound
    velocity: Bound
    effort: Bound
    damping: NotNegative
    friction: NotNegative
    mimic: Mimic | None
    acceleration: Bound = "inf"
    jerk: Bound = "inf"


class Limits(Entry):
    lower: list[Bound]
    upper: list[Bound]
    velocity: list[Bound]
    acceleration: list[Bound]
    jerk: list[Bound]
    effort: list[Bound]


class Robot(Entry):
    """A robot; some keys of the format are older than the names of the attributes."""

    name: Name
    links: Annotated[list[Link], Meta(min_length=1)]
    joints: list[Joint]
    joint_names: Annotated[list[Name], Meta(min_length=1)]
    limits: Limits
    configurations: dict[Name, list[float]]
    locked_joints: dict[Name, float] = field(name="held")
    disabled_collisions: list[Pair] = field(name="never_collide")
    tool: Name
    presets: dict[Name, Limits]
    locked_joint_states: dict[Name, dict[Name, float]] = field(name="named_held")
    source: Text


# ---- scenes --------------------------------------------------------------------------------


class Arm(Entry):
    """An arm; `robot` is the index of its robot in the document's list."""

    name: Name
    robot: Index
    base: Pose
    q: list[float]


class Obstacle(Entry):
    name: Name
    geometries: Annotated[list[Geometry], Meta(min_length=1)]
    pose: Pose
    mass: Positive | None = None
    friction: NotNegative = 1.0


class Attachment(Entry):
    name: Name
    geometries: Annotated[list[Geometry], Meta(min_length=1)]
    arm: Name
    link: Name
    pose: Pose
    touch: list[Name]
    mass: Positive | None = None
    friction: NotNegative = 1.0


class PairPadding(Entry):
    between: Pair
    distance: NotNegative


class Scene(Entry):
    name: Text
    description: Text
    arms: list[Arm]
    obstacles: list[Obstacle]
    attachments: list[Attachment]
    allowed: list[Pair]
    padding: NotNegative
    pair_padding: list[PairPadding]


# ---- problems ------------------------------------------------------------------------------


class JointGoal(Tagged, tag="joints"):
    q: list[float]


class PoseGoal(Tagged, tag="pose"):
    frame: Name
    position: Vector
    quaternion: Quaternion | None
    position_tolerance: Positive
    orientation_tolerance: Positive


class RegionGoal(Tagged, tag="region"):
    frame: Name
    lower: Vector
    upper: Vector
    quaternion: Quaternion | None
    orientation_tolerance: Positive


class Problem(Entry):
    start: list[float]
    goal: dict[Name, Annotated[list[JointGoal | PoseGoal | RegionGoal], Meta(min_length=1)]]
    arms: Annotated[list[Name], Meta(min_length=1)]
    margin: NotNegative = 0.0


# ---- plan graphs ---------------------------------------------------------------------------


class RouteCurve(Entry):
    lengths: list[Positive]
    coefficients: list[Annotated[list[list[float]], Meta(min_length=3, max_length=3)]]


class RouteGrid(Entry):
    piece: list[Index]
    offset: list[float]
    delta: list[Positive]


class RouteSteps(Entry):
    """The steps of a route; `times` are those of all but the first."""

    begins: Annotated[list[Index], Meta(min_length=1)]
    ends: Annotated[list[Index], Meta(min_length=1)]
    times: list[float]


class Route(Entry):
    """The route of an agent."""

    joint_names: Annotated[list[Name], Meta(min_length=1)]
    start: list[float]
    curve: RouteCurve
    grid: RouteGrid
    stops: list[Index]
    steps: RouteSteps


class Dependency(Entry):
    agent: Index
    step: Index
    after_agent: Index
    after_step: Index


class PlanGraph(Entry):
    routes: list[Route]
    dependencies: list[Dependency]
    retiming: str = "blend"
    torque_limits: bool = False


# ---- sequences -----------------------------------------------------------------------------


class Attach(Entry):
    obstacle: Name
    arm: Name
    link: Name
    touch: list[Name]


class SequenceStage(Entry):
    """The times of a segment of a sequence, its allowed contacts, and what it attaches or detaches."""

    label: Text
    begin: float
    end: float
    allowed: list[Pair]
    attach: Attach | None = None
    detach: Name | None = None


class Sequence(Entry):
    """The stages of a motion, and the planning joints that belong to grippers, by arm."""

    stages: Annotated[list[SequenceStage], Meta(min_length=1)]
    gripper_joints: dict[Name, list[Name]]


# ---- documents -----------------------------------------------------------------------------


class RobotReference(Entry):
    robot: Name
    sha256: Digest


class SceneReference(Entry):
    """The scene a document was made for, and the robot of each arm, by their content hashes."""

    scene: Text
    sha256: Digest
    arms: dict[Name, RobotReference]


class Path(Entry):
    joint_names: list[Name]
    units: list[Unit]
    waypoints: Annotated[list[list[float]], Meta(min_length=1)]


class Trajectory(Entry):
    joint_names: list[Name]
    units: list[Unit]
    time_unit: Literal["s"]
    breaks: Annotated[list[float], Meta(min_length=1)]
    coefficients: Annotated[list[list[list[float]]], Meta(min_length=1)]


class Document(Entry, kw_only=True):
    """Common entries of all documents; paths and trajectories of earlier versions do not contain their scene."""

    made_for: SceneReference
    robots: list[Robot] = []
    scene: Scene | None = None


class PathDocument(Document, kw_only=True):
    path: Path


class TrajectoryDocument(Document, kw_only=True):
    trajectory: Trajectory


class MotionDocument(Document, kw_only=True):
    """A whole motion; the report is checked by `Report.from_dict`, which names the place in it."""

    robots: list[Robot]
    scene: Scene
    path: Path | None = None
    trajectory: Trajectory | None = None
    report: dict[str, Any] | None = None
    problem: Problem | None = None
    plan_graph: PlanGraph | None = None


class SequenceDocument(Document, kw_only=True):
    """A planned sequence; the report is checked like that of a motion."""

    robots: list[Robot]
    scene: Scene
    trajectory: Trajectory
    sequence: Sequence
    report: dict[str, Any] | None = None


DOCUMENTS: dict[str, type[Document]] = {
    "path": PathDocument,
    "trajectory": TrajectoryDocument,
    "motion": MotionDocument,
    "sequence": SequenceDocument,
}
