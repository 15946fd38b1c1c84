"""Hints for an attached object that rests on an obstacle, which counts as a collision until the pair is allowed."""

from __future__ import annotations

from collections.abc import Iterable

from rr1plan.files.toml_writer import toml_key, toml_text
from rr1plan.scene.scene_content import SceneContent

# Largest penetration of an attached object that rests on an obstacle [m].
_RESTS = 1e-3
# Clearance from its support at which an attached object is free [m].
_LIFT = 5e-4


def contact_advice(scene: SceneContent, a: str, b: str, gap: float) -> str:
    """Hint for an attached object in contact with its support; empty for any other contact.

    Args:
        scene: The scene.
        a: An element.
        b: Another one, closer than their padding.
        gap: Their signed distance [m], negative in penetration.
    """
    held, support = (a, b) if a in scene.attachments else (b, a)
    if held not in scene.attachments or support not in scene.obstacles or abs(gap) > _RESTS:
        return ""
    lift = 1000.0 * (scene.padding_of(a, b) - gap + _LIFT)
    return (
        f"the held {held!r} rests on {support!r}: allow the pair, which is then not checked "
        f"(scene.allow({held!r}, {support!r}), in a scene file {allowed_entry([(held, support)])}), or hold "
        f"{held!r} {lift:.3g} mm higher (its pose before scene.attach, in a scene file that of "
        f"[attachments.{toml_key(held)}])"
    )


def allowed_entry(pairs: Iterable[tuple[str, str]]) -> str:
    """The entry of a scene file that allows some pairs."""
    rows = ", ".join(f"[{toml_text(a)}, {toml_text(b)}]" for a, b in pairs)
    return f"allowed = [{rows}]"
