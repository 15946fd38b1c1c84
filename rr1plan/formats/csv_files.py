"""Samples of a trajectory as CSV."""

from __future__ import annotations

import pathlib
from typing import Any

import numpy as np

from rr1plan.checks import of_kind
from rr1plan.errors import FormatError, InputError
from rr1plan.formats.files import read_text, write_text
from rr1plan.trajectory import Trajectory

_File = str | pathlib.Path


def save_csv(file: _File, trajectory: Trajectory, dt: float = 0.01) -> pathlib.Path:
    """Write samples of a trajectory as CSV and return the file's path.

    The header is `t,q:<joint>...,v:<joint>...,a:<joint>...`; SI units and radians; the velocities of the
    last row are exactly zero.

    Args:
        file: The file.
        trajectory: A trajectory that ends at rest.
        dt: Time between rows [s]; the last row is the end.

    Raises:
        InputError: the trajectory does not end at rest, or the file cannot be written.
    """
    of_kind("trajectory", trajectory, Trajectory)
    times = trajectory.sample_times(dt)
    q, v, a = (trajectory(times, derivative) for derivative in range(3))
    if np.abs(v[-1]).max(initial=0.0) > 1e-6:
        joint = trajectory.joint_names[int(np.argmax(np.abs(v[-1])))]
        raise InputError(f"the trajectory does not end at rest: {joint!r} has the speed {np.abs(v[-1]).max():.3g}")
    v[-1] = 0.0
    header = ["t", *(f"{kind}:{name}" for kind in "qva" for name in trajectory.joint_names)]
    rows = np.column_stack([times, q, v, a]).tolist()
    return write_text(file, "\n".join([",".join(header), *(",".join(map(repr, row)) for row in rows)]) + "\n")


def load_csv(file: _File) -> Trajectory:
    """Read a trajectory from CSV samples: between rows a quintic that meets position, velocity and acceleration.

    Raises:
        FormatError: another header, a row that is too short, not numbers, or times that do not increase.
    """
    lines = read_text(file).splitlines()
    header = lines[0].split(",") if lines else []
    count = (len(header) - 1) // 3
    names = tuple(column[2:] for column in header[1 : count + 1])
    if count < 1 or header != ["t", *(f"{kind}:{name}" for kind in "qva" for name in names)]:
        raise FormatError("has another header, expected t,q:<joint>...,v:<joint>...,a:<joint>...", file, 1)
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            row = [float(cell) for cell in line.split(",")]
        except ValueError as error:
            raise FormatError(str(error), file, number) from error
        if len(row) != len(header):
            raise FormatError(f"has {len(row)} values, expected {len(header)}", file, number)
        rows.append(row)
    if not rows:
        raise FormatError("has no rows", file)
    try:
        return _quintic(names, np.array(rows))
    except InputError as error:
        raise FormatError(str(error), file) from error


def _quintic(names: tuple[str, ...], rows: Any) -> Trajectory:
    times = rows[:, 0]
    q, v, a = np.split(rows[:, 1:], 3, axis=1)
    if len(rows) == 1:
        return Trajectory(names, times, q[None, :1])
    h = np.diff(times)[:, None]
    if not (h > 0.0).all():
        raise InputError("has times that do not strictly increase")
    dq = q[1:] - q[:-1] - v[:-1] * h - a[:-1] * h**2 / 2
    dv = (v[1:] - v[:-1] - a[:-1] * h) * h
    da = (a[1:] - a[:-1]) * h**2
    cubic, quartic, last = 10 * dq - 4 * dv + da / 2, -15 * dq + 7 * dv - da, 6 * dq - 3 * dv + da / 2
    powers = [q[:-1], v[:-1], a[:-1] / 2, cubic / h**3, quartic / h**4, last / h**5]
    return Trajectory(names, times, np.stack(powers, axis=1))
