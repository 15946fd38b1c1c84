"""The result of `plan_sequence`: one trajectory with its stages and the referee's report; to show, save, simulate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from rr1plan.checks import Array, Value, counted, finite_array, known_name
from rr1plan.errors import NoPlanError
from rr1plan.export.plan_files import save_sequence_document
from rr1plan.notebook_view import NotebookView
from rr1plan.planning import PlanStatus
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.sequences.sequence import Sequence
from rr1plan.sequences.stages import SequenceStage, StagedMotion, carried_names, check_stages, stage_scenes
from rr1plan.trajectory import Trajectory

if TYPE_CHECKING:
    from rr1plan.playback.viewer import Viewer, ViewOptions
    from rr1plan.playback.viewer.page_document import Document
    from rr1plan.sequences.sequence_replay import SequenceReplay


@dataclass(frozen=True, eq=False)
class SequencePlan(Value, NotebookView):
    """Result of `plan_sequence`, or a sequence from a file.

    Accessing the trajectory or report of a failed plan raises `NoPlanError` with the reason; check `found` first.

    Args:
        scene: The scene at the beginning. Gripper joints that move are planning joints in it.
        status: Status of planning. INFEASIBLE means that each candidate for the failed segment failed for a reason that
            more time does not change; it is no proof where other configurations reach the same pose.
        reason: The segment that was not found, and the reason; empty if all were found.
        failed: Index of that segment in `sequence.segments`.
        sequence: The sequence; None for one from a file.
        stages: The stage of each segment; empty without a plan.
        gripper_joints: The planning joints of `scene` that belong to grippers, by arm.
        changes: For a sequence from a file: differences between the scene it was planned in and `scene`.
    """

    scene: Scene
    status: PlanStatus = PlanStatus.FOUND
    reason: str = ""
    failed: int | None = None
    sequence: Sequence | None = None
    stages: tuple[SequenceStage, ...] = ()
    gripper_joints: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    changes: tuple[str, ...] = ()
    _trajectory: Trajectory | None = field(default=None)
    _report: Report | None = field(default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "gripper_joints", MappingProxyType(dict(self.gripper_joints)))
        if self._trajectory is not None:
            check_stages(self._trajectory, self.stages)

    @property
    def found(self) -> bool:
        """Whether all segments were found; `valid` is a separate question."""
        return self._trajectory is not None

    @property
    def valid(self) -> bool:
        """Whether the referee found no violation in any stage."""
        return self._report is not None and self._report.valid

    def __bool__(self) -> bool:
        """Whether the referee's report is valid and certified."""
        return self._report is not None and self._report.certified

    @property
    def trajectory(self) -> Trajectory:
        """The motion of all segments, on one clock."""
        if self._trajectory is None:
            raise NoPlanError(self.reason)
        return self._trajectory

    @property
    def report(self) -> Report:
        """The referee's verdict on all stages."""
        if self._report is None:
            raise NoPlanError(self.reason)
        return self._report

    @property
    def _motion(self) -> StagedMotion:
        return StagedMotion(self.scene, self.trajectory, self.stages, self.report, self.gripper_joints)

    @property
    def events(self) -> tuple[SequenceStage, ...]:
        """The stages in which something is attached or detached."""
        return tuple(stage for stage in self.stages if stage.change is not None)

    def scenes(self) -> list[Scene]:
        """The scene of each stage: arms at its beginning, objects held or put down, and the pairs allowed in it.

        Raises:
            NoPlanError: there is no motion.
        """
        return stage_scenes(self.scene, self.trajectory, self.stages)

    @property
    def carried_names(self) -> tuple[str, ...]:
        """The objects that are attached or detached, in the order of the first such event."""
        return carried_names(self.stages)

    def object_poses(self, name: str, times: ArrayLike) -> Array:
        """Poses of an object, held or put down.

        Args:
            name: An object of the scene, held or not.
            times: Instants [s], shape (n,).

        Returns:
            T_world_object, shape (n, 4, 4).

        Raises:
            UnknownNameError: no such object.
            NoPlanError: there is no motion.
        """
        known_name("object", name, (*self.scene.obstacles, *self.scene.attachments))
        instants = finite_array("times", times, (None,))
        return self._motion.object_poses(name, instants)

    def __repr__(self) -> str:
        if self._report is None:
            return f"SequencePlan({self.status.value}: {self.reason})"
        return f"SequencePlan({counted(len(self.stages), 'stage')}, {self._report!r})"

    def __str__(self) -> str:
        if self._report is None:
            return f"no plan ({self.status.value}): {self.reason}"
        width = max(len(stage.label) for stage in self.stages)
        lines = [self.size()]
        for k, stage in enumerate(self.stages):
            seconds = f"{stage.begin:7.3f} s" + ("" if stage.change else f" to {stage.end:7.3f} s")
            lines.append(f"  {k + 1:3d}  {stage.label:<{width}}  {seconds}")
        lines += [f"  changed      {change}" for change in self.changes]
        return "\n".join([*lines, str(self._report)])

    def size(self) -> str:
        """Number of stages and duration: "11 stages, 4.461 s".

        Raises:
            NoPlanError: there is no motion.
        """
        return f"{counted(len(self.stages), 'stage')}, {self.trajectory.duration:.3f} s"

    # ---- pages and files -------------------------------------------------------------------------

    def show(self, *, replay: SequenceReplay | None = None, options: ViewOptions | None = None) -> Viewer:
        """Open the motion in a live page, where held objects move with the hand.

        Args:
            replay: The result of `simulate_sequence`: objects have their simulated poses, and a shadow shows the
                simulated arms.
            options: How the page looks (default: `ViewOptions()`).

        Raises:
            NoPlanError: there is no motion.
        """
        from rr1plan.playback.viewer.live_viewer import announced
        from rr1plan.sequences.sequence_page import SequenceViewer

        return announced(SequenceViewer(self._motion, replay, options))

    def save_html(
        self, file: str | FilePath, *, replay: SequenceReplay | None = None, options: ViewOptions | None = None
    ) -> FilePath:
        """Write one self-contained page that plays the motion offline.

        Args:
            file: The file (.html), written atomically.
            replay: As in `show`.
            options: As in `show`.

        Raises:
            NoPlanError: there is no motion.
        """
        from rr1plan.sequences.sequence_page import save_sequence_html

        return save_sequence_html(file, self._motion, replay, options)

    def page_content(self, options: ViewOptions | None = None) -> tuple[Document, ViewOptions]:
        """The document of the motion's page, and its options with the panel of the stages."""
        from rr1plan.sequences.sequence_page import page_parts

        return page_parts(self._motion, None, options)

    def save(self, file: str | FilePath, *, embed: bool = False) -> FilePath:
        """Write scene, trajectory, stages and report to one JSON file; read it with `rr1plan.load_sequence`.

        Args:
            file: The file.
            embed: Put large meshes into the file, not into the folder "geometry" next to it; see `save_motion`.

        Raises:
            NoPlanError: there is no motion.
        """
        entries = {
            "stages": [stage.to_dict() for stage in self.stages],
            "gripper_joints": {arm: list(joints) for arm, joints in self.gripper_joints.items()},
        }
        return save_sequence_document(file, self.scene, self.trajectory, entries, report=self.report, embed=embed)
