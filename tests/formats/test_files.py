"""Writing files: whole or not at all, through links, and never in the place of a device."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rr1plan as rp
from rr1plan.files.file_access import check_writable, write_bytes, write_text

WRITERS: dict[str, Callable[[Path, rp.Scene], Any]] = {
    "bytes": lambda file, _: write_bytes(file, b"new"),
    "scene": rp.save_scene,
    "page": lambda file, scene: rp.save_html(file, scene),
    "model": lambda file, scene: rp.save_mjcf(file, scene),
    "check": lambda file, _: check_writable(file),
}


@pytest.fixture(params=WRITERS)
def write(request: pytest.FixtureRequest) -> Callable[[Path, rp.Scene], Any]:
    return WRITERS[request.param]


def test_a_fifo_is_not_replaced(write: Callable[[Path, rp.Scene], Any], rr1_table: rp.Scene, tmp_path: Path) -> None:
    file = tmp_path / "pipe"
    os.mkfifo(file)
    with pytest.raises(rp.InputError, match=r"cannot write .*pipe: it is a FIFO"):
        write(file, rr1_table)
    assert stat.S_ISFIFO(file.stat().st_mode)
    assert list(tmp_path.iterdir()) == [file]


def test_a_device_is_not_replaced(write: Callable[[Path, rp.Scene], Any], rr1_table: rp.Scene, tmp_path: Path) -> None:
    file = tmp_path / "null"
    # A link to the device and not the device itself: if this fails, only the link is lost.
    file.symlink_to(os.devnull)
    with pytest.raises(rp.InputError, match=r"cannot write .*null: it is a device"):
        write(file, rr1_table)
    assert file.is_symlink()


def test_a_folder_is_refused(write: Callable[[Path, rp.Scene], Any], rr1_table: rp.Scene, tmp_path: Path) -> None:
    with pytest.raises(rp.InputError, match="it is a folder"):
        write(tmp_path, rr1_table)


def test_a_link_stays_and_its_file_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "far").mkdir()
    file, link = tmp_path / "far" / "file", tmp_path / "link"
    link.symlink_to(file)
    for text in ("old", "new"):
        assert write_text(link, text) == link
        assert link.is_symlink()
        assert file.read_text() == text
    assert list(file.parent.iterdir()) == [file]


def test_text_that_cannot_be_encoded_leaves_the_old_file(tmp_path: Path) -> None:
    file = tmp_path / "file"
    write_text(file, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(file, "half a page \ud800")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_the_longest_name_that_a_file_can_have_is_written(tmp_path: Path) -> None:
    assert write_text(tmp_path / ("x" * 255), "text").read_text() == "text"
