"""CoACD in a child process, because it takes minutes on some meshes and cannot be interrupted.

The child reads one mesh from its standard input and writes the pieces to its standard output, both as npz archives.
"""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import BackendError
from rr1plan.files.npy_files import archive_bytes

Wait = Callable[[], None]

_POLL = 0.1
# Longest time that the child outlives a killed parent [s].
_GRACE = 5.0
_CHILD = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]);"
    "import rr1plan.shapes.coacd_process as child; child.write_pieces(float(sys.argv[2]), json.loads(sys.argv[3]))"
)


class DecompositionTimeout(Exception):
    """The decomposition exceeded its time limit."""


def coacd_pieces(
    vertices: Array, faces: NDArray[np.int32], options: Mapping[str, object], seconds: float, wait: Wait
) -> list[Array]:
    """The corners of CoACD's pieces of a mesh, each (n, 3).

    Args:
        vertices: Points [m], shape (n, 3).
        faces: Corners of each triangle, shape (m, 3).
        options: Keywords of `coacd.run_coacd`.
        seconds: Time limit [s].
        wait: Called about ten times a second; an exception ends the decomposition.

    Raises:
        DecompositionTimeout: it takes longer than `seconds`.
        BackendError: CoACD failed, or its process ended without a result.
    """
    if not _is_python(sys.executable):
        # Embedded in another program there is no interpreter to start, and no time limit.
        return _pieces(vertices, faces, options)
    arguments = [sys.executable, "-W", "ignore", "-c", _CHILD]
    arguments += [json.dumps(sys.path), str(seconds + _GRACE), json.dumps(dict(options))]
    pipe, flags = subprocess.PIPE, getattr(subprocess, "CREATE_NO_WINDOW", 0)
    # The mesh is in a file: a large one fills a pipe, and after a timeout `communicate` does not send the rest.
    with tempfile.TemporaryFile() as mesh:
        mesh.write(archive_bytes({"vertices": vertices, "faces": faces}))
        mesh.seek(0)
        with subprocess.Popen(arguments, stdin=mesh, stdout=pipe, stderr=pipe, creationflags=flags) as child:
            try:
                output, errors = _communicate(child, seconds, wait)
            finally:
                if child.poll() is None:
                    child.kill()
                    child.wait()
    if child.returncode != 0:
        said = errors.decode(errors="replace").strip().splitlines()
        why = said[-1] if said else f"its process ended with exit code {child.returncode}"
        raise BackendError(f"CoACD could not decompose a mesh of {len(faces)} triangles: {why}")
    with np.load(io.BytesIO(output), allow_pickle=False) as pieces:
        return [pieces[name] for name in pieces.files]


def _is_python(executable: str | None) -> bool:
    return Path(executable or "").name.lower().startswith("python") and not getattr(sys, "frozen", False)


def _communicate(child: subprocess.Popen[bytes], seconds: float, wait: Wait) -> tuple[bytes, bytes]:
    """Standard output and error of the child."""
    began = time.monotonic()
    while True:
        try:
            return child.communicate(timeout=_POLL)
        except subprocess.TimeoutExpired:
            if time.monotonic() - began > seconds:
                raise DecompositionTimeout from None
            wait()


def write_pieces(seconds: float, options: Mapping[str, Any]) -> None:
    """Main function of the child; it exits after `seconds`."""
    if hasattr(signal, "alarm"):
        signal.alarm(int(np.ceil(seconds)))
    result = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # CoACD prints its messages to standard output
    with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as mesh:
        pieces = _pieces(mesh["vertices"], mesh["faces"], options)
    result.write(archive_bytes({str(i): piece for i, piece in enumerate(pieces)}))
    result.close()


def _pieces(vertices: Array, faces: NDArray[np.int32], options: Mapping[str, object]) -> list[Array]:
    import coacd

    coacd.set_log_level("error")
    try:
        parts = coacd.run_coacd(coacd.Mesh(vertices, faces), seed=0, **options)
    except Exception as error:  # coacd raises bare RuntimeErrors from its C++ part
        raise BackendError(f"CoACD could not decompose a mesh of {len(faces)} triangles: {error}") from error
    return [np.asarray(corners, dtype=np.float64) for corners, _ in parts]
