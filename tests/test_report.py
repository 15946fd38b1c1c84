"""The text of a report, and its round trip through a file."""

from __future__ import annotations

import json
import pickle
from typing import Any

import pytest

from rr1plan.errors import FormatError
from rr1plan.report import Margin, Report, Violation

HIT = Violation("collision", ("arm/hand", "shelf"), 1.25, -0.002, 0.0, "arm/hand and shelf overlap by 2.000 mm")
FREE = Report(
    (),
    {
        "clearance": Margin(0.00345, "m", ("arm/hand", "shelf"), 1.5),
        "velocity": Margin(0.875, "", ("arm/j1",), 0.25),
        "clearance_proven": Margin(0.25, "m"),
    },
    ("collision", "velocity"),
    {"start": "no problem was given", "goal": "no problem was given", "torque": "not asked for"},
    2.5,
    {"distances": 120.0},
)
HURT = Report((HIT,), {}, ("collision",), {}, 2.5)


def test_a_certified_motion_says_so_with_its_margins_in_units() -> None:
    lines = str(FREE).splitlines()
    assert lines[0] == "VALID, certified free of collision in continuous time (2.500 s of motion)"
    assert "3.450 mm  arm/hand - shelf at 1.5000 s" in lines[1]
    assert "87.5 % of the limit  arm/j1 at 0.2500 s" in lines[2]
    assert lines[3].endswith("0.2500 m")
    assert "  not checked  start, goal: no problem was given" in lines


def test_an_invalid_motion_names_each_violation() -> None:
    lines = str(HURT).splitlines()
    assert lines[0].startswith("INVALID, 1 violation (")
    assert lines[1] == "  violation    collision: arm/hand and shelf overlap by 2.000 mm"
    assert "2 violations" in str(Report((HIT, HIT), {}, ()))


def test_valid_and_certified_follow_from_what_was_checked() -> None:
    assert FREE.valid
    assert FREE.certified
    assert not HURT.valid
    assert not HURT.certified
    unchecked = Report((), {}, ("velocity",))
    assert unchecked.valid
    assert not unchecked.certified
    assert str(unchecked).startswith("VALID (")


@pytest.mark.parametrize("report", [FREE, HURT])
def test_a_report_comes_back_from_json_and_from_a_pickle(report: Report) -> None:
    again = Report.from_dict(json.loads(json.dumps(report.to_dict())))
    assert again == report
    assert pickle.loads(pickle.dumps(report)) == report


def test_a_report_cannot_be_changed() -> None:
    with pytest.raises(TypeError):
        FREE.margins["clearance"] = Margin(1.0)
    with pytest.raises(TypeError):
        pickle.loads(pickle.dumps(FREE)).not_checked["x"] = "y"


def test_a_margin_is_a_number() -> None:
    assert float(FREE.margins["velocity"]) == 0.875


def altered(path: list[Any], value: Any) -> dict[str, Any]:
    """The plain values of a report with one of them replaced (or added)."""
    data = json.loads(json.dumps(FREE.to_dict() | {"violations": []}))
    inner = data
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "match"),
    [
        (["surprise"], 1, "surprise"),
        (["valid"], False, "valid"),
        (["certified"], 1, "certified"),
        (["duration"], "long", "duration"),
        (["duration"], float("nan"), "duration"),
        (["duration"], True, "duration"),
        (["duration"], 10**400, "duration is .*expected a finite number"),
        (["statistics", "distances"], 10**400, "distances"),
        (["margins"], [], "margins"),
        (["margins", "clearance"], 0.1, "clearance"),
        (["margins", "clearance", "time"], float("inf"), "time"),
        (["margins", "clearance", "subject"], "hand", "subject"),
        (["checked"], "collision", "checked"),
        (["checked"], [1], "checked"),
        (["not_checked", "goal"], None, "goal"),
        (["statistics", "distances"], "many", "distances"),
        (["violations"], {}, "violations"),
        (["violations"], [{"kind": "crash"}], "kind"),
        (["violations"], [HIT.__dict__ | {"subject": [], "kind": "crash"}], "crash"),
    ],
)
def test_an_altered_report_is_refused_by_name(path: list[Any], value: Any, match: str) -> None:
    with pytest.raises(FormatError, match=match):
        Report.from_dict(altered(path, value))


def test_something_else_is_refused() -> None:
    with pytest.raises(FormatError, match="expected a mapping"):
        Report.from_dict([FREE.to_dict()])
    missing = FREE.to_dict()
    del missing["checked"]
    with pytest.raises(FormatError, match="checked"):
        Report.from_dict(missing)
