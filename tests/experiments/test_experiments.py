"""Experiments: measurements, output files, and rejected arguments."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, OK, run
from rr1plan.experiments.boat_meshes import boat_mesh
from rr1plan.experiments.experiment_figures import FIGURES
from rr1plan.experiments.falling_tower import measure_tower
from rr1plan.experiments.measuring_process import measure
from rr1plan.experiments.message_latency import measure_latency
from rr1plan.experiments.simulated_arms import SEVEN_MOVES, measure_arms, measure_static_scene

TIMES = {
    "real_time_factor",
    "cpu_real_time_factor",
    "step_us",
    "step_p95_us",
    "cpu_us",
    "cores",
    "build_s",
    "memory_mb",
}


@pytest.mark.parametrize(("stations", "around"), [(2, 3), (8, 16), (30, 50)])
def test_a_boat_is_closed_and_convex_and_has_the_triangles_asked_for(stations: int, around: int) -> None:
    mesh = boat_mesh(stations, around)
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert len(mesh.faces) == 2 * stations * around
    assert other.is_watertight
    assert other.volume == pytest.approx(other.convex_hull.volume, rel=1e-9)


def test_a_boat_has_the_volume_of_half_an_ellipsoid() -> None:
    mesh = boat_mesh(100, 100)
    exact = 0.5 * 4.0 / 3.0 * np.pi * 0.30 * 0.155 * 0.48
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume == pytest.approx(exact, rel=2e-3)


def test_two_arms_follow_the_seven_poses_in_step() -> None:
    row = measure_arms(2)
    assert row["simulated_s"] == pytest.approx(SEVEN_MOVES)
    assert (row["arms"], row["contacts"], row["start_skew_s"]) == (2, 0, 0.0)
    assert 0.0 < row["tracking_error_rad"] < 1e-3
    assert all(row[name] > 0.0 for name in TIMES)


def test_a_measurement_repeats_but_for_its_times() -> None:
    one, two = (measure_arms(2, seconds=1.0) for _ in range(2))
    assert {k: v for k, v in one.items() if k not in TIMES} == {k: v for k, v in two.items() if k not in TIMES}


def test_arms_that_are_too_close_touch() -> None:
    assert measure_arms(2, spacing=0.3, seconds=4.0)["contacts"] > 0


def test_an_arm_moves_among_boats() -> None:
    row = measure_static_scene(3, stations=8, around=16, seconds=0.5)
    assert (row["boats"], row["triangles"], row["contacts"]) == (3, 256, 0)
    assert row["tracking_error_rad"] < 1e-3


def test_a_tower_falls_and_lies_on_the_floor() -> None:
    rows = measure_tower(6, seconds=3.0)
    assert [(row["from_s"], row["to_s"]) for row in rows] == [(0.0, 2.0), (2.0, 3.0)]
    assert rows[1]["lowest_point_mm"] > -10.0
    assert all(0.0 <= row["penetration_at_end_mm"] <= row["penetration_mm"] < 100.0 for row in rows)
    assert rows[1]["contacts"] > 0
    assert rows[0]["penetration_mm"] != measure_tower(6, seconds=2.0, seed=1)[0]["penetration_mm"]


def test_messages_arrive_before_they_are_acknowledged() -> None:
    row = measure_latency(50_000, repeats=5)
    assert (row["bytes"], row["messages"]) == (50_000, 5)
    assert 0.0 < row["latency_median_ms"] < row["round_trip_median_ms"]
    assert row["latency_median_ms"] <= row["latency_p95_ms"]


def test_a_measurement_that_fails_says_why() -> None:
    with pytest.raises(rp.InputError, match="dt"):
        measure("multi", {"arms": 1, "dt": -1.0})
    with pytest.raises(rp.BackendError, match="legs"):
        measure("multi", {"legs": 1})


def test_experiments_write_tables_figures_and_a_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def too_large(name: str, arguments: Mapping[str, float]) -> Any:
        if arguments["arms"] > 1000:
            raise rp.InputError("more than <this> machine has")
        return measure(name, arguments)

    monkeypatch.setattr("rr1plan.experiments.run_experiments.measure", too_large)
    seen: list[rp.Progress] = []
    report = rp.run_experiments(["multi"], tmp_path / "new", quick=True, arms=[9_999, 2, 2], progress=seen.append)
    assert [progress.stage for progress in seen] == ["multi: 2 arms", "multi: 9,999 arms"]
    assert not report
    assert report.failures == ("multi: 9,999 arms: more than <this> machine has",)
    (row,) = report.results["multi"]
    assert (row["arms"], row["start_skew_s"]) == (2, 0.0)
    names = {"multi.csv", "multi.png", "experiments.md", "experiments.html"}
    assert {file.name for file in report.files} == names == {file.name for file in (tmp_path / "new").iterdir()}
    with (tmp_path / "new/multi.csv").open() as stream:
        (read,) = csv.DictReader(stream)
    assert {name: float(value) for name, value in read.items()} == row
    page = (tmp_path / "new/experiments.html").read_text()
    assert set(re.findall(r'(?:src|href)="([^,"]*)', page)) == {"data:image/png;base64"}
    assert '<meta name="viewport" content="width=device-width' in page  # readable on a phone
    assert "9,999 arms: more than &lt;this&gt; machine has" in page
    assert "| arms |" in (tmp_path / "new/experiments.md").read_text()


def test_tables_of_an_earlier_run_do_not_stay_beside_a_report_of_failures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> Any:
        raise rp.BackendError("no memory")

    for name in ("multi.csv", "multi.png", "static.csv"):
        (tmp_path / name).write_text("earlier")
    monkeypatch.setattr("rr1plan.experiments.run_experiments.measure", fail)
    assert not rp.run_experiments(["multi"], tmp_path, quick=True, arms=[2])
    assert {file.name for file in tmp_path.iterdir()} == {"static.csv", "experiments.md", "experiments.html"}


def test_a_canceled_run_leaves_the_folder_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rr1plan.experiments.run_experiments.measure", lambda *_: [{"size": 1.0}])
    with pytest.raises(rp.CancelledError):
        rp.run_experiments(["multi", "latency"], tmp_path, progress=lambda now: now.stage.startswith("multi"))
    assert list(tmp_path.iterdir()) == []


def test_figures_count_boats_in_whole_numbers_and_show_the_largest_value_whole() -> None:
    rows = [{"boats": n, "step_us": 10.0 + n, "memory_mb": 160.0 + n, "triangles": 100} for n in (0, 7)]
    for plot in FIGURES["static"](rows).axes:
        low, high = plot.get_ylim()
        assert low == 0.0
        assert high > 1.05 * plot.dataLim.y1
        np.testing.assert_array_equal(plot.get_xticks() % 1.0, 0.0)


def test_panels_of_figures_stand_apart() -> None:
    rows = [{"boats": n, "step_us": 20.0, "memory_mb": 1e3, "triangles": 250_000} for n in (0, 500)]
    figure = FIGURES["static"](rows)
    figure.draw_without_rendering()
    left, right = (plot.get_tightbbox() for plot in figure.axes)
    assert right.x0 - left.x1 > 0.03 * figure.bbox.width


def test_the_command_line_measures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["experiment", "multi", "--out", str(tmp_path), "--quick", "--arms", "1", "--json"]
    assert run(arguments) == OK
    result = json.loads(capsys.readouterr().out)
    assert result["failures"] == []
    assert [row["arms"] for row in result["results"]["multi"]] == [1]
    assert all(Path(file).is_file() for file in result["files"])


@pytest.mark.parametrize(
    "words", [["experiment", "swim", "--out", "x"], ["experiment", "all"], ["experiment", "--out", "x"]]
)
def test_the_command_line_refuses(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words) == BAD_INPUT
    assert capsys.readouterr().err


def test_what_makes_no_sense_is_refused_before_anything_is_measured(tmp_path: Path) -> None:
    with pytest.raises(rp.UnknownNameError, match="swim"):
        rp.run_experiments(["swim"], tmp_path)
    for options in ({"arms": [0]}, {"arms": []}, {"seed": -1}, {"quick": "yes"}):
        with pytest.raises(rp.InputError, match=next(iter(options))):
            rp.run_experiments("multi", tmp_path, **options)
    with pytest.raises(rp.InputError, match="experiments"):
        rp.run_experiments([], tmp_path)
    with pytest.raises(rp.InputError, match="option arms has no effect without the experiment multi"):
        rp.run_experiments(["static", "latency"], tmp_path, arms=[3])
    (tmp_path / "file").touch()
    with pytest.raises(rp.InputError, match="folder"):
        rp.run_experiments("multi", tmp_path / "file")
    with pytest.raises(rp.CancelledError):
        rp.run_experiments("all", tmp_path, progress=lambda _: False)
