"""Samples of self-contacts when a robot is loaded: equal to a slow, plain version, and computed once."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path

import coal
import numpy as np
import pytest

import rr1plan as rp
from rr1plan.robot import Robot, self_contacts
from rr1plan.robot.disabled_collisions import free_configuration, touching_links
from rr1plan.robot.link_contacts import LinkBodies, coal_solid


def touching_plainly(robot: Robot, q: np.ndarray) -> set[frozenset[str]]:
    """Pairs of links that touch, each pair of shapes compared."""
    poses, found = robot.link_poses(q), set()
    for one, other in combinations([link for link in robot.links if link.collisions], 2):
        for a in one.collisions:
            for b in other.collisions:
                at, bt = (poses[link.name] @ g.pose for link, g in ((one, a), (other, b)))
                placed = [coal.Transform3s(T[:3, :3], T[:3, 3]) for T in (at, bt)]
                shapes = coal_solid(a.shape), coal_solid(b.shape)
                result = coal.CollisionResult()
                if coal.collide(shapes[0], placed[0], shapes[1], placed[1], coal.CollisionRequest(), result):
                    found.add(frozenset((one.name, other.name)))
    return found


def test_touching_links_are_those_that_touch_pair_by_pair(rr1: Robot) -> None:
    bodies = LinkBodies(rr1)
    rng = np.random.default_rng(0)
    seen = set()
    for q in rng.uniform(rr1.limits.lower, rr1.limits.upper, (25, rr1.nq)):
        found = bodies.touching(rr1.joint_values(q), bodies.pairs)
        assert found == touching_plainly(rr1, q)
        seen |= found
    assert len(seen) > 5


@pytest.mark.parametrize("srdf", [None, False])
def test_a_robot_that_took_long_is_not_sampled_again(
    srdf: bool | None, own_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(self_contacts, "_WORTH_KEEPING", np.inf)
    first = rp.load_robot("rr1", srdf=srdf)
    assert not own_cache.exists()
    monkeypatch.setattr(self_contacts, "_WORTH_KEEPING", 0.0)
    assert rp.load_robot("rr1", srdf=srdf).content_hash == first.content_hash
    (file,) = own_cache.iterdir()
    sample = self_contacts._sampled
    monkeypatch.setattr(self_contacts, "_sampled", lambda *_: pytest.fail("sampled again"))
    kept = rp.load_robot("rr1", srdf=srdf)
    assert kept.content_hash == first.content_hash
    assert kept.home.tolist() == first.home.tolist()
    np.savez(file, always=np.array([[0, 99]]), home=first.home, at_home=np.zeros((0, 2), np.int64))
    monkeypatch.setattr(self_contacts, "_sampled", sample)
    assert rp.load_robot("rr1", srdf=srdf).content_hash == first.content_hash


def test_a_pair_that_touches_at_home_is_checked_though_locked_joints_hold_others_together(tmp_path: Path) -> None:
    box = "<collision><origin xyz='0.2 0 0'/><geometry><box size='0.3 0.05 0.05'/></geometry></collision>"
    limit = "<limit lower='-2' upper='2' velocity='1' effort='1'/>"
    joints = "".join(
        f"<link name='{name}'>{box}</link><joint name='{name}_joint' type='revolute'><parent link='base'/>"
        f"<child link='{name}'/><origin xyz='0 0 {height}'/><axis xyz='0 0 1'/>{limit}</joint>"
        for name, height in (("arm", 0.07), ("left", 0.0), ("right", 0.03))
    )
    (tmp_path / "body.urdf").write_text(f"<robot name='body'><link name='base'/>{joints}</robot>")
    robot = rp.load_robot(tmp_path / "body.urdf", joints=["arm_joint"])
    checker = rp.CollisionChecker(rp.Scene().with_arm("body", robot))
    assert checker.pairs == (("body/arm", "body/left"), ("body/arm", "body/right"))
    assert not checker.is_free([0.0])
    assert checker.is_free(robot.home)
    # Where no configuration is free, the one with the fewest contacts is taken.
    unruled, bodies = replace(robot, disabled_collisions=frozenset()), LinkBodies(robot)
    assert touching_links(unruled, np.zeros(1), bodies) >= {frozenset(("arm", "right")), frozenset(("left", "right"))}
    home = free_configuration(unruled, np.zeros(1), bodies)
    assert touching_links(unruled, home, bodies) == {frozenset(("left", "right"))}
