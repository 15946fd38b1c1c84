"""Trajectories as CSV: written files read back as the same motion; messages name every fault."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest

from rr1plan.errors import FormatError, InputError
from rr1plan.export.csv_files import load_csv, save_csv
from rr1plan.trajectory import Trajectory


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    q0, move = np.array([0.2, -0.9]), np.array([1.0 / 3.0, 0.7])
    names = ("arm/joint1", "arm/joint2")
    return Trajectory(names, [0.0, 2.0], np.array([q0, 0 * q0, 3 * move / 4, -2 * move / 8])[None])


def test_csv_has_its_header_and_ends_with_zero_velocities(tmp_path: FilePath, trajectory: Trajectory) -> None:
    lines = save_csv(tmp_path / "t.csv", trajectory, dt=0.3).read_text().splitlines()
    assert lines[0] == "t,q:arm/joint1,q:arm/joint2,v:arm/joint1,v:arm/joint2,a:arm/joint1,a:arm/joint2"
    rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
    assert rows[-1, 0] == trajectory.end_time
    assert (rows[-1, 3:5] == 0.0).all()
    assert (np.diff(rows[:, 0]) > 0).all()


def test_csv_reads_back_the_same_motion(tmp_path: FilePath, trajectory: Trajectory) -> None:
    read = load_csv(save_csv(tmp_path / "t.csv", trajectory, dt=0.13))
    times = np.linspace(0.0, 2.0, 101)
    for derivative in range(3):
        assert np.allclose(read(times, derivative), trajectory(times, derivative), rtol=0.0, atol=1e-10)


def test_csv_of_standing_still_has_one_row(tmp_path: FilePath) -> None:
    still = Trajectory.rest(("arm/joint1",), [0.5])
    assert load_csv(save_csv(tmp_path / "t.csv", still)).allclose(still, atol=0.0)


@pytest.mark.parametrize("name", ["left, front/joint", 'a "b"/j', "a;b/j,1", "q:a/b", "左 腕/关节"])
def test_names_of_any_letters_come_back(tmp_path: FilePath, name: str) -> None:
    still = Trajectory.rest((name, "other/joint"), [0.5, 0.25])
    assert load_csv(save_csv(tmp_path / "t.csv", still)).allclose(still, atol=0.0)


@pytest.mark.parametrize(
    ("names", "fault"),
    [
        (("a/b ",), "joint 'a/b ' ends with a space"),
        (("a/b\rc",), r"joint 'a/b\\rc' ends with a space or has a carriage return"),
        ((), "the trajectory has no joints"),
    ],
)
def test_a_motion_that_csv_does_not_keep_is_not_written(tmp_path: FilePath, names: tuple[str, ...], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        save_csv(tmp_path / "t.csv", Trajectory.rest(names, [0.5] * len(names)))
    assert not (tmp_path / "t.csv").exists()


def test_a_file_that_a_spreadsheet_wrote_is_read(tmp_path: FilePath) -> None:
    (tmp_path / "t.csv").write_bytes(b'\xef\xbb\xbft,"q:a/b"\r\n0,"1.5"\r\n,\r\n1,2.5\r\n\r\n')
    read = load_csv(tmp_path / "t.csv")
    assert read.joint_names == ("a/b",)
    assert read([0.0, 1.0]).tolist() == [[1.5], [2.5]]


def test_a_motion_that_does_not_end_at_rest_is_not_written_as_csv(tmp_path: FilePath) -> None:
    moving = Trajectory(("arm/joint1",), [0.0, 1.0], np.array([[[0.0], [1.0]]]))
    with pytest.raises(InputError, match="'arm/joint1' has the speed 1"):
        save_csv(tmp_path / "t.csv", moving)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: has no header, expected t,q:"),
        ("\nt,q:a\n0,0\n", ":1: has no header"),
        ("q:a,v:a\n0,0\n", "another header"),
        ("t,time,q:a\n0,0,0\n", "another header"),
        ("t,\n0,0\n", "another header"),
        ("t;q:a\n0;0\n", "another header, 't;q:a', .*separated by commas"),
        ("0,0,0\n1,1,1\n", "another header, '0,0,0'"),
        ("t,q:a,v:b,a:a\n", "positions or velocities alone for a, b, expected both"),
        ("t,q:a,q:b,v:a,v:b,a:a\n", "positions or accelerations alone for b, expected both"),
        ("t,q:a,a:a\n0,0,0\n", "accelerations without velocities"),
        ("t,q:a,v:a,a:a\n", "has no rows"),
        ('t,q:a\n0,"1\n', ":2: is not CSV"),
        ("t,q:a,v:a,a:a\n0,0,0\n", ":2: has 3 values, expected 4"),
        (",t,q:a\n0,0,0\n", ":1: has no name for column 1, expected one: leave out the index of a table"),
        ("t,q:a,\n0,0,\n", ":1: has no name for column 3, expected one"),
        ("t,q:a,v:a,a:a\n0,0,0,x\n", ":2: 'x' is not a number"),
        ("t,q:a\n0,0\n1_0,1\n", ":3: '1_0' is not a number"),
        ("t,q:a,v:a,a:a\n0,0,0,0\n1,nan,0,0\n", ":3: q:a is nan, expected a finite number"),
        ("t,q:a,v:a,a:a\n1,0,0,0\n1,0,0,0\n", "strictly increase"),
        ("t,q:a,q:a,v:a,v:a,a:a,a:a\n0,0,0,0,0,0,0\n", "'q:a' twice"),
    ],
)
def test_wrong_csv_is_refused(tmp_path: FilePath, text: str, message: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(FormatError, match=message):
        load_csv(tmp_path / "t.csv")


@pytest.mark.parametrize(
    ("header", "degree"),
    [("t,q:a,q:b", 1), ("time,a,b", 1), ("t,v:b,q:a,v:a,q:b", 3), ("a:b,a:a,t,q:a,q:b,v:a,v:b", 5)],
)
def test_columns_decide_what_lies_between_rows_in_any_order(tmp_path: FilePath, header: str, degree: int) -> None:
    columns = header.split(",")
    values = {"t": 1.0, "time": 1.0, "q:a": 2.0, "a": 2.0, "q:b": 3.0, "b": 3.0}
    rows = [[0.0] * len(columns), [values.get(name, 0.0) for name in columns]]
    (tmp_path / "t.csv").write_text("\n".join([header, *(",".join(map(str, row)) for row in rows), ""]))
    read = load_csv(tmp_path / "t.csv")
    assert read.degree == degree
    assert read.joint_names == ("a", "b")
    np.testing.assert_allclose(read(1.0), [2.0, 3.0], atol=1e-15)
    np.testing.assert_allclose(read(0.5), [1.0, 1.5], atol=1e-15)


def test_samples_written_by_numpy_are_read(tmp_path: FilePath) -> None:
    rows = [[0.0, 1.0, 2.0], [0.5, 1.5, 2.5]]
    np.savetxt(tmp_path / "t.csv", rows, delimiter=",", header="t,q:a,q:b")
    read = load_csv(tmp_path / "t.csv")
    assert read.joint_names == ("a", "b")
    np.testing.assert_allclose(read(0.5), [1.5, 2.5])


@pytest.mark.parametrize("header", ["t,q:a,q:b", "# t,q:a,q:b", "#t,q:a,q:b"])
def test_comments_before_the_header_are_skipped(tmp_path: FilePath, header: str) -> None:
    (tmp_path / "t.csv").write_text(f"# recorded on Monday, arm 2\n# [s], [rad]\n{header}\n0,1,2\n0.5,1.5,2.5\n")
    np.testing.assert_allclose(load_csv(tmp_path / "t.csv")(0.5), [1.5, 2.5])
    (tmp_path / "t.csv").write_text("# recorded on Monday\nx,y\n0,0\n")
    with pytest.raises(FormatError, match=r":2: has another header, 'x,y'"):
        load_csv(tmp_path / "t.csv")


def test_positions_that_jump_are_not_written_as_csv(tmp_path: FilePath) -> None:
    jump = Trajectory(("arm/a",), [0.0, 1.0, 2.0], [[[0.0]], [[0.5]]])
    with pytest.raises(InputError, match=r"jump of 'arm/a' by 0.5 at 1 s"):
        save_csv(tmp_path / "t.csv", jump)
    assert not (tmp_path / "t.csv").exists()
