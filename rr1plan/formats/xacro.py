"""Xacro: a robot written as macros, expanded to URDF by the optional package xacrodoc.

A xacro file is a program: it reads files and evaluates expressions. Load only those you trust.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType

from rr1plan.checks import file_path
from rr1plan.errors import FormatError, MissingPackageError


def expand_xacro(
    file: str | Path, *, package_dirs: Sequence[str | Path] = (), arguments: Mapping[str, str] | None = None
) -> str:
    """Expand a xacro file to URDF; `package://` names are left as they are.

    Args:
        file: The xacro file. It is trusted code.
        package_dirs: Folders of packages, or folders that hold them, for `$(find package)`.
        arguments: Values of its `xacro:arg`.

    Raises:
        MissingPackageError: xacrodoc is not installed (`pip install 'rr1plan[xacro]'`).
        FormatError: the file cannot be read or expanded.
    """
    try:
        import xacro
        import xacrodoc
        from xacrodoc import packages
    except ImportError as error:
        raise MissingPackageError("xacrodoc", "reading xacro files", "xacro") from error
    file = file_path(file)
    if not file.is_file():
        raise FormatError("there is no such file", file)
    try:
        _find_packages(packages, package_dirs)
        xacro.init_stacks(str(file))  # what it includes by a plain name is beside it
        document = xacrodoc.XacroDoc.from_file(file, subargs=dict(arguments or {}), resolve_packages=False)
        return str(document.dom.toxml())
    except Exception as error:  # xacro evaluates Python expressions, which may raise anything, RecursionError too
        package = _missing_package(error, packages.PackageNotFoundError)
        if package is None:
            raise FormatError(f"cannot be expanded: {type(error).__name__}: {error}", file) from error
        raise FormatError(
            f"refers to the package {package!r}, which is not found; try package_dirs=[...] with the folder that holds "
            f"it or, where the arm itself needs nothing from it, with an empty folder named {package!r}",
            file,
        ) from error
    finally:
        packages.reset()


def _missing_package(error: BaseException | None, kind: type[BaseException]) -> str | None:
    """The package that an error is about: xacro wraps the finder's own error."""
    while error is not None and not isinstance(error, kind):
        error = error.__context__
    return None if error is None else str(error.args[0])


def _find_packages(packages: ModuleType, package_dirs: Sequence[str | Path]) -> None:
    """Tell xacrodoc of the given folders, and of the folders in them, by their names."""
    known: dict[str, Path] = {}
    for folder in map(file_path, package_dirs):
        known[folder.resolve().name] = folder
        if folder.is_dir():
            known.update({child.name: child for child in folder.iterdir() if child.is_dir()})
    packages.update_package_cache(known)
