"""The referee's kernels with sanitizers, compared with the shipped kernels; run by `test_native.py`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import rr1plan as rp
from rr1plan.robot import Geometry
from rr1plan.scene import Arm, Obstacle
from rr1plan.transforms import pose
from rr1plan.validation.bernstein_extremes import extremes
from rr1plan.validation.compiled_search import ProofOptions, Search
from rr1plan.validation.link_motion import TimedColumns
from rr1plan.validation.moving_scene import moving_scene
from rr1plan.validation.referee_kernels import LIBRARY, load_library


def scenes():
    """Scenes of many and of few arms, with all kinds of shapes, attached objects and rules; and their moving arms."""
    rng = np.random.default_rng(0)
    robot = rp.load_robot("rr1")
    arms = {f"arm{i}": Arm(robot, pose([0.6 * (i // 3), 0.6 * (i % 3), 0.0])) for i in range(9)}
    corners = rng.normal(size=(60, 3)) * 0.05
    shapes = [rp.Sphere(0.05), rp.Box((0.1, 0.2, 0.3)), rp.Cylinder(0.05, 0.3), rp.Capsule(0.02, 0.4)]
    hull = rp.Mesh(corners, np.array([[0, 1, 2]]), convex=True)
    concave = rp.Mesh(corners[:4], np.array([[0, 1, 2], [0, 2, 3]]), convex=False)
    cloud = rp.PointCloud(rng.uniform(-0.2, 0.2, (200, 3)), 0.03)
    obstacles = {
        f"thing{i}": Obstacle((Geometry("part", shape),), pose([*rng.uniform(-0.5, 1.5, 2), -0.3]))
        for i, shape in enumerate([*shapes, hull, concave, cloud])
    }
    obstacles["floor"] = Obstacle((Geometry("part", rp.HalfSpace((0.0, 0.0, 1.0), -1.0)),))
    crowd = rp.Scene(arms=arms, obstacles=obstacles).with_padding(0.01, "arm0", "arm1").allow("arm3", "thing0")
    tool = crowd.link_poses()["arm4/tool"]
    crowd = crowd.with_obstacle("plate", concave, tool @ pose([0.0, 0.0, 0.05]))
    crowd = crowd.attach("plate", "arm4", touch=robot.link_names)
    crowd = crowd.with_obstacle("held", rp.Box((0.02, 0.02, 0.1)), tool).attach("held", "arm4", touch=robot.link_names)
    yield crowd, tuple(arms)
    yield crowd, ("arm4", "arm8")
    yield rp.load_scene("rr1_cluttered"), ("rr1",)
    yield rp.load_scene("planar2r_path"), tuple(rp.load_scene("planar2r_path").arms)


def searches():
    """Results of the search for motions with and without contacts."""
    for scene, names in scenes():
        rng = np.random.default_rng(1)
        columns, q = scene.joint_names(names), scene.configuration(names)
        for reach in (0.0, 0.1, 0.6):
            rows = q + np.concatenate([np.zeros((1, len(q))), reach * rng.uniform(-1.0, 1.0, (3, len(q)))])
            move = rp.Trajectory.from_samples(columns, [0.0, 0.3, 0.9, 1.0], rows, np.zeros_like(rows))
            motion = TimedColumns(columns, move.breaks, move.coefficients)
            extremes(move.breaks, move.coefficients)
            for clearance in (True, False):
                search = Search(moving_scene(scene, columns), motion, ProofOptions(2e-4, 400_000, clearance))
                search.run(None)
                yield search


def main(file: str) -> int:
    """Compare the results of a library with those of the shipped library."""
    load_library()
    shipped = list(searches())
    LIBRARY.__dict__["fastest"] = LIBRARY.load(Path(file))
    for one, two in zip(shipped, searches(), strict=True):
        assert [found.elements for found in one.marked] == [found.elements for found in two.marked]
        for values in zip(seen(one), seen(two), strict=True):
            np.testing.assert_allclose(*values, rtol=0.0, atol=1e-9)
    assert sum(bool(search.marked) for search in shipped) > 3
    return len(shipped)


def seen(search):
    """All clearances that a search found."""
    nearest = [found.clearance for found in (search.nearest(0), search.nearest(1), *search.ends) if found is not None]
    marked = [number for found in search.marked for number in found[1:]]
    return [*nearest, *search.proven, *marked]


if __name__ == "__main__":
    sys.stdout.write(f"same answers: {main(sys.argv[1])}\n")
