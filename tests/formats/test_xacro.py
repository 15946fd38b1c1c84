"""Xacro files, through the optional package xacrodoc."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.errors import FormatError, MissingPackageError
from rr1plan.robot.xacro import expand_xacro

XACRO = """<robot name="stack" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.5"/>
  <xacro:property name="length" value="$(arg length)"/>
  <xacro:macro name="arm" params="i parent">
    <link name="l${i}"><collision><origin xyz="${length / 2} 0 0"/>
      <geometry><box size="${length} 0.02 0.02"/></geometry></collision></link>
    <joint name="j${i}" type="revolute"><parent link="${parent}"/><child link="l${i}"/>
      <origin xyz="${length} 0 0"/><axis xyz="0 0 1"/>
      <limit lower="${-pi / 2}" upper="${pi / 2}" velocity="1" effort="1"/></joint>
  </xacro:macro>
  <link name="base"/>
  <xacro:arm i="1" parent="base"/>
  <xacro:arm i="2" parent="l1"/>
</robot>
"""


@pytest.fixture
def stack(tmp_path: Path) -> Path:
    file = tmp_path / "stack.urdf.xacro"
    file.write_text(XACRO)
    return file


def test_a_xacro_file_loads_like_a_urdf(stack: Path) -> None:
    pytest.importorskip("xacrodoc")
    robot = rp.load_robot(stack)
    assert robot.joint_names == ("j1", "j2")
    assert np.allclose(robot.limits.upper, np.pi / 2)
    assert np.allclose(robot.link_poses([0, 0])["l2"][:3, 3], [1.0, 0, 0])


def test_arguments_reach_the_file(stack: Path) -> None:
    pytest.importorskip("xacrodoc")
    robot = rp.load_robot(str(stack), xacro_arguments={"length": "0.2"})
    assert np.allclose(robot.link_poses([0, 0])["l2"][:3, 3], [0.4, 0, 0])


def test_arguments_in_scene_files_are_texts_numbers_or_booleans(stack: Path) -> None:
    pytest.importorskip("xacrodoc")
    unread = '<xacro:if value="$(arg long)"><link name="${1/0}"/></xacro:if>'
    stack.write_text(XACRO.replace("</robot>", f"{unread}</robot>"))
    scene = stack.with_name("cell.toml")
    for length in ("0.2", '"0.2"'):
        arguments = f"{{length = {length}, long = false}}"
        scene.write_text(f'[arms.a]\nrobot = "{stack.name}"\nxacro_arguments = {arguments}\n')
        robot = rp.load_scene(scene).arm("a").robot
        assert np.allclose(robot.link_poses([0, 0])["l2"][:3, 3], [0.4, 0, 0])
        assert robot.load_options["xacro_arguments"] == {"length": "0.2", "long": "false"}
    assert rp.load_robot(stack, xacro_arguments={"length": 0.2, "long": False}).content_hash == robot.content_hash
    scene.write_text(scene.read_text().replace('"0.2"', "[0.2]"))
    with pytest.raises(FormatError, match=r"length: expected text, a number, true or false, got \[0\.2\]"):
        rp.load_scene(scene)


def test_arguments_that_the_file_does_not_have_are_reported(stack: Path, caplog: pytest.LogCaptureFixture) -> None:
    pytest.importorskip("xacrodoc")
    expand_xacro(stack, arguments={"length": "0.2", "lenght": "0.3"})
    assert [record.getMessage() for record in caplog.records] == [
        f"{stack}: has no xacro argument 'lenght', which has no effect; it has length"
    ]
    caplog.clear()
    by_function = "${xacro.arg('side')} $(arg color)"
    stack.write_text(XACRO.replace('<link name="base"/>', f'<link name="base"/><sensor name="{by_function}"/>'))
    expand_xacro(stack, arguments={"side": "left", "color": "red"})
    assert not caplog.records


def test_includes_from_packages_are_found_in_the_given_folders(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc")
    package = tmp_path / "ws" / "my_arm"
    package.mkdir(parents=True)
    (package / "part.xacro").write_text('<robot xmlns:xacro="http://x"><link name="base"/></robot>')
    file = tmp_path / "top.xacro"
    file.write_text(
        '<robot name="r" xmlns:xacro="http://x"><xacro:include filename="$(find my_arm)/part.xacro"/></robot>'
    )
    assert 'name="base"' in expand_xacro(file, package_dirs=[package.parent])
    assert 'name="base"' in expand_xacro(file, package_dirs=[package])
    download = package.rename(package.with_name("my_arm-main"))
    (download / "package.xml").write_text("<package><name>my_arm</name></package>")
    assert 'name="base"' in expand_xacro(file, package_dirs=[package.parent])
    hand = package.with_name("hand") / "urdf"
    hand.mkdir(parents=True)
    (hand.parent / "package.xml").write_text("<package><name>hand</name></package>")
    assert 'name="base"' in expand_xacro(Path(shutil.copy(file, hand)))
    with pytest.raises(FormatError, match="my_arm"):
        expand_xacro(file)


def test_a_package_that_is_not_there_is_named_with_a_way_to_do_without_it(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc")
    file = tmp_path / "arm.xacro"
    file.write_text(
        '<robot name="r" xmlns:xacro="http://x"><xacro:arg name="control" default="$(find arm_control)/c.yaml"/>'
        '<link name="base"/><gazebo><x>$(arg control)</x></gazebo></robot>'
    )
    with pytest.raises(FormatError, match=r"'arm_control'.*package_dirs.*an empty folder 'arm_control'"):
        expand_xacro(file)
    (tmp_path / "stand_in" / "arm_control").mkdir(parents=True)
    for folder in (tmp_path / "stand_in", tmp_path / "stand_in" / "arm_control"):
        assert 'name="base"' in expand_xacro(file, package_dirs=[folder])


RECURSION = '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>'


@pytest.mark.parametrize("inside", [RECURSION, "<a x='${1/0}'/>", "<xacro:none/>", "<a x='${unknown}'/>", "<a>"])
def test_whatever_goes_wrong_inside_is_a_format_error(tmp_path: Path, inside: str) -> None:
    pytest.importorskip("xacrodoc")
    file = tmp_path / "bad.xacro"
    file.write_text(f'<robot name="r" xmlns:xacro="http://x">{inside}</robot>')
    with pytest.raises(FormatError, match=r"bad\.xacro"):
        expand_xacro(file)


def test_a_missing_file_is_a_format_error(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc")
    with pytest.raises(FormatError, match="no such file"):
        expand_xacro(tmp_path / "none.xacro")


def test_without_xacrodoc_the_extra_is_named(stack: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(MissingPackageError, match=r"rr1plan\[xacro\]"):
        rp.load_robot(stack)


def test_a_urdf_that_is_a_xacro_is_expanded_when_arguments_say_so(tmp_path: Path) -> None:
    file = tmp_path / "stack.urdf"
    file.write_text(XACRO)
    pytest.importorskip("xacrodoc")
    with pytest.raises(FormatError, match=r"option xacro_arguments"):
        rp.load_robot(file)
    assert rp.load_robot(file, xacro_arguments={}).nq == 2


def test_what_a_xacro_includes_by_a_plain_name_is_beside_it(
    tmp_path: Path, stack: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("xacrodoc")
    (tmp_path / "parts").mkdir()
    (tmp_path / "elsewhere").mkdir()
    stack.rename(tmp_path / "parts" / "stack.xacro")
    outer = tmp_path / "outer.xacro"
    outer.write_text('<robot name="r" xmlns:xacro="http://x"><xacro:include filename="parts/stack.xacro"/></robot>')
    for folder in (tmp_path, tmp_path / "elsewhere"):
        monkeypatch.chdir(folder)
        assert rp.load_robot(outer).nq == 2
        assert rp.load_robot(Path("../outer.xacro") if folder != tmp_path else Path("outer.xacro")).nq == 2


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="has no FIFOs")
@pytest.mark.parametrize(
    "inside",
    [
        '<xacro:include filename="pipe"/>',
        '<xacro:include filename="p*"/>',
        '<xacro:include filename="link"/>',
        '<xacro:include filename="/dev/zero"/>',
        '<xacro:property name="x" value="${xacro.load_yaml(\'pipe\')}"/><link name="${x}"/>',
    ],
)
def test_a_fifo_or_device_that_is_included_is_refused_before_it_is_read(tmp_path: Path, inside: str) -> None:
    pytest.importorskip("xacrodoc")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("pipe")
    file = tmp_path / "arm.xacro"
    file.write_text(f'<robot name="r" xmlns:xacro="http://x"><link name="base"/>{inside}</robot>')
    with pytest.raises(FormatError, match=r"arm\.xacro: cannot be expanded: .*is a FIFO or device, expected a regular"):
        expand_xacro(file)


@pytest.mark.parametrize(
    "inside",
    [
        '<xacro:include filename="none.xacro"/>',
        '<xacro:property name="x" value="${xacro.load_yaml(\'none.xacro\')}"/><link name="${x}"/>',
    ],
)
def test_a_missing_file_is_named_once(tmp_path: Path, inside: str) -> None:
    pytest.importorskip("xacrodoc")
    file = tmp_path / "arm.xacro"
    file.write_text(f'<robot name="r" xmlns:xacro="http://x"><link name="base"/>{inside}</robot>')
    with pytest.raises(FormatError, match=r"there is no file '.*none\.xacro', which it includes") as caught:
        expand_xacro(file)
    assert str(caught.value).count("none.xacro") == 1
