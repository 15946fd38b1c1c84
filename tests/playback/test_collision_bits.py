"""Collision bits of models of many arms, against excluded pairs of bodies."""

from __future__ import annotations

from itertools import combinations

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.playback.simulation import collision_bits as bits_module
from rr1plan.playback.simulation import mujoco_model
from rr1plan.playback.simulation.collision_bits import OTHERS, collision_bits, products_of
from rr1plan.playback.simulation.mujoco_model import MujocoScene, build_mujoco
from rr1plan.transforms import pose

PAIRS = list(combinations("abcdefg", 2))


@given(st.lists(st.sampled_from(PAIRS), unique=True))
def test_products_cover_the_pairs_and_no_others(pairs: list[tuple[str, str]]) -> None:
    covered = {frozenset((a, b)) for one, other in products_of(pairs) for a in one for b in other}
    assert covered == set(map(frozenset, pairs))


@pytest.fixture(scope="module")
def crowd() -> rp.Scene:
    """RR1 and Pandas so near each other that they touch in most configurations, two of which may, and other things."""
    robots = [rp.load_robot(name) for name in ("rr1", "panda")]
    arms = {f"r{i}": rp.Arm(robots[i % 3 == 0], pose([0.45 * (i % 5), 0.45 * (i // 5), 0.0])) for i in range(20)}
    scene = rp.Scene(arms=arms).with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), -0.02))
    scene = scene.with_obstacle("post", rp.Cylinder(0.05, 1.0), [0.2, 0.2, 0.5])
    scene = scene.with_obstacle("ball", rp.Sphere(0.1), [0.7, 0.6, 0.4], mass=0.2)
    scene = scene.with_obstacle("rod", rp.Box((0.02, 0.02, 0.4)), [0.5, 0.0, 0.6], mass=0.1).attach("rod", "r1")
    return scene.allow("r7", "r8").allow("r3", "post")


def contacts(world: MujocoScene, count: int) -> list[list[tuple[str, str]]]:
    """Pairs of shapes that touch in random configurations."""
    data, rng = mujoco.MjData(world.model), np.random.default_rng(0)
    joints = len(world.joint_names)
    found = []
    for _ in range(count):
        data.qpos[:] = world.model.key_qpos[0]
        data.qpos[:joints] += rng.uniform(-1.5, 1.5, joints)
        mujoco.mj_kinematics(world.model, data)
        mujoco.mj_comPos(world.model, data)
        mujoco.mj_collision(world.model, data)
        pairs = (sorted(world.model.geom(geom).name for geom in pair) for pair in data.contact.geom[: data.ncon])
        found.append(sorted((a, b) for a, b in pairs))
    return found


@pytest.mark.parametrize(("own", "colors", "count"), [(8, 21, 20), (8, 3, 4), (1, 21, 12)])
def test_bits_leave_out_what_exclusions_do(
    crowd: rp.Scene, monkeypatch: pytest.MonkeyPatch, own: int, colors: int, count: int
) -> None:
    """A Panda takes two bits, as does an RR1 that holds a rod; arms without bits have excluded pairs."""
    monkeypatch.setattr(bits_module, "_OWN", own)
    monkeypatch.setattr(bits_module, "_COLORS", colors)
    assert len({crowd.owner(element) for element in collision_bits(crowd)}) == count
    found = build_mujoco(crowd)
    monkeypatch.setattr(mujoco_model, "_MANY", 100)
    expected = build_mujoco(crowd)
    assert found.model.nexclude < expected.model.nexclude
    touching = contacts(expected, 8)
    assert contacts(found, 8) == touching
    pairs = [tuple(expected.scene.owner(name.split("#")[0]) for name in pair) for state in touching for pair in state]
    assert any(a == b is not None for a, b in pairs)
    assert any(a is not None and b is not None and a != b for a, b in pairs)
    assert any("rod" in name for state in touching for pair in state for name in pair)


def test_arms_that_can_meet_have_different_colors_and_others_share_one(rr1: rp.Robot) -> None:
    far = rp.Scene(arms={f"r{i}": rp.Arm(rr1, pose([5.0 * i, 0.0, 0.0])) for i in range(3)})
    near = rp.Scene(arms={f"r{i}": rp.Arm(rr1, pose([0.5 * i, 0.0, 0.0])) for i in range(3)})
    hands = [[collision_bits(scene)[f"r{i}/hand_link"] for i in range(3)] for scene in (far, near)]
    assert len(set(hands[0])) == 1
    assert len(set(hands[1])) == 3
    assert all(affinity & OTHERS and not contype & OTHERS for contype, affinity in hands[0] + hands[1])
