"""A scene: placed arms, obstacles, what the arms hold, and what may touch what. Immutable.

Names. An arm's link is "arm/link", an obstacle or an attached object is its own name (no
slash). A pair that may touch is a pair of such names; a whole arm's name stands for all its links.
"""

from rr1plan.scene.differences import scene_differences
from rr1plan.scene.elements import Arm, Attachment, Obstacle, Pair, pair
from rr1plan.scene.scene import Scene

__all__ = ["Arm", "Attachment", "Obstacle", "Pair", "Scene", "pair", "scene_differences"]
