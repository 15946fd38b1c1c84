"""A motion at its limits is within them after every export, although readers interpolate between samples."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.export.plan_files import save_trajectory
from rr1plan.export.trajectory_samples import sample_within_limits


@pytest.fixture(scope="module")
def scene() -> rp.Scene:
    """An RR1 with nothing around it, for which only limits count."""
    robot = rp.load_robot("rr1")
    return rp.Scene(name="alone").with_arm("rr1", robot)


def corners(scene: rp.Scene, seed: int) -> rp.Path:
    """A path with corners, between position limits of the wrist and the hand."""
    rng, limits = np.random.default_rng(seed), scene.limits()
    points = scene.configuration() + rng.uniform(-0.2, 0.2, (7, 6))
    points[:, 4:] = np.where(rng.random((7, 2)) < 0.5, limits.lower[4:], limits.upper[4:])
    points[:, 4] = np.clip(points[:, 4], 0.0, 1.0)
    return rp.Path(scene.joint_names(), points)


@pytest.fixture(scope="module", params=["blend", "stop", "ruckig"])
def motion(request: pytest.FixtureRequest, scene: rp.Scene) -> rp.Trajectory:
    class Anything:
        """Certifies all blends: limits are what matters here."""

        def polynomial_is_free(self, coefficients: np.ndarray, duration: float) -> bool:
            return True

    trajectory = rp.retime(corners(scene, 3), scene, method=request.param, checker=Anything())
    peaks = limit_report(scene, trajectory).margins
    assert peaks["acceleration"].value > 0.999
    assert peaks["position"].value > 0.999
    return trajectory


def limit_report(scene: rp.Scene, trajectory: rp.Trajectory) -> rp.Report:
    """The referee's report without collisions."""
    report = rp.validate(trajectory, scene, clearance=False)
    wrong = [v for v in report.violations if v.kind != "collision"]
    assert wrong == [], wrong
    return report


def by_bag(storage: str) -> Callable[[Path, rp.Trajectory], rp.Trajectory]:
    def there_and_back(folder: Path, trajectory: rp.Trajectory) -> rp.Trajectory:
        pytest.importorskip("rosbags")
        return rp.load_joint_trajectory(rp.save_rosbag(folder / "bag", trajectory, storage=storage))

    return there_and_back


EXPORTS: dict[str, Callable[[Path, rp.Trajectory], rp.Trajectory]] = {
    "csv": lambda folder, t: rp.load_csv(rp.save_csv(folder / "t.csv", t)),
    "coarse csv": lambda folder, t: rp.load_csv(rp.save_csv(folder / "t.csv", t, dt=0.1)),
    "fine csv": lambda folder, t: rp.load_csv(rp.save_csv(folder / "t.csv", t, dt=0.001)),
    "yaml": lambda folder, t: rp.load_joint_trajectory(rp.save_joint_trajectory(folder / "t.yaml", t)),
    "late yaml": lambda folder, t: rp.load_joint_trajectory(rp.save_joint_trajectory(folder / "t.yml", t, lead=0.3)),
    "mcap": by_bag("mcap"),
    "sqlite3": by_bag("sqlite3"),
}


@pytest.mark.parametrize("export", EXPORTS)
def test_a_motion_at_its_limits_is_within_them_when_it_is_read(
    export: str, motion: rp.Trajectory, scene: rp.Scene, tmp_path: Path
) -> None:
    read = EXPORTS[export](tmp_path, motion)
    read = rp.Trajectory(scene.joint_names(), read.breaks, read.coefficients)
    limit_report(scene, read)
    # It is the same motion, hardly slower.
    assert motion.duration - 1e-9 <= read.duration <= 1.03 * motion.duration
    shares = np.linspace(0.0, 1.0, 400)
    there = motion(motion.start_time + shares * motion.duration)
    back = read(read.start_time + shares * read.duration)
    np.testing.assert_allclose(back, there, rtol=0.0, atol=2e-4)


def test_a_message_of_a_motion_that_begins_late_is_within_the_limits(
    motion: rp.Trajectory, scene: rp.Scene, tmp_path: Path
) -> None:
    late = motion.shifted(1e6)
    file = rp.save_joint_trajectory(tmp_path / "late.yaml", late, rename={name: name for name in late.joint_names})
    limit_report(scene, rp.load_joint_trajectory(file))


@pytest.mark.parametrize("export", ["csv", "yaml"])
def test_times_since_1970_hardly_change_a_written_motion(
    export: str, motion: rp.Trajectory, scene: rp.Scene, tmp_path: Path
) -> None:
    """Their rounding, a quarter of a microsecond, is no jump of positions, and velocities are kept."""
    late = motion.shifted(1.7e9)
    read = EXPORTS[export](tmp_path, late)
    expected = EXPORTS[export](tmp_path, motion)
    assert read.degree == expected.degree
    assert read.duration == pytest.approx(expected.duration, rel=2e-3)
    assert read.start_time == (1.7e9 if export == "csv" else 0.0)
    read = rp.Trajectory(scene.joint_names(), read.breaks, read.coefficients)
    limit_report(scene, read.shifted(-read.start_time))


def test_a_motion_file_is_the_motion_itself(motion: rp.Trajectory, scene: rp.Scene, tmp_path: Path) -> None:
    read = rp.load_motion(save_trajectory(tmp_path / "t.json", motion, scene)).trajectory
    np.testing.assert_array_equal(read.breaks, motion.breaks)
    np.testing.assert_array_equal(read.coefficients, motion.coefficients)


def test_accelerations_are_written_where_they_do_not_jump(scene: rp.Scene) -> None:
    path = corners(scene, 5)
    smooth = sample_within_limits(rp.retime(path, scene, method="ruckig"), 0.02)
    assert smooth.accelerations is not None
    jumping = sample_within_limits(rp.retime(path, scene, method="stop"), 0.02)
    assert jumping.accelerations is None
    # Parabolas are cubics, so that nothing takes longer.
    trajectory = rp.retime(path, scene, method="stop")
    assert jumping.times[-1] == trajectory.end_time
    assert set(trajectory.breaks) <= set(jumping.times)
    assert np.diff(jumping.times).max() <= 0.022
    assert np.diff(jumping.times).min() >= 0.0019


@pytest.mark.parametrize("kind", ["csv", "yaml", "bag"])
def test_positions_joined_by_straight_lines_stay_straight(kind: str, tmp_path: Path) -> None:
    """Velocities jump, so that cubics or quintics between samples would overshoot them."""
    motion = rp.Trajectory.from_samples(["x", "y"], [0, 0.5, 1, 2], [[0, 0], [1, 0.5], [0, 1], [0, 1]])
    if kind == "csv":
        read = rp.load_csv(rp.save_csv(tmp_path / "m.csv", motion))
    else:
        names = {name: name for name in motion.joint_names}
        if kind == "bag":
            pytest.importorskip("rosbags")
        save = rp.save_rosbag if kind == "bag" else rp.save_joint_trajectory
        file = save(tmp_path / ("bag" if kind == "bag" else "m.yaml"), motion, rename=names)
        read = rp.load_joint_trajectory(file)
        assert rp.check_joint_trajectory(file) == ()
    times = np.linspace(0.0, 2.0, 1001)
    np.testing.assert_allclose(read(times), motion(times), atol=1e-9)
    assert np.abs(read(times, 1)).max() <= 2.0 + 1e-6


def test_samples_of_samples_are_the_same(scene: rp.Scene, tmp_path: Path) -> None:
    """A quintic of samples has a sample at each of its breaks, and no others where its own are near enough."""
    smooth = rp.retime(corners(scene, 5), scene, method="ruckig")
    first = rp.load_csv(rp.save_csv(tmp_path / "a.csv", smooth))
    again = rp.load_csv(rp.save_csv(tmp_path / "b.csv", first, dt=1.0))
    assert again.allclose(first, atol=1e-6)


@pytest.mark.parametrize("save", [rp.save_csv, rp.save_joint_trajectory])
def test_millions_of_samples_of_a_pause_are_refused(save: Callable[..., Path], tmp_path: Path) -> None:
    day = rp.Trajectory.rest(["arm/x"], [0.1], duration=86400.0)
    file = tmp_path / ("day.csv" if save is rp.save_csv else "day.yaml")
    with pytest.raises(rp.InputError, match=r"dt of 0\.01 s makes 8640001 samples of 86400 s.*take a longer dt"):
        save(file, day)
    with pytest.raises(rp.InputError, match=r"dt of 1e-06 s makes 8\.64e\+10 samples .*at most 1000000; take a longer"):
        save(file, day, dt=1e-6)
    assert not file.exists()
    load = rp.load_csv if save is rp.save_csv else rp.load_joint_trajectory
    assert load(save(file, day, dt=100.0)).duration == 86400.0


def test_times_are_multiples_of_a_tick(scene: rp.Scene) -> None:
    trajectory = rp.retime(corners(scene, 3), scene)
    samples = sample_within_limits(trajectory, 0.01, tick=1e-3)
    ticks = samples.times / 1e-3
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
