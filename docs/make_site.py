"""Build the documentation as a static site: `python docs/make_site.py`.

Runs the examples and saves the lessons, whose pages the site contains, then runs Sphinx; warnings are errors. The site
opens from disk: `docs/site/index.html` unless another folder is given.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

from make_gallery import run_examples
from sphinx.cmd.build import build_main

import rr1plan as rp

HERE = Path(__file__).resolve().parent


def main(arguments: list[str] | None = None) -> int:
    """Build the site.

    Args:
        arguments: Of the command line (default: those of the process).

    Returns:
        The exit code: 0, or that of Sphinx.
    """
    parser = argparse.ArgumentParser(description="Build the documentation as a static site.")
    parser.add_argument("out", nargs="?", type=Path, default=HERE / "site", help="folder to write (default: docs/site)")
    parser.add_argument("--no-pages", action="store_true", help="pictures instead of the pages of examples and lessons")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as scratch:
        pages = Path(scratch) / "extra" / "pages"
        pages.mkdir(parents=True)
        if not given.no_pages:
            make_pages(pages)
        command = ["-b", "html", "-W", "--keep-going", "-q", "-d", str(Path(scratch) / "doctrees")]
        code = build_main([*command, "-D", f"live_pages={pages.parent}", str(HERE), str(given.out)])
        shutil.copytree(pages.parent, given.out, dirs_exist_ok=True)
    print(given.out / "index.html")
    return code


def make_pages(folder: Path) -> None:
    """Write the pages of all examples and lessons.

    Args:
        folder: Where to.
    """
    with tempfile.TemporaryDirectory() as scratch:
        run_examples(Path(scratch))
        for page in sorted(Path(scratch).glob("*.html")):
            shutil.copy(page, folder)
    for name in rp.lesson_names():
        print(f"lesson {name}", flush=True)
        rp.lesson(name).save_html(folder / f"lesson_{name}.html")


if __name__ == "__main__":
    sys.exit(main())
