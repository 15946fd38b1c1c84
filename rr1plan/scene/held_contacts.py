"""What to do about a held object that rests on an obstacle, which is a collision until it is allowed."""

from __future__ import annotations

from rr1plan.scene.content import SceneContent

# A held object that overlaps an obstacle by no more than this [m] rests on it.
_RESTS = 1e-3
# How much higher than its support an object has to be held [m].
_LIFT = 5e-4


def resting_advice(scene: SceneContent, a: str, b: str, gap: float) -> str:
    """How a held object that touches its support is allowed to or lifted; empty for any other contact.

    Args:
        scene: The scene.
        a: An element.
        b: Another one, nearer to it than their padding.
        gap: Their distance [m], negative where they overlap.
    """
    held, support = (a, b) if a in scene.attachments else (b, a)
    if held not in scene.attachments or support not in scene.obstacles or abs(gap) > _RESTS:
        return ""
    lift = 1000.0 * (scene.padding_of(a, b) - gap + _LIFT)
    return (
        f"the held {held!r} rests on {support!r}: allow the pair, which is then not checked "
        f'(scene.allow({held!r}, {support!r}), in a scene file allowed = [["{held}", "{support}"]]), or hold '
        f"{held!r} {lift:.3g} mm higher (its pose before scene.attach, in a scene file that of "
        f"[attachments.{held}])"
    )
