"""Point clouds from files: all encodings of PLY and PCD, arrays and text; damaged files are rejected."""

from __future__ import annotations

import pickle
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

import rr1plan as rp
from rr1plan.shapes.point_cloud_files import read_points

POINTS = np.array([[0.5, -1.25, 2.0], [3.0, 4.5, -0.125], [0.0, 0.75, 1.0]])
COLORS = np.array([[255, 0, 7], [1, 2, 3], [0, 0, 0]], np.uint8)


def pcd(coding: str, points: np.ndarray = POINTS, **changes: str) -> bytes:
    """A PCD file with fields around the coordinates, one of them of three values."""
    entries = {
        "VERSION": "0.7",
        "FIELDS": "intensity x y z normal",
        "SIZE": "1 4 8 4 4",
        "TYPE": "U F F F F",
        "COUNT": "1 1 1 1 3",
        "WIDTH": f"{len(points)}",
        "HEIGHT": "1",
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": f"{len(points)}",
        "DATA": coding,
    } | changes
    head = "# .PCD v0.7\n" + "".join(f"{key} {value}\n" for key, value in entries.items() if value)
    if coding == "ascii":
        return head.encode() + "".join(f"7 {x!r} {y!r} {z!r} 0 0 1\n" for x, y, z in points.tolist()).encode()
    row = np.dtype([("i", "u1"), ("x", "<f4"), ("y", "<f8"), ("z", "<f4"), ("n", "<f4", 3)])
    rows = np.zeros(len(points), row)
    for axis, column in zip("xyz", points.T, strict=True):
        rows[axis] = column
    return head.encode() + rows.tobytes()


def lzf(data: bytes) -> bytes:
    """Compressed as LibLZF does: the longest earlier match of each place that has one of three bytes or more."""
    out, literals, at = bytearray(), bytearray(), 0
    while at < len(data):
        back, length = 0, 0
        for start in range(max(0, at - 8192), at):
            n = 0
            while n < 264 and at + n < len(data) and data[start + n] == data[at + n]:
                n += 1
            if n > length:
                back, length = at - start, n
        if length < 3:
            literals.append(data[at])
            at += 1
            continue
        out += runs(literals)
        literals.clear()
        high, low = divmod(back - 1, 256)
        out += bytes([(length - 2 << 5) + high, low] if length < 9 else [(7 << 5) + high, length - 9, low])
        at += length
    return bytes(out + runs(literals))


def runs(data: bytes) -> bytes:
    """Bytes that are no reference, 32 at a time."""
    return b"".join(bytes([len(data[k : k + 32]) - 1]) + data[k : k + 32] for k in range(0, len(data), 32))


def compressed_pcd(points: np.ndarray = POINTS) -> bytes:
    head, body = pcd("binary", points, DATA="binary_compressed").split(b"binary_compressed\n")
    row = np.dtype([("i", "u1"), ("x", "<f4"), ("y", "<f8"), ("z", "<f4"), ("n", "<f4", 3)])
    rows = np.frombuffer(body, row)
    fields = b"".join(rows[name].tobytes() for name in row.fields)
    packed = lzf(fields)
    return head + b"binary_compressed\n" + struct.pack("<II", len(packed), len(fields)) + packed


def ply(coding: str, points: np.ndarray = POINTS, kind: str = "float") -> bytes:
    head = f"ply\nformat {coding} 1.0\ncomment by a test\nelement vertex {len(points)}\nproperty uchar red\n"
    head += "".join(f"property {kind} {axis}\n" for axis in "xyz")
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    if coding == "ascii":
        lines = [f"9 {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
        return (head + "\n".join([*lines, "3 0 1 2", ""])).encode()
    order = "<" if "little" in coding else ">"
    width = {"float": "f4", "double": "f8"}[kind]
    rows = np.zeros(len(points), [("r", "u1"), *((axis, order + width) for axis in "xyz")])
    for axis, column in zip("xyz", points.T, strict=True):
        rows[axis] = column
    return head.encode() + rows.tobytes() + b"\3" + np.array([0, 1, 2], f"{order}i4").tobytes()


FILES = {
    "ascii.pcd": pcd("ascii"),
    "binary.pcd": pcd("binary"),
    "compressed.pcd": compressed_pcd(),
    "nocount.pcd": b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 3\nDATA binary\n" + POINTS.astype("<f4").tobytes(),
    "ascii.ply": ply("ascii"),
    "little.ply": ply("binary_little_endian"),
    "big.PLY": ply("binary_big_endian", kind="double"),
    "text.xyz": b"# x y z\n" + b"".join(b"%r, %r %r\n" % tuple(p) for p in POINTS.tolist()),
}


@pytest.mark.parametrize("name", FILES)
def test_every_coding_gives_the_same_points(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    cloud = rp.load_point_cloud(tmp_path / name, resolution=0.05)
    np.testing.assert_array_equal(cloud.points, POINTS)
    assert cloud.resolution == 0.05


@pytest.mark.parametrize(
    "text",
    [
        "1 2 3 255 0 0\n4 5 6 0 255 0\n",
        "1.0, 2.0, 3.0, 0.5\n4.0, 5.0, 6.0, 0.7\n",
        "id,X,Y,Z,label\n7,1,2,3,wall\n8,4,5,6,floor\n",
    ],
)
def test_further_columns_of_a_text_are_skipped(tmp_path: Path, text: str) -> None:
    (tmp_path / "scan.csv").write_text(text)
    assert read_points(tmp_path / "scan.csv").tolist() == [[1, 2, 3], [4, 5, 6]]


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_what_trimesh_writes_is_read(tmp_path: Path, encoding: str) -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50, 3)).astype(np.float32)
    data = trimesh.PointCloud(points, colors=rng.integers(0, 255, (50, 4), np.uint8)).export(
        file_type="ply", encoding=encoding
    )
    (tmp_path / "a.ply").write_bytes(data)
    np.testing.assert_allclose(read_points(tmp_path / "a.ply"), points, atol=1e-6)


def test_compressed_points_of_all_lengths_of_matches_are_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    # Rows that repeat at once, later and never: short, long and overlapping references, and runs of literals.
    points = np.repeat(rng.integers(0, 3, (16, 3)) * rng.choice([1.0, np.pi], (16, 1)), rng.integers(1, 30, 16), axis=0)
    points = points.astype(np.float32).astype(float)
    compressed = compressed_pcd(points)
    (tmp_path / "a.pcd").write_bytes(compressed)
    np.testing.assert_array_equal(read_points(tmp_path / "a.pcd"), points)
    assert len(compressed) < 0.5 * len(pcd("binary", points))


def test_rays_that_met_nothing_are_left_out(tmp_path: Path) -> None:
    points = POINTS.copy()
    points[1] = np.nan
    for name, data in (
        ("a.pcd", pcd("binary", points)),
        ("b.pcd", pcd("ascii", points)),
        ("c.ply", ply("ascii", points)),
    ):
        (tmp_path / name).write_bytes(data)
        np.testing.assert_array_equal(read_points(tmp_path / name), POINTS[[0, 2]])
    (tmp_path / "a.pcd").write_bytes(pcd("binary", points[1:2]))
    with pytest.raises(rp.FormatError, match="no point"):
        read_points(tmp_path / "a.pcd")


def test_a_mark_a_header_and_comments_in_any_encoding_are_no_points(tmp_path: Path) -> None:
    scan = tmp_path / "scan.csv"
    scan.write_bytes("\ufeffx,y,z\n1,2,3\n".encode() + "# Größe\n4,5,6\n".encode("latin-1"))
    assert read_points(scan).tolist() == [[1, 2, 3], [4, 5, 6]]
    scan.write_text('"X","Y","Z"\n"1","2","3E0"\n')
    assert read_points(scan).tolist() == [[1, 2, 3]]
    scan.write_text("//X Y Z R G B\n1 2 3 255 0 0\n4 5 6 0 255 0\n")
    assert read_points(scan).tolist() == [[1, 2, 3], [4, 5, 6]]
    cloud = tmp_path / "cloud.pcd"
    cloud.write_bytes("# Größe\n".encode("latin-1") + pcd("binary"))
    np.testing.assert_array_equal(read_points(cloud), POINTS)


@pytest.mark.parametrize("name", ["empty.txt", "empty.npy", "empty.pcd"])
def test_a_file_without_a_point_is_named(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    if name.endswith("npy"):
        np.save(file, np.empty((0, 3)))
    else:
        file.write_bytes(b"" if name.endswith("txt") else pcd("ascii", POINTS[:0]))
    with pytest.raises(rp.FormatError, match=f"{name}: has no point"):
        rp.load_point_cloud(file)


def test_a_scan_that_seems_to_be_in_millimeters_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "meters.xyz").write_text("0 0 0\n0.4 0.3 1\n")
    (tmp_path / "scan.xyz").write_text("0 0 0\n400 300 1000\n")
    rp.load_point_cloud(tmp_path / "meters.xyz")
    assert not caplog.messages
    rp.load_point_cloud(tmp_path / "scan.xyz")
    (tmp_path / "cell.toml").write_text('[obstacles.scan]\npoints = "scan.xyz"\n')
    rp.load_scene(tmp_path / "cell.toml")
    assert len(caplog.messages) == 2
    for message in caplog.messages:
        assert "scan.xyz: the scan is 1000 m wide; if it is in millimeters, multiply its points by 0.001" in message


def test_a_point_at_infinity_is_refused(tmp_path: Path) -> None:
    points = POINTS.copy()
    points[1] = np.inf
    (tmp_path / "a.pcd").write_bytes(pcd("binary", points))
    with pytest.raises(rp.InputError, match="finite"):
        rp.load_point_cloud(tmp_path / "a.pcd")


@pytest.mark.parametrize(("value", "message"), [(np.nan, r"\[1, 2\] is nan"), (2e4, "holds 20000, expected at most")])
@pytest.mark.parametrize("name", ["scan.npy", "scan.txt"])
def test_a_file_with_a_point_that_is_nowhere_is_named(tmp_path: Path, name: str, value: float, message: str) -> None:
    points = POINTS.copy()
    points[1, 2] = value
    (np.save if name.endswith("npy") else np.savetxt)(tmp_path / name, points)
    (tmp_path / "cell.toml").write_text(f'[obstacles.scan]\npoints = "{name}"\n')
    with pytest.raises(rp.FormatError, match=rf"{name}: point cloud.*{message}"):
        rp.load_point_cloud(tmp_path / name)
    with pytest.raises(rp.FormatError, match=rf"{name}: point cloud.*{message}"):
        rp.load_scene(tmp_path / "cell.toml")


def damaged(data: bytes) -> bytes:
    """The file with a back-reference to before its first byte."""
    head, body = data.split(b"compressed\n")
    return head + b"compressed\n" + body[:8] + b"\xff" * (len(body) - 8)


def bomb(packed: int, size: int) -> bytes:
    """A file that repeats a byte 264 times for each three bytes of its content."""
    body = b"\0\0" + b"\xe0\xff\0" * (packed // 3)
    return pcd("binary", POINTS[:0], DATA="binary_compressed") + struct.pack("<II", len(body), size) + body


WRONG: dict[str, tuple[str, bytes, str]] = {
    "empty pcd": ("a.pcd", b"", "no line 'DATA'"),
    "empty ply": ("a.ply", b"", "no line 'end_header'"),
    "cut off": ("a.pcd", pcd("binary")[:-1], "bytes, the header says"),
    "cut off text": ("a.pcd", pcd("ascii").rsplit(b"\n", 2)[0], "lines, the header says"),
    "another coding": ("a.pcd", pcd("binary", DATA="zip"), "expected ascii, binary or binary_compressed"),
    "compressed and cut off": ("a.pcd", compressed_pcd()[:-1], "it holds"),
    "compressed without a size": (
        "a.pcd",
        pcd("binary", DATA="binary_compressed").split(b"compressed\n")[0],
        "no line",
    ),
    "compressed and damaged": ("a.pcd", damaged(compressed_pcd()), "compressed data are damaged"),
    "compressed without an end": ("a.pcd", bomb(2**20, 2**10), "compressed data are damaged"),
    "compressed beyond all bounds": ("a.pcd", bomb(2**10, 2**31), "are the most"),
    "compressed of another number": ("a.pcd", compressed_pcd().replace(b"POINTS 3", b"POINTS 4"), "the header says"),
    "no x": ("a.pcd", pcd("binary", FIELDS="intensity a y z normal"), "it has no 'x'"),
    "no points": ("a.pcd", pcd("binary", POINTS=""), "it has no 'POINTS'"),
    "a size": ("a.pcd", pcd("binary", SIZE="1 4 3 4 4"), "it has no"),
    "a field too many": ("a.pcd", pcd("binary", FIELDS="intensity x y z normal w"), "not a list of points"),
    "negative": ("a.pcd", pcd("binary", POINTS="-1"), "no count"),
    "very many": ("a.pcd", pcd("binary", POINTS="99999999999"), "the header says"),
    "very many values": ("a.pcd", pcd("binary", COUNT="1 1 1 1 99999999999"), "more than 1000"),
    "very many rows of nothing": ("a.pcd", pcd("ascii", POINTS="99999999999"), "lines, the header says"),
    "words": ("a.pcd", pcd("ascii").replace(b"0.5", b"abc"), "not a list of points"),
    "ply of words": ("a.ply", ply("ascii").replace(b"0.5", b"abc"), "not a list of points"),
    "ply cut off": ("a.ply", ply("binary_little_endian")[:-40], "bytes, the header says"),
    "ply of lists": ("a.ply", ply("ascii").replace(b"uchar red", b"list uchar int red"), "vertex of numbers"),
    "ply of faces first": ("a.ply", ply("ascii").replace(b"element vertex", b"element face"), "vertex of numbers"),
    "ply of equal names": ("a.ply", ply("ascii").replace(b"uchar red", b"uchar x"), "two columns 'x'"),
    "ply of another coding": ("a.ply", ply("ascii").replace(b"ascii", b"utf8"), "it has no 'utf8'"),
    "ply of another type": ("a.ply", ply("ascii").replace(b"float x", b"half x"), "it has no 'half'"),
    "ply of a property first": (
        "a.ply",
        b"ply\nformat ascii 1.0\nproperty float x\nend_header\n",
        "not a list of points",
    ),
    "no ply": ("a.ply", b"plx\nformat ascii 1.0\nend_header\n", "does not begin"),
    "not ASCII": ("a.ply", b"ply\nformat ascii 1.0\ncomment \xff\nend_header\n", "not a list of points"),
    "a header that ends in a bracket": (
        "a.npy",
        b"\x93NUMPY\x01\x00v\x00" + b"{'shape': (3,".ljust(118),
        "not a list of points: damaged",
    ),
    "a pickle": ("a.npy", pickle.dumps([1, 2, 3]), "not a list"),
    "ply without x": ("a.ply", ply("ascii").replace(b"float x", b"float X"), "it has no 'x'"),
    "a line of words": ("a.csv", b"x,y,z\n1,2,3\n\n4,5,six\n", "line 4: 'six' is not a number"),
    "a line of colors": ("a.xyz", b"1 2 3\n1 2 3 255 0 0\n", "line 2: expected three numbers, got '1 2 3 255 0 0'"),
    "a line without a color": ("a.xyz", b"1 2 3 255 0 0\n1 2 3\n", "line 2: expected 6 columns, got '1 2 3'"),
    "decimal commas": ("a.xyz", b"1,5 2,5 3,5\n", "line 1: expected three numbers, got '1,5 2,5 3,5'"),
    "a line without an end": ("a.xyz", b"1 2 3 " * 1000, r"got '1 2 3 .{,200}$"),
    "a slip between digits": ("a.xyz", b"1_0 2 3\n", "line 1: '1_0' is not a number"),
    "a suffix": ("a.las", b"", "expected one of"),
    "UTF-16": ("a.csv", "1 2 3\n".encode("utf-16"), "is UTF-16, not UTF-8 text: save it as UTF-8"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_damaged_file_is_refused_in_words(tmp_path: Path, case: str) -> None:
    name, data, message = WRONG[case]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(rp.FormatError, match=rf"{name}.*{message}"):
        read_points(tmp_path / name)


def test_a_scene_file_takes_a_scan_and_a_mesh_by_their_names(tmp_path: Path) -> None:
    (tmp_path / "scan.pcd").write_bytes(pcd("binary"))
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "box.stl")
    short, long = tmp_path / "short.toml", tmp_path / "long.toml"
    short.write_text('[obstacles.scan]\npoints = "scan.pcd"\n[obstacles.box]\nmesh = "box.stl"\n')
    long.write_text(
        'name = "short"\n[obstacles.scan]\npoints = { file = "scan.pcd", resolution = 0.02 }\n'
        '[obstacles.box]\nmesh = { file = "box.stl", scale = 1.0 }\n'
    )
    assert rp.load_scene(short).content_hash == rp.load_scene(long).content_hash


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ('mesh = { fil = "a.stl" }', "'file' where it says 'fil'"),
        ('points = { flie = "a.pcd" }', "'file' where it says 'flie'"),
        ("mesh = { vertice = [[0, 0, 0]], faces = [[0, 0, 0]] }", "'vertices' where it says 'vertice'"),
        ("cylinder = { radius = 1, lenght = 1 }", "'length' where it says 'lenght'"),
        ("boxx = [1, 1, 1]", "'box' where it says 'boxx'"),
    ],
)
def test_a_misspelt_key_is_answered_with_the_near_one(tmp_path: Path, text: str, near: str) -> None:
    (tmp_path / "a.toml").write_text(f"[obstacles.thing]\n{text}\n")
    with pytest.raises(rp.FormatError, match=rf"a\.toml:\d.*Did you mean {near}"):
        rp.load_scene(tmp_path / "a.toml")
