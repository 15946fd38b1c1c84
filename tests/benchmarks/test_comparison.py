"""The comparison's tables, from known results."""

from __future__ import annotations

import json

import numpy as np
import pytest

import rr1plan as rp


def _answer(name, plan, shorten, retime=None, touch=None):
    seconds = {"set up": 0.001, "plan": plan, "shorten": shorten}
    answer = {"name": name, "seconds": seconds, "raw": [[0.0, 0.0], [0.0, 4.0], [3.0, 4.0]]}
    answer |= {"path": [[0.0, 0.0], [3.0, 4.0]], "touches": {"raw": {"Coal": None, "FCL": None}}}
    answer["touches"]["path"] = {"Coal": touch, "FCL": None}
    if retime is not None:
        seconds["retime"] = retime
        answer["duration"] = 2.0
        answer["touches"]["timed"] = {"Coal": None, "FCL": None}
    return answer


@pytest.fixture
def runs(script):
    run = script("comparison").Run
    touch = ("arm/hand", "shelf", 0.5)
    fast = run("fast", [_answer("shelf/1", 0.001, 0.001, 0.002), _answer("cage/1", 0.003, 0.001, 0.002)], "certified")
    slow = [_answer("shelf/1", 0.010, 0.030, touch=touch), _answer("shelf/2", 0.020, 0.060)]
    slow = run("slow", [*slow, {"name": "cage/1", "seconds": {"plan": 9.0}, "failure": "no path"}])
    fast.answers[0]["excess"], fast.answers[1]["excess"] = 1.04, 1.06
    return [fast, slow, run("absent", [], skipped="pip could not install it")]


def _cells(text, row):
    (line,) = [line for line in text.splitlines() if line.startswith(f"| {row} ")]
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_problems_that_are_not_solved_count_as_endless(script, runs):
    text = script("comparison").time_table(runs[:2])
    header = _cells(text, "planner")
    fast, slow = (dict(zip(header, _cells(text, name), strict=True)) for name in ("fast", "slow"))
    assert fast["plan"] == "2 / 2.9 / 3"
    assert fast["whole query"] == "5 / 5.9 / 6"
    assert fast["with referee"] == "-"
    assert slow["plan + shorten"] == "80 / - / -"
    assert slow["whole query"] == "-"


def test_quantiles_are_those_of_numpy_where_they_end(script):
    quantile = script("comparison").quantile
    values = np.random.default_rng(5).exponential(size=17)
    for share in (0.0, 0.3, 0.5, 0.95, 1.0):
        assert quantile(values, share) == pytest.approx(np.quantile(values, share))
    assert quantile(np.array([1.0, np.inf, 2.0]), 0.5) == 2.0
    assert quantile(np.array([1.0, np.inf, 2.0]), 0.75) is None
    assert quantile(np.empty(0), 0.5) is None


def test_excess_is_seen_in_speed_and_acceleration(script):
    t = np.arange(0.0, 1.0, 0.002)[:, None]
    limits = rp.Limits(
        lower=np.full(2, -9.0),
        upper=np.full(2, 9.0),
        velocity=np.array([2.0, 4.0]),
        acceleration=np.array([8.0, 5.0]),
        jerk=np.full(2, 100.0),
        effort=np.full(2, 100.0),
    )
    excess = script("comparison").excess
    assert excess(np.hstack([3.0 * t, 0.0 * t]), 0.002, limits) == pytest.approx(1.5)
    assert excess(np.hstack([0.0 * t, 3.0 * t**2]), 0.002, limits) == pytest.approx(1.48, abs=0.02)
    assert excess(np.hstack([0.5 * np.sin(4.0 * t), 0.0 * t]), 0.002, limits) == pytest.approx(1.0, abs=1e-3)
    assert excess(np.zeros((2, 2)), 0.002, limits) == 0.0


def test_results_count_solved_lengths_touches_and_broken_limits(script, runs):
    text = script("comparison").result_table(runs[:2])
    assert _cells(text, "fast") == ["fast", "2 / 2", "7", "5", "2", "0.0 %", "0.0 %", "0.0 %", "50.0 %"]
    assert _cells(text, "slow") == ["slow", "2 / 3", "7", "5", "-", "0.0 %", "50.0 %", "-", "-"]


def test_ratios_are_to_the_reference(script, runs):
    text = script("comparison").ratio_table(runs[:2], "slow")
    assert _cells(text, "fast") == ["fast", "10", "-", "26.7", "-"]
    assert _cells(text, "slow") == ["slow", "1", "-", "1", "-"]


def test_sets_have_their_own_medians(script, runs):
    text = script("comparison").set_table(runs[:2])
    assert _cells(text, "shelf") == ["shelf", "2", "60"]
    assert _cells(text, "cage") == ["cage", "4", "-"]


def test_the_report_names_who_did_not_run_and_why(script, runs):
    text = "\n\n".join(script("comparison").compare(runs, "slow"))
    assert "**absent did not run**: pip could not install it." in text
    assert "- fast: certified." in text
    assert "times faster than slow" in text
    assert "times faster" not in "\n".join(script("comparison").compare(runs, "absent"))


def test_the_figures_are_plain_and_without_motions(runs):
    told = json.loads(json.dumps([run.to_dict() for run in runs]))
    assert told[0]["milliseconds"]["plan"]["median"] == pytest.approx(2.0)
    assert told[0]["answers"][0]["length path"] == 5.0
    assert "path" not in told[0]["answers"][0]
    assert told[1]["touching"]["path"] == [1, 2]
    assert told[1]["milliseconds"]["plan"] == {"median": pytest.approx(20.0), "p95": None, "max": None}
    assert told[2]["skipped"] == "pip could not install it"


def test_the_picture_is_drawn_without_those_who_did_not_run(script, runs, tmp_path):
    script("picture").draw(tmp_path / "picture.png", runs, "Known answers")
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")
