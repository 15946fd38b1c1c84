"""The public names: all load, their types are public too, and importing the package loads nothing heavy."""

import ast
import dataclasses
import enum
import inspect
import re
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path

import pytest

import rr1plan


@pytest.mark.parametrize("name", sorted(set(rr1plan.__all__)))
def test_every_public_name_loads(name: str) -> None:
    assert getattr(rr1plan, name) is not None
    assert name in dir(rr1plan)


def test_typed_imports_are_the_lazy_names() -> None:
    tree = ast.parse(Path(rr1plan.__file__).read_text())
    block = next(n for n in tree.body if isinstance(n, ast.If))
    typed = {alias.asname for node in ast.walk(block) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert typed | {"__version__"} == set(rr1plan.__all__)


def test_a_name_has_one_home() -> None:
    """Public names are in `rr1plan` itself, not also in a subpackage."""
    assert [name for name in rr1plan.__all__ if inspect.ismodule(getattr(rr1plan, name))] == ["transforms"]
    assert "rr1plan.playback" not in rr1plan._EXPORTS
    assert list(rr1plan._EXPORTS) == sorted(rr1plan._EXPORTS)


def test_the_overview_in_the_help_lists_public_names() -> None:
    rows = re.findall(r"^    [a-z]+(?: [a-z]+)?  +(.*)$", rr1plan.__doc__ or "", re.MULTILINE)
    names = [name for row in rows for name in row.split(", ")]
    assert len(names) > 50
    assert set(names) <= set(rr1plan.__all__)
    assert len(set(names)) == len(names)


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'plam_motion'"):
        _ = rr1plan.plam_motion


def test_import_loads_nothing_heavy() -> None:
    heavy = "pinocchio coal ompl mujoco meshcat toppra ruckig numba scipy matplotlib trimesh coacd tornado rich"
    assert loaded("import rr1plan", heavy) == []


def test_a_plan_loads_no_more_than_it_needs() -> None:
    others = "ompl mujoco meshcat toppra ruckig scipy matplotlib trimesh coacd tornado rich"
    code = """
import rr1plan as rp
problem = next(iter(rp.load_problems("rr1_table").values()))
assert rp.plan_motion(problem, rng=0).report.valid
"""
    assert loaded(code, others) == []


def loaded(code: str, packages: str) -> list[str]:
    """Those of some packages that a program loads in a new process."""
    script = f"{code}\nimport sys\nprint(*[name for name in {packages!r}.split() if name in sys.modules])"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()


# ---- signatures ---------------------------------------------------------------------------------


def public_callables() -> Iterator[tuple[str, typing.Any]]:
    """Functions, constructors, methods and properties by their public name."""
    for name in rr1plan.__all__:
        value = getattr(rr1plan, name)
        if inspect.isfunction(value):
            yield name, value
        elif inspect.isclass(value) and not issubclass(value, Exception | enum.Enum):
            yield name, value
            ours = [base for base in value.__mro__ if base.__module__.startswith("rr1plan")]
            for verb, raw in ((verb, raw) for base in reversed(ours) for verb, raw in vars(base).items()):
                if verb.startswith("_"):
                    continue
                raw = getattr(raw, "__func__", raw)
                raw = getattr(raw, "fget", None) or getattr(raw, "func", None) or raw
                if inspect.isfunction(raw):
                    yield f"{name}.{verb}", raw


CALLABLES = dict(public_callables())
# JSON-like data, which has no other type.
_UNTYPED = {
    *("Panel", "Replay", "Replay.to_dict", "Report.to_dict", "Report.from_dict", "pack_array", "PairProposal.get"),
    "SequenceReplay.to_dict",
    *("PairProposal.keys", "PairProposal.items", "PairProposal.values"),
    *("PlanGraph.to_dict", "PlanGraph.from_dict"),
}
# For other modules of the package: they lead to its tables, and no page of the documentation names them.
_INTERNAL = {
    *(
        f"CollisionChecker.{name}"
        for name in (
            *("change_to", "exact_kernel", "fixed", "geometry", "memory_image", "model", "run_edge_kernel"),
            *("run_exact_kernel", "solids", "tables"),
        )
    ),
    *("Scene.contact_rules", "Scene.kept", "Scene.kept_for_any_padding", "GroupResult"),
    *("ManyArmsResult.separated", "Schedule", "Schedule.occupancy", "Part", "Part.occupancy", "Route"),
}
# Constructor arguments of data classes are their fields.
_MOST_PARAMETERS = 10


def annotations(function: typing.Any) -> Iterator[str]:
    signature = inspect.signature(function)
    for parameter in signature.parameters.values():
        if parameter.annotation is not inspect.Parameter.empty:
            yield str(parameter.annotation)
    if signature.return_annotation is not inspect.Signature.empty and not inspect.isclass(function):
        yield str(signature.return_annotation)


# Methods that users' own classes implement.
_PROTOCOLS = {"CurveChecker", "HasPage", "SerialPort"}


@pytest.mark.parametrize("name", sorted(set(CALLABLES) - _UNTYPED - _INTERNAL - _PROTOCOLS))
def test_no_signature_hides_its_types(name: str) -> None:
    function = CALLABLES[name]
    assert not [text for text in annotations(function) if "Any" in text]
    kinds = [p.kind for p in inspect.signature(function).parameters.values()]
    assert inspect.Parameter.VAR_KEYWORD not in kinds
    assert dataclasses.is_dataclass(function) or len(kinds) <= _MOST_PARAMETERS


@pytest.mark.parametrize("name", sorted(set(CALLABLES) - _INTERNAL))
def test_the_types_of_signatures_are_public(name: str) -> None:
    """Every class of ours in an annotation, named directly or through an alias, is public."""
    function = CALLABLES[name]
    module = sys.modules[getattr(inspect.unwrap(function), "__module__", "rr1plan")]
    for text in annotations(function):
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Name):
                known = getattr(module, node.id, getattr(rr1plan, node.id, None))
                for kind in classes_in(known):
                    assert getattr(rr1plan, kind.__name__, None) is kind, f"{text}: {kind.__name__}"


def classes_in(kind: typing.Any) -> Iterator[type]:
    """The classes of ours in a type."""
    if inspect.isclass(kind) and kind.__module__.startswith("rr1plan"):
        yield kind
    for part in typing.get_args(kind):
        yield from classes_in(part)


# ---- a type checker ------------------------------------------------------------------------------

SCRIPT = """
import numpy as np
import rr1plan as rp

scene = rp.load_scene("rr1_table").with_obstacle("ball", rp.Sphere(0.1), [0.1, 0.2, 0.3])
problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
motion: rp.MotionPlan = rp.plan_motion(problem, planner=rp.RrtConnect(range=0.5), rng=0)
waypoints: rp.Array = rp.Path(("arm/joint",), [[0.0], [1.0]]).waypoints
free: bool = rp.CollisionChecker(scene).is_free([0.0] * 6)
several = rp.Problem(scene, None, {"rr1": [rp.JointGoal("zero"), rp.JointGoal(np.zeros(6))]})
either = rp.Problem(scene, "home", [rp.JointGoal("zero"), "home", rp.PoseGoal("tool", [-0.30, 0.25, 0.20])])
for answer in rp.plan_many([either], rng=0):
    print(answer.trajectory.duration if isinstance(answer, rp.MotionPlan) else answer.reason)
paths: list[rp.PlanResult | rp.PlanFailure] = rp.plan_many([either], full=False)
late = rp.ArmDelay(start=0.3, pauses=[(0.5, 1.0)])
crate = rp.Obstacle([rp.Geometry("crate", rp.Sphere(0.1), [0, 0, 0.1], [1, 0, 0, 1])], [0.1, 0.2, 0.3], mass=0.2)
rest = rp.Trajectory.rest(["arm/joint"], [0.0])
back = rp.transforms.inverse([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
free_motion = rp.FreeMotion([rp.JointGoal("zero"), rp.PoseGoal("tool", [-0.30, 0.25, 0.20])])
by_arm = rp.FreeMotion({"rr1": [rp.JointGoal("zero"), rp.PoseGoal("tool", [-0.30, 0.25, 0.20])]})
both = rp.Problem(scene, None, {"rr1": [rp.JointGoal("zero"), rp.PoseGoal("tool", [-0.30, 0.25, 0.20])]})
shapes = [rp.Box([0.1, 0.2, 0.3]), rp.HalfSpace([0, 0, 1]), rp.Box(size=np.ones(3))]
lengths: tuple[float, float, float] = rp.Box(np.ones(3)).size
picture = rp.cspace(scene, joints=["shoulder_joint", "elbow_joint"])
fastest = rp.point_to_point(["arm/joint"], [0.0], [1.0], scene.limits())
shelf = rp.dual_arm_shelf(rp.load_robot("rr1"), 0.5, front=[1, 0, 0])
rp.add_motion(rp.plan_many_arms(several), "rr1", [0.0] * 6, at=0.4)


class Mine(rp.Planner):
    name = "mine"

    def plan(
        self,
        problem: rp.Problem,
        *,
        budget: rp.Budget | None = None,
        rng: rp.Seed = None,
        progress: rp.ProgressCallback | None = None,
    ) -> rp.PlanResult:
        return rp.PlanResult(rp.PlanStatus.TIMEOUT, None)


class Still(rp.Controller):
    def update(self, state: rp.JointState) -> rp.SetPoint:
        return rp.SetPoint([0.0, 0.1], velocities=(0.0, 0.0))


positions: rp.Array = rp.SetPoint([0.0]).positions
rp.plan(problem, planner=Mine())
rp.register_planner("mine", Mine)
motion.show(options=rp.ViewOptions(view="top", quiet=True)).wait()
"""
WRONG = {
    "rp.plan_motoin(problem)": "attr-defined",
    "rp.playback.simulate": "attr-defined",
    "rp.plan(problem, 'rrt_connect')": "call-arg",
    "rp.plan(problem, planner=Mine)": "arg-type",
    "rp.simulate(scene, motion.trajectory)": "arg-type",
    "motion.show(view='top')": "call-arg",
    "motion.solved": "attr-defined",
}


def test_a_type_checker_knows_the_names_and_refuses_misspelt_ones(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    script = tmp_path / "script.py"
    script.write_text(SCRIPT + "\n".join(WRONG) + "\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "--hide-error-context"]
    command += ["--cache-dir", str(tmp_path / "cache"), "--follow-imports", "silent", str(script)]
    said = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path).stdout.splitlines()
    first = SCRIPT.count("\n") + 1
    errors = [line for line in said if ": error:" in line]
    found = {(int(e.split(":")[1]), e.rsplit("[", 1)[1].rstrip("]")) for e in errors}
    assert found == {(first + i, code) for i, code in enumerate(WRONG.values())}, "\n".join(said)
