"""Videos of motions: each picture shows its moment, whatever the speed of the machine."""

from __future__ import annotations

import asyncio
import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
import pytest
from browser.conftest import NO_DRAWING
from PIL import Image, ImageSequence

import rr1plan as rp
from rr1plan import save_html, save_video, screenshot
from rr1plan.playback.viewer import page_capture, page_video
from rr1plan.playback.viewer.video_files import video_bytes

pytestmark = pytest.mark.browser

SIZE = (240, 160)
MOMENTS = (0, 3, 8)  # pictures of the video that are looked at


@pytest.fixture(scope="module")
def scene(planar2r: rp.Robot) -> rp.Scene:
    return rp.Scene(name="flat").with_arm("arm", planar2r)


@pytest.fixture(scope="module")
def page(scene: rp.Scene, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """An arm that turns by half a turn in 0.4 s, looked at from above."""
    motion = rp.Trajectory(scene.joint_names(), np.array([1.0, 1.4]), np.array([[[0.0, 0.0], [np.pi / 0.4, 0.0]]]))
    options = rp.ViewOptions(view="top")
    return save_html(tmp_path_factory.mktemp("page") / "page.html", scene, trajectory=motion, options=options)


@pytest.fixture(scope="module")
def stills(page: FilePath, needs_browser: None) -> list[np.ndarray]:
    """Pictures of some moments, framed as a video frames them."""
    taken = []
    with page_capture.opened_page(page, SIZE, bare=True) as tab:
        for i in MOMENTS:
            page_capture.settle_page(tab, 1.0 + 0.05 * i)
            picture = Image.open(io.BytesIO(tab.screenshot(type="png")))
            taken.append(np.asarray(picture.convert("RGB"), dtype=int))
    return taken


class Film(NamedTuple):
    """A GIF of the motion, the pictures that were taken for it, and the progress that was reported."""

    file: FilePath
    pictures: list[np.ndarray]
    progress: list[float]


@pytest.fixture(scope="module")
def film(page: FilePath, needs_browser: None, tmp_path_factory: pytest.TempPathFactory) -> Film:
    taken: list[np.ndarray] = []
    seen: list[float] = []

    def encode(suffix: str, pictures: Any, fps: float) -> bytes:
        taken.extend(pictures[i] for i in range(len(pictures)))
        return video_bytes(suffix, taken, fps)

    file = tmp_path_factory.mktemp("film") / "motion.gif"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page_video, "video_bytes", encode)
        assert save_film(file, page, progress=lambda p: seen.append(p.fraction)) == file
    return Film(file, taken, seen)


def save_film(file: FilePath, page: FilePath, **options: Any) -> FilePath:
    return save_video(file, page, size=SIZE, fps=10, speed=0.5, bare=True, **options)


@pytest.fixture
def undrawn(needs_browser: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Browsers whose pages draw nothing, which takes most of their time, for tests that look at no pixels."""
    usual = page_capture.open_browser

    @contextmanager
    def quick(*size: tuple[int, int]) -> Iterator[Any]:
        with usual(*size) as context:
            context.add_init_script(NO_DRAWING)
            yield context

    monkeypatch.setattr(page_capture, "open_browser", quick)


def pictures(file: FilePath) -> tuple[list[np.ndarray], list[float]]:
    """The pictures of a video, and how long each is shown [s]."""
    if file.suffix == ".mp4":
        av = pytest.importorskip("av", reason="the extra `video` is not installed")
        with av.open(str(file)) as container:
            stream = container.streams.video[0]
            rate = float(stream.average_rate)
            frames = [frame.to_ndarray(format="rgb24").astype(int) for frame in container.decode(stream)]
        return frames, [1 / rate] * len(frames)
    with Image.open(file) as image:
        frames, lengths = [], []
        for frame in ImageSequence.Iterator(image):
            frames.append(np.asarray(frame.convert("RGB"), dtype=int))
            lengths.append(frame.info["duration"] / 1000)
    return frames, lengths


@pytest.mark.parametrize("suffix", [".mp4", ".gif", ".webp"])
def test_every_picture_is_of_its_own_moment(
    suffix: str, film: Film, stills: list[np.ndarray], tmp_path: FilePath
) -> None:
    file = film.file
    if suffix != file.suffix:
        if suffix == ".mp4":
            pytest.importorskip("av", reason="the extra `video` is not installed")
        file = tmp_path / f"motion{suffix}"
        file.write_bytes(video_bytes(suffix, film.pictures, 10.0))
    frames, lengths = pictures(file)
    # 0.4 s at half speed, ten pictures a second, and the last moment.
    assert len(frames) == 9
    np.testing.assert_allclose(lengths[:8], 0.1, atol=1e-9)
    assert film.progress[-9:] == pytest.approx([(i + 1) / 9 for i in range(9)])
    apart = np.array([[np.abs(frames[i] - still).mean() for still in stills] for i in MOMENTS])
    assert frames[0].shape == (*SIZE[::-1], 3)
    assert apart.argmin(axis=1).tolist() == [0, 1, 2]
    # What the encoder loses is little beside what moves.
    assert np.diag(apart).max() < 0.6 * (apart + 9 * np.eye(3)).min()


def test_the_same_motion_gives_the_same_video(film: Film, page: FilePath, tmp_path: FilePath) -> None:
    (first, times), (second, other_times) = pictures(film.file), pictures(save_film(tmp_path / "again.gif", page))
    assert times == other_times
    # Edges may be drawn a little otherwise when the processor is busy.
    assert np.abs(np.asarray(first, dtype=float) - np.asarray(second, dtype=float)).mean() < 1.0


@pytest.mark.usefixtures("needs_browser")
def test_values_are_filmed_and_photographed_without_a_page_file(scene: rp.Scene, tmp_path: FilePath) -> None:
    pytest.importorskip("av", reason="the extra `video` is not installed")
    motion = rp.plan_motion(rp.Problem(scene, [0.0, 0.0], [0.4, 0.2]), rng=0)
    frames, _ = pictures(save_video(tmp_path / "motion.mp4", motion, size=SIZE, fps=4))
    assert len(frames) >= 2
    assert size_of(screenshot(tmp_path / "robot.png", scene.arms["arm"].robot, size=SIZE)) == SIZE


@pytest.mark.usefixtures("needs_browser")
def test_a_configuration_space_is_filmed_along_its_path(tmp_path: FilePath) -> None:
    """The arm beside the square, in which the dot walks the path."""
    problem = next(iter(rp.load_problems("planar2r_path").values()))
    picture = rp.cspace(problem.scene, problem, result=rp.RrtConnect().plan(problem, rng=0), resolution=40)
    frames, _ = pictures(save_video(tmp_path / "cspace.gif", picture, size=(800, 480), fps=1))
    assert len(frames) >= 4
    changed = (np.abs(np.diff(np.array(frames[:3], dtype=int), axis=0)).max(axis=3) > 60).mean(axis=0)
    assert changed[:, :430].mean() > 1e-3
    assert changed[:, 430:].mean() > 1e-3


@pytest.mark.usefixtures("needs_browser")
def test_a_step_of_a_lesson_is_filmed(tmp_path: FilePath) -> None:
    """Without a motion: the step runs through the intervals of an edge."""
    lesson = rp.lesson("continuous_checking")
    frames, _ = pictures(save_video(tmp_path / "step.webp", lesson, size=(480, 320), fps=1, step=4))
    assert len(frames) >= 3


@pytest.mark.usefixtures("undrawn")
def test_a_step_of_a_lesson_is_photographed(tmp_path: FilePath) -> None:
    lesson = rp.lesson("continuous_checking")
    assert size_of(screenshot(tmp_path / "step.png", lesson, size=SIZE, step=2)) == SIZE
    with pytest.raises(rp.InputError, match="step is 40, but the page has 7 steps"):
        screenshot(tmp_path / "step.png", lesson, size=SIZE, step=40)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("time", "fault"), [(-0.1, "0 to 1.500 s"), (1.6, "0 to 1.500 s"), (0.5, "has no motion")])
def test_times_outside_the_motion_are_refused(scene: rp.Scene, tmp_path: FilePath, time: float, fault: str) -> None:
    motion = rp.Trajectory.from_samples(scene.joint_names(), [0.0, 1.5], [[0.0, 0.0], [0.1, 0.1]])
    page = rp.save_html(tmp_path / "page.html", scene, trajectory=None if time == 0.5 else motion)
    with pytest.raises(rp.InputError, match=f"time is {time} s, but .*{fault}"):
        screenshot(tmp_path / "page.png", page, size=SIZE, time=time)


@pytest.mark.usefixtures("undrawn")
def test_pages_that_are_no_lessons_have_no_steps(scene: rp.Scene, tmp_path: FilePath) -> None:
    with pytest.raises(rp.InputError, match="no steps, which only lessons have"):
        screenshot(tmp_path / "scene.png", scene, size=SIZE, step=2)


def size_of(file: FilePath) -> tuple[int, int]:
    with Image.open(file) as picture:
        width, height = picture.size
    return width, height


@pytest.mark.usefixtures("undrawn")
def test_pictures_are_taken_while_an_event_loop_runs(scene: rp.Scene, tmp_path: FilePath) -> None:
    """As in notebooks."""

    async def take() -> FilePath:
        return screenshot(tmp_path / "scene.png", scene, size=SIZE)

    assert size_of(asyncio.run(take())) == SIZE


@pytest.mark.usefixtures("undrawn")
def test_a_page_without_a_motion_is_not_filmed(scene: rp.Scene, tmp_path: FilePath) -> None:
    with pytest.raises(rp.InputError, match=r"no motion.*PNG"):
        save_video(tmp_path / "scene.gif", scene, size=SIZE)
    still = rp.plan_motion(rp.Problem(scene, (0.0, 0.5), (0.0, 0.5)))
    with pytest.raises(rp.InputError, match=r"of 0 s.*PNG"):
        save_video(tmp_path / "still.gif", still, size=SIZE)
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("undrawn")
def test_a_cancelled_video_leaves_nothing(page: FilePath, tmp_path: FilePath) -> None:
    (tmp_path / "old.gif").write_bytes(b"old")
    with pytest.raises(rp.CancelledError):
        save_video(tmp_path / "old.gif", page, size=SIZE, progress=lambda p: p.fraction < 0.5)
    assert [file.name for file in tmp_path.iterdir()] == ["old.gif"]
    assert (tmp_path / "old.gif").read_bytes() == b"old"


@pytest.mark.usefixtures("needs_browser")
def test_ctrl_c_ends_the_browser_too(page: FilePath, tmp_path: FilePath) -> None:
    # A folder for temporary files with a name too long for the browser's socket.
    temporary = tmp_path / ("temporary" * 9)
    temporary.mkdir()
    # More pictures than can be taken while the test waits.
    code = (
        "import sys, rr1plan as rp\n"
        f"rp.save_video({str(tmp_path / 'long.gif')!r}, {str(page)!r}, fps=50, speed=0.002, size={SIZE},"
        " progress=lambda p: print('picture', flush=True))"
    )
    environment = {**os.environ, "TMPDIR": str(temporary)}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "picture\n"
        assert _speak_of(temporary)
        program.send_signal(signal.SIGINT)
        program.communicate(timeout=60)
    assert program.returncode != 0
    end = time.monotonic() + 30
    while _speak_of(temporary) and time.monotonic() < end:
        time.sleep(0.1)
    assert not _speak_of(temporary)
    assert not (tmp_path / "long.gif").exists()


def _speak_of(folder: FilePath) -> list[str]:
    """Processes whose command lines name a folder."""
    found = []
    for file in FilePath("/proc").glob("[0-9]*/cmdline"):
        try:
            words = file.read_bytes()
        except OSError:
            continue
        if str(folder).encode() in words and b"pytest" not in words.split(b"\0")[0] and b"-c\0" not in words:
            found.append(words.decode(errors="replace"))
    return found


class _Colors:
    """Pictures of many grays with a small colored spot."""

    def __len__(self) -> int:
        return 3

    def __getitem__(self, index: int) -> np.ndarray:
        picture = np.repeat(np.linspace(90, 250, 200)[None, :, None], 100, axis=0) * [1.0, 1.01, 1.02]
        picture[10 * index : 10 * index + 8, 20:28] = (255, 200, 0)
        return np.clip(picture, 0, 255).astype(np.uint8)


def test_small_colored_things_keep_their_color_in_gifs(tmp_path: FilePath) -> None:
    (tmp_path / "spot.gif").write_bytes(video_bytes(".gif", _Colors(), 10.0))
    frames, lengths = pictures(tmp_path / "spot.gif")
    assert lengths == pytest.approx([0.1, 0.1, 0.7])
    for i, frame in enumerate(frames):
        assert np.abs(frame[10 * i + 4, 24] - [255, 200, 0]).max() < 24
        assert np.abs(frame - _Colors()[i]).mean() < 4


@pytest.mark.parametrize("fps", [30.0, 24.0, 7.0])
def test_the_length_of_a_gif_does_not_drift(fps: float, tmp_path: FilePath) -> None:
    class Many(_Colors):
        def __len__(self) -> int:
            return 11

    (tmp_path / "many.gif").write_bytes(video_bytes(".gif", Many(), fps))
    _, lengths = pictures(tmp_path / "many.gif")
    shown = np.cumsum(lengths)
    np.testing.assert_allclose(shown[:-1], np.arange(1, 11) / fps, atol=0.0051)


def test_what_makes_no_sense_is_refused(tmp_path: FilePath) -> None:
    (tmp_path / "page.html").write_text("")
    for words, name, more in (
        ("ends in .mp4 or .gif or .webp", "a.avi", {}),
        ("fps is 60, expected 0.01 to 50", "a.gif", {"fps": 60}),
        ("fps is 0.001, expected 0.01 to 50", "a.gif", {"fps": 0.001}),
        ("fps is 0.0001, expected 0.01 to 120", "a.mp4", {"fps": 1e-4}),
        ("even numbers", "a.mp4", {"size": (101, 100)}),
        ("size", "a.gif", {"size": (1, 1)}),
        ("fps", "a.gif", {"fps": 0}),
        ("speed", "a.gif", {"speed": float("nan")}),
        ("True or False", "a.gif", {"bare": "yes"}),
        ("progress", "a.gif", {"progress": 3}),
    ):
        with pytest.raises(rp.InputError, match=words):
            save_video(tmp_path / name, tmp_path / "page.html", **more)


def test_a_missing_encoder_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(rp.MissingPackageError, match=r"rr1plan\[video\]"):
        video_bytes(".mp4", _Colors(), 10.0)
