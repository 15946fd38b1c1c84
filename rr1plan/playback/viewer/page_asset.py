"""The source texts of pages: HTML, CSS and JavaScript in the folders `page` of packages."""

from __future__ import annotations

from functools import cache
from importlib.resources import files


@cache
def page_asset(name: str, package: str = "rr1plan.playback.viewer", *, optional: bool = False) -> str:
    """The text of a file in the folder `page` of a package.

    Args:
        name: The file.
        package: The package.
        optional: A missing file is an empty text.
    """
    file = files(package) / "page" / name
    return "" if optional and not file.is_file() else file.read_text(encoding="utf-8")
