"""Where machine code is kept, so that it is never used for other sources than it was made from.

Numba asks whether the file of a function has changed, but the functions it calls become part of its code and may be
in other files. So the code of a file is kept in a folder that is named by the text of the file and of all kernels it
imports. The folder is in `__pycache__` where that can be written, else in the user's cache folder; NUMBA_CACHE_DIR
goes before both. Code that was made ahead where nothing can be written now is copied to where it can.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import shutil
import tempfile
from functools import cache
from pathlib import Path

from rr1plan.folders import cache_folder

_IMPORTS = re.compile(rb"^from rr1plan\.(?:_kernels(?:\.| import )|(?=places ))(\w+)", re.MULTILINE)


@cache
def stamp_of(file: Path) -> str:
    """A name for a source file and all kernels it imports; "" where it cannot be read.

    It is made when the file is imported: later the file may be another one.
    """
    try:
        text = file.read_bytes()
    except OSError:
        return ""
    digest = hashlib.sha256(text)
    for name in sorted(set(_IMPORTS.findall(text))):
        other = Path(__file__).with_name(f"{name.decode()}.py")
        digest.update(stamp_of(other if other.exists() else other.parents[1] / other.name).encode())
    return f"{file.stem}-{digest.hexdigest()[:16]}"


@cache
def code_folder(file: Path, stamp: str) -> Path | None:
    """The folder that keeps a file's machine code, which exists and can be written, or None."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    beside = file.parent / "__pycache__"
    for place in [Path(given)] if given else [beside, cache_folder() / "code"]:
        folder = place / stamp
        if _can_write(folder):
            if place == beside:
                _drop_older(folder, file.stem)
            else:
                _copy_made(beside / stamp, folder)
            return folder
    if (beside / stamp).is_dir():
        folder = Path(tempfile.mkdtemp(prefix="rr1plan-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        _copy_made(beside / stamp, folder)
        return folder
    return None


def _can_write(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _drop_older(folder: Path, stem: str) -> None:
    """Remove the code of earlier texts of the same file."""
    for other in folder.parent.iterdir():
        name, _, digest = other.name.rpartition("-")
        if name == stem and len(digest) == 16 and other != folder:
            shutil.rmtree(other, ignore_errors=True)


def _copy_made(made: Path, folder: Path) -> None:
    """Take over code that was made ahead, unless there is some already."""
    if made.is_dir() and not any(folder.iterdir()):
        shutil.copytree(made, folder, dirs_exist_ok=True)
