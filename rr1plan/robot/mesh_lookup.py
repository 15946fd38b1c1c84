"""Lookup of a URDF's meshes, restricted to folders of the robot.

`package://name/rest` is `rest` in the package's folder: one of the given `package_dirs` or of ROS_PACKAGE_PATH (either
the package itself or the folder that holds it), a folder next to the URDF or above it, or an installed package in
AMENT_PREFIX_PATH (ROS 2). A package's folder has the package's name, or a package.xml with that name, as in ROS:
downloads are often named otherwise. A plain or `file://` name is relative to the URDF. In URIs "%20" is a space, as in
ROS. Files outside these folders are rejected, also through symbolic links.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

from rr1plan.checks import file_path, items_of, resolved_path
from rr1plan.errors import FormatError, InputError
from rr1plan.files.file_access import is_regular, read_bytes
from rr1plan.files.xml_reader import first_text
from rr1plan.shapes.mesh_files import SUFFIXES

_LEVELS = 5
_PACKAGE, _MAX_BYTES = "package.xml", 1024 * 1024


class MeshLookup:
    """Finds mesh files.

    Args:
        package_dirs: Folders given by the user, first in the order.
        file: The URDF, or None if it is not from a file.

    Raises:
        InputError: not a list of folders.
    """

    def __init__(self, package_dirs: Sequence[str | Path], file: str | Path | None) -> None:
        given = [file_path(folder) for folder in items_of("package_dirs", package_dirs, "folders")]
        self._packages = [*given, *_path_variable("ROS_PACKAGE_PATH")]
        self._beside = None if file is None else resolved_path(file).parent
        self._above = [] if self._beside is None else folders_above(self._beside)
        # Installed packages of ROS 2 are in folders with their names.
        self._installed = [prefix / "share" for prefix in _path_variable("AMENT_PREFIX_PATH")]
        self._allowed = [resolved_path(folder) for folder in (*self._packages, *self._above, *self._installed)]

    def find(self, name: str) -> Path:
        """The file that a URDF refers to as `name`.

        Raises:
            FormatError: not a file name, an unknown suffix or scheme, a path that leaves the folders, or no such file;
                the message lists every path that was tried.
        """
        path = unquote(name) if "://" in name else name
        check_suffix(path, SUFFIXES)
        return self.first(f"mesh {name!r}", self._places(path))

    def first(self, what: str, places: Iterable[Path]) -> Path:
        """The first of some places that is a regular file inside the robot's folders.

        Args:
            what: What is searched for, for messages.
            places: Paths in the order in which they are tried.

        Raises:
            FormatError: none of them is; the message lists all.
        """
        tried: list[Path] = []
        why = "is not there"
        for place in places:
            tried.append(place)
            if not is_regular(place):
                why = "is not a regular file" if os.path.lexists(place) else why
                continue
            if self._is_allowed(place):
                return place
            why = "is outside the robot's folders"
        listed = ", ".join(dict.fromkeys(map(str, tried))) or "nowhere"
        alike = next((other for place in tried for other in _alike(place) if self._is_allowed(other)), None)
        advice = "name the folder it is in with option package_dirs, or in ROS_PACKAGE_PATH"
        if alike is not None:
            advice = f"there is {alike}: upper and lower case count"
        elif "\\" in what:
            advice = "a slash separates folders, not a backslash"
        raise FormatError(f"{what} {why}; tried {listed}; {advice}")

    @property
    def packages(self) -> tuple[Path, ...]:
        """The folders given by the user, then those of ROS_PACKAGE_PATH."""
        return tuple(self._packages)

    def _is_allowed(self, place: Path) -> bool:
        resolved = resolved_path(place)
        return any(resolved.is_relative_to(folder) for folder in self._allowed)

    def _places(self, name: str) -> Iterator[Path]:
        scheme, separator, rest = name.partition("://")
        if separator and scheme in ("package", "model"):
            yield from self._package_places(rest)
        elif separator and scheme != "file":
            raise FormatError(f"mesh {name!r} has the unknown scheme {scheme!r}, expected package or file")
        else:
            path = Path(rest if separator else name)
            folders = [self._beside] if self._beside is not None else self._packages
            yield from (folder / path for folder in folders)

    def _package_places(self, rest: str) -> Iterator[Path]:
        package, _, inside = rest.partition("/")
        if ".." in Path(rest).parts:
            raise FormatError(f"mesh 'package://{rest}' leads out of its package")
        for folder in self._packages:
            yield folder / package / inside
            if folder.name == package or (folder / _PACKAGE).is_file():
                yield folder / inside
        for folder in self._above:
            yield folder / package / inside
            if package in (folder.name, package_name(folder)):
                yield folder / inside
        yield from (folder / package / inside for folder in self._installed)
        for folder in (*self._packages, *self._above):
            yield from (child / inside for child in folders_in(folder) if package_name(child) == package)


def check_suffix(name: str, suffixes: Sequence[str]) -> None:
    """Reject the name of a mesh that no file can have, or with an unsupported suffix.

    Raises:
        FormatError: such a name.
    """
    try:
        suffix = file_path(name).suffix.lower()
    except InputError as error:
        raise FormatError(f"a mesh's {error}") from error
    if suffix not in suffixes:
        raise FormatError(f"mesh {name!r} has an unknown suffix, expected one of {', '.join(suffixes)}")


def _path_variable(variable: str) -> list[Path]:
    """The folders in an environment variable."""
    return [Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder]


def _alike(place: Path) -> Iterator[Path]:
    """The files of the same folder whose names differ in upper and lower case only."""
    try:
        others = sorted(place.parent.iterdir())
    except (OSError, ValueError):
        return
    yield from (o for o in others if o.name != place.name and o.name.casefold() == place.name.casefold())


def folders_in(folder: Path) -> list[Path]:
    """The folders in a folder, sorted; none if it cannot be listed."""
    try:
        return sorted(child for child in folder.iterdir() if child.is_dir())
    except OSError:
        return []


def package_name(folder: Path) -> str | None:
    """The name in a folder's package.xml, ROS's description of a package; None without a readable one."""
    file = folder / _PACKAGE
    try:
        return first_text(read_bytes(file, _MAX_BYTES), "name", file) if is_regular(file) else None
    except FormatError:
        return None


def folders_above(folder: Path) -> list[Path]:
    """The URDF's folder and those above it that may hold its meshes.

    Up to the folder that contains the URDF's package (its package.xml), or five levels without one, but never the home
    folder, the root of the file system or a folder that contains them.
    """
    home = Path.home().resolve()
    found = [folder]
    for parent in list(folder.parents)[:_LEVELS]:
        if len(parent.parts) <= 2 or home.is_relative_to(parent):
            break
        inside_package = (found[-1] / _PACKAGE).is_file()
        found.append(parent)
        if inside_package:
            break
    return found
