"""Has roboplan answer the problems of a file, in an environment of its own."""

from __future__ import annotations

import gzip
import json
import os
import subprocess
import tempfile
import venv
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import trimesh
from shared import console, track

PEER = "roboplan==0.7.0"
STEPS = (0.05, 0.01)  # its collision-check steps [rad]: its default, and one five times as fine


def ask_peer(
    environment: Path, file: Path, urdf: Path, srdf: Path, names: Sequence[str], seed: int
) -> list[dict[str, Any]]:
    """Its answers, one for each problem and step: CPU seconds of each stage, the raw and the short path.

    Args:
        environment: Folder of its virtual environment; made when there is none.
        file: The problems.
        urdf: The robot; each collision mesh is replaced by its convex hull, as rr1plan has it.
        srdf: Its groups and disabled pairs.
        names: The problems to answer.
        seed: Its seed.
    """
    python = _interpreter(environment)
    joints, problems = _plain_problems(file, set(names))
    task = {"srdf": str(srdf), "steps": STEPS, "seed": seed, "joints": joints, "problems": problems}
    with tempfile.TemporaryDirectory() as folder:
        task["urdf"] = str(_with_hulls(urdf, Path(folder)))
        return _run(python, task, len(problems) * len(STEPS))


def _interpreter(environment: Path) -> Path:
    """The environment's Python, after installing what it lacks."""
    python = environment / ("Scripts" if os.name == "nt" else "bin") / "python"
    if not python.exists():
        with console.status(f"installing {PEER} into {environment}"):
            venv.create(environment, with_pip=True)
            subprocess.run([python, "-m", "pip", "install", "-q", PEER], check=True)
    return python


def _plain_problems(file: Path, names: set[str]) -> tuple[list[str], list[dict[str, Any]]]:
    """The problems as they stand in the file."""
    raw = file.read_bytes()
    data = json.loads(gzip.decompress(raw) if file.suffix == ".gz" else raw)
    problems = [
        {"name": f"{group}/{e['i']}", "start": e["start"], "goal": e["goals"][0]}
        | {kind: e[kind] for kind in ("boxes", "cylinders", "spheres")}
        for group, entries in data["problems"].items()
        for e in entries
    ]
    return data["joints"], [p for p in problems if p["name"] in names]


def _with_hulls(urdf: Path, folder: Path) -> Path:
    """A copy of the URDF in which every collision mesh is its own convex hull."""
    tree = ElementTree.parse(urdf)
    for mesh in tree.iterfind(".//collision//mesh"):
        source = urdf.parent / mesh.attrib["filename"].removeprefix("package://")
        hull = folder / f"{source.stem}.stl"
        trimesh.load(source, force="mesh").convex_hull.export(hull)
        mesh.attrib["filename"] = f"package://{hull.name}"
    for link in tree.iterfind("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    copy = folder / urdf.name
    tree.write(copy)
    return copy


def _run(python: Path, task: dict[str, Any], count: int) -> list[dict[str, Any]]:
    worker = Path(__file__).with_name("roboplan_worker.py")
    # Its environment must not see this one's packages.
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    with subprocess.Popen(
        [python, worker], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=clean
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        json.dump(task, process.stdin)
        process.stdin.close()
        lines = (process.stdout.readline() for _ in track(range(count), "roboplan"))
        answers = [json.loads(line) for line in lines if line]
    if process.returncode != 0:
        raise SystemExit(f"roboplan's worker ended with {process.returncode}")
    return answers
