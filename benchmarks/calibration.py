"""Calibration of RR1 from measured tool positions: errors of zeros and scales, and detection of a moved zero.

    python benchmarks/calibration.py [--count 100] [--poses 20] [--noise 0.001] [--pointer 0.1]

Each run draws signs, zeros (30 degrees) and scales (20 % around the start), and measures a pointer across the tool with
normal noise, twice: before and after the zero of one joint has moved. Poses are proposed ones, random ones, and
proposed ones of which two measurements are wrong by up to 10 cm in each coordinate. The error of a scale is that of the
angle at the end of the joint's range.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from shared import heading, make_parser, number, save, table, track

import rr1plan as rp

_STEPS_PER_RADIAN = 2000.0
_POSE_SETS = 5
_WRONG = 0.1  # [m]
_CASES = ("proposed poses", "random poses", "proposed poses, 2 outliers")


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "calibration")
    parser.add_argument("--count", type=int, default=100, help="calibrations of each kind")
    parser.add_argument("--poses", type=int, default=20, help="measurements of a calibration")
    parser.add_argument("--noise", type=float, default=1e-3, help="standard deviation of a coordinate [m]")
    parser.add_argument(
        "--pointer", type=float, default=0.1, help="distance of the point from the axis of the tool [m]"
    )
    parser.add_argument("--shift", type=float, default=2.0, help="how far one zero moves [degrees]")
    args = parser.parse_args(argv)
    bench = _Bench(args.poses, args.noise, args.pointer, math.radians(args.shift))
    results = [
        {"case": case, "seed": args.seed + i} | bench.measure(case, args.seed + i)
        for case in _CASES
        for i in track(range(args.count), f"calibrations, {case}")
    ]
    facts = {"poses": args.poses, "noise": f"{1e3 * args.noise:g} mm", "pointer": f"{1e3 * args.pointer:g} mm"}
    text = "\n\n".join([heading("Calibration of RR1", facts), _table(results)])
    save(args.out, "calibration", {"results": results}, text)
    return 0


class _Bench:
    """An RR1 with a pointer, whose calibration is drawn anew for each run."""

    def __init__(self, poses: int, noise: float, pointer: float, shift: float) -> None:
        self.poses, self.noise, self.shift = poses, noise, shift
        self.point = np.array([pointer, 0.0, 0.0])
        self.robot = rp.load_robot("rr1")
        self.scene = rp.Scene().with_arm("arm", self.robot).with_obstacle("floor", rp.HalfSpace((0, 0, 1), -0.02))
        self.kinematics = rp.Kinematics(self.robot)
        self.start = rp.Calibration.assumed(self.robot, _STEPS_PER_RADIAN, unit="steps")
        self._proposed: dict[int, rp.Array] = {}

    def measure(self, case: str, seed: int) -> dict[str, Any]:
        rng = np.random.default_rng(seed)
        joints, limits = self.robot.nq, self.robot.limits
        signs, zeros = rng.choice([-1.0, 1.0], joints), np.radians(rng.uniform(-30.0, 30.0, joints))
        scales = _STEPS_PER_RADIAN * rng.uniform(0.8, 1.2, joints)
        moved = int(rng.integers(joints))
        later = zeros + np.where(np.arange(joints) == moved, self.shift * rng.choice([-1.0, 1.0]), 0.0)
        wrong = 2 if "outliers" in case else 0
        began = time.process_time()
        before, after = (self._calibrated(case, z, signs * scales, wrong, rng) for z in (zeros, later))
        seconds = 0.5 * (time.process_time() - began)
        found = list(before.joints.values())
        range_ends = np.maximum(np.abs(limits.lower), np.abs(limits.upper))
        shift = after.zero_shifts(before)[0]
        zero_errors = np.array([joint.zero for joint in found]) - zeros
        return {
            "signs": [joint.sign for joint in found] == signs.tolist(),
            "zeros": np.degrees(zero_errors).tolist(),
            "scales": np.degrees((np.array([j.scale for j in found]) / scales - 1.0) * range_ends).tolist(),
            "in two deviations": float(np.mean(np.abs(zero_errors) < 2.0 * np.array([j.zero_std for j in found]))),
            "outliers": len(before.fit.outliers),
            "named": shift.joint == self.robot.joint_names[moved],
            "significance": shift.significance,
            "seconds": seconds,
        }

    def _calibrated(
        self, case: str, zeros: rp.Array, slopes: rp.Array, wrong: int, rng: np.random.Generator
    ) -> rp.Calibration:
        """The calibration from positions measured with noise, some of them outliers."""
        q = self._random_poses(rng) if case == "random poses" else self._proposed_poses(int(rng.integers(_POSE_SETS)))
        T = self.kinematics.poses_batch(q)
        positions = T[:, :3, :3] @ self.point + T[:, :3, 3] + self.noise * rng.standard_normal((len(q), 3))
        positions[rng.choice(len(q), wrong, replace=False)] += rng.uniform(-_WRONG, _WRONG, (wrong, 3))
        readings = np.round((q - zeros) * slopes)
        return rp.calibrate(self.robot, readings, positions, start=self.start, point=self.point, noise=self.noise)

    def _proposed_poses(self, seed: int) -> rp.Array:
        if seed not in self._proposed:
            self._proposed[seed] = rp.propose_calibration_poses(self.scene, self.poses, point=self.point, rng=seed)
        return self._proposed[seed]

    def _random_poses(self, rng: np.random.Generator) -> rp.Array:
        return rng.uniform(self.robot.limits.lower, self.robot.limits.upper, (self.poses, self.robot.nq))


def _table(results: Sequence[Mapping[str, Any]]) -> str:
    header = ["measured at", "signs", "zeros, rms (95 %, worst joint) [deg]", "scales, rms (95 %, worst joint) [deg]"]
    header += ["zeros in 2 std", "moved joint named", "significance, least", "time [s]"]
    rows = []
    for case in dict.fromkeys(r["case"] for r in results):
        mine = [r for r in results if r["case"] == case]
        signs, named = (sum(r[name] for r in mine) for name in ("signs", "named"))
        inside, time_each = (float(np.mean([r[name] for r in mine])) for name in ("in two deviations", "seconds"))
        rows.append(
            [
                case,
                f"{signs} of {len(mine)}",
                *(_errors(np.array([r[name] for r in mine])) for name in ("zeros", "scales")),
                f"{100.0 * inside:.0f} %",
                f"{named} of {len(mine)}",
                number(min(r["significance"] for r in mine)),
                number(time_each),
            ]
        )
    return table(header, rows)


def _errors(degrees: rp.Array) -> str:
    """Root mean square over all, and of the joint with the largest error the 95th percentile."""
    worst = np.quantile(np.abs(degrees), 0.95, axis=0).max()
    return f"{math.sqrt(float((degrees**2).mean())):.3f} ({worst:.3f})"


if __name__ == "__main__":
    sys.exit(main())
