"""What the documentation site adds to Sphinx: reference pages of all public names, and pages to try.

The reference has one page for each room of the package, made from `rr1plan`'s exports, so no name can be missing.
Pages made by `make_site.py` are embedded in the lesson of that name, and linked from their picture in the gallery.
"""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

import rr1plan

# Modules, or packages with all their modules, by the title of their page.
ROOMS = {
    "Robots": ("rr1plan.robot",),
    "Shapes": ("rr1plan.shapes",),
    "Scenes and problems": ("rr1plan.scene",),
    "Kinematics": ("rr1plan.model", "rr1plan.transforms"),
    "Collision checking": ("rr1plan.collision",),
    "Planning": (
        "rr1plan.pipeline",
        "rr1plan.motion_plan",
        "rr1plan.planning",
        "rr1plan.planners",
        "rr1plan.path",
        "rr1plan.batch",
    ),
    "Trajectories": ("rr1plan.trajectory", "rr1plan.retiming"),
    "Validation": ("rr1plan.validation", "rr1plan.report", "rr1plan.testing"),
    "Many arms": ("rr1plan.multi", "rr1plan.playback.schedules"),
    "Sequences": ("rr1plan.sequences",),
    "Simulation": ("rr1plan.playback.simulation", "rr1plan.experiments"),
    "Pages and pictures": ("rr1plan.playback.viewer", "rr1plan.playback.search_trees"),
    "Configuration spaces and lessons": ("rr1plan.playback.cspace", "rr1plan.lessons"),
    "Files": ("rr1plan.export", "rr1plan.saved_motion"),
    "Real arms": ("rr1plan.hardware", "rr1plan.calibration", "rr1plan.mirror"),
    "Errors and types": ("rr1plan.errors", "rr1plan.checks", "rr1plan.progress"),
}
_PAGES = "pages"  # folder of the site with the pages of motions and lessons


def public_names() -> dict[str, list[str]]:
    """The public names on each page of the reference, in the order of its modules in `ROOMS`.

    Raises:
        LookupError: a module with public names that no page lists.
    """
    named: dict[str, list[str]] = {module: [] for modules in ROOMS.values() for module in modules}
    for name in rr1plan.__all__:
        if name == "__version__":
            continue
        module = rr1plan._HOME.get(name, f"rr1plan.{name}")
        parents = [module.rsplit(".", dots)[0] for dots in range(module.count("."))]
        known = [parent for parent in parents if parent in named]
        if not known:
            raise LookupError(f"no page of the reference lists {module}: add it to ROOMS in {Path(__file__).name}")
        named[known[0]].append(name)
    return {title: [name for module in modules for name in named[module]] for title, modules in ROOMS.items()}


def _write_reference(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    stems = []
    for title, names in public_names().items():
        stems.append(title.lower().replace(" ", "_"))
        entries = [_entry(name) for name in names]
        _write(folder / f"{stems[-1]}.rst", "\n".join([title, "=" * len(title), "", *entries]))
    head = ["Reference", "=========", "", "All names are those of ``import rr1plan as rp``.", "", ".. toctree::", ""]
    _write(folder / "index.rst", "\n".join([*head, *(f"   {stem}" for stem in stems), ""]))


def _entry(name: str) -> str:
    value = getattr(rr1plan, name)
    if inspect.ismodule(value):
        return f".. automodule:: rr1plan.{name}\n   :members:\n"
    if inspect.isclass(value):
        return f".. autoclass:: rr1plan.{name}\n   :members:\n"
    if inspect.isfunction(value):
        return f".. autofunction:: rr1plan.{name}\n"
    lines = [f".. py:data:: rr1plan.{name}", "", *_documentation_of_data(name)]
    return "\n   ".join(lines) + "\n"


def _documentation_of_data(name: str) -> list[str]:
    """The docstring below an alias, from the module of its package that defines it."""
    home = import_module(rr1plan._HOME[name])
    modules = [home.__name__]
    if hasattr(home, "__path__"):
        modules += [f"{home.__name__}.{module.name}" for module in iter_modules(home.__path__)]
    for module in modules:
        documented = ModuleAnalyzer.for_module(module).find_attr_docs()
        if ("", name) in documented:
            return documented["", name]
    raise LookupError(f"{name} has no docstring in {home.__name__}")


def _write(file: Path, text: str) -> None:
    # Sphinx reads files again that have changed.
    if not file.exists() or file.read_text(encoding="utf-8") != text:
        file.write_text(text, encoding="utf-8")


def _mark_code(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Make literal blocks of the indented code in docstrings; `lines` is changed in place."""
    marked: list[str] = []
    above = ""
    for line in lines:
        code = line.startswith("    ") and marked and not marked[-1]
        if code and above and not above.startswith(" ") and not re.fullmatch(r"[A-Z]\w+( \w+)?:", above):
            marked += ["::", ""]
        marked.append(line)
        above = line or above
    lines[:] = marked


def _keep_colons(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep napoleon from reading the first line of a property as "type: description"; `lines` is changed in place."""
    if what in ("attribute", "property"):
        # An empty comment: napoleon skips empty lines at the beginning.
        lines[:0] = ["..", ""]


def _link_pages(app: Sphinx, document: nodes.document, docname: str) -> None:
    """Embed the page of a lesson below its title, and link pictures of the gallery to the page that they show."""
    folder = Path(app.config.live_pages or app.srcdir, _PAGES)
    above = "../" * docname.count("/")
    for image in list(document.findall(nodes.image)):
        page = Path(image["uri"]).with_suffix(".html").name
        if "gallery/" in image["uri"] and (folder / page).is_file():
            link = nodes.reference("", refuri=f"{above}{_PAGES}/{page}", title="Open the page")
            image.replace_self(link)
            link += image
    page = f"lesson_{docname.removeprefix('lessons/')}.html"
    if docname.startswith("lessons/") and (folder / page).is_file():
        at = f"{above}{_PAGES}/{page}"
        html = f'<iframe class="page" src="{at}" title="The page of this lesson" loading="lazy"></iframe>\n'
        html += f'<p class="page"><a href="{at}">Open the page in a window</a></p>\n'
        title = next(document.findall(nodes.title))
        title.parent.insert(title.parent.index(title) + 1, nodes.raw("", html, format="html"))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_config_value("live_pages", "", "env", str)
    app.connect("builder-inited", _write_reference)
    app.connect("autodoc-process-docstring", _mark_code, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", _keep_colons, priority=400)
    app.connect("doctree-resolved", _link_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
