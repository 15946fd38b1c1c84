"""SRDF: groups of joints, named states, end effectors and pairs of links that need no check.

A strict reader: a value that is not a number or a group that contains itself is an error with file and line. Links and
joints that the robot does not have, undefined groups and a different robot name are ignored with a warning: many files
serve several variants of a robot.
"""

from __future__ import annotations

import logging
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from rr1plan.files.xml_reader import Element, parse_document
from rr1plan.robot import Joint
from rr1plan.robot.urdf import Tree, refuse_xacro

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class EndEffector:
    """A gripper: its group, the link that it is mounted on and the group of the arm that carries it."""

    name: str
    group: str
    parent_link: str
    parent_group: str | None = None


@dataclass(frozen=True)
class Semantics:
    """Content of an SRDF.

    Args:
        groups: Names of the movable joints of each group, in the robot's order.
        chains: (base link, tip link) of each group that is one chain.
        states: Joint values of each named state, by group ("" if the file names none) and state.
        end_effectors: The grippers.
        passive: Passive joints.
        disabled: Pairs of links with disabled collision checks.
        default_positions: Values of joints that are not planned for (default: zero, or the limit nearest to it).
        is_partial: Whether neighbors and links that always touch need no check either, although `disabled` omits them.
    """

    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    chains: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    states: Mapping[tuple[str, str], Mapping[str, float]] = field(default_factory=dict)
    end_effectors: tuple[EndEffector, ...] = ()
    passive: frozenset[str] = frozenset()
    disabled: frozenset[frozenset[str]] = frozenset()
    default_positions: Mapping[str, float] = field(default_factory=dict)
    is_partial: bool = False


def read_srdf(source: str | bytes | Path, tree: Tree) -> Semantics:
    """Read an SRDF.

    Args:
        source: A file's path, or the document itself: bytes, or text starting with "<".
        tree: The robot that it describes.

    Raises:
        FormatError: a duplicate group or one that contains itself, a value that is not a number, a macro of xacro, or
            malformed XML.
    """
    root = parse_document(source, "robot")
    refuse_xacro(root, "if you trust it, write what the command xacro makes of it to a file .srdf")
    if root.text("name") != tree.name:
        log.warning("%s is for the robot %r, the URDF's is %r", root.file or "SRDF", root.text("name"), tree.name)
    return _Reader(root, tree).read()


def joined_semantics(srdf: Semantics, mjcf: Semantics) -> Semantics:
    """The content of an SRDF, with the configurations and excluded pairs of the MJCF file."""
    return replace(
        srdf,
        groups=srdf.groups or mjcf.groups,
        chains=srdf.chains if srdf.groups else mjcf.chains,
        states={**mjcf.states, **srdf.states},
        disabled=srdf.disabled | mjcf.disabled,
        default_positions=mjcf.default_positions,
        is_partial=not srdf.disabled,
    )


def chain_joints(joints: Sequence[Joint], base: str, tip: str) -> tuple[str, ...]:
    """Names of the joints between two links, up from the base to the link above both, then down to the tip."""
    above = {joint.child: joint for joint in joints}

    def to_root(link: str) -> list[str]:
        names = []
        while link in above:
            names.append(above[link].name)
            link = above[link].parent
        return names

    up, down = to_root(base), to_root(tip)
    shared = set(up) & set(down)
    return (*(n for n in up if n not in shared), *(n for n in reversed(down) if n not in shared))


class _Reader:
    """Reads one document against one robot."""

    def __init__(self, root: Element, tree: Tree) -> None:
        self.root = root
        self.tree = tree
        self.links = {link.name for link in tree.links}
        self.joints = {joint.name: joint for joint in tree.joints}
        self.above = {joint.child: joint for joint in tree.joints}
        self.order = [joint.name for joint in tree.joints if joint.kind != "fixed"]
        self.groups = self._group_elements()
        self.virtual = {e.attributes.get("name") for e in root.all("virtual_joint")}
        self.strange: dict[tuple[str, str], int] = {}

    def read(self) -> Semantics:
        semantics = Semantics(
            groups=self._members(),
            chains=self._chains(),
            states=self._states(),
            end_effectors=self._end_effectors(),
            passive=frozenset(e.text("name") for e in self.root.all("passive_joint") if self._has_joint(e)),
            disabled=self._disabled(),
        )
        if self.strange:
            listed = ", ".join(f"{kind} {name!r} (line {line})" for (kind, name), line in self.strange.items())
            log.warning("%s: there is no %s; passed over", self.root.file or "SRDF", listed)
        return semantics

    # ---- names -------------------------------------------------------------------------

    def _has_link(self, element: Element, attribute: str) -> bool:
        return self._has(element, attribute, "link", self.links)

    def _has_joint(self, element: Element) -> bool:
        return self._has(element, "name", "joint", self.joints)

    def _has(self, element: Element, attribute: str, kind: str, known: Container[str]) -> bool:
        """Whether the link, joint or group in an attribute exists; missing ones are recorded."""
        name = element.text(attribute)
        if name not in known and not (kind == "joint" and name in self.virtual):
            self.strange.setdefault((kind, name), element.line)
        return name in known

    def _has_group(self, element: Element, attribute: str) -> bool:
        return self._has(element, attribute, "group", self.groups)

    # ---- groups ------------------------------------------------------------------------

    def _group_elements(self) -> dict[str, Element]:
        found: dict[str, Element] = {}
        for element in self.root.all("group"):
            name = element.text("name")
            if name in found:
                raise element.error(f"group {name!r} is there twice, first in line {found[name].line}")
            found[name] = element
        return found

    def _members(self) -> dict[str, tuple[str, ...]]:
        """The movable joints of each group, including those of its subgroups."""
        inner = {
            n: [e.text("name") for e in group.all("group") if self._has_group(e, "name")]
            for n, group in self.groups.items()
        }
        found: dict[str, set[str]] = {}
        try:
            for name in TopologicalSorter(inner).static_order():
                found[name] = self._own_members(self.groups[name]).union(*(found[sub] for sub in inner[name]))
        except CycleError as error:
            name = error.args[1][0]
            raise self.groups[name].error(f"group {name!r} contains itself") from error
        return {name: tuple(n for n in self.order if n in found[name]) for name in self.groups}

    def _own_members(self, group: Element) -> set[str]:
        """The movable joints of a group, without those of its subgroups."""
        joints = {e.text("name") for e in group.all("joint") if self._has_joint(e)}
        links = [e.text("name") for e in group.all("link") if self._has_link(e, "name")]
        joints |= {self.above[name].name for name in links if name in self.above}
        for chain in group.all("chain"):
            if self._has_chain(chain):
                joints |= set(chain_joints(self.tree.joints, chain.text("base_link"), chain.text("tip_link")))
        return {n for n in joints if self.joints[n].kind != "fixed"}

    def _has_chain(self, chain: Element) -> bool:
        ends = [self._has_link(chain, end) for end in ("base_link", "tip_link")]
        return all(ends)

    def _chains(self) -> dict[str, tuple[str, str]]:
        found = {}
        for name, group in self.groups.items():
            chains = list(group.all("chain"))
            if len(chains) == 1 and len(group.children) == 1 and self._has_chain(chains[0]):
                found[name] = (chains[0].text("base_link"), chains[0].text("tip_link"))
        return found

    # ---- the rest ----------------------------------------------------------------------

    def _states(self) -> dict[tuple[str, str], dict[str, float]]:
        found: dict[tuple[str, str], dict[str, float]] = {}
        for element in self.root.all("group_state"):
            if "group" in element.attributes and not self._has_group(element, "group"):
                continue
            group = element.attributes.get("group", "")
            key = (group, element.text("name"))
            if key in found:
                raise element.error(f"state {key[1]!r} of group {key[0]!r} is there twice")
            joints = [e for e in element.all("joint") if self._has_joint(e)]
            movable = [e for e in joints if self.joints[e.text("name")].kind != "fixed"]
            found[key] = {e.text("name"): e.number("value") for e in movable}
        return found

    def _end_effectors(self) -> tuple[EndEffector, ...]:
        found = []
        for element in self.root.all("end_effector"):
            known = [self._has_group(element, "group"), self._has_link(element, "parent_link")]
            carried = "parent_group" in element.attributes and self._has_group(element, "parent_group")
            carrier = element.text("parent_group") if carried else None
            if all(known):
                link = element.text("parent_link")
                found.append(EndEffector(element.text("name"), element.text("group"), link, carrier))
        return tuple(found)

    def _disabled(self) -> frozenset[frozenset[str]]:
        """Pairs of links disabled by default, plus disabled pairs, minus pairs enabled again."""
        off = {e.text("link") for e in self.root.all("disable_default_collisions") if self._has_link(e, "link")}
        pairs = {frozenset((a, b)) for a in off for b in self.links if a != b}
        return frozenset((pairs | self._pairs("disable_collisions")) - self._pairs("enable_collisions"))

    def _pairs(self, tag: str) -> set[frozenset[str]]:
        """The pairs of the robot's links in all elements of a tag."""
        found = set()
        for element in self.root.all(tag):
            a, b = element.text("link1"), element.text("link2")
            if a == b:
                raise element.error(f"<{tag}> names the link {a!r} twice, expected two links")
            if all([self._has_link(element, "link1"), self._has_link(element, "link2")]):
                found.add(frozenset((a, b)))
        return found
