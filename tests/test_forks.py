"""Forked processes use the objects of their parent, whatever its threads were doing."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, RLock, Thread

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.thread_locks import exclusive, per_process
from rr1plan.transforms import pose


def _ends_in_a_fork(work: Callable[[], object]) -> bool:
    """Whether some work ends without an error in a forked process."""
    child = os.fork()
    if child == 0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # an alarm ends the process
        signal.alarm(5)
        code = 1
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@contextmanager
def _busy(work: Callable[[], object]) -> Iterator[None]:
    """Repeat some work on two other threads."""
    ended = Event()

    def repeat() -> None:
        while not ended.is_set():
            work()

    threads = [Thread(target=repeat) for _ in range(2)]
    for thread in threads:
        thread.start()
    yield
    ended.set()
    for thread in threads:
        thread.join()


class _Door:
    def __init__(self) -> None:
        self._lock = per_process(self, "_lock", RLock)
        self.entered, self.ended = Event(), Event()

    @exclusive
    def wait(self) -> None:
        self.entered.set()
        self.ended.wait()

    @exclusive
    def fork(self) -> bool:
        return _ends_in_a_fork(self.pass_by)

    @exclusive
    def pass_by(self) -> None:
        pass


def test_a_lock_of_another_thread_is_free_in_a_fork() -> None:
    door = _Door()
    thread = Thread(target=door.wait)
    thread.start()
    door.entered.wait()
    assert _ends_in_a_fork(door.pass_by)
    door.ended.set()
    thread.join()
    assert door.fork()  # by the thread that holds the lock


@pytest.mark.parametrize("kind", ["collisions", "kinematics"])
def test_a_fork_uses_what_other_threads_use(kind: str) -> None:
    scene = rp.load_scene("rr1_table")
    q = scene.configuration()
    checker, kinematics = rp.CollisionChecker(scene), rp.Kinematics(scene)
    work = {
        "collisions": lambda: checker.edge_is_free(q, q + 0.1),
        "kinematics": lambda: kinematics.jacobian(q, "tool"),
    }[kind]
    work()
    with _busy(work):
        assert all(_ends_in_a_fork(work) for _ in range(8))


def test_a_fork_steps_a_simulation_on_several_threads() -> None:
    robot = rp.planar_arm()
    scene = rp.Scene({f"arm_{i}": rp.Arm(robot, pose((5.0 * i, 0.0, 0.0))) for i in range(40)})
    simulation = rp.Simulation(scene, threads=2)
    simulation.step(64)
    positions = simulation.positions
    simulation.reset()

    def step() -> None:
        simulation.step(64)
        assert np.array_equal(simulation.positions, positions)

    assert _ends_in_a_fork(step)


def test_a_fork_steps_a_heap_of_bodies_on_several_threads() -> None:
    """And a reset of it: to the same bytes as one thread."""
    scene = rp.Scene().with_obstacle("floor", rp.HalfSpace((0, 0, 1), 0.0))
    for i in range(50):  # in contact with the floor and with each other
        scene = scene.with_obstacle(f"box_{i}", rp.Box((0.05, 0.05, 0.05)), [0.0499 * i, 0.0, 0.0249], mass=0.1)

    def is_there(simulation: rp.Simulation) -> bool:
        return all(np.array_equal(simulation.body_coordinates(name), pose) for name, pose in expected.items())

    one = rp.Simulation(scene)
    one.step(6)
    expected = {name: one.body_coordinates(name) for name in one.body_names}
    simulation = rp.Simulation(scene, threads=2)
    simulation.step(2)

    def step() -> None:
        simulation.step(4)
        assert is_there(simulation)
        simulation.reset()
        simulation.step(6)
        assert is_there(simulation)

    assert _ends_in_a_fork(step)
    step()


def test_a_fork_in_the_middle_of_a_step_requires_a_reset(rr1_table: rp.Scene) -> None:
    stepping, forked = Event(), Event()

    class Slow(rp.Controller):
        def update(self, state: rp.JointState) -> rp.SetPoint:
            stepping.set()
            forked.wait()
            return rp.SetPoint(state.positions)

    simulation = rp.Simulation(rr1_table)
    simulation.activate(Slow(rr1_table.joint_names()))
    thread = Thread(target=simulation.step)
    thread.start()
    stepping.wait()

    def step() -> None:
        forked.set()
        with pytest.raises(rp.InputError, match="forked in the middle of a step of the simulation; reset it first"):
            simulation.step()
        simulation.reset()
        simulation.step()

    assert _ends_in_a_fork(step)
    forked.set()
    thread.join()
    assert simulation.steps == 1
