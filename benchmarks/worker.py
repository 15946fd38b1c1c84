"""Common code of the peers' workers. It does not use rr1plan and needs only NumPy.

Protocol, one JSON object per line. First line in: {"seconds": limit of one search, "options": {...}}; first line
out: {"ready": true}. Then problems in, results out:

    in   name, seed, start, goal, obstacles (name, kind, size, pose), may_touch (pairs of link and obstacle),
         robot (name, urdf, srdf, base, tip, joints, velocity, acceleration)
    out  name, seconds (CPU time of each stage: set up, plan, shorten, retime), raw, path (lists of waypoints),
         timed (positions every 2 ms), step (the exact time between those), duration; failure if something failed

Sizes are [x, y, z] of a box, [radius, length] of a cylinder, [radius] of a sphere; poses are matrices in
the frame of the robot's base.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

FINE = 0.002  # step of the checked samples of a timed motion [s]
COARSE = 0.01  # step of the samples that the time of retiming includes [s]


class Answer:
    """A peer's result for one problem, and the CPU seconds of its stages."""

    def __init__(self, name: str) -> None:
        self.data: dict[str, Any] = {"name": name, "seconds": {}}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body of the `with` statement."""
        began = time.process_time()
        try:
            yield
        finally:
            self.data["seconds"][name] = time.process_time() - began

    def keep(self, kind: str, waypoints: Any) -> None:
        """A path or samples, as plain numbers."""
        self.data[kind] = np.asarray(waypoints, dtype=float).tolist()


def serve(load: Callable[..., Any], solve: Callable[..., None]) -> None:
    """Solve problems until the input ends.

    Args:
        load: Prepares the data for `solve` from `robot` and the first line; called once for each robot.
        solve: Fills an answer: `solve(loaded, problem, answer)`; may raise.
    """
    # Output of libraries goes to standard error; the pipe is for answers only.
    pipe = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    task = json.loads(sys.stdin.readline())
    _send(pipe, {"ready": True})
    robots: dict[str, Any] = {}
    for line in sys.stdin:
        problem = json.loads(line)
        answer = Answer(problem["name"])
        try:
            urdf = problem["robot"]["urdf"]
            if urdf not in robots:
                robots[urdf] = load(problem["robot"], task)
            solve(robots[urdf], problem, answer)
        except Exception as error:  # a library may raise anything; continue with the next problem
            answer.data["failure"] = f"{type(error).__name__}: {error}"
        _send(pipe, answer.data)


def _send(pipe: Any, data: dict[str, Any]) -> None:
    pipe.write(json.dumps(data) + "\n")
    pipe.flush()
