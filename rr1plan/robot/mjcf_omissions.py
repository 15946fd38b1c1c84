"""Warnings about content of an MJCF file that its robots omit or assume."""

from __future__ import annotations

import logging
from collections.abc import Container, Mapping, Sequence

import mujoco

from rr1plan.robot.mjcf_links import MjcfLinkReader
from rr1plan.robot.mjcf_model import CompiledDocument

log = logging.getLogger(__name__)

_MOST_NAMES = 12  # in a warning
_CONNECTS = (int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD))
_TENDONS = int(mujoco.mjtEq.mjEQ_TENDON)
_WRAPS_JOINT, _WRAPS_SITE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_SITE)


def warn_of_omissions(compiled: CompiledDocument, shapes: MjcfLinkReader, link_of: Mapping[int, str]) -> None:
    """Log once which content of the file is missing in the robots, and which is assumed.

    Args:
        compiled: The file.
        shapes: Reads the shapes and masses of its bodies.
        link_of: The link of each body of the robots; 0 is the world.
    """
    file, bodies = compiled.document.file, [body for body in link_of if body]
    if compiled.document.not_read:
        log.warning("%s: left out, not read: %s", file, ", ".join(compiled.document.not_read))
    assumed = [link_of[body] for body in shapes.assumed_masses(bodies)]
    if assumed:
        log.warning(
            "%s: links without a mass, taken as solid with 1000 kg/m³, torques are estimates: %s",
            file,
            listed_names(assumed),
        )
    loops = _closed_loops(compiled.model, bodies)
    if loops:
        log.warning(
            "%s: closed loops are not modeled, their joints are held or, if planned for, move independently: %s",
            file,
            listed_names(loops),
        )
    tendons = _coupling_tendons(compiled.model, bodies)
    if tendons:
        log.warning(
            "%s: lengths and limits of tendons are not modeled, their joints move independently: %s",
            file,
            listed_names(tendons),
        )
    hidden = [link_of[b] for b in bodies if any(compiled.uses[g].switched_off for g in shapes.geoms(b))]
    if hidden:
        log.info(
            "%s: shapes of hidden groups (3 to 5) are checked although contype and conaffinity are 0, of %s",
            file,
            listed_names(hidden),
        )


def _closed_loops(model: mujoco.MjModel, bodies: Container[int]) -> list[str]:
    """Active equalities that connect or weld two bodies of robots, or one that joints move with the world."""
    return [
        model.eq(e).name or f"equality {e}"
        for e in range(model.neq)
        if model.eq_active0[e] and int(model.eq_type[e]) in _CONNECTS and _joins_robots(model, e, bodies)
    ]


def _joins_robots(model: mujoco.MjModel, equality: int, bodies: Container[int]) -> bool:
    ends = (int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality]))
    if int(model.eq_objtype[equality]) == int(mujoco.mjtObj.mjOBJ_SITE):
        ends = (int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]]))
    return all(end in bodies or end == 0 for end in ends) and (0 not in ends or _is_moved(model, max(ends)))


def _is_moved(model: mujoco.MjModel, body: int) -> bool:
    """Whether joints other than the free joint of a base move a body."""
    top = int(model.body_weldid[body])
    return top != 0 and int(model.jnt_type[model.body_jntadr[top]]) != int(mujoco.mjtJoint.mjJNT_FREE)


def _coupling_tendons(model: mujoco.MjModel, bodies: Container[int]) -> list[str]:
    """Tendons of robots that couple joints or limit them together."""
    active = [e for e in range(model.neq) if model.eq_active0[e]]
    equal = {t for e in active if int(model.eq_type[e]) == _TENDONS for t in (model.eq_obj1id[e], model.eq_obj2id[e])}
    return [
        model.tendon(t).name or f"tendon {t}"
        for t in range(model.ntendon)
        if (t in equal or model.tendon_limited[t]) and _is_on_robot(model, t, bodies)
    ]


def _is_on_robot(model: mujoco.MjModel, tendon: int, bodies: Container[int]) -> bool:
    start, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    wraps = range(start, start + count)
    joints = [int(model.wrap_objid[w]) for w in wraps if int(model.wrap_type[w]) == _WRAPS_JOINT]
    sites = [int(model.wrap_objid[w]) for w in wraps if int(model.wrap_type[w]) == _WRAPS_SITE]
    wrapped = [*model.jnt_bodyid[joints].tolist(), *model.site_bodyid[sites].tolist()]
    return any(body in bodies for body in wrapped)


def listed_names(names: Sequence[str]) -> str:
    """The names, or the first of many, separated by commas."""
    return ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")
