"""The file to which a mirror writes its messages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp


@pytest.fixture
def scene() -> rp.Scene:
    return rp.load_scene("rr1_table")


def test_a_recording_over_its_own_source_keeps_the_states(scene: rp.Scene, tmp_path: Path) -> None:
    file, names = tmp_path / "run.jsonl", scene.joint_names()
    q = scene.configuration()
    with rp.Mirror(scene, record=file) as mirror:
        for k in range(5):
            mirror.receive(rp.StateMessage(0.1 * k, names, q + 0.01 * k))
    with rp.Mirror(scene, record=file) as mirror:
        report = mirror.run(rp.read_states(file))
    assert report.messages == 5
    states = list(rp.read_states(file))
    assert [state.time for state in states] == pytest.approx(0.1 * np.arange(5))
    np.testing.assert_array_equal(states[-1].positions, q + 0.04)


def test_a_recording_is_emptied_at_the_first_message(
    scene: rp.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "run.jsonl"
    file.write_text("precious\n")
    monkeypatch.chdir(tmp_path)
    with rp.Mirror(scene, record="run.jsonl") as mirror:
        mirror.receive(rp.StreamError("silence", "no message for 1 s"))
        assert file.read_text() == "precious\n"
        (tmp_path / "elsewhere").mkdir()
        monkeypatch.chdir(tmp_path / "elsewhere")
        mirror.receive(rp.StateMessage(0.0, scene.joint_names(), scene.configuration()))
    assert len(list(rp.read_states(file))) == 1


def test_a_recording_that_cannot_be_written_is_refused_at_once(scene: rp.Scene, tmp_path: Path) -> None:
    with pytest.raises(rp.InputError, match=r"cannot write .*run\.jsonl"):
        rp.Mirror(scene, record=tmp_path / "gone" / "run.jsonl")


def test_a_full_disk_is_named(scene: rp.Scene) -> None:
    mirror = rp.Mirror(scene, record="/dev/full")
    with pytest.raises(rp.InputError, match="cannot write /dev/full: No space left on device"), mirror:
        mirror.receive(rp.StateMessage(0.0, scene.joint_names(), scene.configuration()))
