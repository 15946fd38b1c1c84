"""The guide's files and code, taken from the page, run as they stand there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

GUIDE = Path(__file__).parent.parent / "docs" / "guide.md"


def _blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", GUIDE.read_text(), re.MULTILINE | re.DOTALL)


def test_the_guide_s_code_runs_on_the_guide_s_files(tmp_path: Path) -> None:
    (urdf, mjcf), (scene,) = _blocks("xml"), _blocks("toml")
    # A declaration or comment may not come before what names the file.
    (tmp_path / "picker.urdf").write_text(urdf)
    (tmp_path / "lifter.xml").write_text(mjcf)
    (tmp_path / "cell.toml").write_text(scene)
    assert urdf.startswith("<!-- picker.urdf -->")
    assert mjcf.startswith("<!-- lifter.xml -->")
    assert scene.startswith("# cell.toml")
    checks = "assert motion.valid and report.certified and not replay.contacts, (report, replay)\n"
    checks += "assert past_the_post.valid and lifter.tool == 'grasp' and lifter.joint_names == ('turn', 'lift')\n"
    checks += "assert set(cell.obstacles) == {'floor', 'post'}\n"
    checks += "assert all(rp.plan(p, rng=0).found for p in (by_pose, anywhere_in, either))\n"
    checks += "assert near.valid and near.result.planner == 'straight_line', near\n"
    (tmp_path / "guide.py").write_text("\n".join([*_blocks("python"), checks]))
    command = [sys.executable, "-W", "error", "guide.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    # What is said of the first compilation depends on what ran before.
    said = ("compiling for this machine", "lifter.xml: not part of the robot", "no velocity limit for turn, lift")
    assert [line for line in done.stderr.splitlines() if not line.startswith(said)] == []
    assert (tmp_path / "cell.html").stat().st_size > 0
    assert "certified free of collision in continuous time" in done.stdout


def test_every_name_the_guide_uses_is_public() -> None:
    import rr1plan

    used = set(re.findall(r"\brp\.(\w+)", GUIDE.read_text()))
    assert used <= set(rr1plan.__all__)
