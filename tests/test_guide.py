"""Files and code of the guide run unchanged."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import rr1plan as rp

GUIDE = Path(__file__).parent.parent / "docs" / "guide.md"
PAGES = sorted(GUIDE.with_name("moving_over").glob("[!R]*.md"))


def _blocks(language: str, page: Path = GUIDE) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)


def test_the_guide_s_code_runs_on_the_guide_s_files(tmp_path: Path) -> None:
    (urdf, mjcf), (scene, sequence) = _blocks("xml"), _blocks("toml")
    # No declaration or comment may precede the line that names the file.
    (tmp_path / "picker.urdf").write_text(urdf)
    (tmp_path / "lifter.xml").write_text(mjcf)
    (tmp_path / "cell.toml").write_text(scene)
    (tmp_path / "pick.toml").write_text(sequence)
    assert urdf.startswith("<!-- picker.urdf -->")
    assert mjcf.startswith("<!-- lifter.xml -->")
    assert scene.startswith("# cell.toml")
    assert sequence.startswith("# pick.toml")
    checks = "assert motion.valid and report.certified and not replay.contacts, (report, replay)\n"
    checks += "assert past_the_post.valid and lifter.tool == 'grasp' and lifter.joint_names == ('turn', 'lift')\n"
    checks += "assert set(cell.obstacles) == {'floor', 'post'}\n"
    checks += "assert all(rp.plan(p, rng=0).found for p in (by_pose, anywhere_in, either))\n"
    checks += "assert by_hand and len(by_hand.stages) == 16, by_hand\n"
    checks += "assert near.valid and near.result.planner == 'straight_line', near\n"
    (tmp_path / "guide.py").write_text("\n".join([*_blocks("python"), checks]))
    command = [sys.executable, "-W", "error", "guide.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    # Messages about the first compilation depend on earlier runs.
    said = ("compiling for this machine", "lifter.xml: not part of the robot", "no velocity limit for turn, lift")
    assert [line for line in done.stderr.splitlines() if not line.startswith(said)] == []
    assert (tmp_path / "cell.html").stat().st_size > 0
    assert "certified free of collision in continuous time" in done.stdout


def test_the_guide_s_joint_state_is_read(tmp_path: Path) -> None:
    (line,) = _blocks("json")
    (tmp_path / "states.jsonl").write_text(line)
    (state,) = rp.read_states(tmp_path / "states.jsonl")
    assert isinstance(state, rp.StateMessage)
    assert state.joint_names == ("turn", "lift", "bend")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_code_of_a_page_on_moving_over_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files on the page are named in their first line."""
    monkeypatch.chdir(tmp_path)
    for language in ("xml", "yaml", "toml", "text"):
        for text in _blocks(language, page):
            first, rest = text.split("\n", 1)
            name = re.fullmatch(r"(?:<!-- |# )(\S+?)(?: -->)?", first)
            assert name, first
            # In formats without comments, the content starts after the name.
            (tmp_path / name[1]).write_text(rest if language == "text" else text)
    code = _blocks("python", page)
    assert code
    exec(compile("\n".join(code), str(page), "exec"), {})


def test_every_page_on_moving_over_is_listed_with_what_did_it_before_and_now() -> None:
    index = GUIDE.with_name("moving_over") / "README.md"
    assert set(re.findall(r"\((\w+\.md)\)", index.read_text())) == {page.name for page in PAGES}
    for page in PAGES:
        assert "**There:**" in page.read_text()
        assert "**Here:**" in page.read_text()


@pytest.mark.parametrize("page", [GUIDE, *PAGES], ids=lambda page: page.stem)
def test_every_name_the_guide_uses_is_public(page: Path) -> None:
    import rr1plan

    used = set(re.findall(r"\brp\.(\w+)", page.read_text()))
    assert used <= set(rr1plan.__all__)
