"""The MuJoCo models of a simulation, stepped together on several threads, and their common state."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context

import numpy as np

from rr1plan.checks import Array, known_name
from rr1plan.playback.simulation.arm_variation import ArmVariation
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.playback.simulation.mujoco_model import Solver, build_mujoco
from rr1plan.playback.simulation.set_points import Rows
from rr1plan.playback.simulation.stepped_models import Tile
from rr1plan.playback.simulation.tiles import check_memory, tile_scenes
from rr1plan.robot.mujoco_warnings import mujoco_warnings
from rr1plan.scene import Scene
from rr1plan.thread_locks import per_process

# Smallest number of steps of single arms without contact for which threads are faster than one.
_SHARED = 1000


class TiledModel:
    """The models of a scene: one, or several with arms that can never meet.

    Args:
        scene: The scene.
        joints: Its joints.
        dt: Time of a step [s].
        stiffness: Natural frequency of the joint servos [rad/s].
        threads: Number of threads.
        solver: Solver for contact forces if there are loose bodies.
        variation: Differences of the arms from their description; None: none.

    Attributes:
        scene: The present scene, see `change_scene`.
        tiles: The models with their data.
        state: Positions, velocities and efforts of all joints, shape (3, n).
        warnings: MuJoCo's warnings.

    Raises:
        InputError: a point cloud of too many cells, or more arms or bodies than fit into the machine's memory.
        BackendError: MuJoCo rejects the scene.
    """

    def __init__(
        self,
        scene: Scene,
        joints: JointMap,
        dt: float,
        *,
        stiffness: float,
        threads: int,
        solver: Solver,
        variation: ArmVariation | None,
    ) -> None:
        self._joints, self._dt, self._stiffness, self._threads = joints, dt, stiffness, threads
        self._solver: Solver = solver
        self._variation = variation
        self.warnings: list[str] = []
        self.scene, self.tiles = scene, self._build(scene)
        self._pool: ThreadPoolExecutor | None = None
        if threads > 1:
            self._pool = per_process(self, "_pool", lambda: ThreadPoolExecutor(threads - 1))
        self._rows = Rows(3, len(joints.names))
        start = joints.expand(scene.configuration())
        self.begin(np.array([start, np.zeros(len(start))]))

    def _build(self, scene: Scene) -> list[Tile]:
        tiles: list[Tile] = []
        with self.collect_warnings():
            parts = tile_scenes(scene)
            check_memory(parts)
            for part in parts:
                world = build_mujoco(part, timestep=self._dt, stiffness=self._stiffness, solver=self._solver)
                columns, worker = self._joints.indices(world.joint_names), len(tiles) % self._threads
                count, threads = len(self._joints.names), self._threads
                tiles.append(Tile(world, columns, count, self._variation, threads=threads, worker=worker))
        return tiles

    @contextmanager
    def collect_warnings(self) -> Iterator[list[str]]:
        """Add MuJoCo's warnings to `warnings`, instead of a file in the working directory."""
        with mujoco_warnings() as warnings:
            try:
                yield warnings
            finally:
                self.warnings += warnings

    @property
    def body_names(self) -> tuple[str, ...]:
        """The loose bodies."""
        return tuple(name for tile in self.tiles for name in tile.bodies)

    def tile_of_body(self, name: str) -> Tile:
        """The tile that contains a loose body.

        Raises:
            UnknownNameError: no such loose body.
        """
        known_name("loose body", name, self.body_names, "An obstacle with a mass is a loose body.")
        return next(tile for tile in self.tiles if name in tile.bodies)

    # ---- state -----------------------------------------------------------------------------------

    def begin(self, state: Array) -> None:
        """Restart with positions and velocities of all joints, shape (2, n); `restore` returns to this state."""
        with self.collect_warnings():
            for tile in self.tiles:
                tile.begin(state)
        self._origin = self.scene, self.tiles
        self._initial = [tile.save() for tile in self.tiles]
        self._observe()

    def restore(self) -> None:
        """Return exactly to the state and scene of the last `begin`."""
        self.scene, self.tiles = self._origin
        with self.collect_warnings():
            for tile, state in zip(self.tiles, self._initial, strict=True):
                tile.restore(state)
        self._observe()

    def _observe(self) -> None:
        self.state = np.empty((3, len(self._joints.names)))
        for tile in self.tiles:
            tile.observe(self.state)

    def change_scene(self, scene: Scene, stay: Container[str]) -> None:
        """Build the models of another scene of the same arms, which keep their state.

        Args:
            scene: The other scene.
            stay: Loose bodies of both scenes that keep their state.
        """
        tiles = self._build(scene)
        with self.collect_warnings():
            for tile in tiles:
                tile.place(self.state)
                for name in (name for name in tile.bodies if name in stay):
                    before = self.tile_of_body(name).body_state(name)
                    for values, kept in zip(tile.body_state(name), before, strict=True):
                        values[:] = kept
                tile.refresh()
        self.tiles, self.scene = tiles, scene

    # ---- steps -----------------------------------------------------------------------------------

    @property
    def most_steps(self) -> int:
        """Largest number of steps that `take_steps` may take from the present state."""
        return min(tile.most_steps for tile in self.tiles)

    def take_steps(self, desired: Array) -> Array:
        """Take steps until one ends in a state that may have contacts.

        Args:
            desired: Set-points of all joints for each step: positions, velocities, accelerations and efforts to add,
                shape (k, 4, n) with k up to `most_steps`.

        Returns:
            Positions, velocities and efforts before the first step and after each step that was taken, shape
            (up to k + 1, 3, n); overwritten by the next call.
        """
        states, tiles = self._rows.take(len(desired) + 1), self.tiles
        states[0] = self.state

        def advance(worker: int) -> None:
            for tile in tiles:
                tile.advance(worker, desired, states)

        free = sum(tile.free_arms for tile in tiles) * len(desired)
        self._distribute(advance, free >= _SHARED or (len(tiles) > 1 and not all(tile.free_arms for tile in tiles)))
        taken = min(tile.count_valid(states) for tile in tiles)
        valid, valid_states = desired[:taken], states[: taken + 1]

        def settle(worker: int) -> None:
            for tile in tiles:
                if tile.worker == worker:
                    tile.settle(valid, valid_states)

        self._distribute(settle, len(tiles) > 1)
        self.state = valid_states[-1].copy()
        return valid_states

    def _distribute(self, work: Callable[[int], None], shared: bool) -> None:
        """Run the work of every worker, on threads if `shared`."""
        if self._pool is None or not shared:
            for worker in range(self._threads):
                work(worker)
            return
        # With this thread's context, in which MuJoCo's warnings are collected.
        futures = [self._pool.submit(copy_context().run, work, worker) for worker in range(1, self._threads)]
        work(0)
        for future in futures:
            future.result()

    def is_unstable(self) -> bool:
        """Whether MuJoCo has warned of values that are not finite or too large."""
        return any(tile.is_unstable() for tile in self.tiles)
