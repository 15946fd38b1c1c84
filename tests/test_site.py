"""The documentation site: Sphinx builds it without a warning, and no link in it is broken."""

from __future__ import annotations

import base64
import html
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import rr1plan as rp
from rr1plan.playback.viewer import view_document
from rr1plan.playback.viewer.html_page import page_html
from rr1plan.playback.viewer.page_capture import open_browser, wait_until

pytest.importorskip("sphinx", reason="sphinx is not installed")

DOCS = Path(__file__).parent.parent / "docs"


class Page(HTMLParser):
    """The links of a page, the names that links can target, and the pictures without a text alternative."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors = {""}
        self.unnamed: list[str] = []
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Record the target of a link, the name of a tag, or a picture without a text alternative."""
        if tag == "img" and not dict(attrs).get("alt"):
            self.unnamed.append(dict(attrs).get("src") or "")
        for name, value in attrs:
            if value and name in ("href", "src"):
                self.links.append(value)
            elif value and name == "id":
                self.anchors.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, with pictures instead of example pages."""
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, str(DOCS / "make_site.py"), str(out), "--no-pages"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.strip() == str(out / "index.html")
    return out


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    """All pages of the site."""
    return {file.resolve(): Page(file) for file in site.rglob("*.html")}


def test_no_link_is_broken(site: Path, pages: dict[Path, Page]) -> None:
    assert len(pages) > 40
    broken, checked = [], 0
    for file, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            checked += 1
            if not target.is_file() or (target in pages and unquote(parts.fragment) not in pages[target].anchors):
                broken.append(f"{file.relative_to(site)}: {link}")
    assert broken == []
    assert checked > 1000


def test_all_pictures_have_a_text_alternative(pages: dict[Path, Page]) -> None:
    assert {picture for page in pages.values() for picture in page.unnamed} == set()


def test_the_reference_has_every_public_name(site: Path) -> None:
    anchors = set[str]().union(*(Page(file).anchors for file in (site / "api").glob("*.html")))
    missing = {name for name in rp.__all__ if f"rr1plan.{name}" not in anchors and name != "__version__"}
    assert missing in (set(), {"transforms"})
    assert "module-rr1plan.transforms" in anchors


def test_the_reference_keeps_sentences_of_properties_with_a_colon(site: Path) -> None:
    members = {"trajectories": rp.Trajectory.degree, "many_arms": rp.PlanGraph.nodes, "robots": rp.Robot.content_hash}
    for page, member in members.items():
        (sentence, *_) = str(member.__doc__).splitlines()
        assert ": " in sentence
        assert sentence in " ".join((site / "api" / f"{page}.html").read_text(encoding="utf-8").split())


def test_the_reference_has_no_sentences_as_return_types(site: Path) -> None:
    # Napoleon takes what precedes a colon in "Returns" for the type.
    form = re.compile(r'Return type<span class="colon">:</span></dt>\s*<dd[^>]*><p>(.*?)</p>', re.DOTALL)
    texts = [text for file in (site / "api").glob("*.html") for text in form.findall(file.read_text(encoding="utf-8"))]
    types = [html.unescape(re.sub("<[^>]*>", "", text)) for text in texts]
    assert [kind for kind in types if re.search(r"[a-z]\s[a-z]", kind)] == []


def test_all_pages_of_the_documentation_are_in_the_site(site: Path) -> None:
    written = {file.relative_to(DOCS).with_suffix(".html") for file in DOCS.rglob("*.md")}
    assert len(written) > 15
    assert {page for page in written if not (site / page).is_file()} == set()
    # The site and the pages of motions have the same icon.
    assert any(link.endswith("site.svg") for link in Page(site / "index.html").links)
    icon = page_html(view_document(rp.Scene())).split('<link rel="icon" href="data:image/svg+xml;base64,')[1]
    assert base64.b64decode(icon.split('"')[0]) == (DOCS / "site.svg").read_bytes().strip()


@pytest.mark.browser
def test_the_search_works_from_disk(site: Path) -> None:
    complaints: list[str] = []
    with open_browser((960, 640)) as context:
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        page.goto(f"{(site / 'search.html').as_uri()}?q=certified+edge")
        wait_until(page, "document.querySelectorAll('#search-results li a').length > 5")
        links = page.eval_on_selector_all("#search-results li a", "(all) => all.map((link) => link.href)")
    assert complaints == []
    assert any("concepts.html" in link for link in links)
