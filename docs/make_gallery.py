"""Make the gallery by running the examples: `python docs/make_gallery.py`, or some of them: `... 20 21`.

Every example runs in a scratch folder; each page it writes is photographed in a headless Chromium
(needs the extra `dev` and a chromium), each PNG is copied. The pictures go to docs/gallery/.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from rr1plan import save_html, screenshot
from rr1plan.saved_motion import load_motion
from rr1plan.scene.model_library import load_scene
from rr1plan.sequences.sequence_files import holds_sequence, load_sequence

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent / "examples"
SIZE = (1280, 720)
# Scenes that are shown as they stand, without a motion.
SCENES = ("rr1_shelf", "rr1_cage", "rr1_bin", "rr1_window")
# When something is seen of motions that no file holds [s].
MOMENTS = {"18_delays": 0.8, "21_nobody_waits": 0.35, "25_loose_bodies": 1.6}


def main(only: Sequence[str] = ()) -> None:
    """Run all examples and photograph what they wrote.

    Args:
        only: Numbers of the examples to run, and no scenes then (default: all of them).
    """
    gallery = HERE / "gallery"
    gallery.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        run_examples(work, only)
        for page in sorted(work.glob("*.html")):
            screenshot(gallery / f"{page.stem}.png", page, size=SIZE, time=_moment(work, page))
        for picture in sorted(work.glob("*.png")):
            shutil.copy(picture, gallery / f"{picture.stem}-figure.png")
        for name in () if only else SCENES:
            page = save_html(work / f"{name}.html", load_scene(name))
            screenshot(gallery / f"{name}.png", page, size=SIZE, bare=True)


def run_examples(folder: Path, only: Sequence[str] = ()) -> None:
    """Run examples in a folder, where they write their pages.

    Args:
        folder: Where to.
        only: Numbers of some of them.

    Raises:
        CalledProcessError: one failed.
    """
    for example in sorted(EXAMPLES.glob("[0-9]*.py")):
        if only and example.name.split("_")[0] not in only:
            continue
        print(example.name, flush=True)
        subprocess.run([sys.executable, str(example)], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def _moment(work: Path, page: Path) -> float | None:
    """The middle of the motion when the example saved one under the page's name, or its own moment."""
    if page.stem in MOMENTS:
        return MOMENTS[page.stem]
    saved = work / f"{page.stem}.json"
    if not saved.exists():
        return None
    trajectory = (load_sequence if holds_sequence(saved) else load_motion)(saved).trajectory
    return trajectory.start_time + 0.5 * trajectory.duration


if __name__ == "__main__":
    main(sys.argv[1:])
