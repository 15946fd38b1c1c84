"""The lesson page that follows the running program."""

from __future__ import annotations

from dataclasses import replace

from rr1plan.errors import InputError
from rr1plan.path import Path
from rr1plan.playback.cspace.cspace_page import page_parts
from rr1plan.playback.cspace.cspace_query import CSpaceQuery, compute_query
from rr1plan.playback.simulation.replay import Replay
from rr1plan.playback.viewer.live_viewer import Viewer, announced
from rr1plan.playback.viewer.view_options import ViewOptions, with_panel
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
from rr1plan.trajectory import Trajectory


def show_page(
    picture: CSpaceQuery,
    *,
    trajectory: Trajectory | None = None,
    options: ViewOptions | None = None,
) -> CSpaceViewer:
    """Open the lesson live in the browser of this machine; the program can move the arm with `Viewer.update`.

    Args:
        picture: The configuration space, with a query and its result if it has one.
        trajectory: The timed motion to play; None plays the path at a steady speed.
        options: How the page looks (default: `ViewOptions()`).

    Raises:
        InputError: the trajectory moves other joints than the two shown.
        BackendError: no free port.
        MissingPackageError: Meshcat is not installed.
    """
    return announced(CSpaceViewer(picture, trajectory=trajectory, options=options))


class CSpaceViewer(Viewer):
    """A live page of a configuration space. `CSpace.show` makes one; see `Viewer` for its other methods.

    Args:
        picture: The configuration space.
        trajectory: The timed motion to play, or None.
        options: As in `show_page`.
    """

    def __init__(
        self,
        picture: CSpaceQuery,
        *,
        trajectory: Trajectory | None = None,
        options: ViewOptions | None = None,
    ) -> None:
        document, panel = page_parts(picture, trajectory=trajectory, options=options)
        self._open(picture.grid.scene, document, with_panel(options, panel))
        self._picture = picture

    def load(
        self,
        scene: Scene | CSpaceQuery,
        *,
        trajectory: Trajectory | None = None,
        path: Path | None = None,
        problem: Problem | None = None,
        report: Report | None = None,
        replay: Replay | None = None,
        options: ViewOptions | None = None,
    ) -> None:
        """Show another scene on the same page, in the workspace and in the configuration space.

        Args:
            scene: A scene, whose configuration space is computed at the resolution of the page, for the same arm and
                joints if it has them; or a `CSpace`, with its own query, path and tree.
            trajectory: The timed motion to play, or None.
            path: The result of the query, or None.
            problem: The query: its start and goals are drawn in both spaces, and the verdict refers to it.
            report: The referee's verdict on the trajectory, shown as a badge.
            replay: The simulated trajectory.
            options: Only the title and the spheres are used.

        Raises:
            UnknownNameError: a column that is not a joint of the scene.
            InputError: an arm without two joints, a problem, path or trajectory of other joints, or a closed viewer.
        """
        picture = scene if isinstance(scene, CSpaceQuery) else self._picture_of(scene, problem, path)
        document, panel = page_parts(picture, trajectory=trajectory, report=report, replay=replay, options=options)
        self._exchange(picture.grid.scene, document, (panel,))
        self._picture = picture

    def _picture_of(self, scene: Scene, problem: Problem | None, path: Path | None) -> CSpaceQuery:
        grid, arm, joints = self._picture.grid, None, None
        if problem is None and grid.arm in scene.arms:
            arm = grid.arm
            joints = grid.joint_names if set(grid.joint_names) <= set(scene.arms[arm].robot.joint_names) else None
        picture = compute_query(CSpaceQuery, scene, problem, arm=arm, joints=joints, resolution=len(grid.free))
        if path is None:
            return picture
        names = tuple(f"{picture.grid.arm}/{name}" for name in picture.grid.joint_names)
        if path.joint_names != names:
            raise InputError(
                f"the path moves {', '.join(path.joint_names)}, expected the joints shown: {', '.join(names)}"
            )
        return replace(picture, path=path.waypoints)
