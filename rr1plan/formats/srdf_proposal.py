"""Pairs of links that need no check, for robots without an SRDF."""

from __future__ import annotations

from collections.abc import Sequence

from rr1plan.robot import Joint

Pairs = frozenset[frozenset[str]]


def rigid_pairs(joints: Sequence[Joint]) -> Pairs:
    """Pairs of links whose relative pose never changes: a check could tell nothing new."""
    body: dict[str, list[str]] = {}
    for joint in joints:
        members = body.setdefault(joint.parent, [joint.parent])
        if joint.kind == "fixed":
            members.append(joint.child)
            body[joint.child] = members
    return frozenset(frozenset((a, b)) for members in body.values() for a in members for b in members if a != b)


def adjacent_pairs(joints: Sequence[Joint]) -> Pairs:
    """Pairs of links that a joint joins."""
    return frozenset(frozenset((joint.parent, joint.child)) for joint in joints)
