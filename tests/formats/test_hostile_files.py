"""Paths that are not regular files, and small files with huge content: every reader rejects them immediately."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rr1plan as rp
from rr1plan.robot.srdf import read_srdf
from rr1plan.robot.urdf import read_urdf
from rr1plan.robot.xacro import expand_xacro
from rr1plan.scene.motion_bench import problem_set_joints
from rr1plan.shapes.mesh_files import SUFFIXES, read_mesh
from rr1plan.shapes.point_cloud_files import read_points

URDF = '<robot name="r"><link name="base"/></robot>'

READERS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "urdf": (rp.load_robot, "a.urdf"),
    "mjcf": (rp.load_robot, "a.mjcf"),
    "mjcf scene": (rp.load_scene, "a.xml"),
    "xacro": (expand_xacro, "a.xacro"),
    "srdf": (lambda file: read_srdf(file, read_urdf(URDF)), "a.srdf"),
    "scene": (rp.load_scene, "a.toml"),
    "sequence": (rp.load_segments, "a.toml"),
    "moveit": (rp.load_scene, "a.scene"),
    "bench": (rp.load_scene, "a.yaml"),
    "problems": (problem_set_joints, "a.json.gz"),
    "motion": (rp.load_motion, "a.json"),
    "csv": (rp.load_csv, "a.csv"),
    "message": (rp.load_joint_trajectory, "a.yaml"),
    "points": (read_points, "a.npy"),
    "text points": (read_points, "a.xyz"),
    "ply points": (read_points, "a.ply"),
    "pcd points": (rp.load_point_cloud, "a.pcd"),
    **{suffix: (read_mesh, f"a{suffix}") for suffix in SUFFIXES},
}


@pytest.fixture(params=READERS)
def reader(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Callable[[Path], Any], Path]:
    if request.param == "xacro":
        pytest.importorskip("xacrodoc")
    read, name = READERS[request.param]
    return read, tmp_path / name


def test_a_fifo_is_refused_and_not_waited_for(reader: tuple[Callable[[Path], Any], Path]) -> None:
    read, file = reader
    os.mkfifo(file)
    with pytest.raises(rp.FormatError, match=f"{file.name}.*is a FIFO, expected a regular file"):
        read(file)


WRITERS: dict[str, Callable[[Path, rp.Scene], Any]] = {
    "scene": lambda file, scene: rp.save_scene(file.with_suffix(".toml"), scene),
    "page": lambda file, scene: rp.save_html(file.with_suffix(".html"), scene),
    "picture": lambda file, scene: rp.cspace(scene, resolution=8).save(file.with_suffix(".png")),
    "model": lambda file, scene: rp.save_mjcf(file.with_suffix(".xml"), scene),
    "samples": lambda file, scene: rp.save_csv(
        file.with_suffix(".csv"), rp.Trajectory.rest(scene.joint_names(), [0.0] * len(scene.joint_names()))
    ),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_a_fifo_and_a_device_are_not_replaced_by_a_file(writer: str, tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    WRITERS[writer](tmp_path / "good", scene)
    (good,) = tmp_path.iterdir()
    fifo, link, old = (tmp_path / f"{name}{good.suffix}" for name in ("fifo", "link", "good"))
    os.mkfifo(fifo)
    link.symlink_to("/dev/full")
    for file, kind in ((fifo, "a FIFO"), (link, "a device")):
        with pytest.raises(rp.InputError, match=f"cannot write .*{file.name}: it is {kind}, expected a regular file"):
            WRITERS[writer](file, scene)
    assert sorted(tmp_path.iterdir()) == sorted([fifo, link, old])
    assert fifo.is_fifo()
    assert link.is_symlink()


@pytest.mark.parametrize("writer", WRITERS)
def test_a_file_is_written_whole_or_not_at_all(writer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    WRITERS[writer](tmp_path / "good", scene)
    (good,) = tmp_path.iterdir()
    before = good.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(rp.InputError, match=r"cannot write .*good.*: No space left"):
        WRITERS[writer](tmp_path / "good", scene.without_arm("arm").with_arm("other", rp.load_robot("planar2r")))
    assert [file.name for file in tmp_path.iterdir()] == [good.name]
    assert good.read_bytes() == before


def test_a_device_is_refused_and_not_read_to_its_end(reader: tuple[Callable[[Path], Any], Path]) -> None:
    read, file = reader
    file.symlink_to("/dev/zero")
    with pytest.raises(rp.FormatError, match=f"{file.name}.*is a device, expected a regular file"):
        read(file)


def test_a_folder_is_refused(reader: tuple[Callable[[Path], Any], Path]) -> None:
    read, file = reader
    file.mkdir()
    with pytest.raises(rp.FormatError, match=f"{file.name}.*is a folder, expected a regular file"):
        read(file)


def test_a_loop_of_links_is_refused(reader: tuple[Callable[[Path], Any], Path]) -> None:
    read, file = reader
    file.symlink_to(file)
    with pytest.raises(rp.FormatError, match=f"{file.name}.*cannot be read"):
        read(file)


def test_a_file_that_is_not_there_is_named(reader: tuple[Callable[[Path], Any], Path]) -> None:
    read, file = reader
    with pytest.raises(rp.FormatError, match=f"{file.name}.*no such file"):
        read(file)


def test_a_file_of_a_terabyte_is_refused_by_its_size(reader: tuple[Callable[[Path], Any], Path]) -> None:
    read, file = reader
    file.touch()
    os.truncate(file, 2**40)
    with pytest.raises(rp.FormatError, match=f"{file.name}.*is larger than"):
        read(file)


@pytest.mark.parametrize("stem", ["x" * 300, "/".join(["x" * 200] * 30), "a\0b", "\ud800"])
def test_a_name_that_no_file_can_have_is_refused(stem: str, reader: tuple[Callable[[Path], Any], Path]) -> None:
    read, file = reader
    with pytest.raises(rp.InputError, match="file name"):
        read(file.with_name("x").parent / f"{stem}{file.suffix}")


URDF_MESH = """<robot name="r"><link name="base"/><link name="arm">
<{role}><geometry><mesh filename="{name}"/></geometry></{role}></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


@pytest.mark.parametrize("name", ["x" * 300 + ".stl", "package://" + "y" * 300 + "/a.stl", "pipe.stl", "loop.stl"])
def test_a_mesh_that_is_no_file_is_refused_with_its_line(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "loop.stl").symlink_to("loop.stl")
    file = tmp_path / "a.urdf"
    file.write_text(URDF_MESH.format(role="collision", name=name))
    why = "is not a regular file" if name in ("pipe.stl", "loop.stl") else "longer than 255 bytes"
    with pytest.raises(rp.FormatError, match=rf"a\.urdf:2: .*{why}"):
        rp.load_robot(file)


def test_a_mesh_that_is_only_looked_at_and_no_file_is_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    file = tmp_path / "a.urdf"
    for name in ("pipe.stl", "x" * 300 + ".stl"):
        file.write_text(URDF_MESH.format(role="visual", name=name))
        assert rp.load_robot(file).nq == 1
        assert "shown without it" in caplog.text
        caplog.clear()


@pytest.mark.parametrize("name", ["pipe.stl", "x" * 300 + ".stl", "loop.stl", "a\\u0000.stl", "/dev/zero"])
@pytest.mark.parametrize("kind", ["mesh", "points"])
def test_a_scene_names_what_is_no_file(tmp_path: Path, kind: str, name: str) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "loop.stl").symlink_to("loop.stl")
    file = tmp_path / "a.toml"
    file.write_text(f'[obstacles.thing]\n{kind} = {{ file = "{name}" }}\n')
    with pytest.raises(rp.FormatError):
        rp.load_scene(file)


@pytest.mark.parametrize("key", ["robot", "srdf"])
@pytest.mark.parametrize("name", ["./" + "x" * 300 + ".urdf", "./a\\u0000.urdf", "loop.urdf"])
def test_a_scene_names_a_robot_that_is_no_file(tmp_path: Path, key: str, name: str) -> None:
    (tmp_path / "loop.urdf").symlink_to("loop.urdf")
    file = tmp_path / "a.toml"
    file.write_text(f'[arms.a]\n{key} = "{name}"\n' + ('robot = "rr1"\n' if key == "srdf" else ""))
    with pytest.raises(rp.FormatError, match=r"a\.toml|loop\.urdf"):
        rp.load_scene(file)


# ---- small files that stand for large values -------------------------------------------------


def test_groups_that_double_forty_times_are_read(tmp_path: Path) -> None:
    tree = read_urdf(URDF_MESH.format(role="visual", name="a.stl"))
    groups = "".join(f'<group name="g{i}"><group name="g{i + 1}"/><group name="g{i + 1}"/></group>' for i in range(40))
    srdf = f'<robot name="r">{groups}<group name="g40"><joint name="j"/></group></robot>'
    assert set(read_srdf(srdf, tree).groups.values()) == {("j",)}


def test_groups_that_nest_three_thousand_deep_are_read(tmp_path: Path) -> None:
    tree = read_urdf(URDF_MESH.format(role="visual", name="a.stl"))
    chain = "".join(f'<group name="g{i}"><group name="g{i + 1}"/></group>' for i in range(3000))
    semantics = read_srdf(f'<robot name="r">{chain}<group name="g3000"><joint name="j"/></group></robot>', tree)
    assert semantics.groups["g0"] == ("j",)
    with pytest.raises(rp.FormatError, match="contains itself"):
        read_srdf(f'<robot name="r">{chain}<group name="g3000"><group name="g17"/></group></robot>', tree)


def test_a_robot_of_very_many_links_is_refused() -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(1001))
    with pytest.raises(rp.FormatError, match="has 1001 links, expected at most 1000"):
        read_urdf(f'<robot name="r">{links}</robot>')


DEEP = {
    "dots": ("a.toml", "a" + ".a" * 10_000 + " = 1\n"),
    "very many dots": ("a.toml", "x = 1\n" + "a" + ".a" * 1_000_000 + " = 1\n"),
    "quoted dots": ("a.toml", '"$"' + '."$"' * 10_000 + " = 1\n"),
    "a deep header": ("a.toml", "[a" + ".a" * 10_000 + "]\n"),
    "inline tables": ("a.toml", "a = " + "{a=" * 5_000 + "1" + "}" * 5_000),
    "lists": ("a.toml", "a = " + "[" * 5_000 + "]" * 5_000),
    "objects": ("a.json", '{"a":' * 50_000 + "1" + "}" * 50_000),
    "a few objects": ("a.json", '{"a":' * 500 + "1" + "}" * 500),
    "yaml lists": ("a.yaml", "a: " + "[" * 5_000 + "]" * 5_000),
    "a list that contains itself": ("a.yaml", "a: &a [*a]"),
}
LOADERS = {".toml": rp.load_scene, ".json": rp.load_motion, ".yaml": rp.load_scene}


@pytest.mark.parametrize("case", DEEP)
def test_depth_is_bounded_and_named(tmp_path: Path, case: str) -> None:
    name, text = DEEP[case]
    (tmp_path / name).write_text(text)
    with pytest.raises(rp.FormatError, match=r"deeper than 100|more than 100 dots|aliases of aliases"):
        LOADERS[Path(name).suffix](tmp_path / name)


def test_long_lines_and_dots_in_strings_are_no_deep_keys(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    points = ", ".join(["[0.5, 0.25, 0.125]"] * 200)
    words = "a." * 500
    file.write_text(f'description = "{words}"\n[obstacles.a]\npoints = {{ points = [{points}] }} # {words}\n')
    assert rp.load_scene(file).description == words


YAML_BOMBS = {
    "aliases": "a0: &a0 [1, 1]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 40)),
    "merges": "a0: &a0 {b: 1}\n" + "".join(f"a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}\n" for i in range(1, 40)),
    "an empty whole number": 'a: !!int ""',
    "no date": "a: !!timestamp abc",
    "no truth": "a: !!bool abc",
}


@pytest.mark.parametrize("case", YAML_BOMBS)
def test_yaml_that_expands_without_end_or_breaks_its_parser_is_refused(tmp_path: Path, case: str) -> None:
    (tmp_path / "a.yaml").write_text(YAML_BOMBS[case])
    with pytest.raises(rp.FormatError, match=r"aliases|merge keys|is not YAML"):
        rp.load_scene(tmp_path / "a.yaml")


def test_aliases_in_yaml_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(
        "world: {collision_objects: [{id: a, primitives: [{type: box, dimensions: &d [1, 1, 1]}], primitive_poses: "
        "[{position: &p [0, 0, 0], orientation: [0, 0, 0, 1]}]}, {id: b, primitives: [{type: box, dimensions: *d}], "
        "primitive_poses: [{position: *p, orientation: [0, 0, 0, 1]}]}]}\n"
    )
    assert set(rp.load_scene(tmp_path / "a.yaml").obstacles) == {"a", "b"}


@pytest.mark.parametrize("number", ["9" * 400, "-" + "9" * 400, "9" * 5_000])
def test_a_whole_number_beyond_all_floats_is_refused(tmp_path: Path, number: str) -> None:
    (tmp_path / "a.toml").write_text(f"padding = {number}\n")
    with pytest.raises(rp.FormatError):
        rp.load_scene(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_text(f"[obstacles.a]\nbox = [1, 1, {number}]\n")
    with pytest.raises(rp.FormatError):
        rp.load_scene(tmp_path / "a.toml")


XACRO = {
    "power": '<xacro:property name="a" value="${10**10**10}"/><link name="${a}"/>',
    "doubling": "".join(f'<xacro:macro name="m{i}"><xacro:m{i + 1}/><xacro:m{i + 1}/></xacro:macro>' for i in range(40))
    + '<xacro:macro name="m40"><link/></xacro:macro><xacro:m0/>',
}


@pytest.mark.parametrize("case", XACRO)
def test_xacro_that_does_not_end_is_stopped(tmp_path: Path, case: str) -> None:
    pytest.importorskip("xacrodoc")
    file = tmp_path / "a.xacro"
    file.write_text(f'<robot name="r" xmlns:xacro="http://x">{XACRO[case]}</robot>')
    with pytest.raises(rp.FormatError, match=r"a\.xacro: is not expanded within 1 s"):
        expand_xacro(file, seconds=1.0)


def test_xacro_that_fills_the_memory_is_stopped(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc")
    file = tmp_path / "a.xacro"
    file.write_text('<robot name="r" xmlns:xacro="http://x"><link name="${[0] * 10**10}"/></robot>')
    with pytest.raises(rp.FormatError, match=r"a\.xacro: cannot be expanded: MemoryError"):
        expand_xacro(file)
