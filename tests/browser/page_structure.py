"""The structure of a page in a few numbers: positions of its parts, and a coarse picture of its window.

Fonts and graphics differ between machines, and pixels with them. The places of cards, pictures and buttons
stay, and so do the mean color and the amount of detail of each part of the window. Run
`python tests/browser/page_structure.py` to store these numbers of all pages in `structures`, and with
`--pictures FOLDER` to look at the pages first.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import open_browser, wait_until

FOLDER = Path(__file__).parent / "structures"
SIZES = ((390, 844), (800, 600), (1440, 900))  # small first: pages are drawn several times while they open
READY = "Boolean(window.RR1 && RR1.ready)"

# Selectors of the parts whose boxes are compared. A hidden part has no box.
PARTS = (
    "#stage", "#headline", "#side", "#bar", "#play", "#scrub", "#fold", "#panels", "#panel-steps", ".texts",
    ".panel", ".panel .plot", ".panel canvas", ".panel .pair", ".panel .sliders", ".panel .tools", ".panel .verdict",
    ".panel .walk", ".panel .knobs", ".panel .chart", ".panel .race", ".panel .bars", ".readout", ".corner", ".tile",
)  # fmt: skip
_BOXES = """(parts) => {
  const box = (node) => {
    const { left, top, right, bottom } = node.getBoundingClientRect();
    return [left / innerWidth, top / innerHeight, right / innerWidth, bottom / innerHeight];
  };
  // A part for screen readers only is one pixel wide.
  const shown = (node) => node.checkVisibility({ visibilityProperty: true }) && node.offsetWidth > 1;
  const rows = (part) => [...document.querySelectorAll(part)].map((node, k) => [`${part} ${k}`, node]);
  const found = parts.flatMap(rows).filter(([, node]) => shown(node));
  return Object.fromEntries(found.map(([name, node]) => [name, box(node)]));
}"""
GRID = (12, 8)  # of the longer side and the shorter one
BOX_TOLERANCE = 0.08  # of the window: other fonts make other lines
COLOR_TOLERANCE = 12  # of 255, the mean of a field; serifs change it by 5 at most
DETAIL_TOLERANCE = 6  # of 255, the mean step between neighboring pixels in a field
MOST_FIELDS_OFF = 0.06  # of the fields of a picture may be off

Structure = dict[str, Any]


def structure(page: Any) -> Structure:
    """The boxes of a page's parts and a coarse picture of its window."""
    boxes = page.evaluate(_BOXES, list(PARTS))
    picture = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=float)
    return {
        "boxes": {name: [round(v, 3) for v in box] for name, box in boxes.items()},
        **{name: np.round(field).astype(int).tolist() for name, field in _coarse(picture).items()},
    }


def _coarse(picture: np.ndarray) -> dict[str, np.ndarray]:
    """Mean color (3) and detail (1) of each field of a grid."""
    height, width, _ = picture.shape
    columns, rows = GRID if width > height else GRID[::-1]
    gray = picture.mean(axis=2)
    steps = np.zeros_like(gray)
    steps[:, 1:] += np.abs(np.diff(gray, axis=1))
    steps[1:] += np.abs(np.diff(gray, axis=0))
    x, y = (np.linspace(0, size, count + 1).round().astype(int) for size, count in ((width, columns), (height, rows)))

    def means(values: np.ndarray) -> np.ndarray:
        return np.array([[values[a:b, c:d].mean(axis=(0, 1)) for c, d in pairwise(x)] for a, b in pairwise(y)])

    return {"colors": means(picture), "detail": means(steps)}


def differences(found: Structure, stored: Mapping[str, Any]) -> list[str]:
    """Differences from the stored structure, as messages; empty if there are none."""
    own, expected = found["boxes"], stored["boxes"]
    words = [f"{name} is missing" for name in expected if name not in own]
    words += [f"{name} is new" for name in own if name not in expected]
    for name in expected.keys() & own.keys():
        off = float(np.abs(np.subtract(own[name], expected[name])).max())
        if off > BOX_TOLERANCE:
            words.append(f"{name} is at {own[name]}, expected {expected[name]}")
    for name, tolerance in (("colors", COLOR_TOLERANCE), ("detail", DETAIL_TOLERANCE)):
        difference = np.abs(np.subtract(found[name], stored[name]))
        off = (difference if difference.ndim == 2 else difference.max(axis=2)) > tolerance
        if off.mean() > MOST_FIELDS_OFF:
            words.append(f"{name} differ in {off.mean():.0%} of the fields: {np.argwhere(off)[:8].tolist()}")
    return words


def resize(page: Any, size: tuple[int, int]) -> None:
    """Resize the window, and wait until the page has been drawn."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    wait_until(page, f"innerWidth === {size[0]} && innerHeight === {size[1]}")
    page.mouse.move(0, 0)
    frames = page.evaluate("RR1.frames")
    wait_until(page, f"RR1.frames > {frames} + 4 && RR1.settled")


def stored(name: str, size: tuple[int, int]) -> Mapping[str, Any]:
    """The stored structure of a page for a window size."""
    found: Mapping[str, Any] = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return found[f"{size[0]}x{size[1]}"]


# ---- the pages that are compared ---------------------------------------------------------------


def _motion(file: Path) -> None:
    problem = next(iter(rp.load_problems("rr1_shelf").values()))
    motion = rp.plan_motion(problem, rng=0)
    slow = rp.ViewOptions(play=False, compare={"half speed": motion.trajectory.stretched(2.0)}, side_by_side=True)
    motion.save_html(file, options=slow)


def _cspace(file: Path) -> None:
    problem = next(iter(rp.load_problems("planar2r_path").values()))
    result = rp.RrtConnect(range=0.15, tree=True).plan(problem, rng=0)
    picture = rp.cspace(problem.scene, problem, result=result, resolution=120)
    picture.save_html(file, options=rp.ViewOptions(play=False))


def _slice(file: Path) -> None:
    scene = rp.load_scene("rr1_table")
    rp.cspace(scene, joints=("shoulder_joint", "elbow_joint"), resolution=90).save_html(file)


def makers() -> dict[str, Callable[[Path], object]]:
    """For each compared page, the function that writes its file."""
    own: dict[str, Callable[[Path], object]] = {"motion": _motion, "cspace": _cspace, "slice": _slice}
    return own | {
        f"lesson_{name}": lambda file, name=name: rp.lesson(name).save_html(file) for name in rp.lesson_names()
    }


def open_at_rest(page: Any, file: Path) -> None:
    """Open a page, and wait until its planner is loaded and its initial animation has ended."""
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    page.goto(file.as_uri())
    wait_until(page, f"{READY} && Boolean(RR1.planner || RR1.noPlanner || !RR1.document.planner)")
    # The tables of a live configuration space are inflated after that.
    wait_until(page, "!RR1.planner || !RR1.panelData.cspace?.live || Boolean(RR1.lesson.live)")
    page.evaluate("RR1.pause()")


def main() -> int:
    parser = argparse.ArgumentParser(description="Store how pages are built.")
    parser.add_argument("--pictures", type=Path, help="a folder for the pictures")
    parser.add_argument("--only", nargs="*", choices=list(makers()), help="pages by name")
    args = parser.parse_args()
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, open_browser(SIZES[0]) as browser:
        for name, make in makers().items():
            if args.only and name not in args.only:
                continue
            file = Path(folder) / "page.html"
            make(file)
            page = browser.new_page()
            open_at_rest(page, file)
            found = {}
            for size in SIZES:
                resize(page, size)
                found[f"{size[0]}x{size[1]}"] = structure(page)
                if args.pictures:
                    args.pictures.mkdir(parents=True, exist_ok=True)
                    page.screenshot(path=args.pictures / f"{name}-{size[0]}x{size[1]}.png")
            page.close()
            (FOLDER / f"{name}.json").write_text(json.dumps(found, separators=(",", ":")) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
