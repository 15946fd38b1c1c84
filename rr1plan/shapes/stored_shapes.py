"""Meshes and point clouds in separate files, named by the hash of their content.

The folder is beside the documents that refer to it, so that many motions of one robot share its meshes. A file is
rejected if its content does not have the hash in its name.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rr1plan.errors import FormatError, InputError
from rr1plan.files.file_access import read_bytes, write_bytes
from rr1plan.files.npy_files import Arrays, archive_bytes, parse_archive
from rr1plan.shapes import Mesh, PointCloud
from rr1plan.shapes.content_digest import value_hash

FOLDER = "geometry"


def store_shapes(folder: Path, shapes: Mapping[str, Mesh | PointCloud]) -> None:
    """Write shapes to files atomically; existing files are kept.

    Args:
        folder: The folder; it is created if it is missing.
        shapes: The shapes by their hashes.

    Raises:
        InputError: the folder or a file cannot be written.
    """
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror}") from error
    for sha256, shape in shapes.items():
        try:
            read_shape(folder, sha256)
        except FormatError:
            arrays = {name: np.asarray(getattr(shape, name)) for name in shape.__dataclass_fields__}
            write_bytes(_file(folder, sha256), archive_bytes(arrays))


def read_shape(folder: Path, sha256: str) -> Mesh | PointCloud:
    """The shape with a hash.

    Raises:
        FormatError: there is no such file, or it holds something else.
    """
    file = _file(folder, sha256)
    try:
        shape = _shape(parse_archive(read_bytes(file)))
    except FormatError:
        raise
    except ValueError as error:  # an InputError of the shape is one
        raise FormatError(f"holds no mesh or point cloud: {error}", file) from error
    if value_hash(shape) != sha256:
        raise FormatError(
            "was altered after it was written: its content does not have the sha256 that is its name", file
        )
    return shape


def _shape(arrays: Arrays) -> Mesh | PointCloud:
    if set(arrays) == set(Mesh.__dataclass_fields__):
        return Mesh(arrays["vertices"], arrays["faces"], bool(arrays["convex"]))
    if set(arrays) == set(PointCloud.__dataclass_fields__):
        return PointCloud(arrays["points"], arrays["resolution"].item())
    raise InputError(f"its arrays are {', '.join(arrays) or 'none'}")


def _file(folder: Path, sha256: str) -> Path:
    return folder / f"{sha256}.npz"
