"""A sequence of pictures as one file: MP4 (H.264), GIF or WebP."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator, Sequence
from fractions import Fraction
from importlib import import_module
from itertools import pairwise
from pathlib import Path as FilePath
from types import ModuleType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rr1plan.errors import MissingPackageError

Picture = NDArray[np.uint8]  # (height, width, 3)

FASTEST = {".mp4": 120.0, ".gif": 50.0, ".webp": 60.0}  # [frames/s], by suffix; browsers slow down faster GIFs
SLOWEST = 0.01  # [frames/s]; a GIF cannot hold a picture for more than 655 s, nor MP4 give any rate
_HOLD = 0.6  # [s] for which a repeating video holds its last frame, as on the page
_PALETTE_SAMPLES = 6
_PALETTE_SIZE = 255
# Ordered dithering (Bayer 1973): unlike error diffusion, it leaves static areas unchanged between frames.
_BAYER = np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) / 16.0 - 0.5
_DITHER = 6.0  # of 255, about the distance between neighboring gray values of a palette


class Frames(Protocol):
    """The pictures of a video, each made on access, in any order."""

    def __len__(self) -> int:
        """Number of pictures."""
        ...

    def __getitem__(self, index: int) -> Picture:
        """One picture."""
        ...


def video_bytes(suffix: str, frames: Frames, fps: float) -> bytes:
    """The content of a video file.

    Args:
        suffix: Suffix of the file, a key of `FASTEST`.
        frames: The pictures, all of one size; even numbers of pixels each way for MP4.
        fps: Pictures per second.

    Raises:
        MissingPackageError: PyAV is not installed, for MP4.
    """
    return _ENCODERS[suffix](frames, fps)


def require_encoder(suffix: str) -> None:
    """Require the package that writes files with a suffix, a key of `FASTEST`.

    Raises:
        MissingPackageError: PyAV is not installed, for MP4.
    """
    if suffix == ".mp4":
        _load_pyav()


def _load_pyav() -> ModuleType:
    try:
        return import_module("av")
    except ImportError as error:
        raise MissingPackageError("av", "writing MP4", "video") from error


def _mp4(frames: Frames, fps: float) -> bytes:
    av = _load_pyav()
    height, width = frames[0].shape[:2]
    with tempfile.TemporaryDirectory(prefix="rr1plan-video-") as folder:
        file = FilePath(folder) / "video.mp4"
        # "faststart": the index comes first, so that browsers play the file while it is loading
        with av.open(str(file), "w", options={"movflags": "faststart"}) as container:
            stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.options = {"crf": "18"}
            context = stream.codec_context
            context.colorspace, context.color_range = av.video.reformatter.Colorspace.ITU709, 1
            context.color_primaries = context.color_trc = 1  # BT.709, as browsers expect it
            for picture in _in_order(frames):
                frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                container.mux(stream.encode(frame.reformat(format="yuv420p", dst_colorspace="ITU709")))
            container.mux(stream.encode())
        return file.read_bytes()


def _gif(frames: Frames, fps: float) -> bytes:
    from PIL import Image

    samples = np.linspace(0, len(frames) - 1, min(_PALETTE_SAMPLES, len(frames))).astype(int)
    colors = _colors_to_keep(np.concatenate([frames[int(i)].reshape(-1, 3) for i in samples]))
    palette = Image.fromarray(colors[None]).quantize(_PALETTE_SIZE, method=Image.Quantize.MEDIANCUT)
    height, width = frames[0].shape[:2]
    dither = _DITHER * np.tile(_BAYER, (height // 4 + 1, width // 4 + 1))[:height, :width, None]

    def flat(picture: Picture) -> Any:
        noisy = np.clip(np.rint(picture + dither), 0, 255).astype(np.uint8)
        return Image.fromarray(noisy).quantize(palette=palette, dither=Image.Dither.NONE)

    return _animation("GIF", map(flat, _in_order(frames)), _durations(len(frames), fps, 10), {"disposal": 1})


def _colors_to_keep(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colors for median cut, repeated by their frequencies, shape (n, 3).

    Weighted by area, a palette would contain only grays of the background, so colors of small objects get more weight.
    """
    bins = (pixels >> 3).astype(np.int64) @ [1024, 32, 1]
    _, owner, counts = np.unique(bins, return_inverse=True, return_counts=True)
    means = np.stack([np.bincount(owner, weights=pixels[:, k]) for k in range(3)], axis=1) / counts[:, None]
    return np.repeat(np.rint(means).astype(np.uint8), np.ceil(counts**0.25).astype(int), axis=0)


def _webp(frames: Frames, fps: float) -> bytes:
    from PIL import Image

    pictures = map(Image.fromarray, _in_order(frames))
    return _animation("WEBP", pictures, _durations(len(frames), fps, 1), {"quality": 88, "method": 3})


def _animation(kind: str, pictures: Iterator[Any], durations: Sequence[int], options: dict[str, Any]) -> bytes:
    first, buffer = next(pictures), io.BytesIO()
    first.save(buffer, kind, save_all=True, append_images=pictures, duration=durations, loop=0, **options)
    return buffer.getvalue()


def _durations(count: int, fps: float, unit: int) -> list[int]:
    """Duration of each picture [ms]: multiples of `unit` whose sums are as close as possible to the true times."""
    ends = [unit * round((i * 1000.0 / fps + (i == count) * 1000.0 * _HOLD) / unit) for i in range(count + 1)]
    return [b - a for a, b in pairwise(ends)]


def _in_order(frames: Frames) -> Iterator[Picture]:
    return (frames[i] for i in range(len(frames)))


_ENCODERS = {".mp4": _mp4, ".gif": _gif, ".webp": _webp}
