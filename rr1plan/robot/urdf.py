"""URDF: a strict reader of links, joints and shapes.

Errors that lenient parsers ignore or repair silently (a box of size NaN, a zero axis, inverted limits, an unknown mimic
joint) raise an error with file, line and name. Defects that do not affect kinematics or collision cause warnings: a
visual shape or color, a physically impossible inertia, a mobile base. Elements that do not describe the arm
(transmission, gazebo, sensor, ...) are skipped.

Beyond URDF 1.0 the reader supports `<capsule radius length>` (the length of the segment, without the round ends) and
`<origin quat_xyzw>` of version 1.1, and `<limit acceleration deceleration jerk>` of version 1.2, like urdfdom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rr1plan.checks import known_name
from rr1plan.files.xml_reader import Element, parse_document
from rr1plan.robot import Joint, Link
from rr1plan.robot.gltf_axes import with_fitting_axes
from rr1plan.robot.mesh_lookup import MeshLookup
from rr1plan.robot.urdf_joints import read_joint, with_constant_joints_fixed
from rr1plan.robot.urdf_links import UrdfLinkReader
from rr1plan.shapes.convex_decomposition import CONVEXITIES, Convexity

# All pairs of links are compared.
MAX_LINKS = 1000


@dataclass(frozen=True, eq=False)
class Tree:
    """Content of a URDF: a tree of links, before planning joints are chosen.

    Args:
        name: The robot's name.
        links: All links, the root first, depth first, siblings by the name of their joint.
        joints: The joint above each link but the root, in the same order.
        source: Origin of the document, for messages.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    source: str = ""


def read_urdf(
    source: str | bytes | Path,
    *,
    package_dirs: Sequence[str | Path] = (),
    convex: Convexity = "hull",
    file: str | Path | None = None,
) -> Tree:
    """Read a URDF.

    Args:
        source: A file's path, or the document itself: bytes, or text starting with "<".
        package_dirs: Folders in which to search for `package://` meshes first.
        convex: Replacement of non-convex collision meshes: their "hull", or convex "pieces".
        file: Origin of a document given as text: meshes are searched beside it.

    Raises:
        FormatError: not a valid description of a tree of links.
        UnknownNameError: an unknown `convex`.
    """
    known_name("convex", convex, CONVEXITIES)
    root = parse_document(source, "robot", file)
    name = root.text("name")
    refuse_xacro(root, "if you trust it, name the file .xacro, or set option xacro_arguments")
    link_elements = _by_name(root, "link")
    joint_elements = _by_name(root, "joint")
    if not link_elements:
        raise root.error(f"robot {name!r} has no link")
    if len(link_elements) > MAX_LINKS:
        raise root.error(f"robot {name!r} has {len(link_elements)} links, expected at most {MAX_LINKS}")
    joints = {n: read_joint(e) for n, e in joint_elements.items()}
    _check_mimics(joint_elements, joints)
    joints = with_constant_joints_fixed(joint_elements, joints)
    order = _order(root, link_elements, joint_elements, joints)
    reader = UrdfLinkReader(root, MeshLookup(package_dirs, root.file), convex)
    base = (set(link_elements) - {j.child for j in order}).pop()
    source = root.file or name
    links = [reader.link(link_elements[n]) for n in (base, *(j.child for j in order))]
    return Tree(name, tuple(with_fitting_axes(links, reader.gltf, source)), tuple(order), source)


def refuse_xacro(root: Element, advice: str) -> None:
    """Reject a document with macros, which a reader would skip.

    Args:
        root: The document.
        advice: How to expand them, for the message.

    Raises:
        FormatError: an element of xacro.
    """
    waiting = [root]
    while waiting:
        element = waiting.pop()
        if element.tag.startswith("xacro:"):
            raise element.error(f"<{element.tag}> has to be expanded first; {advice}")
        waiting.extend(reversed(element.children))


def _by_name(root: Element, tag: str) -> dict[str, Element]:
    """The elements of a tag by their name; a duplicate name is an error."""
    found: dict[str, Element] = {}
    for element in root.all(tag):
        name = element.text("name")
        if name in found:
            raise element.error(f"{tag} {name!r} is there twice, first in line {found[name].line}")
        found[name] = element
    return found


def _order(
    root: Element, links: dict[str, Element], elements: dict[str, Element], joints: dict[str, Joint]
) -> list[Joint]:
    """The joints from the root on, depth first, siblings by name (Pinocchio's order)."""
    parents: dict[str, str] = {}
    for name, joint in joints.items():
        element = elements[name]
        for role in ("parent", "child"):
            if getattr(joint, role) not in links:
                raise element.error(f"joint {name!r} has the unknown {role} link {getattr(joint, role)!r}")
        if joint.child in parents:
            raise element.error(f"link {joint.child!r} has two parents: joints {parents[joint.child]!r} and {name!r}")
        parents[joint.child] = name
    bases = [name for name in links if name not in parents]
    if len(bases) > 1:
        raise links[bases[1]].error(f"several links have no parent, expected one base: {', '.join(bases)}")
    below: dict[str, list[Joint]] = {name: [] for name in links}
    for name in sorted(joints, reverse=True):
        below[joints[name].parent].append(joints[name])
    order: list[Joint] = []
    waiting = list(below[bases[0]]) if bases else []
    while waiting:
        order.append(waiting.pop())
        waiting.extend(below[order[-1].child])
    missing = set(joints) - {j.name for j in order}
    if missing or not bases:
        raise root.error(f"the joints {', '.join(sorted(missing))} form a cycle")
    return order


def _check_mimics(elements: dict[str, Element], joints: dict[str, Joint]) -> None:
    """Require that every chain of mimic joints ends at an independent movable joint."""
    for name, joint in joints.items():
        seen = [name]
        while joint.mimic is not None:
            leader = joint.mimic.joint
            if leader not in joints:
                raise elements[joint.name].error(f"joint {joint.name!r} mimics the unknown joint {leader!r}")
            if leader in seen:
                raise elements[name].error(f"joints mimic each other in a circle: {', '.join([*seen, leader])}")
            if joints[leader].kind == "fixed":
                raise elements[joint.name].error(f"joint {joint.name!r} mimics {leader!r}, which is fixed")
            seen.append(leader)
            joint = joints[leader]
