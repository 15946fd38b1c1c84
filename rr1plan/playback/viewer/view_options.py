"""Options of a page: title, first view, panels and layers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from types import MappingProxyType
from typing import Any

from numpy.typing import ArrayLike

from rr1plan.checks import Value, check_text, items_of, of_kind, shown, true_or_false, whole_number
from rr1plan.errors import InputError
from rr1plan.planning import SearchTree
from rr1plan.playback.viewer.camera import check_view
from rr1plan.trajectory import Trajectory


@dataclass(frozen=True)
class Panel:
    """Custom content next to the 3-D view, e.g. a picture of the configuration space.

    Args:
        name: A name unique on the page; letters, digits and "-".
        title: Headline of the panel.
        html: Content of the panel.
        css: Style rules, in which lengths in px grow with the window, as all texts of the page. They apply to the
            whole page, so begin selectors with "#panel-NAME", the element of the panel.
        script: JavaScript statements, run once with three names in scope: `viewer` (see `page/main.js` for its
            interface), `root` (the panel's element), `data`.
        data: Anything that JSON can represent, and numbers and arrays of NumPy; large arrays by `pack_array`.
        width: Width of the column of panels [px], in a small window.

    Raises:
        InputError: a name with other characters.
    """

    name: str
    title: str
    _: KW_ONLY
    html: str = ""
    css: str = ""
    script: str = ""
    data: Any = None
    width: int = 420

    def __post_init__(self) -> None:
        for name in ("name", "title", "html", "css", "script"):
            check_text(f"panel {name}", getattr(self, name))
        whole_number("panel width", self.width, 1, 10_000)
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9-]*", self.name):
            raise InputError(f"panel name is {shown(self.name)}, expected letters, digits and '-'")


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewOptions(Value):
    """Options of a page, the same for live pages and files.

    Args:
        title: Headline of the page (default: the scene's name).
        view: Initial view: a name ("front", "back", "left", "right", "top", "corner"), azimuth and elevation [rad], or
            a direction in world coordinates, shape (3,). None chooses a view that shows the motion; a planar arm next
            to its configuration space is shown from above.
        spheres: Show the spheres that contain each link and held object, with chips for each of their levels.
        panels: Panels next to the 3-D view, with different names.
        play: The motion runs from the start, unless the reader's system asks for reduced motion.
        planner: The page contains the planners' kernels and can plan by itself; this adds 0.3 MB, for twelve arms about
            1 MB.
        compare: Another motion of the same arms by its name, e.g. {"anytime": other.trajectory}: drawn as a ghost
            together with the motion of the page, with dashed curves, both on one clock.
        side_by_side: Show the motion to compare, and the simulated one of a replay, in pictures next to that of the
            page's motion, with the same camera; otherwise overlaid. A chip of the page (V) switches.
        tree: A search tree or roadmap (`PlanResult.tree`, `Roadmap.graph`), drawn as the paths of the tools; pages of a
            `MotionPlan` take that of their planner. Its columns are the joints of the arms of the page's problem, or of
            all arms.
        clearances: Sample the clearances along the motion at 120 instants (True) or not at all (False); None: as many
            as about 0.1 s of processor time allows, none for many arms.
        port: First port that a live page tries; the next free one is taken. 0: any port; None: 7000 or the next free
            port, shared by all live pages of the program.
        quiet: A live page neither prints its address, which is `Viewer.url`, nor opens a browser.

    Raises:
        UnknownNameError: no view of that name.
        InputError: a view that is not a direction, panels of the same name, more than one motion to compare, or an
            invalid port.
    """

    title: str | None = None
    view: str | ArrayLike | None = None
    spheres: bool = False
    panels: Sequence[Panel] = ()
    play: bool = True
    planner: bool = True
    compare: Mapping[str, Trajectory] = field(default_factory=dict)
    side_by_side: bool = False
    tree: SearchTree | None = None
    clearances: bool | None = None
    port: int | None = None
    quiet: bool = False

    def __post_init__(self) -> None:
        if self.title is not None:
            check_text("title", self.title)
        panels = items_of("panels", self.panels, "Panel")
        for panel in panels:
            of_kind("one of the panels", panel, Panel)
        names = [panel.name for panel in panels]
        if len(set(names)) != len(names):
            raise InputError(f"panels are named {names}, expected names unique on the page")
        object.__setattr__(self, "view", check_view(self.view))
        object.__setattr__(self, "panels", panels)
        for name in ("spheres", "play", "planner", "side_by_side", "quiet"):
            object.__setattr__(self, name, true_or_false(name, getattr(self, name)))
        if self.port is not None:
            whole_number("port", self.port, 0, 65535)
        of_kind("tree", self.tree, SearchTree, optional=True)
        if self.clearances is not None:
            object.__setattr__(self, "clearances", true_or_false("clearances", self.clearances))
        self._check_compare()

    def _check_compare(self) -> None:
        of_kind("compare", self.compare, Mapping)
        for name, motion in self.compare.items():
            check_text("a name in compare", name)
            of_kind(f"compare[{name!r}]", motion, Trajectory)
        if len(self.compare) > 1:
            raise InputError(f"compare has {len(self.compare)} motions, expected one in addition to that of the page")
        object.__setattr__(self, "compare", MappingProxyType(dict(self.compare)))


def checked_options(options: ViewOptions | None) -> ViewOptions:
    """The options, or the defaults.

    Raises:
        InputError: a value of another type.
    """
    of_kind("options", options, ViewOptions, optional=True)
    return ViewOptions() if options is None else options


def with_panel(options: ViewOptions | None, panel: Panel) -> ViewOptions:
    """The options of a page with one more panel, the first."""
    options = checked_options(options)
    return replace(options, panels=(panel, *options.panels))
