"""Loose bodies on the page: at their poses at every time, drawn while they were in the scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.transforms import pose

pytestmark = pytest.mark.browser


def test_bodies_move_as_recorded_and_are_drawn_while_they_are_there(tab: Any, tmp_path: Path) -> None:
    block = rp.Obstacle([rp.Geometry("block", rp.Box((0.1, 0.1, 0.1)), np.eye(4))], pose([0, 0, 1.0]), mass=1.0)
    scene = rp.Scene().with_obstacle("floor", rp.HalfSpace()).with_obstacles({"a": block})
    sim = rp.Simulation(scene)
    sim.place_body("a", [0, 0, 1.0], [0.5, 0, 0, 0, 0, 3.0])
    with rp.Recorder(sim, 0.02) as recorder:
        sim.run(duration=0.2)
        sim.update_scene(scene.with_obstacle("b", rp.Sphere(0.1), [0.5, 0, 1.0], mass=1.0))
        sim.run(duration=0.2)
    replay = recorder.replay()
    file = rp.save_html(tmp_path / "o.html", scene, replay=replay, options=rp.ViewOptions(play=False))
    tab.open(file)
    for row in (0, 7, 20):
        tab.ask("t => RR1.seek(t)", replay.record.times[row])
        found = np.reshape(tab.ask("Array.from(RR1.world.bodyPoses)"), (2, 4, 4)).swapaxes(1, 2)
        for k, coordinates in enumerate(replay.record.bodies.poses[row]):
            if np.isnan(coordinates).any():
                assert not found[k][:3, :3].any()
                continue
            np.testing.assert_allclose(found[k][:3, 3], coordinates[:3], atol=1e-5)
            expected = rp.transforms.rotation_from_quaternion(coordinates[3:])
            np.testing.assert_allclose(found[k][:3, :3], expected, atol=1e-5)
    middle = 0.5 * (replay.record.times[4] + replay.record.times[5])
    tab.ask("t => RR1.seek(t)", middle)
    at = tab.ask("Array.from(RR1.world.bodyPoses.slice(12, 15))")
    np.testing.assert_allclose(at, replay.record.bodies.poses[4:6, 0, :3].mean(axis=0), atol=1e-5)
    assert tab.complaints == []
