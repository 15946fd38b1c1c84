"""Writing files: whole or not at all, through links, and never in the place of a device."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, run
from rr1plan.files.file_access import check_writable, write_bytes, write_text
from rr1plan.scene import model_library

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


def test_a_link_into_a_missing_folder_names_that_folder(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "gone" / "file")
    with pytest.raises(rp.InputError, match=r"cannot write .*link: there is no folder .*gone$"):
        write_text(link, "text")


def test_a_new_file_has_the_mode_of_the_umask_and_an_old_one_keeps_its_own(tmp_path: Path) -> None:
    new, old = tmp_path / "new", tmp_path / "old"
    old.write_text("old")
    old.chmod(0o600)
    before = os.umask(0o027)
    try:
        write_text(new, "text")
        write_text(old, "text")
    finally:
        os.umask(before)
    assert stat.S_IMODE(new.stat().st_mode) == 0o640
    assert stat.S_IMODE(old.stat().st_mode) == 0o600


def test_writing_never_changes_the_umask_which_all_threads_share(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def changed(_: int) -> int:
        raise AssertionError("the umask was changed")

    monkeypatch.setattr(os, "umask", changed)
    write_text(tmp_path / "file", "new")
    write_text(tmp_path / "file", "old")


SAVERS: dict[str, Callable[[Path, rp.Scene], Any]] = {
    ".json": rp.save_motion,
    ".csv": lambda file, scene: rp.save_csv(file, rp.Trajectory.rest(scene.joint_names(), scene.configuration())),
    ".toml": rp.save_scene,
    ".xml": rp.save_mjcf,
    ".html": rp.save_html,
}


@pytest.mark.parametrize("suffix", SAVERS)
def test_a_suffix_by_which_a_file_would_be_read_as_another_format_is_refused(
    suffix: str, rr1_table: rp.Scene, tmp_path: Path
) -> None:
    for name in ("a.scene", "a.txt", "a"):
        with pytest.raises(rp.InputError, match=rf"{name}', expected a name that ends in \{suffix}"):
            SAVERS[suffix](tmp_path / name, rr1_table)
    assert not list(tmp_path.iterdir())
    SAVERS[suffix](tmp_path / f"A{suffix.upper()}", rr1_table)


@pytest.mark.parametrize("suffix", [".json", ".csv", ".yaml"])
def test_motions_are_recognized_by_suffixes_in_capitals(suffix: str, rr1_table: rp.Scene, tmp_path: Path) -> None:
    trajectory, file = rp.Trajectory.rest(rr1_table.joint_names(), rr1_table.configuration()), f"A{suffix.upper()}"
    if suffix == ".json":
        rp.save_motion(tmp_path / file, rr1_table, trajectory=trajectory)
    else:
        {".csv": rp.save_csv, ".yaml": rp.save_joint_trajectory}[suffix](tmp_path / file, trajectory)
    assert rp.load_motion(tmp_path / file, rr1_table).trajectory.joint_names == trajectory.joint_names


def test_text_that_cannot_be_encoded_leaves_the_old_file(tmp_path: Path) -> None:
    file = tmp_path / "file"
    write_text(file, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(file, "half a page \ud800")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_the_longest_name_that_a_file_can_have_is_written(tmp_path: Path) -> None:
    assert write_text(tmp_path / ("x" * 255), "text").read_text() == "text"


def test_a_working_folder_that_was_deleted_is_named(
    rr1_table: rp.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    for write in WRITERS.values():
        with pytest.raises(rp.InputError, match=r"a\.toml is in a working folder that is no longer there"):
            write(Path("a.toml"), rr1_table)
    assert run(["plan", "planar2r_path", "--output", "a.json"]) == BAD_INPUT


def test_an_archive_is_no_place_to_run_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_library, "_PACKAGE", tmp_path / "rr1plan.zip" / "rr1plan")
    with pytest.raises(rp.InstallationError, match=r"folder of models .* is missing"):
        rp.load_scene("rr1_table")


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("hand.stl", rp.load_mesh),
        ("hand.dae", rp.load_mesh),
        ("scan.pcd", rp.load_point_cloud),
        ("arm.urdf", rp.load_robot),
        ("cell.toml", rp.load_scene),
        ("motion.json", rp.load_motion),
    ],
)
def test_a_pointer_of_git_lfs_is_recognized(tmp_path: Path, name: str, read: Callable[[Path], Any]) -> None:
    pointer = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'4d7a2146' * 8}\nsize 12345\n"
    (tmp_path / name).write_text(pointer)
    with pytest.raises(rp.FormatError, match=rf"{name}: is a pointer of Git LFS .*: fetch the file by 'git lfs pull'"):
        read(tmp_path / name)
