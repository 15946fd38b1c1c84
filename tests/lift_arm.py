"""A scene with an arm of six joints whose first one slides, and a wall that blocks most of its configurations."""

from __future__ import annotations

from pathlib import Path

import rr1plan as rp

_JOINTS = ("0 0 0", "0 0 0.2", "0 0 0.2", "0.4 0 0", "0.3 0 0", "0.1 0 0")
_AXES = ("0 0 1", "0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0")
_BOX = '<geometry><box size="0.05 0.05 0.05"/></geometry>'
_INERTIA = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'


def lift_scene(folder: Path) -> rp.Scene:
    """The scene; the arm's URDF is written into a folder."""
    parts = ['<robot name="lift"><link name="l0"/>']
    for k, (place, axis) in enumerate(zip(_JOINTS, _AXES, strict=True), 1):
        kind, lower, upper = ("revolute", -2.5, 2.5) if k > 1 else ("prismatic", 0.0, 0.5)
        parts.append(
            f'<joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/><child link="l{k}"/><origin xyz="{place}"/>'
            f'<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/></joint>'
            f'<link name="l{k}"><inertial><mass value="1"/>{_INERTIA}</inertial><collision>{_BOX}</collision></link>'
        )
    file = folder / "lift.urdf"
    file.write_text("".join([*parts, "</robot>"]), encoding="utf-8")
    scene = rp.Scene(name="lift").with_arm("arm", rp.load_robot(file), q=[0.2, 2.4, 0.5, -1.0, 0.4, 0.6])
    return scene.with_obstacle("wall", rp.Box((1.6, 3.0, 3.0)), (0.88, 0.0, 0.4))
