"""Scenes and meshes through the public names: what `save_scene` writes, `load_scene` reads back as the same scene."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import trimesh

import rr1plan as rp
from rr1plan.export.plan_files import read_plan_file, save_motion
from rr1plan.scene.model_library import robot_folder

ARM = """<robot name="crane">
<link name="base"/>
<link name="boom"><collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.05 0.05"/></geometry></collision></link>
<link name="jib"><collision><origin xyz="0.2 0 0.1"/><geometry><box size="0.3 0.05 0.05"/></geometry></collision></link>
<link name="hook"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="boom"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="fold" type="revolute"><parent link="boom"/><child link="jib"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><parent link="jib"/><child link="hook"/><origin xyz="0.4 0 0"/></joint>
</robot>"""


@pytest.fixture
def crane(tmp_path: Path) -> Path:
    file = tmp_path / "crane.urdf"
    file.write_text(ARM)
    return file


def test_a_scene_of_shipped_robots_is_saved_and_loaded_by_public_names(tmp_path: Path) -> None:
    scene = rp.load_scene("rr1_pair").with_obstacle("post", rp.Cylinder(0.02, 0.3), [0.5, 0.5, 0.15])
    problems = rp.load_problems("rr1_pair")
    file = rp.save_scene(tmp_path / "cell.toml", scene, problems=problems)
    assert rp.load_scene(file).content_hash == scene.content_hash
    assert set(rp.load_problems(file)) == set(problems)


def test_a_robot_from_a_file_is_found_again_with_its_joints_and_tool(tmp_path: Path, crane: Path) -> None:
    robot = rp.load_robot(crane, joints=["fold"], tool="jib")
    scene = rp.Scene().with_arm("crane", robot, (0, 0, 1), q=[0.3])
    read = rp.load_scene(rp.save_scene(tmp_path / "cell.toml", scene))
    assert read.content_hash == scene.content_hash
    assert read.arms["crane"].robot.tool == "jib"
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    shutil.copy(crane, folder / "moved.urdf")
    named = rp.save_scene(folder / "cell.toml", scene, robots={"crane": "./moved.urdf"})
    assert "./moved.urdf" in named.read_text()
    assert rp.load_scene(named).content_hash == scene.content_hash


@pytest.mark.usefixtures("foreign_robots")
@pytest.mark.parametrize("name", ["ur5", "talos_left_arm", "xarm7", "alexander_v1.lowerBodyOnly"])
def test_an_installed_robot_is_saved_by_its_name(tmp_path: Path, name: str) -> None:
    robot = rp.load_robot(name)
    limits = robot.limits.scaled(velocity=0.5)
    scene = rp.Scene().with_arm("a", robot).with_arm("b", robot.with_limits(limits), (0, 5, 0))
    file = rp.save_scene(tmp_path / "cell.toml", scene)
    assert file.read_text().count(f'robot = "{name}"\n') == 2
    assert rp.load_scene(file).content_hash == scene.content_hash


def test_an_installed_robot_with_options_is_saved_by_its_name(tmp_path: Path, foreign_robots: Path) -> None:
    robot = rp.load_robot("ur5", srdf=False)
    assert robot.content_hash != rp.load_robot("ur5").content_hash
    for other in (robot, rp.load_robot("ur5", srdf=False, tool="forearm_link")):
        for robots in (None, {"a": "ur5"}):
            file = rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("a", other), robots=robots)
            assert 'robot = "ur5"\nsrdf = false\n' in file.read_text().replace('tool = "forearm_link"\n', "")
            read = rp.load_scene(file).arms["a"].robot
            assert (read.content_hash, read.tool) == (other.content_hash, other.tool)
    robot = replace(robot, disabled_collisions=frozenset())
    with pytest.raises(rp.InputError, match=r"robot of arm 'a' differs from .*'ur5'.*robots={'a': NAME_OR_FILE}"):
        rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("a", robot), robots={"a": "ur5"})
    other = rp.load_robot("ur5", tool="forearm_link")
    file = rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("a", other))
    assert 'robot = "ur5"\n' in file.read_text()
    assert rp.load_scene(file).arms["a"].robot.tool == "forearm_link"
    for tool in (None, other.tool, "tool0"):
        few = rp.load_robot("ur5", joints=["elbow_joint", "shoulder_lift_joint"], tool=tool)
        file = rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("a", few))
        assert 'robot = "ur5"\n' in file.read_text()
        read = rp.load_scene(file).arms["a"].robot
        assert (read.content_hash, read.joint_names, read.tool) == (few.content_hash, few.joint_names, few.tool)


@pytest.mark.parametrize("part", ["collision", "visual"])
def test_a_changed_copy_of_a_shipped_robot_is_saved_by_its_file(tmp_path: Path, part: str) -> None:
    folder = tmp_path / "planar2r"
    shutil.copytree(robot_folder("planar2r"), folder)
    file = folder / "planar2r.urdf"
    before, opening, after = file.read_text().partition(f"<{part}>")
    file.write_text(before + opening + after.replace('radius="0.12"', 'radius="0.13"', 1))
    robot = rp.load_robot(file)
    saved = rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("a", robot))
    assert f'robot = "{file}"' in saved.read_text()
    read = rp.load_scene(saved).arms["a"].robot
    assert read.content_hash == robot.content_hash
    assert [shape.shape for shape in read.links[0].visuals] == [shape.shape for shape in robot.links[0].visuals]


def test_tool_and_planning_joints_of_a_shipped_robot_are_in_the_scene_file(tmp_path: Path, rr1: rp.Robot) -> None:
    few = rp.load_robot("rr1", tool="opposite_finger_link", joints=rr1.joint_names[:4])
    scene = rp.Scene().with_arm("a", few, q=few.home + 0.1).with_arm("b", rr1, (0, 1, 0))
    file = rp.save_scene(tmp_path / "cell.toml", scene)
    read = rp.load_scene(file)
    assert [arm.robot.tool for arm in read.arms.values()] == ["opposite_finger_link", "tool"]
    assert read.content_hash == scene.content_hash
    assert file.read_text().count("tool = ") == 1
    with pytest.raises(rp.InputError, match=r"would not read back: .*rr2"):
        rp.save_scene(file, scene, robots={"a": "rr2"})


def test_named_configurations_that_would_read_back_with_other_values_are_an_error(
    tmp_path: Path, rr1: rp.Robot
) -> None:
    moved = replace(rr1, configurations={**rr1.configurations, "home": rr1.home + 0.1})
    more = replace(rr1, configurations={**rr1.configurations, "pick": rr1.home + 0.1})
    for robot, q, name in ((moved, "home", "home"), (more, "pick", "pick"), (more, "home", "pick")):
        with pytest.raises(rp.InputError, match=f"configuration '{name}' of arm 'a' differs .* as numbers"):
            rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("a", robot, q=q))
    assert not (tmp_path / "cell.toml").exists()


def test_named_configurations_of_several_groups_survive(tmp_path: Path, crane: Path) -> None:
    groups = [("turn", "turn", 0.5), ("fold", "fold", -0.5)]
    entries = [f'<group name="{group}"><joint name="{joint}"/></group>' for group, joint, _ in groups]
    for group, joint, value in groups:
        state = f'<joint name="{joint}" value="{value}"/>'
        entries.append(f'<group_state name="rest" group="{group}">{state}</group_state>')
    crane.with_suffix(".srdf").write_text(f'<robot name="crane">{"".join(entries)}</robot>')
    robot = rp.load_robot(crane, groups=["turn", "fold"])
    assert robot.configurations["rest"].tolist() == [0.5, -0.5]
    read = rp.load_scene(rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("crane", robot)))
    assert read.arms["crane"].robot.configurations["rest"].tolist() == [0.5, -0.5]


@pytest.mark.parametrize("srdf", [False, "other.srdf", "crane.srdf", None])
def test_the_srdf_with_which_a_robot_was_loaded_is_in_the_scene_file(
    tmp_path: Path, crane: Path, srdf: str | Literal[False] | None
) -> None:
    for name, value in (("crane", 0.5), ("other", -0.5)):
        rest = f'<group_state name="rest" group="all"><joint name="turn" value="{value}"/></group_state>'
        text = f'<robot name="crane"><group name="all"><joint name="turn"/></group>{rest}</robot>'
        (tmp_path / f"{name}.srdf").write_text(text)
    robot = rp.load_robot(crane, srdf=tmp_path / srdf if srdf else srdf)
    file = rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("crane", robot))
    read = rp.load_scene(file).arms["crane"].robot
    assert dict(read.configurations).keys() == dict(robot.configurations).keys()
    assert all(np.array_equal(read.configurations[name], q) for name, q in robot.configurations.items())
    assert ("srdf = " in file.read_text()) == (srdf in (False, "other.srdf"))


def test_an_srdf_in_a_scene_file_is_a_file_or_false(tmp_path: Path, crane: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(f'[arms.a]\nrobot = "{crane.name}"\nsrdf = true\n')
    with pytest.raises(rp.FormatError, match="srdf: expected a file or false, got True"):
        rp.load_scene(file)


def test_the_margin_of_a_problem_is_in_files(tmp_path: Path, rr1_table: rp.Scene) -> None:
    problem = rp.Problem(rr1_table, "home", "home")
    for margin in (0.0, 0.01):
        problems = {"stay": problem.with_margin(margin)}
        file = rp.save_scene(tmp_path / "cell.toml", rr1_table, problems=problems)
        assert rp.load_problems(file)["stay"].margin == margin
        motion = save_motion(tmp_path / "m.json", rr1_table, problem=problems["stay"])
        read = read_plan_file(motion).problem
        assert read is not None
        assert read.margin == margin
        assert ["margin" in f.read_text() for f in (file, motion)] == [margin > 0.0] * 2
    file.write_text(file.read_text().replace("margin = 0.01", "margin = -0.01"))
    with pytest.raises(rp.FormatError, match=r"queries.stay.*margin is -0.01"):
        rp.load_problems(file)


def test_problems_of_another_scene_are_saved_by_joint_name(tmp_path: Path, crane: Path) -> None:
    one = rp.Scene().with_arm("arm", rp.load_robot(crane, joints=["turn", "fold"]))
    turned = rp.Scene().with_arm("arm", rp.load_robot(crane, joints=["fold", "turn"]))
    problem = rp.Problem(one, [0.1, 0.2], [0.3, 0.4])
    file = rp.save_scene(tmp_path / "cell.toml", turned, problems={"there": problem})
    assert rp.load_problems(file)["there"].start.tolist() == [0.2, 0.1]
    read = read_plan_file(save_motion(tmp_path / "m.json", turned, problem=problem)).problem
    assert read is not None
    assert read.start.tolist() == [0.2, 0.1]
    other = rp.Scene().with_arm("arm", rp.load_robot("planar2r"))
    with pytest.raises(
        rp.InputError, match=r"problem 'there' cannot be a query of the scene .* joints turn, fold of arm"
    ):
        rp.save_scene(tmp_path / "other.toml", other, problems={"there": problem})
    with pytest.raises(rp.InputError, match="the problem moves the joints turn, fold of arm"):
        save_motion(tmp_path / "m.json", other, problem=problem)


def test_options_with_which_a_robot_was_loaded_are_in_the_scene_file(tmp_path: Path) -> None:
    """A fork of two prongs, from a package, whose hull would close it."""
    prongs = [trimesh.creation.box((0.2, 0.02, 0.02), rp.transforms.pose([0.3, y, 0.0])) for y in (-0.05, 0.05)]
    package = tmp_path / "src" / "forks"
    package.mkdir(parents=True)
    trimesh.util.concatenate(prongs).export(package / "fork.stl")
    fork = '<collision><geometry><mesh filename="package://forks/fork.stl"/></geometry></collision>'
    (tmp_path / "crane.urdf").write_text(ARM.replace('<link name="hook"/>', f'<link name="hook">{fork}</link>'))
    robot = rp.load_robot(tmp_path / "crane.urdf", package_dirs=[tmp_path / "src"], convex="pieces")
    scene = rp.Scene().with_arm("crane", robot.with_limits(robot.limits))
    (tmp_path / "cells").mkdir()
    file = rp.save_scene(tmp_path / "cells" / "cell.toml", scene)
    assert rp.load_scene(file).content_hash == scene.content_hash
    text = file.read_text()
    file.write_text(text.replace(f'["{tmp_path / "src"}"]', '["../src"]'))
    assert rp.load_scene(file).content_hash == scene.content_hash
    file.write_text(text.replace('"pieces"', '"parts"'))
    with pytest.raises(rp.FormatError, match="convex: expected one of hull, pieces, got 'parts'"):
        rp.load_scene(file)


def test_arguments_of_xacro_are_in_the_scene_file(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc")
    text = ARM.replace(
        'name="crane">', 'name="crane" xmlns:xacro="http://ros.org"><xacro:arg name="end" default="0.4"/>'
    )
    robot = rp.load_robot(
        write(tmp_path / "crane.urdf", text.replace('"0.4 0 0"/></joint>', '"$(arg end) 0 0"/></joint>')),
        xacro_arguments={"end": "0.7"},
    )
    scene = rp.Scene().with_arm("crane", robot)
    file = rp.save_scene(tmp_path / "cell.toml", scene)
    assert rp.load_scene(file).content_hash == scene.content_hash
    plain = write(tmp_path / "plain.urdf", ARM.replace('"0.4 0 0"/></joint>', '"0.7 0 0"/></joint>'))
    named = rp.save_scene(tmp_path / "named.toml", scene, robots={"crane": str(plain)})
    assert "xacro_arguments" not in named.read_text()
    plain.write_text("<robot")
    with pytest.raises(rp.InputError, match=r"named.toml would not read back: .*plain.urdf"):
        rp.save_scene(tmp_path / "named.toml", scene, robots={"crane": str(plain)})


def write(file: Path, text: str) -> Path:
    file.write_text(text)
    return file


def test_a_scene_that_would_read_back_differently_is_not_written(tmp_path: Path, crane: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_text("old")
    scene = rp.Scene().with_arm("crane", rp.load_robot(crane))
    crane.write_text(ARM.replace("0.4 0.05 0.05", "0.4 0.06 0.05"))
    with pytest.raises(rp.InputError, match="would not read back as this scene: the robot of arm 'crane' differs"):
        rp.save_scene(file, scene)
    crane.unlink()
    with pytest.raises(rp.InputError, match=r"robot 'crane' of arm 'crane' was loaded from no file.*robots="):
        rp.save_scene(file, scene)
    with pytest.raises(rp.UnknownNameError, match="Did you mean 'crane'"):
        rp.save_scene(file, scene, robots={"crain": "crane.urdf"})
    assert file.read_text() == "old"


def test_a_scene_with_an_arm_without_a_file_is_not_written(tmp_path: Path) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("RR"))
    with pytest.raises(rp.InputError, match=r"robot 'planar_rr' of arm 'arm' was made in Python.*pickle the scene"):
        rp.save_scene(tmp_path / "flat.toml", scene)
    assert not list(tmp_path.iterdir())


def test_a_mesh_file_becomes_one_shape(tmp_path: Path) -> None:
    file = tmp_path / "corner.obj"
    corners = "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nv 0.2 0.2 0.2\n"
    file.write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 5\nf 3 4 5\nf 4 2 5\n")
    shape = rp.load_mesh(file, scale=0.5)
    assert len(shape.faces) == 6
    assert shape.vertices.max() == 1.0
    assert not shape.convex
    hull = rp.load_mesh(file, scale=(0.5, 0.5, 0.5), hull=True)
    assert hull.convex
    assert len(hull.vertices) == 4
    np.testing.assert_allclose(hull.vertices.max(axis=0), shape.vertices.max(axis=0))
    assert rp.Scene().with_obstacle("part", hull).obstacles["part"].geometries[0].shape is hull
    for wrong in (0.0, np.nan, "1", (1.0, 2.0), (1.0, 0.0, 1.0), None):
        with pytest.raises(rp.InputError, match="scale"):
            rp.load_mesh(file, scale=wrong)
    with pytest.raises(rp.FormatError, match="no such file"):
        rp.load_mesh(tmp_path / "none.stl")
