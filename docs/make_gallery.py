"""Make the gallery by running the examples: `python docs/make_gallery.py`.

Every example runs in a scratch folder; each page it writes is photographed in a headless Chromium
(needs the extra `dev` and a chromium), each PNG is copied. The pictures go to docs/gallery/.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
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


def main() -> None:
    """Run all examples and photograph what they wrote."""
    gallery = HERE / "gallery"
    gallery.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        run_examples(work)
        for page in sorted(work.glob("*.html")):
            screenshot(gallery / f"{page.stem}.png", page, size=SIZE, time=_moment(work, page))
        for picture in sorted(work.glob("*.png")):
            shutil.copy(picture, gallery / f"{picture.stem}-figure.png")
        for name in SCENES:
            page = save_html(work / f"{name}.html", load_scene(name))
            screenshot(gallery / f"{name}.png", page, size=SIZE, bare=True)


def run_examples(folder: Path) -> None:
    """Run all examples in a folder, where they write their pages.

    Raises:
        CalledProcessError: one failed.
    """
    for example in sorted(EXAMPLES.glob("[0-9]*.py")):
        print(example.name, flush=True)
        subprocess.run([sys.executable, str(example)], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def _moment(work: Path, page: Path) -> float | None:
    """The middle of the motion when the example saved one under the page's name."""
    saved = work / f"{page.stem}.json"
    if not saved.exists():
        return None
    trajectory = (load_sequence if holds_sequence(saved) else load_motion)(saved).trajectory
    return trajectory.start_time + 0.5 * trajectory.duration


if __name__ == "__main__":
    main()
