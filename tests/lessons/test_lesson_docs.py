"""The pages about the lessons: their code runs, and its output agrees with the answers to the exercises."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest

import rr1plan as rp

FOLDER = Path(__file__).parents[2] / "docs" / "lessons"
PAGES = sorted(FOLDER.glob("[!R]*.md"))


@pytest.mark.parametrize("page", [*PAGES, FOLDER / "README.md"], ids=lambda page: page.stem)
def test_the_answers_of_a_page_are_what_its_code_prints(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    said = None
    for language, text in re.findall(r"^```(python|text)\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL):
        if language == "text":
            assert text == said
            said = None
            continue
        assert not said, f"what the page's code prints is not on the page: {said}"
        with contextlib.redirect_stdout(io.StringIO()) as output:
            exec(compile(text, str(page), "exec"), names)
        said = output.getvalue()
    assert not said
    assert names


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_exercise_has_an_answer(page: Path) -> None:
    text = page.read_text()
    exercises = text.split("## Exercises")[1].split("\n**")[1:]
    assert len(exercises) >= 3
    assert all("<details><summary>Answer</summary>" in exercise for exercise in exercises)
    assert [int(exercise.split(".")[0]) for exercise in exercises] == list(range(1, len(exercises) + 1))


def test_every_lesson_has_a_page_a_script_and_a_row() -> None:
    assert {page.stem for page in PAGES} == set(rp.lesson_names())
    rows = re.findall(r"^\| \[(\w+)\]\((\w+)\.md\) \|", (FOLDER / "README.md").read_text(), re.MULTILINE)
    assert rows == [(name, name) for name in rp.lesson_names()]
    for page in PAGES:
        (script,) = re.findall(r"\]\((../../examples/lessons/\d\d_(\w+)\.py)\)", page.read_text())
        assert script[1] == page.stem
        assert (FOLDER / script[0]).is_file()
