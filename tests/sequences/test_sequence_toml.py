"""Sequences written by hand: each kind of segment equals that of Python, and messages give the line of a mistake."""

from __future__ import annotations

import copy
import json
import random
from pathlib import Path

import numpy as np
import pytest
from sequences.conftest import tool_down

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, NO_PLAN, OK, run
from rr1plan.files.toml_writer import to_toml
from rr1plan.sequences.sequence_toml import is_sequence_file

POSE = '{ frame = "tool", position = [-0.3, 0, 0.2], quaternion = [0, 1, 0, 0] }'


@pytest.fixture
def folder(table: rp.Scene, tmp_path: Path) -> Path:
    """A folder with the scene, and a path for a sequence next to it."""
    rp.save_scene(tmp_path / "cell.toml", table)
    return tmp_path


def write(folder: Path, *segments: str, head: str = 'scene = "cell.toml"') -> Path:
    file = folder / "pick.toml"
    file.write_text("\n".join([head, *(f"\n[[segments]]\n{segment}" for segment in segments), ""]))
    return file


def described(segment: object) -> object:
    """All content of a segment as comparable values."""
    if isinstance(segment, np.ndarray):
        return segment.tolist()
    if isinstance(segment, tuple | list):
        return [described(part) for part in segment]
    if hasattr(segment, "__dataclass_fields__"):
        return type(segment).__name__, {name: described(getattr(segment, name)) for name in segment.__dict__}
    return segment


CASES = {
    'free_motion = "home"': rp.FreeMotion("home"),
    'free_motion = [0.1, 0, 0.2, 0, 1, 0]\narm = "arm"': rp.FreeMotion([0.1, 0, 0.2, 0, 1, 0], arm="arm"),
    f'free_motion = [{POSE}, "raised"]\nallow = [["arm", "block"]]': rp.FreeMotion(
        [rp.PoseGoal("tool", [-0.3, 0, 0.2], [0, 1, 0, 0]), "raised"], allow=[("arm", "block")]
    ),
    "free_motion = { lower = [-0.4, 0, 0.2], upper = [-0.3, 0.1, 0.3] }": rp.FreeMotion(
        rp.RegionGoal("tool", [-0.4, 0, 0.2], [-0.3, 0.1, 0.3])
    ),
    'free_motions = { arm = "raised" }': rp.FreeMotion({"arm": "raised"}),
    f"straight_line = {POSE}": rp.StraightLine(rp.PoseGoal("tool", [-0.3, 0, 0.2], [0, 1, 0, 0])),
    "straight_line = { offset = [0, 0, -0.05] }": rp.StraightLine(offset=[0, 0, -0.05]),
    'straight_line = { offset = [0, 0, 0.05], axes = "tool" }\nallow = [["block", "table"]]': rp.StraightLine(
        offset=[0, 0, 0.05], axes="tool", allow=[("block", "table")]
    ),
    'move_gripper = "open"\nseconds = 0.7': rp.MoveGripper("open", seconds=0.7),
    "move_gripper = 0.2": rp.MoveGripper(0.2),
    "move_gripper = { width = 0.05 }": rp.MoveGripper(width=0.05),
    'move_gripper = { around = "block", squeeze = 0.002 }': rp.MoveGripper(around="block", squeeze=0.002),
    'attach = "block"\nlink = "tool"\ntouch = []': rp.Attach("block", link="tool", touch=[]),
    'attach = "block"\narm = "arm"': rp.Attach("block", arm="arm"),
    'free_motion = "home"\nstop = false': rp.FreeMotion("home", stop=False),
    "straight_line = { offset = [0, 0, 0.05] }\nstop = false": rp.StraightLine(offset=[0, 0, 0.05], stop=False),
    "pause = 2": rp.Pause(2.0),
}


@pytest.mark.parametrize("text", CASES, ids=lambda text: text.splitlines()[0][:40])
def test_a_segment_is_that_of_python(text: str, folder: Path) -> None:
    (made,) = rp.load_segments(write(folder, text)).segments
    assert described(made) == described(CASES[text])


def test_the_scene_is_beside_the_file_or_shipped(
    folder: Path, table: rp.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    read = rp.load_segments(write(folder, 'attach = "block"', 'detach = "block"'))
    assert rp.scene_differences(read.scene, table) == ()
    assert [segment.label for segment in read.segments] == ["attach 'block'", "detach 'block'"]
    assert rp.load_segments(write(folder, "pause = 1", head='scene = "rr1_table"')).scene.name == "rr1_table"


def test_a_pick_stands_for_its_segments_and_is_planned(folder: Path, table: rp.Scene) -> None:
    options = 'height = 0.06\nsupports = ["table"]\narm = "arm"\nstop = false'
    text = f'pick_and_place = "block"\nplace = [-0.28, -0.12, 0.03]\n{options}'
    read = rp.load_segments(write(folder, text, 'free_motion = "home"'))
    expected = rp.pick_and_place(
        table, "block", [-0.28, -0.12, 0.03], arm="arm", supports=["table"], height=0.06, stop=False
    )
    assert described(read.segments) == described([*expected, rp.FreeMotion("home")])
    plan = rp.plan_sequence(read, rng=0, budget=rp.Budget(seconds=100.0))
    assert plan, plan
    # A place is a pose of the object's frame.
    where = "{ position = [-0.28, -0.12, 0.03], quaternion = [1, 0, 0, 0] }"
    grasp = "{ position = [-0.3, 0.1, 0.04], quaternion = [0, 1, 0, 0] }"
    read = rp.load_segments(write(folder, f'pick_and_place = "block"\nplace = {where}\ngrasps = {grasp}'))
    place = rp.PoseGoal("block", [-0.28, -0.12, 0.03], [1, 0, 0, 0])
    by_hand = rp.pick_and_place(table, "block", place, grasps=[tool_down(-0.3, 0.1, 0.04)])
    assert described(read.segments) == described(by_hand)


MISTAKES = {
    ("free_motion = 'home'\npause = 1",): (3, "expected exactly one of free_motion, .*; got free_motion and pause"),
    ("fre_motion = 'home'",): (3, "got none .* Did you mean 'free_motion' where it says 'fre_motion'"),
    ("pause = 1", "pause = 1\narm = 'arm'"): (8, r"segments\[1\].arm: unknown key 'arm'"),
    ("pause = nan",): (4, r"segments\[0\].pause: expected a finite number"),
    ("pause = '1'",): (4, r"segments\[0\].pause: expected a number, got '1'"),
    ("pause = -1",): (3, "seconds is -1"),
    ("pause = 1", "free_motion = 'hom'"): (6, "unknown configuration 'hom'. Did you mean 'home'"),
    ("pause = 1", "detach = 'block'"): (6, "unknown held object 'block'"),
    ("attach = 'blok'",): (3, "unknown obstacle 'blok'. Did you mean 'block'"),
    ("straight_line = { offset = [0, 0] }",): (4, r"offset has shape \(2,\)"),
    ("straight_line = { offset = [0, 0, 1], axis = 'tool' }",): (4, "unknown key 'axis'. Did you mean 'axes'"),
    ("straight_line = { offset = [0, 0, 1], axes = 'tol' }",): (4, "unknown axes 'tol'. Did you mean 'tool'"),
    ("straight_line = 'home'",): (4, "the goal of a straight line is 'home', expected a PoseGoal"),
    ("free_motion = { position = [0, 0, inf] }",): (4, "position"),
    ("free_motions = { arm = 'home' }\narm = 'arm'",): (5, "has no effect with free_motions"),
    ("free_motions = { other = 'home' }",): (3, "unknown arm 'other'"),
    ("pause = 1\nstop = false",): (5, "unknown key 'stop'"),
    ("free_motion = 'home'\nstop = 0",): (5, "expected true or false, got 0"),
    ("move_gripper = {}",): (4, "expected exactly one of width, around; got none"),
    ("move_gripper = { width = 1, around = 'block' }",): (4, "got width and around"),
    ("move_gripper = 'opn'",): (3, "'opn'"),
    ("pause = 1", "move_gripper = 'open'\nallow = [['arm']]"): (8, "expected pairs of names, got"),
    ("move_gripper = 'open'\nallow = [['arm', 'blok']]",): (3, "unknown element 'blok'"),
    ("pick_and_place = 'block'",): (3, "has no 'place', which is required"),
    ("pick_and_place = 'table'\nplace = [0, 0, 1]",): (3, "cannot grasp 'table' from above"),
    ("attach = 'block'", "detach = 'block'", "pick_and_place = 'block'\nplace = [0, 0, 1]"): (
        10,
        "is elsewhere by now",
    ),
    (): (None, "a sequence of 0 segments"),
}


@pytest.mark.parametrize("segments", MISTAKES, ids=lambda segments: (segments or ("none",))[-1].splitlines()[0][:40])
def test_a_mistake_is_named_with_its_line(segments: tuple[str, ...], folder: Path) -> None:
    line, words = MISTAKES[segments]
    with pytest.raises(rp.FormatError, match=words) as caught:
        rp.load_segments(write(folder, *segments))
    assert "pick.toml" in str(caught.value)
    assert line is None or f"pick.toml:{line}:" in str(caught.value)


_VALUES = [
    *(True, 0, -1, 0.5, 1e9, float("inf"), 2**62, "", "arm", "block", "home"),
    *([], [[]], [0], [1.0, 2.0, 3.0], [["arm", "table"]]),
    *({}, {"offset": [0, 0, 0.1]}, {"width": 0.05}, {"around": "block"}, {"frame": "x"}, {"position": [0, 0, 1]}),
]


def test_whatever_a_file_says_it_is_read_or_refused_with_its_place(folder: Path) -> None:
    """Segments in which one or two values are replaced by others, or keys are added."""
    pose = {"frame": "tool", "position": [-0.3, 0, 0.3], "quaternion": [0, 1, 0, 0]}
    segments = [
        {"free_motion": pose, "arm": "arm", "allow": [["arm", "table"]], "stop": False},
        {"free_motions": {"arm": "home"}},
        {"straight_line": {"offset": [0, 0, -0.05], "axes": "tool"}},
        {"move_gripper": {"width": 0.05}, "seconds": 0.5},
        {"attach": "block", "link": "tool", "touch": ["finger_link"]},
        {"pause": 1.0},
    ]
    rng, refused = random.Random(0), 0
    for _ in range(200):
        changed = copy.deepcopy(segments)
        for _ in range(rng.choice((1, 1, 2))):
            at = rng.choice(changed)
            while True:
                key = rng.choice([*at, "place", "stop"]) if isinstance(at, dict) else rng.randrange(len(at))
                inner = at.get(key) if isinstance(at, dict) else at[key]
                if not inner or not isinstance(inner, dict | list) or rng.random() < 0.5:
                    break
                at = inner
            at[key] = copy.deepcopy(rng.choice(_VALUES))
        (folder / "f.toml").write_text(to_toml({"scene": "cell.toml", "segments": changed}))
        try:
            read = rp.load_segments(folder / "f.toml")
        except rp.FormatError as error:
            refused += "f.toml" in str(error)
        else:
            assert len(read.segments) == len(segments)
    assert 100 < refused < 200


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("", "has no 'scene', which is required"),
        ('scene = "none.toml"', r"scene: there is no such file: .*none.toml"),
        ('scene = "rr1_tabel"', "unknown scene 'rr1_tabel'. Did you mean 'rr1_table'"),
        ('scene = "cell.toml"\nversion = 2', "is version 2, expected 1"),
        ('scene = "cell.toml"\nsegment = 1', "unknown key 'segment'. Did you mean 'segments'"),
        ("scene = [", "TOML"),
    ],
)
def test_a_wrong_head_is_named(head: str, words: str, folder: Path) -> None:
    with pytest.raises(rp.InputError, match=words):
        rp.load_segments(write(folder, "pause = 1", head=head))


def test_only_files_with_segments_are_sequences(folder: Path) -> None:
    assert is_sequence_file(write(folder, "pause = 1"))
    (folder / "inline.toml").write_text('scene = "cell.toml"\nsegments = [{ pause = 1 }]\n')
    assert is_sequence_file(folder / "inline.toml")
    assert len(rp.load_segments(folder / "inline.toml").segments) == 1
    (folder / "SHOUTED.TOML").write_text((folder / "inline.toml").read_text())
    assert is_sequence_file(folder / "SHOUTED.TOML")
    assert not is_sequence_file(folder / "cell.toml")
    assert not is_sequence_file("rr1_table")
    assert not is_sequence_file(folder / "none.toml")
    with pytest.raises(rp.FormatError, match="holds a sequence, not a scene; read it with load_segments"):
        rp.load_scene(folder / "pick.toml")


# ---- command line --------------------------------------------------------------------------------


def test_the_command_plans_a_sequence_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(folder, 'free_motion = "raised"', 'move_gripper = "open"', "pause = 0.25", 'free_motion = "home"')
    outputs = {"--output": folder / "o.json", "--csv": folder / "o.csv", "--html": folder / "o.html"}
    words = [str(word) for pair in outputs.items() for word in pair]
    assert run(["plan", str(file), *words]) == OK
    said = capsys.readouterr().out
    assert "4 stages" in said
    assert "certified free of collision" in said
    assert rp.load_sequence(folder / "o.json").valid
    assert rp.load_csv(folder / "o.csv").joint_names[-1] == "arm/finger_joint"
    assert "panel-stages" in (folder / "o.html").read_text()
    assert run(["plan", str(file), "--json"]) == OK
    value = json.loads(capsys.readouterr().out)
    assert [stage["label"] for stage in value["stages"]][2] == "pause of 0.25 s"
    assert value["report"]["valid"]


def test_the_command_says_which_segment_was_not_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(folder, "pause = 0.1", "straight_line = { offset = [0, 0, 5] }")
    assert run(["plan", str(file)]) == NO_PLAN
    assert "segment 2 (straight line 5000 mm up) not found" in capsys.readouterr().err
    assert run(["plan", str(file), "--json"]) == NO_PLAN
    assert json.loads(capsys.readouterr().out)["failed"] == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--goal", "home"], "--goal has no effect with a sequence"),
        (["--timeline", "t.svg"], "--timeline has no effect with a sequence"),
        (["--output", "-"], "--output - has no effect with a sequence"),
        (["--planner", "rt_connect"], "rt_connect"),
    ],
)
def test_options_without_effect_are_refused(
    words: list[str], message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plan", str(write(folder, "pause = 0.1")), *words]) == BAD_INPUT
    assert message in capsys.readouterr().err
