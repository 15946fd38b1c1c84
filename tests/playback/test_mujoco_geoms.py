"""Bounding spheres of meshes in MuJoCo models."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.simulation.mujoco_geoms import shrink_bounding_spheres
from rr1plan.playback.simulation.mujoco_model import build_mujoco
from rr1plan.robot import Geometry
from rr1plan.scene import Obstacle
from rr1plan.shapes import Box, HalfSpace
from rr1plan.shapes.convex_hulls import convex_hull
from rr1plan.transforms import identity, pose


@pytest.fixture
def heap() -> rp.Scene:
    """Wedges and a box, each with room, above a floor and beside a Panda, whose collision shapes are meshes."""
    corners = [(x, y, z) for x in (-0.1, 0.3) for y in (-0.05, 0.1) for z in (-0.1, 0.05) if x < 0.0 or z < 0.0]
    wedge = Obstacle((Geometry("wedge", convex_hull(np.array(corners)), identity()),), mass=0.2)
    scene = rp.Scene().with_obstacle("floor", HalfSpace()).with_arm("arm", rp.load_robot("panda"))
    wedges = {f"wedge{i}": replace(wedge, pose=pose([1.0 + i, 0.0, 1.0])) for i in range(6)}
    return scene.with_obstacle("box", Box((0.2, 0.1, 0.1)), pose([1.0, -1.0, 1.0]), mass=0.3).with_obstacles(wedges)


def test_contacts_do_not_depend_on_bounding_spheres(heap: rp.Scene) -> None:
    world, large = build_mujoco(heap), build_mujoco(heap).model
    model = world.model
    shrink_bounding_spheres(model)
    rng, data, expected, found = np.random.default_rng(0), mujoco.MjData(model), mujoco.MjData(large), 0
    for _ in range(200):
        data.qpos[:] = large.qpos0
        bodies = data.qpos[len(world.joint_names) :].reshape(-1, 7)
        bodies[:, :3] = rng.uniform([-0.4, -0.4, 0.0], [0.4, 0.4, 0.6], (len(bodies), 3))
        bodies[:, 3:] = rng.normal(size=(len(bodies), 4))
        expected.qpos[:] = data.qpos
        for m, d in ((model, data), (large, expected)):
            mujoco.mj_forward(m, d)
        np.testing.assert_array_equal(data.contact.geom, expected.contact.geom)
        np.testing.assert_array_equal(data.contact.dist, expected.contact.dist)
        np.testing.assert_array_equal(data.qacc, expected.qacc)
        found += data.ncon
    assert found > 1000


def test_bounding_spheres_of_meshes_touch_their_farthest_vertices(heap: rp.Scene) -> None:
    model, meshes = rp.Simulation(heap).model, 0
    boxes = np.linalg.norm(np.abs(model.geom_aabb[:, :3]) + model.geom_aabb[:, 3:], axis=1)
    for i in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        first = model.mesh_vertadr[model.geom_dataid[i]]
        vertices = model.mesh_vert[first : first + model.mesh_vertnum[model.geom_dataid[i]]]
        farthest = np.linalg.norm(vertices.astype(float), axis=1).max()
        assert farthest < model.geom_rbound[i] < 1.00001 * farthest
        assert model.geom_rbound[i] < boxes[i]
        meshes += 1
    assert meshes > 10


def test_other_shapes_keep_their_bounding_spheres(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", rr1, pose([0.0, 0.0, 0.2])).with_obstacle("floor", HalfSpace())
    model = build_mujoco(scene).model
    before = model.geom_rbound.copy()
    shrink_bounding_spheres(model)
    np.testing.assert_array_equal(model.geom_rbound, before)
