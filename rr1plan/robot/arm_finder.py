"""The joints and the tool of an arm in a file that specifies neither: MJCF, or a URDF without an SRDF."""

from __future__ import annotations

import re
from collections.abc import Set

from rr1plan.robot import Joint
from rr1plan.robot.urdf import Tree

# Names of tool frames, the most specific first, without prefixes ("left/") and the endings "_site" and "_frame".
_TOOLS = (
    "tcp", "link_tcp", "hand_tcp", "tool_center_point", "pinch", "grip", "grasp", "gripper", "gripperframe", "ee",
    "eef", "end_effector", "attachment", "tool", "tool0", "ee_link", "flange",
)  # fmt: skip
# Joints that open and close a hand.
_GRIPPER = re.compile(r"finger|grip|jaw|claw|knuckle|thumb", re.IGNORECASE)


class ArmFinder:
    """Finds the arms in a tree: their hands, and the joints that lead there.

    Args:
        tree: The links and joints of all robots of the file.
        driven: The joints that have a motor; empty if the file does not specify them.
        sites: Links that are sites.

    Attributes:
        driven: The joints that an arm may consist of, initially those with a motor.
        moving: All joints that can move independently.
    """

    def __init__(self, tree: Tree, driven: Set[str] = frozenset(), sites: Set[str] = frozenset()) -> None:
        self.sites = sites
        self.above: dict[str, Joint] = {joint.child: joint for joint in tree.joints}
        self.below: dict[str, list[Joint]] = {}
        for joint in tree.joints:
            self.below.setdefault(joint.parent, []).append(joint)
        self.moving = {joint.name for joint in tree.joints if joint.kind != "fixed" and joint.mimic is None}
        self.driven = self.moving & driven if driven else self.moving
        self.reach: dict[str, int] = {}
        for joint in reversed(tree.joints):
            self.reach[joint.parent] = max(
                self.reach.get(joint.parent, 0), self.reach.get(joint.child, 0) + (joint.kind != "fixed")
            )

    def chain(self, link: str) -> list[Joint]:
        """The joints from the base to a link."""
        found: list[Joint] = []
        while link in self.above:
            found.append(self.above[link])
            link = found[-1].parent
        return found[::-1]

    def is_below(self, link: str, root: str) -> bool:
        """Whether a link is another one or a descendant of it."""
        return link == root or any(joint.parent == root for joint in self.chain(link))

    def named_tool(self, root: str) -> str | None:
        """The site or body of a robot that has a tool's name and is behind at least one driven joint."""
        found = []
        for place, name in enumerate(self.above):
            word = re.split(r"[/:]", name)[-1].lower()
            word = word.removesuffix("_site").removesuffix("_frame")
            is_site = name in self.sites
            if word not in _TOOLS or not (is_site or self.reach.get(name, 0) == 0) or not self.is_below(name, root):
                continue
            if any(joint.name in self.driven for joint in self.chain(name)):
                found.append((not is_site, _TOOLS.index(word), place, name))
        return min(found)[-1] if found else None

    def hand(self, root: str) -> str:
        """The last body of the arm: where fingers branch off, or the last one whose joint is not a gripper's."""
        link, passed = root, sum(joint.kind != "fixed" for joint in self.chain(root))
        while True:
            branches = [j for j in self.below.get(link, ()) if self.reach.get(j.child, 0) + (j.kind != "fixed") > 0]
            if not branches:
                return self._end(link)
            best = max(branches, key=lambda j: self.reach.get(j.child, 0) + (j.kind != "fixed"))
            ahead = self.reach.get(best.child, 0) + (best.kind != "fixed")
            if (len(branches) > 1 and passed >= ahead) or (best.kind != "fixed" and self._is_gripper(best)):
                return link
            passed += best.kind != "fixed"
            link = best.child

    def _end(self, link: str) -> str:
        """The end of the chain of single links below a link."""
        while len(branches := [j for j in self.below.get(link, ()) if j.child not in self.sites]) == 1:
            link = branches[0].child
        return link

    def _is_gripper(self, joint: Joint) -> bool:
        """Whether a joint and all joints below it belong to a gripper, judged by their names."""
        waiting, names = [joint], []
        while waiting:
            at = waiting.pop()
            waiting.extend(self.below.get(at.child, ()))
            names.extend([at.name] if at.kind != "fixed" else [])
        return all(_GRIPPER.search(name) for name in names)

    def arm_joints(self, tip: str) -> tuple[str, ...]:
        """The driven joints on the way to a tip, without those of a gripper at its end."""
        joints = [joint for joint in self.chain(tip) if joint.name in self.driven]
        while joints and self._is_gripper(joints[-1]):
            joints.pop()
        return tuple(joint.name for joint in joints)
