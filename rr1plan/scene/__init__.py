"""Scenes: placed arms, obstacles, attached objects, allowed contacts. Immutable.

Elements are named "arm/link" for links, and by a plain name (no slash) for obstacles and attached
objects. An allowed pair is a pair of such names; an arm's name stands for all its links.
"""

from rr1plan.scene.scene import Scene
from rr1plan.scene.scene_differences import scene_differences
from rr1plan.scene.scene_elements import Arm, Attachment, Obstacle, Pair, pair

__all__ = ["Arm", "Attachment", "Obstacle", "Pair", "Scene", "pair", "scene_differences"]
