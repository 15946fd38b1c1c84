"""What a motion looks like: replay in MuJoCo, the 3-D page, pictures of the configuration space.

Names are loaded on first use: MuJoCo, Meshcat and Matplotlib stay out until they are needed.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rr1plan.playback.configuration_space import CSpace as CSpace
    from rr1plan.playback.configuration_space import cspace as cspace
    from rr1plan.playback.export import save_mjcf as save_mjcf
    from rr1plan.playback.export import save_rosbag as save_rosbag
    from rr1plan.playback.replay import Replay as Replay
    from rr1plan.playback.simulation import simulate as simulate
    from rr1plan.playback.viewer import Panel as Panel
    from rr1plan.playback.viewer import Viewer as Viewer
    from rr1plan.playback.viewer import pack as pack
    from rr1plan.playback.viewer import save_html as save_html
    from rr1plan.playback.viewer import screenshot as screenshot
    from rr1plan.playback.viewer import show as show

_EXPORTS = {
    "rr1plan.playback.configuration_space": ("CSpace", "cspace"),
    "rr1plan.playback.export": ("save_mjcf", "save_rosbag"),
    "rr1plan.playback.replay": ("Replay",),
    "rr1plan.playback.simulation": ("simulate",),
    "rr1plan.playback.viewer": ("Panel", "Viewer", "pack", "save_html", "screenshot", "show"),
}
_HOME = {name: module for module, names in _EXPORTS.items() for name in names}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Load a public name on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'rr1plan.playback' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """All public names, loaded or not."""
    return sorted(__all__)
