"""The URDF reader: correct results for good files, and a clear error for every bad one."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.errors import FormatError, UnknownNameError
from rr1plan.robot.urdf import read_urdf
from rr1plan.shapes import Box, Capsule, Cylinder, Sphere

LIMIT = '<limit lower="-1" upper="1" velocity="2" effort="3"/>'


def link_text(name: str, inside: str = "") -> str:
    return f'<link name="{name}">{inside}</link>'


def joint_text(name: str, parent: str, child: str, inside: str = LIMIT, kind: str = "revolute") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def robot_text(*parts: str) -> str:
    return '<robot name="r" version="1.1">\n' + "\n".join(parts) + "\n</robot>"


def one_joint(inside: str, kind: str = "revolute") -> str:
    return robot_text(link_text("a"), link_text("b"), joint_text("j", "a", "b", inside, kind))


def one_shape(shape: str, tag: str = "collision") -> str:
    return robot_text(link_text("a", f"<{tag}><geometry>{shape}</geometry></{tag}>"))


def one_mass(mass: str = "1", moments: tuple[object, ...] = (1, 1, 1), cross: str = "0") -> str:
    xx, yy, zz = moments
    return robot_text(
        link_text(
            "a",
            f'<inertial><mass value="{mass}"/><inertia ixx="{xx}" ixy="{cross}" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
            "</inertial>",
        )
    )


BAD = {
    "two roots": (robot_text(link_text("a"), link_text("b")), "no parent"),
    "no link": ('<robot name="r"/>', "no link"),
    "no name": ("<robot/>", "name"),
    "another root element": ("<sdf/>", "expected <robot>"),
    "link twice": (robot_text(link_text("a"), link_text("a")), "'a' is there twice"),
    "joint twice": (
        robot_text(
            link_text("a"), link_text("b"), link_text("c"), joint_text("j", "a", "b"), joint_text("j", "a", "c")
        ),
        "'j' is there twice",
    ),
    "cycle of all": (
        robot_text(link_text("a"), link_text("b"), joint_text("j", "a", "b"), joint_text("k", "b", "a")),
        "cycle",
    ),
    "cycle beside a root": (
        robot_text(*map(link_text, "abc"), joint_text("j", "b", "c"), joint_text("k", "c", "b")),
        "cycle",
    ),
    "two parents": (
        robot_text(*map(link_text, "abc"), joint_text("j", "a", "c"), joint_text("k", "b", "c")),
        "two parents",
    ),
    "joint to itself": (robot_text(link_text("a"), joint_text("j", "a", "a")), "to itself"),
    "unknown parent": (robot_text(link_text("a"), joint_text("j", "x", "a")), "unknown parent link 'x'"),
    "unknown child": (robot_text(link_text("a"), joint_text("j", "a", "x")), "unknown child link 'x'"),
    "no limit": (one_joint(""), "no <limit>"),
    "no limit on a slide": (one_joint("", "prismatic"), "no <limit>"),
    "inverted limits": (one_joint('<limit lower="1" upper="-1" velocity="1" effort="1"/>'), "lower < upper"),
    "nan limit": (one_joint('<limit lower="nan" upper="1" velocity="1" effort="1"/>'), "finite"),
    "inf limit": (one_joint('<limit lower="-inf" upper="1" velocity="1" effort="1"/>'), "finite"),
    "velocity negative": (one_joint('<limit lower="-1" upper="1" velocity="-2" effort="1"/>'), "velocity"),
    "effort nan": (one_joint('<limit lower="-1" upper="1" velocity="1" effort="nan"/>'), "finite"),
    "zero axis": (one_joint('<axis xyz="0 0 0"/>' + LIMIT), "axis of joint 'j'"),
    "huge axis": (one_joint('<axis xyz="1.7e308 1e308 0"/>' + LIMIT), "axis of joint 'j'"),
    "nan axis": (one_joint('<axis xyz="0 nan 0"/>' + LIMIT), "finite"),
    "short axis": (one_joint('<axis xyz="0 1"/>' + LIMIT), "3 numbers"),
    "unknown type": (one_joint(LIMIT, "hinge"), "'hinge'"),
    "negative damping": (one_joint(LIMIT + '<dynamics damping="-1"/>'), "damping"),
    "nan origin": (one_joint('<origin xyz="0 0 nan"/>' + LIMIT), "finite"),
    "two rotations": (one_joint('<origin rpy="0 0 0" quat_xyzw="0 0 0 1"/>' + LIMIT), "both"),
    "zero quaternion": (one_joint('<origin quat_xyzw="0 0 0 0"/>' + LIMIT), "norm"),
    "words for numbers": (one_joint('<origin xyz="a b c"/>' + LIMIT), "'a' is not a number"),
    "numbers with _": (one_joint('<origin xyz="1_0 0 0"/>' + LIMIT), "'1_0' is not a number"),
    "two origins": (one_joint("<origin/><origin/>" + LIMIT), "at most one"),
    "mimic of nobody": (one_joint(LIMIT + '<mimic joint="x"/>'), "unknown joint 'x'"),
    "mimic of itself": (one_joint(LIMIT + '<mimic joint="j"/>'), "circle"),
    "mimics in a circle": (
        robot_text(
            *map(link_text, "abc"),
            joint_text("j", "a", "b", LIMIT + '<mimic joint="k"/>'),
            joint_text("k", "a", "c", LIMIT + '<mimic joint="j"/>'),
        ),
        "circle",
    ),
    "mimic of a fixed joint": (
        robot_text(
            *map(link_text, "abc"),
            joint_text("j", "a", "b", LIMIT + '<mimic joint="k"/>'),
            joint_text("k", "a", "c", "", "fixed"),
        ),
        "fixed",
    ),
    "mimic of a constant joint, out of reach": (
        robot_text(
            *map(link_text, "abc"),
            joint_text("k", "a", "b", '<limit lower="1" upper="1"/>'),
            joint_text("j", "b", "c", LIMIT + '<mimic joint="k" multiplier="1e300"/>'),
        ),
        "joint 'j' is fixed at 1e+300",
    ),
    "mimic by nan": (one_joint(LIMIT + '<mimic joint="j" multiplier="nan"/>'), "finite"),
    "box of nan": (one_shape('<box size="nan 1 1"/>'), "finite"),
    "box of inf": (one_shape('<box size="inf 1 1"/>'), "finite"),
    "negative box": (one_shape('<box size="-1 1 1"/>'), "above zero"),
    "box of two": (one_shape('<box size="1 1"/>'), "3 numbers"),
    "zero sphere": (one_shape('<sphere radius="0"/>'), "above zero"),
    "negative cylinder": (one_shape('<cylinder radius="1" length="-1"/>'), "above zero"),
    "capsule without length": (one_shape('<capsule radius="1"/>'), "length"),
    "unknown shape": (one_shape('<cone radius="1"/>'), "<cone>"),
    "no shape": (one_shape(""), "nothing"),
    "two shapes": (one_shape('<sphere radius="1"/><sphere radius="1"/>'), "<sphere>, <sphere>"),
    "mesh scale zero": (one_shape('<mesh filename="a.stl" scale="0 1 1"/>'), "scale"),
    "mesh scale nan": (one_shape('<mesh filename="a.stl" scale="nan 1 1"/>'), "finite"),
    "mesh without a name": (one_shape("<mesh/>"), "filename"),
    "no mesh": (one_shape('<mesh filename="a.stl"/>'), "a.stl"),
    "negative mass": (one_mass("-1"), "mass"),
    "mass of no body": (one_mass("1e300"), "link 'a' has mass 1e+300"),
    "inertia of no body": (one_mass(moments=("1e300", "1e300", "1e300")), "an inertia up to 1e+300"),
    "inertia without moments": (one_mass(moments=("1e308",) * 3, cross="1e308"), "an inertia up to 1e+308"),
    "mass nan": (one_mass("nan"), "finite"),
    "inertia missing": (
        robot_text(link_text("a", '<inertial><mass value="1"/></inertial>')),
        "<inertial> of link 'a' has no <inertia>; add one, or leave <inertial> out",
    ),
    "doctype": ('<!DOCTYPE robot [<!ENTITY x "y">]>' + robot_text(link_text("a")), "DOCTYPE"),
    "external entity": (
        '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot name="&x;"/>',
        "DOCTYPE",
    ),
    "not closed": ('<robot name="r"><link name="a">', "well-formed"),
    "empty": (b"", "well-formed"),
    "not xml": (b"\x00\x01", "well-formed"),
    "unknown encoding": (b'<?xml version="1.0" encoding="klingon"?><robot name="r"/>', "encoding"),
    "deep nesting": (robot_text("<a>" * 300 + "</a>" * 300), "deeper"),
    "xacro left in": (
        '<robot name="r" xmlns:xacro="http://x"><link name="a"/><xacro:property name="p"/></robot>',
        "xacro_arguments",
    ),
    "xacro in a link": (
        '<robot name="r" xmlns:xacro="http://x"><link name="a"><xacro:inertia mass="1"/></link></robot>',
        "<xacro:inertia> has to be expanded first",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_a_format_error_that_names_the_thing(name: str) -> None:
    text, word = BAD[name]
    with pytest.raises(FormatError) as caught:
        read_urdf(text, file="robots/bad.urdf")
    assert word in str(caught.value)
    assert "bad.urdf" in str(caught.value)


def test_the_error_names_the_line(tmp_path: Path) -> None:
    file = tmp_path / "bad.urdf"
    file.write_text(
        robot_text(link_text("a"), link_text("b"), joint_text("j", "a", "b", '<axis xyz="0 0 0"/>' + LIMIT))
    )
    with pytest.raises(FormatError) as caught:
        read_urdf(file)
    assert caught.value.line == 4
    assert f"{file}:4:" in str(caught.value)


def test_a_missing_mesh_is_named_once_with_its_line() -> None:
    with pytest.raises(FormatError) as caught:
        read_urdf(one_shape('<mesh filename="package://nowhere/a.stl"/>'), file="r.urdf")
    assert str(caught.value).count("r.urdf:2") == 1
    assert "package_dirs" in str(caught.value)


def test_a_missing_file_is_a_format_error(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no such file"):
        read_urdf(tmp_path / "none.urdf")


def test_an_unknown_convex_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="hulls"):
        read_urdf(one_shape('<sphere radius="1"/>'), convex="hulls")


def test_shapes_poses_and_colors_are_read() -> None:
    shapes = ('<box size="1 2 3"/>', '<sphere radius="1"/>', '<cylinder radius="1" length="2"/>')
    shapes += ('<capsule radius="1" length="2"/>',)
    visuals = [f'<visual><geometry>{s}</geometry><material name="m"/></visual>' for s in shapes]
    collision = (
        f'<collision><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><geometry>{shapes[0]}</geometry></collision>'
    )
    tree = read_urdf(
        robot_text(
            '<material name="m"><color rgba="1 0.5 0 1"/></material>', link_text("a", "".join(visuals) + collision)
        )
    )
    link = tree.links[0]
    assert [type(v.shape) for v in link.visuals] == [Box, Sphere, Cylinder, Capsule]
    assert all(v.color == (1.0, 0.5, 0.0, 1.0) for v in link.visuals)
    assert np.allclose(link.collisions[0].pose @ [1, 0, 0, 1], [1, 3, 3, 1])
    assert len({g.name for g in (*link.visuals, *link.collisions)}) == 5


def test_a_material_of_another_link_counts_and_an_unknown_one_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    sphere = '<geometry><sphere radius="1"/></geometry>'
    first = f'<visual>{sphere}<material name="m"><color rgba="0 1 0 1"/></material></visual>'
    second = f'<visual>{sphere}<material name="m"/></visual><visual>{sphere}<material name="nowhere"/></visual>'
    text = robot_text(link_text("a", first), link_text("b", second), joint_text("j", "a", "b"))
    with caplog.at_level(logging.WARNING):
        tree = read_urdf(text)
    assert [v.color for v in tree.links[1].visuals] == [(0.0, 1.0, 0.0, 1.0), None]
    assert "nowhere" in caplog.text


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_base_that_floats_or_rolls_stands_still(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    joint = read_urdf(one_joint('<origin xyz="1 2 3"/>', kind)).joints[0]
    assert joint.kind == "fixed"
    assert joint.origin[:3, 3].tolist() == [1, 2, 3]
    assert f"'j' is {kind}, it is taken as fixed: joints with several degrees of freedom are not" in caplog.text


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_joint_without_a_range_is_fixed_where_it_is(kind: str, caplog: pytest.LogCaptureFixture) -> None:
    limit = '<origin xyz="1 2 3"/><axis xyz="0 0 1"/><limit lower="0.5" upper="0.5" velocity="1" effort="1"/>'
    tree = read_urdf(one_joint(limit, kind))
    free = read_urdf(one_joint(limit.replace('upper="0.5"', 'upper="0.6"'), kind))
    assert tree.joints[0].kind == "fixed"
    expected = free.joints[0].origin @ free.joints[0].motion(0.5)
    np.testing.assert_allclose(tree.joints[0].origin, expected, atol=1e-15)
    assert "'j' has no range but 0.5" in caplog.text


def test_a_joint_that_follows_one_without_a_range_is_fixed_at_its_value(caplog: pytest.LogCaptureFixture) -> None:
    limit = '<axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/>'
    text = robot_text(
        *map(link_text, "abcde"),
        joint_text("j1", "a", "b", limit.replace("2", "0.5").replace("-", "")),
        joint_text("j2", "b", "c", limit + '<mimic joint="j1" multiplier="2" offset="0.1"/>'),
        joint_text("j3", "c", "d", limit + '<mimic joint="j2" multiplier="-1"/>'),
        joint_text("j4", "d", "e", limit),
    )
    joints = read_urdf(text).joints
    assert [joint.kind for joint in joints] == ["fixed", "fixed", "fixed", "revolute"]
    angles = [np.arctan2(joint.origin[1, 0], joint.origin[0, 0]) for joint in joints]
    np.testing.assert_allclose(angles, [0.5, 1.1, -1.1, 0.0])
    assert "'j2' follows 'j1', which has no range, it is taken as fixed at 1.1" in caplog.text


@pytest.mark.parametrize("text", [one_mass(moments=(1, -1, 1)), one_mass(moments=(1, -1e-8, 1)), one_mass(cross="5")])
def test_an_inertia_that_is_not_definite_makes_the_link_a_point(text: str, caplog: pytest.LogCaptureFixture) -> None:
    inertial = read_urdf(text).links[0].inertial
    assert inertial is not None
    assert inertial.mass == 1.0
    assert not inertial.inertia.any()
    assert "not positive definite" in caplog.text


@pytest.mark.parametrize(("moment", "is_said"), [(8000.0, True), (0.004, False)])
def test_an_inertia_in_square_millimeters_is_said(
    moment: float, is_said: bool, caplog: pytest.LogCaptureFixture
) -> None:
    read_urdf(one_mass(moments=(moment, moment, moment)))
    said = "link 'a' of 1 kg has a radius of gyration of 89.4 m; if its inertia is in kg mm², scale it by 1e-6"
    assert (said in caplog.text) == is_said


@pytest.mark.parametrize("rgba", ["255 0 0 1", "0.5 0.5 0.5 0 1", "red"])
def test_a_color_that_is_none_is_logged(rgba: str, caplog: pytest.LogCaptureFixture) -> None:
    material = f'<material name="m"><color rgba="{rgba}"/></material>'
    visual = f'<visual><geometry><sphere radius="1"/></geometry>{material}</visual>'
    color = read_urdf(robot_text(link_text("a", visual))).links[0].visuals[0].color
    assert color is None or color == (1.0, 0.0, 0.0, 1.0)
    assert rgba in caplog.text or "not a number" in caplog.text


@pytest.mark.parametrize("mesh", ["a.glb", "package://nowhere/a.stl"])
def test_a_mesh_that_is_only_looked_at_may_be_missing(mesh: str, caplog: pytest.LogCaptureFixture) -> None:
    text = one_shape(f'<mesh filename="{mesh}"/>', "visual")
    assert read_urdf(text).links[0].visuals == ()
    assert mesh in caplog.text
    with pytest.raises(FormatError, match=r"a\.(glb|stl)"):
        read_urdf(text.replace("visual", "collision"))


@pytest.mark.parametrize(
    "shape",
    [
        '<sphere radius="0"/>',
        '<sphere radius="nan"/>',
        '<box size="1 0 1"/>',
        '<cylinder radius="1" length="-1"/>',
        '<mesh filename="a.stl" scale="1 0 1"/>',
    ],
)
def test_a_shape_of_no_size_that_is_only_looked_at_is_left_out_with_a_warning(
    shape: str, caplog: pytest.LogCaptureFixture
) -> None:
    assert read_urdf(one_shape(shape, "visual")).links[0].visuals == ()
    assert "shown without it" in caplog.text
    with pytest.raises(FormatError, match="number"):
        read_urdf(one_shape(shape))


def test_an_effort_below_zero_is_unknown_with_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    joint = read_urdf(one_joint('<limit lower="-1" upper="1" velocity="2" effort="-1"/>')).joints[0]
    assert joint.effort == np.inf
    assert "joint 'j' has effort -1, it is taken as unknown" in caplog.text


@pytest.mark.parametrize("velocity", ["0", "1e+16", "3.40282e+38", "1.7976931348623157e+308"])
def test_a_velocity_of_zero_or_beyond_any_joint_is_unknown(velocity: str, caplog: pytest.LogCaptureFixture) -> None:
    joint = read_urdf(one_joint(f'<limit lower="-1" upper="1" velocity="{velocity}" effort="1"/>')).joints[0]
    assert joint.velocity == np.inf
    assert f"joint 'j' has velocity {float(velocity):g}, it is taken as unknown" in caplog.text


def test_elements_that_do_not_describe_the_arm_are_skipped() -> None:
    tree = read_urdf(robot_text(link_text("a"), "<gazebo><x/></gazebo>", "<transmission name='t'/>", "<ros2_control/>"))
    assert [link.name for link in tree.links] == ["a"]


def test_an_inertia_is_turned_into_the_links_axes() -> None:
    text = robot_text(
        link_text(
            "a",
            '<inertial><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><mass value="2"/>'
            '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2.5"/></inertial>',
        )
    )
    inertial = read_urdf(text).links[0].inertial
    assert inertial is not None
    assert inertial.com.tolist() == [1, 2, 3]
    assert np.allclose(inertial.inertia, np.diag([2, 1, 2.5]), atol=1e-12)


def test_a_mass_of_zero_marks_a_frame_and_says_so_if_it_had_inertia(caplog: pytest.LogCaptureFixture) -> None:
    assert read_urdf(one_mass("0", (0, 0, 0))).links[0].inertial is None
    assert caplog.text == ""
    assert read_urdf(one_mass("0")).links[0].inertial is None
    assert "no mass" in caplog.text


@pytest.mark.parametrize("moment", [0.0, -2e-22, -9e-10])
def test_an_inertia_that_misses_being_definite_by_rounding_is_raised_a_little(moment: float) -> None:
    inertial = read_urdf(one_mass(moments=(1, moment, 1))).links[0].inertial
    assert inertial is not None
    assert np.linalg.eigvalsh(inertial.inertia)[0] == pytest.approx(1e-9, rel=1e-3)
    assert np.allclose(inertial.inertia, np.diag([1, 0, 1]), atol=2e-9)


def test_an_inertia_no_body_can_have_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    read_urdf(one_mass(moments=(1, 1, 3)))
    assert "no body can have" in caplog.text


def test_a_continuous_joint_has_no_position_limits_and_an_effort_of_zero_is_unknown() -> None:
    text = one_joint('<limit lower="-1" upper="1" velocity="2" effort="0"/>', "continuous")
    joint = read_urdf(text).joints[0]
    assert (joint.lower, joint.upper, joint.velocity, joint.effort) == (-np.inf, np.inf, 2.0, np.inf)


def random_tree(rng: np.random.Generator, joints: int) -> str:
    """A random tree of links, so named and written that the orders of file, names and depth differ."""
    names = rng.permutation(joints)
    parts = [link_text("l0")]
    for i in range(1, joints + 1):
        parent = f"l{rng.integers(i)}"
        kind = str(rng.choice(["revolute", "continuous", "prismatic", "fixed"]))
        xyz, rpy, axis = (" ".join(map(repr, rng.normal(size=3).tolist())) for _ in range(3))
        inside = f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>' + LIMIT
        parts += [link_text(f"l{i}"), joint_text(f"j{names[i - 1]:02d}", parent, f"l{i}", inside, kind)]
    return robot_text(*rng.permutation(parts))


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000), joints=st.integers(1, 12))
def test_order_and_forward_kinematics_are_pinocchios(seed: int, joints: int) -> None:
    rng = np.random.default_rng(seed)
    text = random_tree(rng, joints)
    tree = read_urdf(text)
    model = pin.buildModelFromXML(text)
    movable = [j for j in tree.joints if j.kind != "fixed"]
    assert [j.name for j in movable] == list(model.names)[1:]
    values = {j.name: float(rng.uniform(-1, 1)) for j in movable}
    q = np.concatenate(
        [
            [np.cos(values[j.name]), np.sin(values[j.name])] if j.kind == "continuous" else [values[j.name]]
            for j in movable
        ]
        or [np.empty(0)]
    )
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    poses = {tree.links[0].name: np.eye(4)}
    for j in tree.joints:
        poses[j.child] = poses[j.parent] @ j.origin @ j.motion(values.get(j.name, 0.0))
    for name, pose in poses.items():
        reference = data.oMf[model.getFrameId(name, pin.FrameType.BODY)].homogeneous
        assert np.abs(pose - reference).max() < 1e-11


@settings(deadline=None, max_examples=200)
@given(data=st.binary(max_size=200))
def test_any_bytes_are_a_tree_or_a_format_error(data: bytes) -> None:
    with pytest.raises(FormatError):
        read_urdf(b'<robot name="r">' + data)
