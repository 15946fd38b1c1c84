"""Live pages in real browsers: several at once, programs that end and start again, notebooks."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Queue
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from browser.conftest import Tab
from tornado.web import Application
from tornado.websocket import WebSocketHandler

import rr1plan as rp
from rr1plan.playback.viewer import page_server
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

CONNECTED = "window.RR1 && RR1.ready && RR1.live.socket.readyState === 1"


@pytest.fixture
def flat(planar2r: rp.Robot) -> rp.Scene:
    return rp.Scene(name="flat").with_arm("arm", planar2r)


def test_all_browsers_follow_and_each_is_heard(browser: Any, flat: rp.Scene) -> None:
    heard: Queue[tuple[str, float]] = Queue()
    tabs = [Tab(browser.new_page()).page for _ in range(3)]
    with rp.show(flat, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        viewer.on_slider(lambda joint, value: heard.put((joint, value)))
        for tab in tabs:
            tab.goto(viewer.url)
        for tab in tabs:
            wait_until(tab, CONNECTED)
        viewer.update([0.25, -0.5])
        for tab in tabs:
            wait_until(tab, "RR1.q[0] === 0.25 && RR1.q[1] === -0.5")
        assert viewer.pages == 3  # a page may know of its connection before the server does
        for i, tab in enumerate(tabs):
            tab.evaluate("(value) => RR1.live.tellSlider(1, value)", 0.125 * i)
        told = sorted(heard.get(timeout=60) for _ in tabs)
        assert told == [("arm/joint2", 0.0), ("arm/joint2", 0.125), ("arm/joint2", 0.25)]
        tabs[0].close()
        viewer.update([0.5, 0.5])
        for tab in tabs[1:]:
            wait_until(tab, "RR1.q[0] === 0.5")
        assert heard.empty()
    for tab in tabs[1:]:
        wait_until(tab, "RR1.live.ended")
        assert "no longer updates" in tab.evaluate("document.getElementById('status').textContent")
        tab.close()


def test_pages_that_open_later_have_the_latest_data_of_panels(browser: Any, flat: rp.Scene) -> None:
    script = "const show = () => { root.title = JSON.stringify(data); }; show(); viewer.on('data', show);"
    panel = rp.Panel("numbers", "Numbers", script=script, data={"first": 0, "second": 0})
    tabs = [Tab(browser.new_page()).page for _ in range(2)]
    with rp.show(flat, options=rp.ViewOptions(port=0, quiet=True, panels=[panel])) as viewer:
        for tab, number in zip(tabs, (1, 2), strict=True):
            viewer.update_panel("numbers", {"first": number})  # no page follows yet, or the other one does
            tab.goto(viewer.url)
            for shown in tabs[:number]:
                wait_until(shown, f"{CONNECTED} && document.getElementById('panel-numbers').title[9] === '{number}'")
        assert tabs[1].evaluate("document.getElementById('panel-numbers').title") == '{"first":2,"second":0}'
        viewer.update([0.25, -0.5])
        wait_until(tabs[0], "RR1.q[0] === 0.25")
        # What the program sent before a reconnection does not undo what the user has changed since; news arrives.
        tabs[0].evaluate(
            """() => new Promise((closed) => {
                RR1.panelData.numbers.first = 7;
                RR1.setJoint(0, 1.0);
                const { socket } = RR1.live;
                socket.addEventListener("close", closed);
                socket.close();
            })"""
        )
        viewer.update_panel("numbers", {"second": 5})
        wait_until(tabs[0], f"{CONNECTED} && RR1.panelData.numbers.second === 5")
        viewer.update_panel("numbers", {"third": 1})
        wait_until(tabs[0], "RR1.panelData.numbers.third === 1")  # after the frame
        tabs[0].evaluate("new Promise(requestAnimationFrame)")
        assert tabs[0].evaluate("[RR1.panelData.numbers.first, RR1.q[0]]") == [7, 1.0]
        viewer.update([0.25, -0.5])  # the same again, but not because of the connection
        wait_until(tabs[0], "RR1.q[0] === 0.25")
    for tab in tabs:
        tab.close()


def test_the_menu_shows_a_speed_set_by_the_program(browser: Any, flat: rp.Scene) -> None:
    still = rp.Trajectory.from_samples(flat.joint_names(), [0.0, 1.0], [[0.0, 0.0], [0.1, 0.1]])
    tab, menu = Tab(browser.new_page()).page, "document.getElementById('speed')"
    with rp.show(flat, trajectory=still, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        tab.goto(viewer.url)
        wait_until(tab, CONNECTED)
        usual = tab.evaluate(f"{menu}.options.length")
        for speed, text in ((3.0, "3×"), (0.75, "0.75×"), (2.0, "2×")):
            viewer.set_speed(speed)
            wait_until(tab, f"RR1.player.speed === {speed}")
            assert tab.evaluate(f"{menu}.selectedOptions[0].text") == text
            assert tab.evaluate(f"{menu}.options.length") == usual + (speed != 2.0)
        viewer.set_speed(3.0)
        wait_until(tab, "RR1.player.speed === 3")
        tab.keyboard.press("ArrowUp")
        assert tab.evaluate("RR1.player.speed") == 5
    tab.close()


def test_pages_that_open_later_obey_the_commands_so_far(tab: Any, flat: rp.Scene) -> None:
    still = rp.Trajectory.from_samples(flat.joint_names(), [0.0, 1.0], [[0.0, 0.0], [0.1, 0.1]])
    with rp.show(flat, trajectory=still, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        viewer.set_speed(3.0)
        viewer.seek(0.5)
        viewer.pause()
        tab.open(viewer.url, f"{CONNECTED} && RR1.live.count === 3", plays=True)
        assert tab.ask("[RR1.player.speed, RR1.time, RR1.playing]") == [3, 0.5, False]
        # They are not repeated after a reconnection, which would undo what the user has changed since.
        tab.ask(
            """() => new Promise((closed) => {
                RR1.seek(0.25);
                const { socket } = RR1.live;
                socket.addEventListener("close", closed);
                socket.close();
            })"""
        )
        wait_until(tab.page, CONNECTED)
        viewer.set_speed(2.0)
        wait_until(tab.page, "RR1.player.speed === 2")
        assert tab.ask("RR1.time") == 0.25
        viewer.load(flat, trajectory=still)
        tab.open(viewer.url, f"{CONNECTED} && RR1.player.speed === 2", plays=True)
        assert tab.ask("RR1.playing")
    assert tab.complaints == []


def test_a_page_that_loads_slowly_skips_documents(tab: Any, flat: rp.Scene) -> None:
    still = rp.Trajectory.from_samples(flat.joint_names(), [0.0, 1.0], [[0.0, 0.0], [0.1, 0.1]])
    with rp.show(flat, trajectory=still, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        tab.open(viewer.url, CONNECTED)
        loaded = tab.ask(
            """async (page) => {
                const { live } = RR1, loaded = [], usual = RR1.load.bind(RR1);
                RR1.load = (value, keep) => { loaded.push(value.title); usual(value, keep); };
                const send = (type, value) => live.take(JSON.stringify({ type, value, version: live.version }));
                send("seek", 0.5);
                for (const title of ["first", "second", "third"]) send("document", { ...page, title });
                send("seek", 0.25);
                while (document.title !== "third") await new Promise(requestAnimationFrame);
                return loaded;
            }""",
            viewer.page_content()[0],
        )
        assert loaded == ["third"]
        assert tab.ask("RR1.time") == 0.25
    assert tab.complaints == []


PROGRAM = """
import sys, rr1plan as rp
robot = rp.load_robot("planar2r")
scene = rp.Scene(name=sys.argv[2]).with_arm("arm", robot)
viewer = rp.show(scene, options=rp.ViewOptions(port=int(sys.argv[1]), quiet=True))
print(viewer.url, flush=True)
viewer.update([float(sys.argv[3]), 0.0])
print(viewer.url, flush=True)
sys.stdin.read()
"""


def run_program(port: int, name: str, q: float) -> tuple[subprocess.Popen[str], str]:
    """A program that shows a scene of a name at a port (0: a free one), and the address of its page."""
    command = [sys.executable, "-c", PROGRAM, str(port), name, str(q)]
    program = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    return program, program.stdout.readline().strip()


def test_pages_come_back_when_a_killed_program_is_started_again(browser: Any) -> None:
    tab = Tab(browser.new_page()).page
    program, url = run_program(0, "first", 0.5)
    with program:
        tab.goto(url)
        wait_until(tab, f"{CONNECTED} && RR1.q[0] === 0.5")
        tab.evaluate("window.loaded = 'by the first program'")
        program.kill()
    wait_until(tab, "!document.getElementById('status').hidden")
    assert "not answering" in tab.evaluate("document.getElementById('status').textContent")
    with tab.expect_navigation():
        program, again = run_program(urlsplit(url).port or 0, "second", 0.75)
    with program:
        assert again == url
        wait_until(tab, f"{CONNECTED} && RR1.q[0] === 0.75")
        assert tab.evaluate("[document.title, typeof window.loaded]") == ["second", "undefined"]
        assert tab.evaluate("document.getElementById('status').hidden")
        program.kill()
    tab.close()


def test_a_page_says_that_its_program_no_longer_updates_it(tab: Any) -> None:
    program, url = run_program(0, "first", 0.5)
    with program:
        tab.page.goto(url)
        wait_until(tab.page, f"{CONNECTED} && RR1.q[0] === 0.5")
        program.communicate(timeout=60)  # it ends by itself, without `close`
        assert program.returncode == 0
        wait_until(tab.page, "RR1.live.ended")
    assert "no longer updates" in tab.ask("document.getElementById('status').textContent")


def test_a_page_notices_that_its_program_does_not_answer(
    tab: Any, flat: rp.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_server, "_PING", 0.1)
    resumed = threading.Event()
    tab.page.add_init_script("const usual = setTimeout; setTimeout = (act, delay) => usual(act, delay / 20);")
    with rp.show(flat, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        viewer.on_slider(lambda _joint, _value: resumed.wait(60))
        try:
            tab.open(viewer.url, CONNECTED)
            tab.ask("RR1.live.tellSlider(1, 0.5)")
            wait_until(tab.page, "document.getElementById('status').textContent.includes('not answering')")
        finally:
            resumed.set()
        wait_until(tab.page, "document.getElementById('status').hidden && RR1.live.socket.readyState === 1")


def test_a_viewer_in_a_notebook_follows_the_program_and_stays_when_it_ends(
    tab: Any, flat: rp.Scene, tmp_path: Path
) -> None:
    heard: Queue[tuple[str, float]] = Queue()
    viewer = rp.show(flat, options=rp.ViewOptions(port=0, quiet=True))
    viewer.on_slider(lambda joint, value: heard.put((joint, value)))
    notebook = tmp_path / "notebook.html"
    # Not even the encoding is what the page expects.
    header = "<!DOCTYPE html><meta charset=windows-1252><p>A notebook</p>"
    notebook.write_text(f"{header}{viewer._repr_html_()}", encoding="utf-8")
    tab.page.goto(notebook.as_uri())
    frame = tab.page.frames[1]
    wait_until(frame, CONNECTED)
    viewer.update([0.25, -0.5])
    wait_until(frame, "RR1.q[0] === 0.25 && RR1.q[1] === -0.5")
    frame.evaluate("RR1.live.tellSlider(0, 0.75)")
    assert heard.get(timeout=60) == ("arm/joint1", 0.75)
    viewer.update([0.0, 0.0])
    wait_until(frame, "RR1.q[0] === 0")
    assert heard.empty()
    assert not tab.complaints
    viewer.close()
    wait_until(frame, "RR1.live.ended")
    # As a recipient of the notebook sees it: a page on its own, without messages about a program.
    tab.page.reload()
    frame = tab.page.frames[1]
    wait_until(frame, "window.RR1 && RR1.ready && RR1.live.socket.readyState === 3")
    assert frame.evaluate("document.getElementById('status').hidden")
    frame.evaluate("RR1.setJoint(0, 0.5)")
    np.testing.assert_allclose(frame.evaluate("Array.from(RR1.q)")[0], 0.5)


def test_a_live_page_that_was_saved_works_without_its_program(tab: Any, flat: rp.Scene, tmp_path: Path) -> None:
    page = tmp_path / "saved.html"
    with rp.show(flat, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        page.write_bytes(tab.page.request.get(viewer.url).body())
    tab.open(page)
    tab.ask("RR1.editing.jog(0, 0.5)")
    assert tab.ask("RR1.q[0]") == 0.5
    assert tab.ask("document.getElementById('status').hidden")
    assert tab.complaints == []


# The first wait ends after a twentieth of its time, during which the page is busy.
BUSY = """
const usual = setTimeout; let busy = true; setTimeout = (act, delay) => usual(act, busy ? delay / 20 : delay);
const Usual = WebSocket;
WebSocket = class extends Usual {
  constructor(...wanted) {
    super(...wanted);
    const block = () => { const end = performance.now() + 1000; while (performance.now() < end); busy = false; };
    if (busy) usual(block, 0);
  }
};
"""


DROPPED = """
const Usual = WebSocket; let first = true;
WebSocket = class extends Usual {
  constructor(...wanted) {
    super(...wanted);
    if (first) this.close();
    first = false;
  }
};
"""


@pytest.mark.parametrize("script", [BUSY, DROPPED], ids=["busy", "dropped"])
def test_a_page_in_a_notebook_without_an_answer_tries_again(
    tab: Any, flat: rp.Scene, tmp_path: Path, script: str
) -> None:
    with rp.show(flat, options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        notebook = tmp_path / "notebook.html"
        notebook.write_text(f"<!DOCTYPE html>{viewer._repr_html_()}")
        tab.page.add_init_script(script)
        tab.page.goto(notebook.as_uri())
        wait_until(tab.page.frames[1], CONNECTED)


class ForeignSocket(WebSocketHandler):
    """Accepts every page, and sends a message that pages of this package would obey."""

    def check_origin(self, origin: str) -> bool:
        return True

    def open(self, *_args: str, **_kwargs: str) -> None:
        self.write_message('{"type": "reload"}')


@contextmanager
def foreign_server(port: int, *, answers: bool) -> Iterator[None]:
    """Another program at a port, which speaks WebSocket, or accepts connections and never answers."""
    if not answers:
        with socket.create_server(("127.0.0.1", port)):
            yield
        return
    loop, started = asyncio.new_event_loop(), threading.Event()

    async def serve() -> None:
        server = Application([(r".*", ForeignSocket)]).listen(port, "127.0.0.1")
        started.set()
        await ended.wait()
        server.stop()
        await server.close_all_connections()

    ended = asyncio.Event()
    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    try:
        assert started.wait(20)
        yield
    finally:
        loop.call_soon_threadsafe(ended.set)
        thread.join()
        loop.close()


@pytest.mark.parametrize("answers", [True, False])
def test_a_page_does_not_follow_another_program_that_took_the_port(
    tab: Any, flat: rp.Scene, tmp_path: Path, answers: bool
) -> None:
    viewer = rp.show(flat, options=rp.ViewOptions(port=0, quiet=True))
    port = int(viewer.url.rsplit(":", 1)[1].strip("/"))
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!DOCTYPE html><p>A notebook</p>{viewer._repr_html_()}")
    viewer.close()
    tab.page.add_init_script("const usual = setTimeout; setTimeout = (act, delay) => usual(act, delay / 20);")
    with foreign_server(port, answers=answers):
        tab.page.goto(notebook.as_uri())
        frame = tab.page.frames[1]
        wait_until(frame, "window.RR1 && RR1.ready && RR1.live.socket.readyState === 3")
        frame.evaluate("RR1.setJoint(0, 0.5)")
        np.testing.assert_allclose(frame.evaluate("Array.from(RR1.q)")[0], 0.5)
        assert frame.evaluate("document.getElementById('status').hidden")
