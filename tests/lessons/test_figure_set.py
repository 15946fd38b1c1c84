"""All figures at once, from Python and from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import rr1plan as rp
from rr1plan.cli import run


def test_named_figures_are_written(tmp_path: Path) -> None:
    said: list[str] = []
    files = rp.save_figures(
        tmp_path / "new", ["workspace", "planar2r_path"], progress=lambda progress: said.append(progress.stage)
    )
    assert said == ["workspace", "planar2r_path"]
    assert [file.name for pair in files.values() for file in pair] == [
        "workspace.png",
        "workspace.svg",
        "planar2r_path.png",
        "planar2r_path.svg",
    ]
    for png, svg in files.values():
        assert png.read_bytes().startswith(b"\x89PNG")
        assert "</svg>" in svg.read_text()


def test_all_lessons_have_a_figure() -> None:
    assert set(rp.figure_names()) == {"first_motion", "planar2r_path", *rp.lesson_names()}


def test_an_unknown_figure_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["figures", "nopath", "--out", str(tmp_path / "new")]) == 2
    assert "no_path" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_the_command_lists_its_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["figures", "workspace", "--out", str(tmp_path), "--json"]) == 0
    made = json.loads(capsys.readouterr().out)
    assert made == {"workspace": [str(tmp_path / "workspace.png"), str(tmp_path / "workspace.svg")]}


def test_cancelling_keeps_what_is_written(tmp_path: Path) -> None:
    with pytest.raises(rp.CancelledError, match="'planar2r_path'"):
        rp.save_figures(
            tmp_path, ["workspace", "planar2r_path"], progress=lambda progress: progress.stage != "planar2r_path"
        )
    assert sorted(file.name for file in tmp_path.iterdir()) == ["workspace.png", "workspace.svg"]
