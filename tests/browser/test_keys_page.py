"""Keys: which of several rows they act on, and the list that "?" shows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import pytest

import rr1plan as rp

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def page_file(rr1_table: rp.Scene, tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    panel = rp.Panel("own", "Own", html="<input><button>x</button>", script="viewer.own = [];")
    options = rp.ViewOptions(panels=[panel])
    return rp.save_html(tmp_path_factory.mktemp("keys") / "page.html", rr1_table, options=options)


@pytest.fixture
def calm(opened: Any) -> Iterator[Any]:
    opened.resize(960, 640)
    opened.ask("RR1.own = [], RR1.late = false, RR1.keys.dialog.close()")
    opened.ask("document.activeElement.blur(), document.body.classList.remove('folded')")
    opened.ask("RR1.keys.rows = RR1.keys.rows.filter((row) => row.title !== 'Own'), 0")
    yield opened
    assert opened.complaints == []


def add(tab: Any, name: str, options: str = "{}", when: str = "() => true", keys: str = '["u"]') -> None:
    row = f"{{ keys: {keys}, text: '{name}', when: {when}, act: () => RR1.own.push('{name}') }}"
    tab.ask(f"RR1.keys.add('Own', [{row}], {options})")


def test_the_last_row_counts_unless_one_is_first_or_has_the_focus(calm: Any) -> None:
    add(calm, "early", "{ first: true }", "() => !RR1.late")
    add(calm, "one")
    add(calm, "two")
    calm.page.keyboard.press("u")
    calm.ask("RR1.late = true")
    calm.page.keyboard.press("u")
    calm.ask("document.querySelector('#panel-own button').focus()")
    add(calm, "focused", "{ on: document.querySelector('#panel-own button') }")
    calm.page.keyboard.press("u")
    calm.page.keyboard.press("Control+u")
    calm.page.keyboard.press("Alt+u")
    assert calm.ask("RR1.own") == ["early", "two", "focused"]


def test_text_fields_sliders_and_buttons_keep_their_keys(calm: Any) -> None:
    add(calm, "letter")
    add(calm, "arrow", keys='["ArrowRight", " "]')
    calm.page.focus("#panel-own input")
    calm.page.keyboard.press("u")
    calm.resize(1400, 640)  # wide enough for the sliders beside the panel
    calm.page.focus("#joint-0")
    calm.page.keyboard.press("ArrowRight")
    calm.page.keyboard.press("u")
    calm.page.focus("#panel-own button")
    calm.page.keyboard.press("Space")
    assert calm.ask("RR1.own") == ["letter"]


def test_a_question_mark_lists_what_keys_do_now(calm: Any) -> None:
    add(calm, "Hides the frames", keys='["r"]')
    calm.page.keyboard.press("?")
    dialog = calm.page.locator("#help")
    assert dialog.is_visible()
    words = dialog.inner_text()
    assert "Hides the frames" in words
    # Another row has its key now, and there is no motion that could play.
    assert "Look at everything" not in words
    assert "Play or pause" not in words
    assert "Hide or show the cards" in words
    calm.page.keyboard.press("h")
    assert not calm.ask("document.body.classList.contains('folded')")
    calm.page.keyboard.press("Escape")
    assert dialog.is_hidden()
    calm.page.click("#bar [data-help]")
    assert dialog.is_visible()
    calm.page.click("#help [data-help]")
    assert dialog.is_hidden()


def test_keys_that_presenters_send_to_blank_the_screen_change_nothing(calm: Any) -> None:
    for key in ("b", "."):
        row = calm.ask("key => (RR1.keys.rowOf(key, null) || { title: null }).title", key)
        assert row in (None, "Motion"), key  # a period steps a motion
