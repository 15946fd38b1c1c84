"""The convex solids of a scene, and which pairs of them are checked.

Its parts are shared: what the arms carry by all scenes with the same arms, an obstacle by all scenes that have it at
the same place, the pairs by all scenes that differ only in where things are. A layout knows no padding, so scenes that
differ in that alone share it as a whole.
"""

from __future__ import annotations

from functools import cached_property

from rr1plan.collision.carried import Solid, carried_by
from rr1plan.collision.pairs import solid_pairs
from rr1plan.collision.standing import standing_of
from rr1plan.model import SceneModel


class Layout:
    """The solids of a scene and the pairs of them that must not touch.

    Args:
        model: The scene's model.

    Attributes:
        carried: Solids of links and held objects.
        standing: Those of each obstacle.
        pairs: Which of them must not touch.

    Raises:
        InputError: a shape that cannot be made solid.
    """

    def __init__(self, model: SceneModel) -> None:
        scene = model.scene
        self.carried = carried_by(model)
        self.standing = tuple(standing_of(name, thing) for name, thing in scene.obstacles.items())
        self.pairs = solid_pairs(self.carried, self.standing, scene.contact_rules)

    @cached_property
    def solids(self) -> tuple[Solid, ...]:
        """All solids: those that are carried, then those that stand."""
        return self.carried.solids + tuple(solid for thing in self.standing for solid in thing.solids)


def layout_of(model: SceneModel) -> Layout:
    """The layout of a scene and its moving arms, which is kept with the scene."""
    kept = model.scene.kept_for_any_padding
    found = kept.get(("layout", model.arms))
    if not isinstance(found, Layout):
        found = kept["layout", model.arms] = Layout(model)
    return found
