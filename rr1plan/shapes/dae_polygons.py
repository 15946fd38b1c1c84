"""Concave polygons of DAE files as triangles, because readers divide them into fans that cover their notches."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import FormatError
from rr1plan.shapes.concave_faces import concave_triangles


def with_triangulated_polygons(data: bytes, file: Path) -> bytes:
    """The DAE with triangles for its concave polygons.

    Args:
        data: A DAE without document type. If it is damaged, it is returned as it is, and the parser says what is wrong.
        file: Its file, for messages.

    Raises:
        FormatError: too many corners in concave polygons.
    """
    if b"polylist" not in data and b"polygons" not in data:
        return data
    try:
        root = ElementTree.fromstring(data)
        by_id = {"#" + element.get("id", ""): element for element in root.iter()}
        lists = [element for element in root.iter() if _tag(element) in ("polylist", "polygons")]
        changed = [_triangulate(element, by_id, file) for element in lists]
    except FormatError:
        raise
    except (ElementTree.ParseError, ValueError, LookupError):
        return data
    return ElementTree.tostring(root) if any(changed) else data


def _triangulate(polygons: Element, by_id: dict[str, Element], file: Path) -> bool:
    """Divide concave polygons of an element into triangles; whether there are any."""
    inputs = _children(polygons, "input")
    width = 1 + max(int(each.get("offset", "0")) for each in inputs)
    (vertex,) = (each for each in inputs if each.get("semantic") == "VERTEX")
    column = int(vertex.get("offset", "0"))
    lists = _children(polygons, "p")
    corners = np.array(" ".join(each.text or "" for each in lists).split(), dtype=int).reshape(-1, width)
    if _tag(polygons) == "polylist":
        counts = np.array((_children(polygons, "vcount")[0].text or "").split(), dtype=int)
    else:
        counts = np.array([len((each.text or "").split()) // width for each in lists])
    if not (counts > 3).any() or counts.sum() != len(corners) or counts.min() < 0:
        return False
    faces = np.split(corners, np.cumsum(counts)[:-1])
    points = _points(vertex, by_id)
    if corners[:, column].min() < 0 or corners[:, column].max() >= len(points):
        return False
    concave = concave_triangles(points, [face[:, column].tolist() for face in faces], file)
    if not concave:
        return False
    parts = [face[t] for i, face in enumerate(faces) for t in concave.get(i, [list(range(len(face)))])]
    namespace = polygons.tag.removesuffix(_tag(polygons))
    polygons.tag = f"{namespace}polylist"
    polygons.set("count", str(len(parts)))
    for each in [*lists, *_children(polygons, "vcount")]:
        polygons.remove(each)
    for tag, numbers in (("vcount", [len(part) for part in parts]), ("p", np.concatenate(parts).ravel().tolist())):
        ElementTree.SubElement(polygons, f"{namespace}{tag}").text = " ".join(map(str, numbers))
    return True


def _points(vertex: Element, by_id: dict[str, Element]) -> Array:
    """The positions that an input of vertices refers to, shape (n, 3)."""
    vertices = by_id[vertex.get("source", "")]
    (position,) = (each for each in _children(vertices, "input") if each.get("semantic") == "POSITION")
    (numbers,) = _children(by_id[position.get("source", "")], "float_array")
    return np.array((numbers.text or "").split(), dtype=float).reshape(-1, 3)


def _children(element: Element, tag: str) -> list[Element]:
    return [child for child in element if _tag(child) == tag]


def _tag(element: Element) -> str:
    """The tag without its namespace."""
    return element.tag.rpartition("}")[2]
