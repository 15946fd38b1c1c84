"""Arms of two joints that move in a plane: forward and inverse kinematics in closed form.

Positions in the plane are complex numbers. A turning joint multiplies `rot` by exp(i sense q), a sliding joint adds
`rot * slide * q`; after each joint its bar adds `rot * bar`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rr1plan.checks import Array
from rr1plan.scene.scene_elements import Arm

_EXACT = 1e-9
_Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class FlatArm:
    """Two joints that turn (R) or slide (P), and the tool, in a horizontal plane.

    Args:
        kinds: "RR", "RP", "PR" or "PP".
        base: Position of the first joint at zero [m].
        height: z of the tool [m].
        bars: From the first joint to the second, and from there to the tool, with both joints at zero [m].
        senses: Senses of turning joints: 1.0 for counter-clockwise, -1.0 for clockwise.
        slides: Directions of sliding joints at zero, of length 1.
    """

    kinds: str
    base: complex
    height: float
    bars: tuple[complex, complex]
    senses: tuple[float, float]
    slides: tuple[complex, complex]

    def points(self, q: ArrayLike) -> Array:
        """Positions of first joint, second joint and tool [m], shape (..., 3, 2), from joint values (..., 2)."""
        values = np.asarray(q, dtype=float)
        at, rot = np.full(values.shape[:-1], self.base), np.ones(values.shape[:-1], dtype=complex)
        found = []
        for k, kind in enumerate(self.kinds):
            if kind == "R":
                found.append(at)
                rot = rot * np.exp(1j * self.senses[k] * values[..., k])
            else:
                at = at + rot * self.slides[k] * values[..., k]
                found.append(at)
            at = at + rot * self.bars[k]
        found.append(at)
        return np.stack([np.stack([z.real, z.imag], axis=-1) for z in found], axis=-2)

    def solutions(self, points: ArrayLike) -> Array:
        """All joint values that put the tool at points of the plane, ignoring limits.

        Args:
            points: Positions [m], shape (..., 2).

        Returns:
            Shape (..., 2, 2): for each point two solutions of two joint values, angles within ±π. NaN for points out of
            reach, and for the second solution of "PP", which has only one. Both solutions are equal at points that have
            only one (at the rim of an annulus).
        """
        xy = np.asarray(points, dtype=float)
        target = xy[..., 0] + 1j * xy[..., 1] - self.base
        with np.errstate(invalid="ignore"):
            both = [np.stack(self._solve(target, side), axis=-1) for side in (1.0, -1.0)]
        if self.kinds == "PP":
            both[1] = np.full_like(both[1], np.nan)
        return np.stack(both, axis=-2)

    def _solve(self, target: _Complex, side: float) -> tuple[Array, Array]:
        (a, c), (s1, s2), (u1, u2) = self.bars, self.senses, self.slides
        match self.kinds:
            case "RR":
                cosine = (np.abs(target) ** 2 - abs(a) ** 2 - abs(c) ** 2) / (2 * abs(a) * abs(c))
                # Points on the rim count as reached.
                cosine = np.where(np.abs(np.abs(cosine) - 1.0) < _EXACT, np.sign(cosine), cosine)
                bend = side * np.arccos(cosine)
                fore = c / abs(c) * (a / abs(a)).conjugate()
                return s1 * np.angle(target / (a * (1 + abs(c) / abs(a) * np.exp(1j * bend)))), _wrap(
                    s2 * (bend - np.angle(fore))
                )
            case "RP":
                offset = (a + c) / u2
                along = side * np.sqrt(np.abs(target) ** 2 - offset.imag**2)
                return s1 * np.angle(target / (u2 * (along + 1j * offset.imag))), along - offset.real
            case "PR":
                local = (target - a) / u1
                q1 = local.real - side * np.sqrt(abs(c) ** 2 - local.imag**2)
                return q1, s2 * np.angle((local - q1) * u1 / c)
            case _:
                local = (target - a - c) / u1
                q2 = local.imag / (u2 / u1).imag
                return local.real - q2 * (u2 / u1).real, q2


def _wrap(angle: Array) -> Array:
    """An angle in [-pi, pi]."""
    return np.asarray(np.angle(np.exp(1j * angle)))


def flat_arm(arm: Arm) -> FlatArm | None:
    """The arm as two joints in a horizontal plane, or None if it is not such an arm."""
    robot = arm.robot
    if robot.nq != 2:
        return None
    joints = [robot.joint(name) for name in robot.joint_names]
    zero = {name: arm.base @ T for name, T in robot.link_poses(np.zeros(2)).items()}
    axes = [zero[joint.child][:3, :3] @ joint.axis for joint in joints]
    kinds = "".join("P" if joint.kind == "prismatic" else "R" for joint in joints)
    flat = all(abs(abs(axis[2]) - (kind == "R")) < _EXACT for kind, axis in zip(kinds, axes, strict=True))
    if not flat:
        return None
    spots = [complex(*zero[link][:2, 3]) for link in (joints[0].child, joints[1].child, robot.tool)]
    slides = [complex(axis[0], axis[1]) if kind == "P" else 1.0 + 0.0j for kind, axis in zip(kinds, axes, strict=True)]
    senses = [float(np.sign(axis[2])) if kind == "R" else 1.0 for kind, axis in zip(kinds, axes, strict=True)]
    found = FlatArm(
        kinds,
        spots[0],
        float(zero[robot.tool][2, 3]),
        (spots[1] - spots[0], spots[2] - spots[1]),
        (senses[0], senses[1]),
        (slides[0], slides[1]),
    )
    return found if _moves_like(found, arm) else None


def _moves_like(found: FlatArm, arm: Arm) -> bool:
    """Whether the formulas agree with the arm's forward kinematics, and can be inverted."""
    for q in ((0.7, -1.1), (-0.4, 0.3)):
        there = (arm.base @ arm.robot.link_poses(q)[arm.robot.tool])[:2, 3]
        if np.abs(found.points(q)[2] - there).max() > _EXACT:
            return False
    first, second = found.bars
    across = (found.slides[1] / found.slides[0]).imag
    return {
        "RR": min(abs(first), abs(second)) > _EXACT,
        "RP": True,
        "PR": abs(second) > _EXACT,
        "PP": abs(across) > _EXACT,
    }[found.kinds]
