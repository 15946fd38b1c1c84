"""Messages about collisions: the pairs in contact, their depths, and hints for held objects."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from rr1plan.checks import Array, millimeters
from rr1plan.collision import CollisionChecker, Contact
from rr1plan.files.toml_writer import toml_key, toml_text
from rr1plan.scene import Scene
from rr1plan.scene.held_contacts import allowed_entry, contact_advice

# Elements whose depth is below this [m] touch, rather than overlap: the resolution of the kernel and of Coal.
_TOUCH = 1e-6


def describe_collision(checker: CollisionChecker, q: Array, without: Collection[str] = ()) -> str:
    """Message about the contacts at a configuration, deepest first, with hints how to resolve them.

    Args:
        checker: Collision checker of the scene and its moving arms.
        q: Configuration in collision [rad or m], shape (nq,).
        without: Arms whose contacts are ignored.
    """
    contacts = contacts_without(checker, q, without)
    if not contacts:
        k = _nearest_to_contact(checker, q, without)
        (a, b), padding = checker.pairs[k], 1000.0 * checker.padding[k]
        where = "from contact" if padding == 0.0 else f"beyond the padding of {padding:.3g} mm"
        return f"{a!r} and {b!r} are less than a micrometer {where}, too near to prove any motion"
    said = [_describe(checker, contact) for contact in contacts[:3]]
    rest = len(contacts) - 3
    more = f" and {rest} more {'pair' if rest == 1 else 'pairs'}" if rest > 0 else ""
    advice = dict.fromkeys(text for contact in contacts for text in _advice(checker, contact))
    return "; ".join([", ".join(said) + more, *advice, *_touch_advice(checker, contacts)])


def contacts_without(checker: CollisionChecker, q: Array, arms: Collection[str]) -> Sequence[Contact]:
    """Contacts at q (nq,) that do not involve `arms`, deepest first."""
    owner = checker.scene.owner
    return [c for c in checker.contacts(q) if owner(c.a) not in arms and owner(c.b) not in arms]


def _nearest_to_contact(checker: CollisionChecker, q: Array, arms: Collection[str]) -> int:
    """Index of the pair with the least distance beyond its padding: kernels reject gaps below 1 µm, Coal does not."""
    scene = checker.scene
    counts = [scene.owner(a) not in arms and scene.owner(b) not in arms for a, b in checker.pairs]
    beyond = np.where(counts, checker.distances(q) - checker.padding, np.inf)
    return int(np.argmin(beyond))


def _gap(checker: CollisionChecker, contact: Contact) -> float:
    """Signed distance of the two elements of a contact [m], negative in penetration."""
    return _distance_to_keep(checker, contact) - contact.depth


def _distance_to_keep(checker: CollisionChecker, contact: Contact) -> float:
    """Padding of two elements [m], plus the margin if they move relative to each other."""
    rigid = (contact.a, contact.b) in checker.static_contacts
    return checker.scene.padding_of(contact.a, contact.b) + (0.0 if rigid else checker.margin)


def _describe(checker: CollisionChecker, contact: Contact) -> str:
    gap, both = _gap(checker, contact), f"{contact.a!r} and {contact.b!r}"
    if gap > _TOUCH:
        padding = _distance_to_keep(checker, contact)
        return f"{both} are {millimeters(gap)} apart, nearer than the padding of {millimeters(padding)}"
    return f"{both} touch" if gap > -_TOUCH else f"{both} overlap by {millimeters(-gap)}"


def _advice(checker: CollisionChecker, contact: Contact) -> Iterator[str]:
    """Hints for held objects that rest on an obstacle, for bases, and for links of locked joints."""
    scene = checker.scene
    advice = contact_advice(scene, contact.a, contact.b, _gap(checker, contact))
    if advice:
        yield advice
    if (contact.a, contact.b) not in checker.static_contacts:
        return  # a moving joint lies between them
    posed = _posed_arms(checker, contact)
    for arm in posed:
        yield (
            f"{arm!r} does not move in this problem: give it another configuration "
            f"(scene.with_configuration({arm!r}, ...), in a scene file q of [arms.{toml_key(arm)}])"
        )
    if posed:
        return
    if not {contact.a, contact.b} & (scene.obstacles.keys() | scene.attachments.keys()):
        yield from _locked_joints_advice(scene, contact)
    for link, support in ((contact.a, contact.b), (contact.b, contact.a)):
        if scene.owner(link) in scene.arms and link not in scene.attachments and support in scene.obstacles:
            yield (
                f"{link!r} does not move: if it stands on {support!r}, allow the pair, which is then not checked "
                f"(scene.allow({link!r}, {support!r}), in a scene file {allowed_entry([(link, support)])}), or move "
                "one of them"
            )


def _touch_advice(checker: CollisionChecker, contacts: Sequence[Contact]) -> Iterator[str]:
    """One hint for each held object that touches the hand."""
    scene = checker.scene
    touched: dict[str, list[str]] = {}
    for a, b in ((contact.a, contact.b) for contact in contacts):
        for held, other in ((a, b), (b, a)) if (a, b) in checker.static_contacts else ():
            if held in scene.attachments and scene.owner(other) == scene.attachments[held].arm:
                touched.setdefault(held, []).append(other.split("/", 1)[-1])
    for held, links in touched.items():
        yield (
            f"{held!r} touches the hand that holds it: name {'the link' if len(links) == 1 else 'the links'} with "
            f"scene.attach({held!r}, touch={links!r}), in a scene file touch = [{', '.join(map(toml_text, links))}] in "
            f"[attachments.{toml_key(held)}]"
        )


def _posed_arms(checker: CollisionChecker, contact: Contact) -> list[str]:
    """Arms that do not move in the problem and have a part in a contact whose place depends on their configuration."""
    found: list[str] = []
    for name in (contact.a, contact.b):
        arm = checker.scene.owner(name)
        if arm is None or arm in (*checker.arms, *found):
            continue
        base = checker.scene.arms[arm].robot.bodies[0]
        if name not in {f"{arm}/{link.name}" for link in base}:
            found.append(arm)
    return found


def _locked_joints_advice(scene: Scene, contact: Contact) -> Iterator[str]:
    """Hints for two links of one arm that only locked joints could separate."""
    arm = scene.owner(contact.a)
    if arm is not None and arm == scene.owner(contact.b):
        states = scene.arms[arm].robot.locked_joint_states
        example = repr(next(iter(states))) if states else "..."
        yield (
            f"no planned joint of {arm!r} separates them: set its locked joints (robot.with_locked_joints({example}), "
            "in a scene file locked_joints), or allow a pair that does not touch in the real robot"
        )
