"""Robots of the package example-robot-data by name, which the extra `robots` installs."""

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
    """The files of a robot: its URDF, and its SRDF if it has one."""

    urdf: Path
    srdf: Path | None


@cache
def installed_robots() -> Mapping[str, InstalledRobot]:
    """The robots by name, sorted; empty if the package is not installed.

    A robot is named after its URDF without "_robot" at the end, so ur5_robot.urdf is "ur5"; if several have the same
    name, they are named after their folders without "_description".
    """
    try:
        root = importlib.metadata.distribution(PACKAGE).locate_file(f"cmeel.prefix/share/{PACKAGE}/robots")
    except importlib.metadata.PackageNotFoundError:
        return MappingProxyType({})
    files = sorted(Path(str(root)).glob("*/*/*.urdf"))
    # Of two files in a folder that differ only in this ending, the one with "_robot" is the complete robot.
    whole = {file.with_stem(_short(file)) for file in files if _short(file) != file.stem}
    files = [file for file in files if file not in whole]
    count = Counter(map(_short, files))
    named = {_short(f) if count[_short(f)] == 1 else f.parents[1].name.removesuffix("_description"): f for f in files}
    robots = {name: InstalledRobot(named[name], _srdf(named[name], name)) for name in sorted(named, key=str.lower)}
    return MappingProxyType(robots)


def _short(file: Path) -> str:
    return file.stem.removesuffix("_robot")


def _srdf(urdf: Path, name: str) -> Path | None:
    """The SRDF of a robot: the one with its name, or the only one."""
    found = {file.stem: file for file in sorted((urdf.parents[1] / "srdf").glob("*.srdf"))}
    return found.get(urdf.stem) or found.get(name) or (next(iter(found.values())) if len(found) == 1 else None)
