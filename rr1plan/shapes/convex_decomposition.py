"""Convex decomposition of a mesh into pieces whose union contains its surface.

A mesh is first split into its connected parts. A part that equals its hull is one piece, a flat part becomes thin
plates, an open one of few triangles a plate for each of them; only other parts are decomposed (Wei et al., Approximate
convex decomposition for 3D meshes with collision-aware concavity and tree search, 2022: the package coacd). CoACD's
pieces do not contain the whole surface, so each triangle, cut to small size if necessary, is assigned to the best
piece, and the piece becomes the hull of both. The protrusion of pieces from their part is measured and logged.
Decompositions are cached on disk.
"""

from __future__ import annotations

import importlib.metadata
import logging
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, check_callback, known_name, of_kind, positive_number
from rr1plan.errors import CancelledError, InputError
from rr1plan.files.disk_cache import cache_key, load_cached, store_cached
from rr1plan.files.npy_files import Arrays
from rr1plan.progress import Progress, ProgressCallback
from rr1plan.progress_bar import Advance, library_bar, no_progress
from rr1plan.shapes import Mesh
from rr1plan.shapes.coacd_process import DecompositionTimeout, coacd_pieces
from rr1plan.shapes.convex_hulls import convex_hull, distance_outside, is_convex

log = logging.getLogger(__name__)

Convexity = Literal["hull", "pieces"]
CONVEXITIES: tuple[Convexity, ...] = ("hull", "pieces")

SECONDS = 120.0
CONCAVITY = 0.05
CUTS_PER_SIZE = 16
# More iterations take several times as long without reducing the protrusion of pieces.
_EFFORT = {"threshold": CONCAVITY, "resolution": 1000, "mcts_nodes": 8, "mcts_iterations": 20}
# CoACD replaces a surface that is not closed by a finer, closed one around it.
_CLOSED = {**_EFFORT, "preprocess_mode": "off"}
_OPEN = {**_EFFORT, "preprocess_mode": "auto"}
_VERSION = "pieces-5"
# More would take many minutes.
MAX_TRIANGLES = 100_000
# An open part of at most this many triangles has a plate for each.
_MOST_PLATES = 64
# A triangle fits a piece that it sticks out of by at most this fraction of the mesh's size.
_FITS = 1e-3
# Half the thickness of a plate, in sizes of the mesh.
_PLATE = 5e-4
# More connected parts are decomposed as one.
_MOST_PARTS = 256
# A mesh counts as its own hull if the hull protrudes by at most this fraction of the mesh's size.
_OWN_HULL = 2e-3
# Number of samples along a mesh for measuring the protrusion of pieces.
_SAMPLES_PER_SIZE = 24
# A warning is logged if pieces protrude by more than this fraction of the size.
_MUCH = 0.02
# A decomposition that takes longer is announced [s].
_ANNOUNCED = 1.0


@dataclass(frozen=True, eq=False)
class _Part:
    """The pieces of one connected part of a mesh, and their protrusion [m]."""

    pieces: list[Mesh]
    swelling: float = 0.0
    decomposed: bool = False


def convex_shapes(meshes: Sequence[Mesh], convex: Convexity = "hull") -> list[Mesh]:
    """Convex meshes whose union contains the surfaces of the given ones.

    Args:
        meshes: The parts of one mesh file.
        convex: "hull" for one hull around all, "pieces" for a decomposition of each that is not convex (slow the first
            time, then cached on disk).

    Raises:
        UnknownNameError: an unknown `convex`.
        InputError: a mesh without volume, or one whose decomposition takes too long.
        BackendError: the decomposition failed.
    """
    known_name("convex", convex, CONVEXITIES)
    if convex == "hull":
        return [convex_hull(np.concatenate([mesh.vertices for mesh in meshes]))]
    return [piece for mesh in meshes for piece in convex_pieces(mesh)]


def convex_pieces(mesh: Mesh, *, seconds: float = SECONDS, progress: ProgressCallback | None = None) -> list[Mesh]:
    """Convex meshes whose union contains the surface of a mesh; its hull alone if it is convex.

    Decompositions are cached on disk.

    Args:
        mesh: The mesh.
        seconds: The longest that its decomposition may take [s].
        progress: Called about ten times a second, with the spent fraction of `seconds`; returns False to cancel.
            Without it, a bar is drawn on stderr after a second if that is a terminal.

    Raises:
        InputError: a mesh without volume, of too many triangles, or one that takes longer.
        BackendError: the decomposition failed.
        CancelledError: `progress` returned False.
    """
    of_kind("mesh", mesh, Mesh)
    seconds = positive_number("seconds", seconds)
    check_callback("progress", progress)
    if not mesh.convex and len(mesh.faces) > MAX_TRIANGLES:
        raise InputError(
            f"a mesh of {len(mesh.faces)} triangles is not cut into convex pieces, expected at most {MAX_TRIANGLES}; "
            "try a decimated mesh, or its hull"
        )
    if mesh.convex or _is_own_hull(mesh):
        return [convex_hull(mesh.vertices)]
    with ExitStack() as stack:
        clock = _Clock(mesh, seconds, progress, stack)
        parts = [_part(part, _size(mesh.vertices), clock) for part in _parts(mesh)]
    _log_swelling(mesh, parts)
    return [piece for part in parts for piece in part.pieces]


class _Clock:
    """Time limit of a mesh's decompositions; announces a long one, with a bar until `stack` closes."""

    def __init__(self, mesh: Mesh, seconds: float, progress: ProgressCallback | None, stack: ExitStack) -> None:
        self._mesh = mesh
        self._seconds = seconds
        self._progress = progress
        self._began = time.monotonic()
        self._announced = False
        self._stack = stack
        self._bar: Advance = no_progress

    @property
    def left(self) -> float:
        """Seconds left [s]."""
        return self._seconds - (time.monotonic() - self._began)

    def wait(self) -> None:
        """Report progress."""
        spent = self._seconds - self.left
        if spent > _ANNOUNCED and not self._announced:
            self._announced = True
            log.warning(
                "cutting a mesh of %d triangles into convex pieces takes up to %g s, once (they are kept on disk)",
                len(self._mesh.faces),
                self._seconds,
            )
            if self._progress is None:
                self._bar = self._stack.enter_context(library_bar("cutting a mesh into convex pieces"))
        share = min(1.0, spent / self._seconds)
        self._bar(share)
        if self._progress is not None and self._progress(Progress("convex pieces", spent, share)) is False:
            raise CancelledError(f"cancelled while a mesh of {len(self._mesh.faces)} triangles was cut into pieces")

    def too_slow(self) -> InputError:
        """The error for an exceeded time limit."""
        return InputError(
            f"a mesh of {len(self._mesh.faces)} triangles was not cut into convex pieces in {self._seconds:g} s; try a "
            'decimated mesh, boxes and cylinders in its place or its hull (convex = "hull"), or let it take longer, '
            "once: rr1plan.convex_pieces(mesh, seconds=600) keeps the pieces on disk"
        )


def _log_swelling(mesh: Mesh, parts: list[_Part]) -> None:
    worst, size = max(part.swelling for part in parts), _size(mesh.vertices)
    count = sum(len(part.pieces) for part in parts)
    if any(part.decomposed for part in parts) or worst > _MUCH * size:
        log.log(
            logging.WARNING if worst > _MUCH * size else logging.INFO,
            "a mesh of %d triangles and %.3g m became %d convex piece%s, sticking out of it by up to %.3g mm",
            len(mesh.faces),
            size,
            count,
            "" if count == 1 else "s",
            1e3 * worst,
        )


# ---- connected parts ---------------------------------------------------------------------


def _parts(mesh: Mesh) -> list[Mesh]:
    """The connected parts of a mesh, closed ones oriented outward; the whole mesh if one of them is a cavity.

    Triangles are connected by edges of exactly two triangles, so that bodies in contact remain separate.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, which, counts = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    order = np.argsort(which, kind="stable")
    inner = order[counts[which[order]] == 2].reshape(-1, 2) // 3
    count = len(mesh.faces)
    graph = coo_matrix((np.ones(len(inner)), (inner[:, 0], inner[:, 1])), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    if number > _MOST_PARTS:
        return [mesh]
    parts = [_only(mesh, label == i) for i in range(number)]
    volumes = [enclosed_volume(part) if is_closed(part) else 0.0 for part in parts]
    if min(volumes) < 0.0 < max(volumes):
        return [mesh]
    return [Mesh(p.vertices, p.faces[:, ::-1]) if v < 0.0 else p for p, v in zip(parts, volumes, strict=True)]


def _only(mesh: Mesh, kept: NDArray[np.bool_]) -> Mesh:
    """Some triangles of a mesh. A single one gets its center as the fourth vertex, as a mesh needs four."""
    used, faces = np.unique(mesh.faces[kept], return_inverse=True)
    vertices = mesh.vertices[used]
    if len(vertices) < 4:
        vertices = np.concatenate([vertices, np.repeat(vertices.mean(axis=0)[None], 4 - len(vertices), axis=0)])
    return Mesh(vertices, faces.reshape(-1, 3).astype(np.int32))


def enclosed_volume(mesh: Mesh) -> float:
    """Volume within a closed mesh [m³], negative if its triangles face inward."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - mesh.vertices[0] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def is_closed(mesh: Mesh) -> bool:
    """Whether each edge has two triangles with consistent orientations."""
    directed = mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    forth, back = (np.unique(pairs, axis=0) for pairs in (directed, directed[:, ::-1]))
    return len(forth) == len(directed) and np.array_equal(forth, back)


def _part(part: Mesh, size: float, clock: _Clock) -> _Part:
    """The pieces of a connected part of a mesh; `size` is that of the whole mesh [m]."""
    if _is_flat(part):
        return _plates(part, size)
    if _is_own_hull(part):
        return _Part([convex_hull(part.vertices)])
    closed = is_closed(part)
    if not closed and len(part.faces) <= _MOST_PLATES:
        return _plates(part, size)
    options = _CLOSED if closed else _OPEN
    key = cache_key(
        _VERSION, importlib.metadata.version("coacd"), f"{CUTS_PER_SIZE} {sorted(options.items())}",
        part.vertices, part.faces,
    )  # fmt: skip
    kept = load_cached(key)
    found = None if kept is None else _unpack(kept)
    if kept is not None and found is None:
        log.warning("the cache entry %s is damaged, it is made anew", key[:12])
    if found is None:
        try:
            corners = coacd_pieces(part.vertices, part.faces, options, max(clock.left, 0.1), clock.wait)
        except DecompositionTimeout:
            raise clock.too_slow() from None
        pieces = _covering(part, [convex_hull(points) for points in corners])
        found = _Part(pieces, _swelling(part, pieces, closed), True)
        store_cached(key, _pack(found))
    return found


def _is_flat(mesh: Mesh) -> bool:
    used = mesh.vertices[np.unique(mesh.faces)]
    spread = np.linalg.svd(used - used.mean(axis=0), compute_uv=False)
    return bool(spread[2] <= 1e-6 * spread[0]) if len(spread) == 3 else True


def _plates(part: Mesh, size: float) -> _Part:
    """A thin plate for each triangle; a single plate for flat ones that fill their outline."""
    half = _PLATE * size
    corners = part.vertices[part.faces]
    if _is_flat(part) and _fills_its_outline(part):
        corners = part.vertices[np.unique(part.faces)][None]
    # An octahedron around each corner: the hull then has a volume even for degenerate triangles.
    around = half * np.concatenate([np.eye(3), -np.eye(3)])
    return _Part([convex_hull((points[:, None] + around).reshape(-1, 3)) for points in corners], half)


def _fills_its_outline(flat: Mesh) -> bool:
    """Whether flat triangles fill the convex polygon around them."""
    from scipy.spatial import ConvexHull, QhullError

    used = flat.vertices[np.unique(flat.faces)]
    plane = np.linalg.svd(used - used.mean(axis=0))[2][:2]
    a, b, c = (flat.vertices[flat.faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    try:
        return bool(area >= (1.0 - 1e-6) * ConvexHull((used - used.mean(axis=0)) @ plane.T).volume)
    except QhullError:  # all points on one line
        return True


# ---- pieces that cover the surface -------------------------------------------------------


def _covering(mesh: Mesh, pieces: list[Mesh]) -> list[Mesh]:
    """The pieces, each extended to contain the triangles of the surface that fit it best.

    A triangle that sticks out of all pieces is halved until it is small.
    """
    size = _size(mesh.vertices)
    covered: list[list[Array]] = [[] for _ in pieces]
    triangles = mesh.vertices[mesh.faces]
    while len(triangles):
        points, corners = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
        outside = np.empty((len(pieces), len(triangles)))
        for row, piece in zip(outside, pieces, strict=True):
            row[:] = distance_outside(piece.vertices, points)[corners.reshape(-1, 3)].max(axis=1)
        best, fits = outside.argmin(axis=0), outside.min(axis=0) <= _FITS * size
        done = fits | (_edges(triangles).max(axis=1) <= size / CUTS_PER_SIZE)
        for i, of_piece in enumerate(covered):
            of_piece.append(triangles[done & (best == i)].reshape(-1, 3))
        triangles = _halved(triangles[~done])
    return [_grown(piece, np.concatenate(points)) for piece, points in zip(pieces, covered, strict=True)]


def _grown(piece: Mesh, points: Array) -> Mesh:
    """The hull of a piece and the points outside it."""
    return convex_hull(np.concatenate([piece.vertices, points[distance_outside(piece.vertices, points) > 0.0]]))


def _cut(triangles: Array, longest: float) -> Array:
    """Triangles (n, 3, 3) halved until none has an edge longer than `longest`."""
    done: list[Array] = []
    while len(triangles):
        long = _edges(triangles).max(axis=1) > longest
        done.append(triangles[~long])
        triangles = _halved(triangles[long])
    return np.concatenate(done)


def _halved(triangles: Array) -> Array:
    """Triangles (n, 3, 3) halved across their longest edge."""
    start = _edges(triangles).argmax(axis=1)
    a, b, c = (triangles[np.arange(len(start)), (start + k) % 3] for k in range(3))
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _edges(triangles: Array) -> Array:
    """Lengths of the edges of triangles (n, 3, 3), the first from corner 0 to 1 [m], shape (n, 3)."""
    return np.asarray(np.linalg.norm(triangles - np.roll(triangles, -1, axis=1), axis=2))


def _size(points: Array) -> float:
    return float(np.ptp(points, axis=0).max())


# ---- protrusion --------------------------------------------------------------------------


def _is_own_hull(mesh: Mesh) -> bool:
    """Whether a mesh is the surface of its hull up to small gaps; an open box is not."""
    if not is_convex(mesh):
        return False
    return is_closed(mesh) or _swelling(mesh, [convex_hull(mesh.vertices)], False) <= _OWN_HULL * _size(mesh.vertices)


def _swelling(mesh: Mesh, pieces: list[Mesh], closed: bool) -> float:
    """Largest sampled protrusion of pieces from a mesh's surface [m], only outside if it is closed."""
    step = _size(mesh.vertices) / _SAMPLES_PER_SIZE
    samples = np.concatenate([_cut(piece.vertices[piece.faces], step).mean(axis=1) for piece in pieces])
    # Long thin triangles are cut into many more small ones than needed.
    _, first = np.unique(np.floor(2.0 * samples / step), axis=0, return_index=True)
    samples = samples[first]
    distance = _distances(mesh, samples, step)
    order, triangles = np.argsort(-distance), mesh.vertices[mesh.faces]
    for some in np.array_split(order, 1 + len(order) * len(mesh.faces) // 1_000_000):
        outside = some[~are_inside(samples[some], triangles)] if closed else some
        if len(outside):
            return float(distance[outside].max())
    return 0.0


def _distances(mesh: Mesh, points: Array, step: float) -> Array:
    """Distance of points (n, 3) from a mesh's surface [m], shape (n,)."""
    from scipy.spatial import cKDTree
    from trimesh.triangles import closest_point

    triangles = _cut(mesh.vertices[mesh.faces], step)
    count = min(8, len(triangles))
    _, near = cKDTree(triangles.mean(axis=1)).query(points, k=count)
    nearest: Any = closest_point(triangles[near.reshape(-1)], np.repeat(points, count, axis=0))
    lengths = np.linalg.norm(np.asarray(nearest).reshape(len(points), count, 3) - points[:, None], axis=2)
    return np.asarray(lengths.min(axis=1))


def are_inside(points: Array, triangles: Array) -> NDArray[np.bool_]:
    """Whether points (n, 3) are inside a closed surface of triangles (m, 3, 3), by its winding number.

    The solid angle of each triangle: Van Oosterom, Strackee, The Solid Angle of a Plane Triangle, 1983.
    """
    a, b, c = (triangles[:, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(corner, axis=2) for corner in (a, b, c))
    volume = np.einsum("nmk,nmk->nm", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("nmk,nmk->nm", x, y) for x, y in ((a, b), (b, c), (c, a)))
    angle = 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return np.asarray(np.abs(angle.sum(axis=1)) > 2.0 * np.pi)


def _pack(part: _Part) -> Arrays:
    arrays: Arrays = {"swelling": np.array(part.swelling)}
    return arrays | {f"{n}{i}": getattr(p, n) for i, p in enumerate(part.pieces) for n in ("vertices", "faces")}


def _unpack(kept: Arrays) -> _Part | None:
    """The pieces of a cache entry, or None if it is invalid."""
    try:
        count = len(kept) // 2
        pieces = [Mesh(kept[f"vertices{i}"], kept[f"faces{i}"], convex=True) for i in range(count)]
        return _Part(pieces, float(kept["swelling"]), True) if pieces else None
    except (KeyError, InputError, ValueError, TypeError):
        return None
