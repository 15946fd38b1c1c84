"""Robots of the package example-robot-data, by name: what the extra `robots` installs."""

from __future__ import annotations

import importlib.metadata
from collections import Counter
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

PACKAGE = "example-robot-data"


class InstalledRobot(NamedTuple):
    """The files of a robot: its URDF, and its SRDF where it has one."""

    urdf: Path
    srdf: Path | None


@cache
def installed_robots() -> Mapping[str, InstalledRobot]:
    """The robots by name, sorted; none where the package is not installed.

    A robot is called as its URDF without "_robot" at the end, so that ur5_robot.urdf is "ur5"; where several have one
    name, as their folders without "_description".
    """
    try:
        root = importlib.metadata.distribution(PACKAGE).locate_file(f"cmeel.prefix/share/{PACKAGE}/robots")
    except importlib.metadata.PackageNotFoundError:
        return MappingProxyType({})
    files = sorted(Path(str(root)).glob("*/*/*.urdf"))
    # A file that ends in "_robot" is the whole one, where there is another of that name in the folder.
    whole = {file.with_stem(_short(file)) for file in files if _short(file) != file.stem}
    files = [file for file in files if file not in whole]
    count = Counter(map(_short, files))
    named = {_short(f) if count[_short(f)] == 1 else f.parents[1].name.removesuffix("_description"): f for f in files}
    robots = {name: InstalledRobot(named[name], _srdf(named[name], name)) for name in sorted(named, key=str.lower)}
    return MappingProxyType(robots)


def _short(file: Path) -> str:
    return file.stem.removesuffix("_robot")


def _srdf(urdf: Path, name: str) -> Path | None:
    """The SRDF of a robot: the one of its name, or the only one there is."""
    found = {file.stem: file for file in sorted((urdf.parents[1] / "srdf").glob("*.srdf"))}
    return found.get(urdf.stem) or found.get(name) or (next(iter(found.values())) if len(found) == 1 else None)
