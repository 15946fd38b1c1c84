"""Samples of a trajectory as CSV."""

from __future__ import annotations

import csv
import io
import math
import pathlib
from collections.abc import Iterator

import numpy as np

from rr1plan.checks import counted, number_in, shown
from rr1plan.errors import FormatError, InputError
from rr1plan.export.trajectory_samples import sample_within_limits
from rr1plan.files.file_access import check_writable, read_text, write_text
from rr1plan.trajectory import Trajectory

_File = str | pathlib.Path
_TIMES = ("t", "time")
_HEADER = "t,q:<joint>...,v:<joint>...,a:<joint>..."


def save_csv(file: _File, trajectory: Trajectory, *, dt: float = 0.01) -> pathlib.Path:
    """Write samples of a trajectory as CSV, from which `load_csv` restores a motion within the same limits.

    The header is `t,q:<joint>...,v:<joint>...,a:<joint>...`; the `a` columns are omitted if accelerations jump, and the
    `v` columns if velocities jump. SI units and radians.

    Args:
        file: The file, whose name ends in .csv.
        trajectory: A trajectory that ends at rest.
        dt: Longest time between rows [s]; there is one at each break, too.

    Raises:
        InputError: the trajectory jumps or does not end at rest, more than a million rows, a joint whose name ends with
            a space or has a carriage return, another suffix, or the file cannot be written.
    """
    return write_text(check_writable(file, ".csv"), csv_text(trajectory, dt))


def csv_text(trajectory: Trajectory, dt: float = 0.01) -> str:
    """Samples of a trajectory as CSV, from which `load_csv` restores a motion within the same limits.

    The header is `t,q:<joint>...,v:<joint>...,a:<joint>...`; the `a` columns are omitted if accelerations jump, and the
    `v` columns if velocities jump, because interpolation between rows would exceed them. SI units and radians; the
    velocities of the last row are exactly zero.

    Args:
        trajectory: A trajectory that ends at rest.
        dt: Longest time between rows [s]; there is one at each break, too.

    Raises:
        InputError: the trajectory jumps or does not end at rest, more than a million rows, or a joint whose name ends
            with a space or has a carriage return.
    """
    times, *columns = sample_within_limits(trajectory, dt)
    for name in trajectory.joint_names:
        if name != name.rstrip() or "\r" in name:
            raise InputError(
                f"joint {name!r} ends with a space or has a carriage return, which CSV files do not keep; save as .json"
            )
    kinds = [(kind, values) for kind, values in zip("qva", columns, strict=True) if values is not None]
    header = ["t", *(f"{kind}:{name}" for kind, _ in kinds for name in trajectory.joint_names)]
    rows = np.column_stack([trajectory.start_time + times, *(values for _, values in kinds)]).tolist()
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


def load_csv(file: _File) -> Trajectory:
    """Read a trajectory from CSV samples: one column of times, and columns for each joint.

    The header names them: `t` (or `time`) [s], `q:<joint>` (or the bare name) for positions, `v:<joint>` for
    velocities, `a:<joint>` for accelerations, in any order; SI units and radians. Rows are joined by straight lines,
    cubics or quintics, depending on the columns; see `Trajectory.from_samples`. Lines before the header that begin with
    "#" are comments.

    Args:
        file: The file, UTF-8, also compressed (.csv.gz).

    Raises:
        FormatError: another header, a row of another length, not numbers, or times that do not increase.
    """
    # Spreadsheets begin UTF-8 files with a byte order mark.
    reader = csv.reader(io.StringIO(read_text(file).removeprefix("\ufeff"), newline=""), strict=True)
    try:
        header = _header(reader)
        time, names, columns = _columns(header, file, max(1, reader.line_num))
        rows = np.array([_row(row, header, file, reader.line_num) for row in reader if "".join(row).strip()])
    except csv.Error as error:
        raise FormatError(f"is not CSV: {error}", file, reader.line_num) from error
    if not len(rows):
        raise FormatError("has no rows", file)
    q = rows[:, [columns[0][name] for name in names]]
    qd, qdd = (rows[:, [where[name] for name in names]] if where else None for where in columns[1:])
    try:
        return Trajectory.from_samples(names, rows[:, time], q, qd, qdd)
    except InputError as error:
        raise FormatError(str(error), file) from error


def _header(reader: Iterator[list[str]]) -> list[str]:
    """The names of the columns, after comments; NumPy's `savetxt` writes them as a comment, too."""
    for row in reader:
        names = [column.strip() for column in row]
        if not names or not names[0].startswith("#"):
            return names
        names[0] = names[0].removeprefix("#").lstrip()
        if any(name in _TIMES for name in names):
            return names
    return []


def _columns(header: list[str], file: _File, line: int) -> tuple[int, list[str], list[dict[str, int]]]:
    """The index of the time, the names of the joints, and the index of each one's position, velocity, acceleration."""
    columns: list[dict[str, int]] = [{}, {}, {}]
    times = [i for i, column in enumerate(header) if column in _TIMES]
    if len(times) != 1:
        raise _other_header(header, file, line)
    for i, column in enumerate(header):
        if i in times:
            continue
        kind, name = (column[0], column[2:]) if column[:2] in ("q:", "v:", "a:") else ("q", column)
        where = columns["qva".index(kind)]
        if name in where:
            raise FormatError(f"has the column {column!r} twice", file, line)
        where[name] = i
    names = list(columns[0])
    if any(names) and "" in header:
        number = header.index("") + 1
        fault = (
            f"has no name for column {number}, expected one: leave out the index of a table, and commas that end lines"
        )
        raise FormatError(fault, file, line)
    if not names or "" in names:
        raise _other_header(header, file, line)
    for quantity, where in (("velocities", columns[1]), ("accelerations", columns[2])):
        if where and set(where) != set(names):
            odd = sorted(set(where) ^ set(names))
            raise FormatError(
                f"has positions or {quantity} alone for {', '.join(odd)}, expected both for each joint", file, line
            )
    return times[0], names, columns


def _other_header(header: list[str], file: _File, line: int) -> FormatError:
    fault = f"has another header, {shown(','.join(header))}" if any(header) else "has no header"
    return FormatError(f"{fault}, expected {_HEADER}, separated by commas", file, line)


def _row(cells: list[str], header: list[str], file: _File, number: int) -> list[float]:
    try:
        row = [number_in(cell) for cell in cells]
    except ValueError as error:
        raise FormatError(str(error), file, number) from error
    if len(row) != len(header):
        raise FormatError(f"has {counted(len(row), 'value')}, expected {len(header)}", file, number)
    for name, value in zip(header, row, strict=True):
        if not math.isfinite(value):
            raise FormatError(f"{name} is {value}, expected a finite number", file, number)
    return row
