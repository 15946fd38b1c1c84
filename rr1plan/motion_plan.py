"""`MotionPlan`, the result of `plan_motion`: path, trajectory and report, to show, print or save."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, TypedDict, TypeVar

from rr1plan.checks import check_text, counted, known_name
from rr1plan.errors import InputError, NoPlanError
from rr1plan.notebook_view import NotebookView
from rr1plan.path import Path
from rr1plan.planning import EACH_ARM_ALONE, PlanResult, PlanStatus
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.scene.joint_units import length_unit
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory

if TYPE_CHECKING:
    from rr1plan.multi.many_arms_result import ManyArmsResult
    from rr1plan.playback.schedules.coordination_diagram import CoordinationDiagram
    from rr1plan.playback.schedules.timeline import Timeline
    from rr1plan.playback.simulation.replay import Replay
    from rr1plan.playback.viewer import Viewer, ViewOptions
    from rr1plan.playback.viewer.page_document import Document

_T = TypeVar("_T")
_DEGREES = {0: "constant", 1: "linear", 2: "quadratic", 3: "cubic", 4: "quartic", 5: "quintic"}


class _Content(TypedDict):
    """Arguments of the functions that show or write a motion."""

    path: Path | None
    trajectory: Trajectory | None
    report: Report | None
    problem: Problem | None


@dataclass(frozen=True, eq=False)
class MotionPlan(NotebookView):
    """Result of `plan_motion`: the planner's result, path, trajectory and report.

    Path, trajectory and report of a failed plan raise `NoPlanError` with the planner's reason; check `found`, `valid`
    and `status` first.

    Args:
        problem: The planning problem, with the margin that was given, if any; None for a motion from a file without a
            problem.
        result: The planner's result.
        seconds: Wall time of each stage [s], in order: "imports" (lazy imports of `rr1plan` before the first query of
            the process), "set up" (collision tables, once for each scene), "plan", "shorten", "retime", "validate".
        margin: Distance kept beyond the scene's padding while planning [m]; 0 for the planners of many arms, which keep
            as much for each arm and each pair of arms as their starts, goals and narrow passages allow.
        changes: For a motion from a file: differences between the scene it was planned in and `scene`.
        many_arms: Result of the planner "many_arms": paths by arm, stages, makespan; without a composite `path`.
    """

    problem: Problem | None
    result: PlanResult
    seconds: Mapping[str, float] = field(default_factory=dict)
    margin: float = 0.0
    _path: Path | None = None
    _trajectory: Trajectory | None = None
    _report: Report | None = None
    changes: tuple[str, ...] = ()
    _scene: Scene | None = None
    many_arms: ManyArmsResult | None = None
    # Makes the report with the smallest clearances, which `_report` lacks, from trajectory, scene and problem.
    _judge: Callable[[Trajectory, Scene, Problem | None], Report] | None = None

    @property
    def scene(self) -> Scene:
        """The scene."""
        if self._scene is not None:
            return self._scene
        assert self.problem is not None, "a plan without a problem is made with its scene"
        return self.problem.scene

    @property
    def status(self) -> PlanStatus:
        """How planning ended."""
        return self.result.status

    @property
    def reason(self) -> str:
        """Why there is no path, and what to try."""
        return self.result.reason

    @property
    def found(self) -> bool:
        """Whether the planner found a path; its motion may still not be `valid`."""
        return self.result.found

    @property
    def valid(self) -> bool:
        """Whether there is a trajectory and the referee found no violation."""
        return self._report is not None and self._report.valid

    def __bool__(self) -> bool:
        """Whether the referee's report is valid and certified."""
        return self._report is not None and self._report.certified

    @property
    def path(self) -> Path:
        """The shortened path."""
        if self.many_arms is not None and self.found:
            raise NoPlanError(EACH_ARM_ALONE)
        return self._path if self._path is not None else _present(self.result.path, self.result)

    @property
    def trajectory(self) -> Trajectory:
        """The timed motion."""
        return _present(self._trajectory, self.result)

    @property
    def report(self) -> Report:
        """The referee's report on the trajectory; its smallest clearances are computed when it is first read."""
        return _present(self._whole_report, self.result)

    @cached_property
    def _whole_report(self) -> Report | None:
        if self._report is None or self._judge is None:
            return self._report
        return self._judge(self.trajectory, self.scene, self.problem)

    def with_clearances(self) -> MotionPlan:
        """The same plan with the smallest clearances in its report, otherwise computed when the report is read."""
        return replace(self, _report=self._whole_report, _judge=None)

    def __repr__(self) -> str:
        if self._report is None:
            return f"MotionPlan({self.result!r})"
        return f"MotionPlan({self.size()}, {self._report!r})"

    def __str__(self) -> str:
        if self._report is None:
            return f"no plan ({self.result.planner}, {self.status.value}): {self.result.reason}"
        stages = "".join(f"{name} {1e3 * seconds:.1f} ms, " for name, seconds in self.seconds.items())
        lines = [f"{self.size()}; {stages}".rstrip("; ,"), *(f"  changed      {change}" for change in self.changes)]
        return "\n".join([*lines, str(self._whole_report)])

    def size(self) -> str:
        """Summary of path and trajectory: "57 waypoints, 2.31 rad long, 1.20 s in 112 quartic pieces"."""
        path, trajectory = self._path_if_any(), self._trajectory
        parts = []
        if path is not None:
            unit = length_unit(path.joint_names, self.scene)
            parts.append(f"{counted(len(path), 'waypoint')}, {path.length:.2f} {unit} long")
        if trajectory is not None:
            kind = _DEGREES.get(trajectory.degree, f"degree-{trajectory.degree}")
            parts.append(f"{trajectory.duration:.3f} s in {counted(len(trajectory.coefficients), f'{kind} piece')}")
        return ", ".join(parts)

    def show(self, *, replay: Replay | None = None, options: ViewOptions | None = None) -> Viewer:
        """Open the motion in a live Meshcat page and print its address.

        End a script with `motion.show().wait()`, which keeps the page until it is closed.

        Args:
            replay: A replay of the motion, shown with it.
            options: Appearance of the page.

        Raises:
            NoPlanError: there is neither a path nor a timed motion.
            InputError: as `rr1plan.show`.
        """
        from rr1plan.playback.viewer import show

        return show(self.scene, **self._content(), replay=replay, options=self._page_options(options))

    def save_html(
        self, file: str | FilePath, *, replay: Replay | None = None, options: ViewOptions | None = None
    ) -> FilePath:
        """Write one self-contained page that plays the motion offline.

        Args:
            file: The file, written atomically.
            replay: A replay of the motion, shown with it.
            options: Appearance of the page.

        Returns:
            The file.

        Raises:
            NoPlanError: there is neither a path nor a timed motion.
            InputError: as `rr1plan.save_html`.
        """
        from rr1plan.playback.viewer import save_html

        return save_html(file, self.scene, **self._content(), replay=replay, options=self._page_options(options))

    def page_content(self, options: ViewOptions | None = None) -> tuple[Document, ViewOptions]:
        """The document of the motion's page, and its options with all panels."""
        from rr1plan.playback.viewer.page_document import view_document

        options = self._page_options(options)
        return view_document(self.scene, **self._content(), options=options), options

    def timeline(self) -> Timeline:
        """The time line: when each arm moves and rests, which arms it waits for, and contacts that the referee found.

        Raises:
            NoPlanError: there is no timed motion.
        """
        from rr1plan.playback.schedules.timeline import timeline

        if self.many_arms is None:
            return timeline(self.trajectory, self.scene, report=self._report)
        from rr1plan.multi.timing.waits import undelayed, waits_of

        schedules = self.many_arms.separated.schedules
        return timeline(
            self.trajectory,
            self.scene,
            report=self._report,
            waits=waits_of(schedules),
            undelayed=undelayed(schedules),
        )

    def coordination_diagram(self, one: str, two: str) -> CoordinationDiagram:
        """The coordination diagram of two arms of a plan of many arms, with their schedules.

        Args:
            one: A moving arm.
            two: Another one.

        Raises:
            UnknownNameError: no such arm moves.
            InputError: the same arm twice, arms that only move as one, or a motion without schedules.
            NoPlanError: there is no timed motion.
        """
        from rr1plan.multi.timing.waits import pair_timing
        from rr1plan.playback.schedules.coordination_diagram import CoordinationDiagram

        names = (one, two)
        check_text("one", one)
        check_text("two", two)
        _present(self._trajectory, self.result)
        if self.many_arms is None:
            raise InputError("this motion has no schedules of arms; plan it with planner='many_arms'")
        owner = {arm: schedule for schedule in self.many_arms.separated.schedules for arm in schedule.arms}
        first, second = (owner[known_name("moving arm", name, owner)] for name in names)
        if one == two:
            raise InputError(f"{one!r} is named twice, expected two arms")
        if first is second:
            raise InputError(f"{one!r} and {two!r} only move as one in their joint space, so they have no diagram")
        numbers = {arm: k for k, arm in enumerate(self.scene.arms)}
        along, beside = (length_unit(self.scene.joint_names(each.arms), self.scene) for each in (first, second))
        timing = pair_timing(first, second)
        return CoordinationDiagram(names, (numbers[one], numbers[two]), units=(along, beside), **vars(timing))

    def _page_options(self, options: ViewOptions | None) -> ViewOptions:
        """The options of a page, with the planner's tree; for a plan of many arms also with its time line."""
        from rr1plan.playback.viewer.view_options import checked_options, with_panel

        options = checked_options(options)
        if options.tree is None and self.problem is not None:
            options = replace(options, tree=self.result.tree)
        if self.many_arms is None or self._trajectory is None:
            return options
        return with_panel(options, self.timeline().panel())

    def save(self, file: str | FilePath, *, embed: bool = False) -> FilePath:
        """Write scene, problem, path, trajectory and report to one JSON file; read it with `rr1plan.load_motion`.

        Args:
            file: The file.
            embed: Put large meshes into the file instead of the folder "geometry" beside it; see `save_motion`.

        Raises:
            NoPlanError: there is neither a path nor a timed motion.
            InputError: a file that cannot be written.
        """
        from rr1plan.export.plan_files import save_motion

        return save_motion(file, self.scene, **self._content(), embed=embed)

    def to_json(self) -> str:
        """Text of a self-contained motion file.

        Raises:
            NoPlanError: there is neither a path nor a timed motion.
        """
        from rr1plan.export.plan_files import motion_text

        return motion_text(self.scene, **self._content())

    def _content(self) -> _Content:
        return _Content(
            path=self._path_if_any(), trajectory=self._trajectory, report=self._whole_report, problem=self.problem
        )

    def _path_if_any(self) -> Path | None:
        """The path, or None for a motion from a file with only a trajectory."""
        path = self._path if self._path is not None else self.result.path
        if path is None:
            _present(self._trajectory, self.result)
        return path


def _present(value: _T | None, result: PlanResult) -> _T:
    if value is None:
        if not result.found:
            result.path_or_raise()
        raise NoPlanError(result.reason or f"{result.planner}: found a path that was not timed")
    return value
