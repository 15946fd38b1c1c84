"""Edges and curves by a library with sanitizers, compared with the one that ships; run by `test_edge_kernel.py`.

Scenes hold all kinds of bodies and obstacles, padding, something held, and two arms.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.collision.edge_kernel import EdgeKernel
from rr1plan.collision.sphere_tables import build_cover
from rr1plan.kernels.library import load_file, load_library
from rr1plan.transforms import pose


def scenes():
    cloud = rp.PointCloud(np.random.default_rng(0).uniform(0.3, 0.6, (60, 3)), 0.03)
    rod = rp.Scene().with_arm("arm", rp.load_robot("rr1")).with_obstacle("rod", rp.Capsule(0.01, 0.4))
    scene = rod.attach("rod", "arm", touch=rp.load_robot("rr1").link_names[-3:], pose=pose([0.0, 0.0, 0.05]))
    scene = scene.with_obstacle("ground", rp.HalfSpace((0, 0, 1), -0.3)).with_obstacle("cloud", cloud)
    hull = rp.load_scene("rr1_cluttered").obstacles
    for name, obstacle in hull.items():
        scene = scene.with_obstacle(name, obstacle.geometries[0].shape, obstacle.pose)
    yield scene.with_padding(0.005)
    yield rp.load_scene("rr1_pair")
    yield rp.load_scene("planar2r_path")


def main() -> int:
    checked = load_file(Path(sys.argv[1]))
    asked = 0
    for scene in scenes():
        checker = CollisionChecker(scene)
        cover, _ = build_cover(checker, checker.tables, 1e-6)
        one, other = (
            EdgeKernel(cover, checker.tables, checker.nq, 1e-6, library) for library in (checked, load_library())
        )
        rng = np.random.default_rng(1)
        for q in rng.uniform(-2.0, 2.0, (60, checker.nq)):
            step = rng.normal(size=checker.nq) * rng.choice([0.0, 0.1, 0.6])
            curve = np.array([q, step, rng.normal(size=checker.nq) * 0.1])
            asked += 1
            if one.certify_edge(q, q + step) != other.certify_edge(q, q + step):
                return 1
            if one.certify_parabola(curve, 1.0) != other.certify_parabola(curve, 1.0):
                return 2
            if asked % 6 == 0 and one.certify_curve(curve, 1.0) != other.certify_curve(curve, 1.0):
                return 3
    sys.stdout.write(f"same answers to {asked} questions\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
