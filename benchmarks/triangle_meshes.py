"""Cost of a concave obstacle as triangles and as convex pieces.

    python benchmarks/triangle_meshes.py

An RR1 next to a mug of 2,600 triangles, and above a terrain of 10,000 and of 100,000, all generated here. Set up is the
time for the tables of the scene if those of the arm exist. Edges are random, from random free configurations. Convex
pieces come from CoACD (`convex_pieces`), if it finishes within `--seconds`. Verdicts of the kernels are compared with
those of python-fcl's hierarchy of triangles at random configurations; those nearer to contact than `GRAZING` are
counted separately.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from typing import Any
from unittest import mock

import numpy as np
from clutter import box_of
from coal_proof import PlainCoal
from concave_shapes import mug, terrain
from shared import heading, make_parser, number, pin_to_core, save, table, track

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.collision.edge_kernel import FREE, EdgeKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.errors import BackendError, InputError
from rr1plan.robot import Geometry
from rr1plan.shapes.convex_decomposition import convex_pieces
from rr1plan.testing.collision_checkers import ElementChecker

GRAZING = 1e-4  # [m]
_ROUNDS = 5
_HEADER = [
    *("mesh", "triangles", "set up [ms]", "edge [us]", "free", "pieces", "their making [s]", "edge beside them [us]"),
    *("free beside them", "samples", "in contact", "grazing", "FCL differs"),
]


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    pin_to_core(args.core)
    rng = np.random.default_rng(args.seed)
    meshes = {"none": None, "mug": (mug(), [-0.33, 0.0, 0.1])}
    meshes |= {f"terrain of {n}": (_terrain(rng, n), [0.0, 0.0, -0.06]) for n in args.triangles}
    results = [_measure(name, given, args) for name, given in track(list(meshes.items()), "meshes")]
    facts = {"seed": args.seed, "edges": args.edges, "CoACD's limit": f"{args.seconds:g} s"}
    text = "\n\n".join([heading("Concave obstacles", facts), table(_HEADER, [_row(result) for result in results])])
    save(args.out, "triangle_meshes", {"settings": facts, "meshes": results}, text)
    return 1 if any(result.get("different") for result in results) else 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser("Concave obstacles as triangles and as convex pieces", "triangle_meshes")
    parser.add_argument("--triangles", type=int, nargs="*", default=[10_000, 100_000], help="of the terrains")
    parser.add_argument("--edges", type=int, default=1000, help="edges that are timed beside each mesh")
    parser.add_argument("--samples", type=int, default=1000, help="configurations checked by python-fcl")
    parser.add_argument("--seconds", type=float, default=120.0, help="longest decomposition; 0 leaves them all out")
    return parser.parse_args(argv)


def _terrain(rng: np.random.Generator, triangles: int) -> rp.Mesh:
    return terrain(rng, max(2, int(np.sqrt(triangles / 2))), 1.6, 0.12)


def _measure(name: str, given: tuple[rp.Mesh, Any] | None, args: argparse.Namespace) -> dict[str, Any]:
    """All measurements of one mesh at a pose."""
    bare, rng = rp.Scene().with_arm("arm", rp.load_robot("rr1")), np.random.default_rng(args.seed)
    CollisionChecker(bare).warm_up()
    if given is None:
        return {"mesh": name, "triangles": 0} | _time_edges(bare, args.edges, rng)
    mesh, place = given
    scene = bare.with_obstacle("mesh", mesh, place)
    result = {"mesh": name, "triangles": len(mesh.faces), "warm_up": _time_set_up(bare, mesh, place)}
    result |= _time_edges(scene, args.edges, rng)
    if args.seconds > 0.0:
        result["pieces"] = _decompose(bare, mesh, place, args, rng)
    return result | _compare(scene, bare, args.samples, rng)


def _time_set_up(bare: rp.Scene, mesh: rp.Mesh, place: Any) -> float:
    """Best CPU time to build the tables of a scene with a new mesh [s]."""
    times = []
    for k in range(_ROUNDS):
        scene = bare.with_obstacle("mesh", rp.Mesh(mesh.vertices * (1.0 + 1e-9 * (k + 1)), mesh.faces), place)
        begin = time.process_time()
        CollisionChecker(scene).warm_up()
        times.append(time.process_time() - begin)
    return min(times)


def _time_edges(scene: rp.Scene, count: int, rng: np.random.Generator) -> dict[str, float]:
    """Best CPU time of a certified edge [s], and the fraction of free edges."""
    checker = CollisionChecker(scene)
    low, high = box_of(checker.limits)
    begins: list[Array] = []
    while len(begins) < count:
        q = rng.uniform(low, high)
        if checker.is_free(q):
            begins.append(q)
    steps = rng.normal(size=(count, checker.nq))
    steps *= rng.uniform(0.2, 1.5, (count, 1)) / np.linalg.norm(steps, axis=1)[:, None]
    ends = np.clip(np.array(begins) + steps, checker.limits.lower, checker.limits.upper)
    tables = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, checker.tolerance)
    kernel = EdgeKernel(tables, checker.exact_kernel, checker.nq)
    free = kernel.certify_edges(np.array(begins), ends) == FREE
    return {"edge": _best(kernel.certify_edges, np.array(begins), ends) / count, "free": float(free.mean())}


def _best(function: Callable[..., Any], *arguments: Any) -> float:
    """CPU time of the best of some rounds [s]."""
    times = []
    for _ in range(_ROUNDS):
        begin = time.process_time()
        function(*arguments)
        times.append(time.process_time() - begin)
    return min(times)


def _decompose(
    bare: rp.Scene, mesh: rp.Mesh, place: Any, args: argparse.Namespace, rng: np.random.Generator
) -> dict[str, Any]:
    """Likewise for convex pieces, or why there are none."""
    begin = time.perf_counter()
    try:
        # Pieces of an earlier run would be read from the cache.
        with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, RR1PLAN_CACHE=folder):
            pieces = convex_pieces(mesh, seconds=args.seconds, progress=lambda _: True)
    except (InputError, BackendError) as error:
        return {"failed": str(error)}
    made = time.perf_counter() - begin
    scene = bare.with_obstacle("mesh", [Geometry(f"piece{i}", piece) for i, piece in enumerate(pieces)], place)
    return {"count": len(pieces), "making": made} | _time_edges(scene, args.edges, rng)


# ---- python-fcl ------------------------------------------------------------------------------------


def _compare(scene: rp.Scene, bare: rp.Scene, samples: int, rng: np.random.Generator) -> dict[str, int]:
    """Verdicts at random configurations that are free without the mesh."""
    checker, alone, plain = CollisionChecker(scene), CollisionChecker(bare), PlainCoal(scene)
    low, high = box_of(checker.limits)
    q: list[Array] = []
    while len(q) < samples:
        q += [one for one in rng.uniform(low, high, (samples, checker.nq)) if alone.is_free(one)]
    contacts = ElementChecker(scene, scene.joint_names(), ["FCL"]).contacts(np.array(q[:samples]))
    touching = np.array([any("mesh" in pair for pair in found) for found in contacts])
    found = {"samples": samples, "contacts": int(touching.sum()), "grazing": 0, "different": 0}
    for one, touches in zip(q, touching, strict=False):
        if checker.is_free(one) == touches:
            bracket = plain.bracket(one)
            found["grazing" if max(-bracket.lower, bracket.upper) <= GRAZING else "different"] += 1
    return found


# ---- what came of it -------------------------------------------------------------------------------


def _row(result: dict[str, Any]) -> list[str]:
    def shown(data: dict[str, Any], key: str, scale: float = 1.0) -> str:
        return number(scale * data[key]) if key in data else "-"

    pieces = result.get("pieces", {})
    count = str(pieces.get("count", "none" if "failed" in pieces else "-"))
    row = [result["mesh"], str(result["triangles"]), shown(result, "warm_up", 1e3), shown(result, "edge", 1e6)]
    row += [f"{100 * result['free']:.0f} %", count, shown(pieces, "making"), shown(pieces, "edge", 1e6)]
    row.append(f"{100 * pieces['free']:.0f} %" if "free" in pieces else "-")
    return [*row, *(str(result.get(key, "-")) for key in ("samples", "contacts", "grazing", "different"))]


if __name__ == "__main__":
    sys.exit(main())
