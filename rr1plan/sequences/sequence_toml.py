"""Sequence files: a scene, and the actions of arms in it, as readable TOML.

    scene = "cell.toml"                # a shipped scene, or a file relative to this one

    [[segments]]
    free_motion = { frame = "tool", position = [-0.3, 0.1, 0.2], quaternion = [0, 1, 0, 0] }

    [[segments]]
    straight_line = { offset = [0, 0, -0.1] }
    allow = [["block", "table"]]       # pairs that may touch during this segment

    [[segments]]
    move_gripper = { around = "block" }

    [[segments]]
    attach = "block"

Each segment has one of these keys, and further keys as options of its kind:

    free_motion     a goal as in the queries of a scene file: a name, numbers, a table, or a list of alternatives
    free_motions    goals by arm, for several arms that move at once
    straight_line   a goal table, a list of them, or { offset = [x, y, z] } (and axes = "tool")
    move_gripper    a named state, a joint value, { width = 0.04 }, or { around = "block" } (and squeeze); seconds
    attach          an obstacle; link, touch
    detach          a held object
    pause           seconds
    pick_and_place  an obstacle; place, and grasps, supports, height, stop: stands for the segments of `pick_and_place`

`arm` and `allow` go with the first four, `stop` with the first three, `arm` with `attach` and `pick_and_place`. The
reader is strict: an unknown key, a wrong type, NaN or a missing entry is an error that names its position.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rr1plan.checks import file_path, resolved_path
from rr1plan.files.checked_tables import Table, is_number
from rr1plan.files.documents import parse_toml
from rr1plan.files.file_access import is_regular, read_text
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_scene
from rr1plan.scene.scene_queries import read_goal
from rr1plan.sequences.pick_and_place import pick_and_place
from rr1plan.sequences.segments import Attach, Detach, FreeMotion, MoveGripper, Pause, Segment, StraightLine
from rr1plan.sequences.sequence import SegmentCheck, Sequence

_VERSION = 1
_PICK = "pick_and_place"
_MAX_BYTES = 16 * 1024 * 1024


def is_sequence_file(file: str | Path) -> bool:
    """Whether a file is TOML with segments; `load_segments` reports its errors."""
    path = file_path(file)
    if path.suffix.lower() != ".toml" or not is_regular(path):
        return False
    return re.search(r"^\s*(\[\[\s*)?segments\s*[]=]", read_text(path), re.MULTILINE) is not None


def load_segments(file: str | Path) -> Sequence:
    """Read the segments of a sequence, and its scene, from a TOML file; `plan_sequence` plans it.

    Args:
        file: The file (.toml): the key `scene` and a table `[[segments]]` for each segment, as in the guide.

    Raises:
        FormatError: not TOML, or not a sequence of its scene; names the position and the line.
        UnknownNameError: no shipped scene of that name.
    """
    path = file_path(file)
    top = parse_toml(read_text(path, _MAX_BYTES), path)
    if top.raw("version", _VERSION) != _VERSION:
        raise top.error(f"is version {top.raw('version')!r}, expected {_VERSION}", "version")
    name = top.string("scene")
    with top.blame("scene"):
        if "/" in name or Path(name).suffix:
            file = resolved_path(path.absolute().parent / name)
            top.check_there(file, "scene")
            scene = load_scene(file)
        else:
            scene = load_scene(name)
    rows = top.tables("segments")
    top.finish()
    check, moved = SegmentCheck(scene), set[str]()
    segments: list[Segment] = []
    for row in rows:
        kind = row.one_of({**_KINDS, _PICK: None})
        made = _read_pick(row, scene, moved) if kind == _PICK else [_KINDS[kind](row)]
        row.finish()
        with row.blame():
            for segment in made:
                check(segment)
        moved.update(segment.obstacle for segment in made if isinstance(segment, Attach))
        segments += made
    with top.blame("segments"):
        return Sequence(scene, segments)


def _motion_options(row: Table) -> dict[str, Any]:
    """The common options, and whether the motion stops at its end."""
    return _options(row) | {"stop": row.boolean("stop", True)}


def _options(row: Table) -> dict[str, Any]:
    """The arm of a segment, and the pairs that may touch."""
    arm = row.string("arm") if "arm" in row else None
    pairs = row.rows("allow")
    for both in pairs:
        if not isinstance(both, list) or len(both) != 2 or not all(isinstance(name, str) for name in both):
            raise row.error(f"expected pairs of names, got {both!r}", "allow")
    return {"arm": arm, "allow": [tuple(both) for both in pairs]}


def _free_motion(row: Table) -> Segment:
    options = _motion_options(row)
    goal = read_goal(row, "free_motion")
    with row.blame():
        return FreeMotion(goal, **options)


def _free_motions(row: Table) -> Segment:
    if "arm" in row:
        raise row.error("has no effect with free_motions, which names the arms", "arm")
    options, goals = _motion_options(row), row.table("free_motions")
    goal = {arm: read_goal(goals, arm) for arm in goals.names()}
    with row.blame():
        return FreeMotion(goal, **options)


def _straight_line(row: Table) -> Segment:
    options, value = _motion_options(row), row.required("straight_line")
    if isinstance(value, Mapping) and "offset" in value:
        line = row.table("straight_line")
        offset, axes = line.numbers("offset", (3,)), line.string("axes", "world")
        line.finish()
        with line.blame():
            return StraightLine(offset=offset, axes=axes, **options)  # type: ignore[arg-type]  # checked there
    goal = read_goal(row, "straight_line")
    with row.blame("straight_line"):
        return StraightLine(goal, **options)


def _move_gripper(row: Table) -> Segment:
    options, value = _options(row), row.required("move_gripper")
    if "seconds" in row:
        options["seconds"] = row.number("seconds")
    if isinstance(value, str) or is_number(value):
        with row.blame("move_gripper"):
            return MoveGripper(value if isinstance(value, str) else row.number("move_gripper"), **options)
    gripper = row.table("move_gripper")
    if gripper.one_of({"width": None, "around": None}) == "width":
        options["width"] = gripper.number("width")
    else:
        options["around"] = gripper.string("around")
        if "squeeze" in gripper:
            options["squeeze"] = gripper.number("squeeze")
    gripper.finish()
    with gripper.blame():
        return MoveGripper(**options)


def _attach(row: Table) -> Segment:
    names = {name: row.string(name) for name in ("arm", "link") if name in row}
    touch = row.strings("touch") if "touch" in row else None
    obstacle = row.string("attach")
    with row.blame():
        return Attach(obstacle, **names, touch=touch)


def _detach(row: Table) -> Segment:
    name = row.string("detach")
    with row.blame():
        return Detach(name)


def _pause(row: Table) -> Segment:
    seconds = row.number("pause")
    with row.blame():
        return Pause(seconds)


def _read_pick(row: Table, scene: Scene, moved: set[str]) -> list[Segment]:
    """The segments of a pick-and-place of an object at its pose in the scene."""
    obstacle = row.string(_PICK)
    if obstacle in moved:
        raise row.error(
            f"{obstacle!r} is elsewhere by now, and the scene does not say where; write the segments of its second "
            "motion one by one",
            _PICK,
        )
    place = row.required("place")
    if isinstance(place, list) and place and all(is_number(value) for value in place):
        place = row.numbers("place", (3,))
    else:
        place = read_goal(row, "place", obstacle)
    options: dict[str, Any] = {"arm": row.string("arm")} if "arm" in row else {}
    if "grasps" in row:
        grasps = read_goal(row, "grasps")
        options["grasps"] = grasps if isinstance(grasps, list) else [grasps]
    if "supports" in row:
        options["supports"] = row.strings("supports")
    if "height" in row:
        options["height"] = row.number("height")
    options["stop"] = row.boolean("stop", True)
    with row.blame():
        return pick_and_place(scene, obstacle, place, **options)


_KINDS: dict[str, Callable[[Table], Segment]] = {
    "free_motion": _free_motion,
    "free_motions": _free_motions,
    "straight_line": _straight_line,
    "move_gripper": _move_gripper,
    "attach": _attach,
    "detach": _detach,
    "pause": _pause,
}
