"""The live page's server, tested without a browser."""

from __future__ import annotations

import asyncio
import contextlib
import html
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import WebSocketClientConnection, WebSocketClosedError, websocket_connect

import rr1plan as rp
from rr1plan import Viewer, show
from rr1plan.playback.viewer import live_viewer


@pytest.fixture
def viewer(rr1_table: rp.Scene) -> Iterator[Viewer]:
    with Viewer(rr1_table, options=rp.ViewOptions(port=0)) as shown:
        yield shown


def fetch(url: str, host: str | None = None) -> str:
    request = urllib.request.Request(url, headers={} if host is None else {"Host": host})
    with urllib.request.urlopen(request, timeout=20) as answer:
        return str(answer.read().decode())


async def close(connection: WebSocketClientConnection) -> None:
    """Close a connection, and read what the server sent before it noticed; None follows the last message."""
    connection.close()
    message: str | bytes | None = ""
    while message is not None:
        message = await asyncio.wait_for(connection.read_message(), 20)


def token_in(page: str) -> str:
    """The token with which a page follows its viewer and acts on it."""
    found = re.search(r'"token":\s*"([^"]+)"', page)
    assert found is not None
    return found[1]


def updates(viewer: Viewer, version: str = "1", token: str | None = None) -> str:
    """The address of a viewer's messages."""
    known = token_in(fetch(viewer.url)) if token is None else token
    return f"{viewer.url.replace('http', 'ws')}updates?version={version}&token={known}"


async def listen(viewer: Viewer, count: int, version: str = "1", token: str | None = None, **headers: str) -> list[Any]:
    request = HTTPRequest(updates(viewer, version, token), headers=headers)
    connection = await websocket_connect(request)
    try:
        return [await asyncio.wait_for(connection.read_message(), 20) for _ in range(count)]
    finally:
        await close(connection)


def test_the_page_is_served(viewer: Viewer, rr1_table: rp.Scene) -> None:
    page = fetch(viewer.url)
    assert f"<title>{rr1_table.name}</title>" in page
    assert "MeshCat" in page


def test_only_this_machine_is_listened_to(viewer: Viewer) -> None:
    port = int(viewer.url.rsplit(":", 1)[1].strip("/"))
    addresses = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), port, socket.AF_INET)}
    for address in addresses - {"127.0.0.1"}:
        with socket.socket() as probe:
            probe.settimeout(2)
            if not address.startswith("127."):
                assert probe.connect_ex((address, port)) != 0
    assert viewer._server.listener.getsockname() == ("127.0.0.1", port)


@pytest.mark.parametrize("host", ["evil.example", "evil.example:7000", "0.0.0.0:7000"])
def test_a_foreign_host_name_is_refused(viewer: Viewer, host: str) -> None:
    with pytest.raises(urllib.error.HTTPError, match="403") as caught:
        fetch(viewer.url, host)
    caught.value.close()


def test_a_page_of_another_origin_is_refused(viewer: Viewer) -> None:
    with pytest.raises(HTTPClientError, match="403"):
        asyncio.run(listen(viewer, 1, token="guessed", Origin="http://evil.example"))


def test_late_joiners_get_the_newest_document_and_configuration(viewer: Viewer, rr1_table: rp.Scene) -> None:
    q = rr1_table.configuration() + 0.01
    viewer.load(rr1_table.with_obstacle("new", rp.Sphere(0.1)))
    viewer.update(q)
    document, frame = asyncio.run(listen(viewer, 2))
    obstacles = [o["name"] for o in json.loads(document)["value"]["obstacles"]]
    assert "new" in obstacles
    np.testing.assert_array_equal(np.frombuffer(frame, "<f8"), q)


def test_a_slow_page_gets_the_newest_configuration(viewer: Viewer, rr1_table: rp.Scene) -> None:
    home = rr1_table.configuration()

    async def follow() -> np.ndarray:
        connection = await websocket_connect(updates(viewer))
        for i in range(500):
            viewer.update(home + i)
        while True:
            frame = await asyncio.wait_for(connection.read_message(), 20)
            q = np.frombuffer(frame, "<f8")
            if q[0] == home[0] + 499:
                await close(connection)
                return q

    np.testing.assert_array_equal(asyncio.run(follow()), home + 499)


def test_many_connects_do_not_hang_the_server(viewer: Viewer) -> None:
    async def many() -> None:
        for _ in range(12):
            await asyncio.gather(*(listen(viewer, 0) for _ in range(20)))

    asyncio.run(many())
    assert "MeshCat" in fetch(viewer.url)


def test_commands_arrive_in_order(viewer: Viewer) -> None:
    async def follow() -> list[Any]:
        listening = asyncio.ensure_future(listen(viewer, 4))
        while viewer.pages == 0:
            await asyncio.sleep(0.01)
        viewer.play()
        viewer.set_speed(2)
        viewer.seek(0.5)
        viewer.pause()
        return [json.loads(text) for text in await listening]

    messages = asyncio.run(follow())
    assert [m["type"] for m in messages] == ["play", "speed", "seek", "pause"]
    assert [m["value"] for m in messages] == [None, 2.0, 0.5, None]


def test_sliders_of_pages_are_heard_and_anything_else_is_not(viewer: Viewer) -> None:
    heard: list[tuple[str, float]] = []
    viewer.on_slider(lambda joint, value: heard.append((joint, value)))
    sent = ['{"type": "slider", "column": 1, "value": 0.5}', '{"type": "slider", "column": 0, "value": -1}']
    odd = ["", "[", "7", "x" * 100_000, '{"type": "slider"}', '{"type": "slider", "column": 6, "value": 0}']
    odd += ['{"type": "slider", "column": 0, "value": 1e300}', '{"type": "slider", "column": 0, "value": NaN}']

    async def tell() -> None:
        connection = await websocket_connect(updates(viewer))
        for message in (*odd, *sent):
            await connection.write_message(message)
        while len(heard) < 2:
            await asyncio.sleep(0.01)
        await close(connection)

    asyncio.run(asyncio.wait_for(tell(), 20))
    assert heard == [("rr1/upper_arm_joint", 0.5), ("rr1/shoulder_joint", -1.0)]
    with pytest.raises(rp.InputError, match="callback is 3, expected a function"):
        viewer.on_slider(3)


def test_a_taken_port_gives_the_next_one(rr1_table: rp.Scene, viewer: Viewer) -> None:
    taken = int(viewer.url.rsplit(":", 1)[1].strip("/"))
    with Viewer(rr1_table, options=rp.ViewOptions(port=taken)) as other:
        assert other.url != viewer.url
        assert "MeshCat" in fetch(other.url)


@pytest.mark.parametrize("port", [-1, 70_000, "http", True, 1.5])
def test_a_port_that_is_none_is_refused(rr1_table: rp.Scene, port: Any) -> None:
    with pytest.raises(rp.InputError, match="port"):
        Viewer(rr1_table, options=rp.ViewOptions(port=port))


def test_nothing_is_left_after_close(rr1_table: rp.Scene) -> None:
    before = threading.active_count()
    viewer = Viewer(rr1_table, options=rp.ViewOptions(port=0))
    url = viewer.url
    viewer.close()
    viewer.close()
    assert viewer.closed
    assert threading.active_count() == before
    with pytest.raises(urllib.error.URLError):
        fetch(url)
    with pytest.raises(rp.InputError, match="closed"):
        viewer.update(rr1_table.configuration())


def test_wait_ends_with_close_and_with_its_timeout(viewer: Viewer) -> None:
    assert not viewer.wait(0.01)
    closing = threading.Timer(0.05, viewer.close)
    closing.start()
    assert viewer.wait(20)
    closing.join()


async def look(viewer: Viewer, times: int, away: float) -> None:
    """A page that is opened, and reloaded `times` - 1 times."""
    for _ in range(times):
        connection = await websocket_connect(updates(viewer))
        await asyncio.sleep(0.05)
        await close(connection)
        await asyncio.sleep(away)


def test_wait_ends_when_the_page_has_been_opened_and_closed(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_viewer, "_RELOAD", 0.2)
    assert not viewer.wait(0.3)
    waiting, usual = threading.Event(), viewer._ended.wait
    monkeypatch.setattr(viewer._ended, "wait", lambda timeout: (waiting.set(), usual(timeout))[1])

    def open_and_close() -> None:
        assert waiting.wait(20)  # what has been closed before does not count
        asyncio.run(look(viewer, 1, 0.0))

    looker = threading.Thread(target=open_and_close)
    looker.start()
    assert viewer.wait(20)
    looker.join()
    assert not viewer.closed


def test_a_page_that_is_loaded_again_does_not_end_wait(viewer: Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_viewer, "_RELOAD", 20.0)
    looker = threading.Thread(target=asyncio.run, args=(look(viewer, 3, 0.1),))
    looker.start()
    assert not viewer.wait(0.7)
    looker.join()
    assert viewer._page.visits == 3


@pytest.mark.parametrize("timeout", [-1.0, float("nan"), "long"])
def test_a_wait_that_makes_no_sense_is_refused(viewer: Viewer, timeout: Any) -> None:
    with pytest.raises(rp.InputError, match="timeout"):
        viewer.wait(timeout)


def test_show_prints_the_address_and_opens_it_unless_it_is_quiet(
    rr1_table: rp.Scene, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setenv("DISPLAY", ":0")
    # Another test may have loaded it, and in notebooks viewers show themselves.
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    with show(rr1_table, options=rp.ViewOptions(port=0)) as viewer:
        assert capsys.readouterr().out == f"page: {viewer.url}\n"
        assert opened == [viewer.url]
    with show(rr1_table, options=rp.ViewOptions(port=0, quiet=True)):
        assert capsys.readouterr().out == ""
    assert len(opened) == 1


def test_a_motion_is_loaded_by_its_scene_and_trajectory(viewer: Viewer, rr1_table: rp.Scene) -> None:
    problem = rp.Problem(rr1_table, "home", rp.JointGoal("home"))
    motion = rp.MotionPlan(problem, rp.PlanResult(rp.PlanStatus.TIMEOUT, None))
    with pytest.raises(rp.InputError, match=r"MotionPlan.*load\(motion\.scene, trajectory=motion\.trajectory\)"):
        viewer.load(motion)


def test_a_page_without_a_planner_has_none_after_a_load(rr1_table: rp.Scene) -> None:
    q = rr1_table.configuration()
    motion = rp.Trajectory.from_samples(rr1_table.joint_names(), [0.0, 1.0], [q, q + 0.1])
    options = rp.ViewOptions(port=0, planner=False, clearances=False)
    with Viewer(rr1_table, trajectory=motion, options=options) as shown:
        shown.load(rr1_table.without_obstacle("ball"), trajectory=motion, options=rp.ViewOptions(title="another"))
        document, _ = shown.page_content()
        assert document["title"] == "another"
        assert document["planner"] is None
        assert document["samples"]["clearance"] is None


def test_ctrl_c_ends_wait_and_leaves_the_viewer_usable(
    viewer: Viewer, rr1_table: rp.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(_timeout: float | None) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(viewer._ended, "wait", interrupt)
    assert viewer.wait()
    viewer.update(rr1_table.configuration())
    assert "MeshCat" in fetch(viewer.url)


@pytest.mark.parametrize("bad", [[0.0], [float("nan")] * 6, "home", {"nobody": "home"}])
def test_a_bad_configuration_is_refused(viewer: Viewer, bad: Any) -> None:
    with pytest.raises(rp.InputError):
        viewer.update(bad)


def test_a_mapping_moves_some_arms_only(viewer: Viewer, rr1_table: rp.Scene) -> None:
    arm = next(iter(rr1_table.arms))
    viewer.update({arm: "home"})
    (frame,) = asyncio.run(listen(viewer, 1))
    np.testing.assert_array_equal(np.frombuffer(frame, "<f8"), rr1_table.arms[arm].robot.home)


def test_an_empty_mapping_changes_nothing_in_a_scene_without_arms() -> None:
    with show(rp.Scene(name="bare"), options=rp.ViewOptions(port=0, quiet=True)) as viewer:
        viewer.update({})
        (frame,) = asyncio.run(listen(viewer, 1))
    assert len(frame) == 0


def test_a_notebook_holds_the_whole_page(viewer: Viewer) -> None:
    text = viewer._repr_html_()
    assert text.startswith("<iframe srcdoc=")
    assert "<script" not in text
    assert "MeshCat" in text
    assert f"connect-src {viewer.url.replace('http', 'ws')}updates;" in html.unescape(html.unescape(text))


def test_a_viewer_in_a_notebook_may_follow_with_its_token(viewer: Viewer, rr1_table: rp.Scene) -> None:
    viewer.update(rr1_table.configuration())
    for origin in ("null", "http://localhost:8888", "https://hub.example"):
        (frame,) = asyncio.run(listen(viewer, 1, Origin=origin))
        np.testing.assert_array_equal(np.frombuffer(frame, "<f8"), rr1_table.configuration())


def test_without_the_token_nothing_is_told_and_nothing_heard(viewer: Viewer, rr1_table: rp.Scene) -> None:
    heard: list[object] = []
    viewer.on_slider(lambda *moved: heard.append(moved))
    viewer.update(rr1_table.configuration())

    async def try_to_act() -> list[Any]:
        connection = await websocket_connect(updates(viewer, token="guessed"))
        with contextlib.suppress(WebSocketClosedError):
            await connection.write_message('{"type": "slider", "column": 1, "value": 0.5}')
        told = []
        while (message := await asyncio.wait_for(connection.read_message(), 20)) is not None:
            told.append(json.loads(message))
        connection.close()
        return told

    assert asyncio.run(try_to_act()) == [{"type": "reload"}]
    # The same message is accepted from a page with the token.
    asyncio.run(asyncio.wait_for(_act(viewer, heard), 20))
    assert heard == [("rr1/upper_arm_joint", 0.25)]
    assert viewer._page.visits == 1


async def _act(viewer: Viewer, heard: list[object]) -> None:
    connection = await websocket_connect(updates(viewer))
    await connection.write_message('{"type": "slider", "column": 1, "value": 0.25}')
    while not heard:
        await asyncio.sleep(0.01)
    await close(connection)


def test_tokens_differ_and_stand_in_the_page_alone(viewer: Viewer, rr1_table: rp.Scene) -> None:
    with Viewer(rr1_table, options=rp.ViewOptions(port=0)) as other:
        token = token_in(fetch(viewer.url))
        assert token != token_in(fetch(other.url))
        assert len(token) > 20
        assert token not in viewer.url


def test_other_websites_can_neither_frame_nor_read_the_page(viewer: Viewer) -> None:
    with urllib.request.urlopen(viewer.url, timeout=20) as answer:
        headers = answer.headers
    assert headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert headers["Access-Control-Allow-Origin"] is None


def test_viewers_share_one_port_and_one_thread(rr1_table: rp.Scene, planar2r: rp.Robot) -> None:
    before = threading.active_count()
    flat = rp.Scene(name="flat").with_arm("arm", planar2r)
    with Viewer(rr1_table) as one, Viewer(flat) as two:
        assert threading.active_count() == before + 1
        assert two.url == f"{one.url}2/"
        assert [re.search("<title>(.*)</title>", fetch(v.url))[1] for v in (one, two)] == ["rr1_table", "flat"]
        one.update(rr1_table.configuration() + 0.1)
        two.update([0.3, 0.4])
        frames = [asyncio.run(listen(v, 1))[0] for v in (one, two)]
        assert [len(frame) for frame in frames] == [8 * 6, 8 * 2]
        # A page's token is invalid for other pages.
        assert json.loads(asyncio.run(listen(two, 1, token=token_in(fetch(one.url))))[0]) == {"type": "reload"}
        one.close()
        assert one.closed
        assert not two.closed
        with pytest.raises(urllib.error.HTTPError, match="404") as caught:
            fetch(one.url)
        caught.value.close()
        with pytest.raises(rp.InputError, match="closed"):
            one.update(rr1_table.configuration())
        two.update([0.5, 0.6])
        with Viewer(rr1_table) as third:
            assert third.url == one.url
    assert threading.active_count() == before
    with Viewer(flat) as later:
        assert later.url == one.url


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_what_is_not_finite_is_never_sent(rr1_table: rp.Scene, bad: float) -> None:
    panel = rp.Panel("own", "Own", data={"value": 1.0})
    with Viewer(rr1_table, options=rp.ViewOptions(port=0, panels=[panel])) as viewer:

        async def follow() -> list[Any]:
            listening = asyncio.ensure_future(listen(viewer, 1))
            while viewer.pages == 0:
                await asyncio.sleep(0.01)
            calls = (
                lambda: viewer.update([bad] * 6),
                lambda: viewer.update({"rr1": [0, 0, 0, 0, 0, bad]}),
                lambda: viewer.seek(bad),
                lambda: viewer.set_speed(bad),
                lambda: viewer.update_panel("own", {"value": bad}),
                lambda: viewer.load(rr1_table, trajectory=rp.Trajectory.rest(rr1_table.joint_names(), [bad] * 6)),
            )
            for call in calls:
                with pytest.raises(rp.InputError):
                    call()
            viewer.pause()
            return await listening

        # The first message is from the only valid call.
        assert json.loads(asyncio.run(follow())[0])["type"] == "pause"


def test_ctrl_c_ends_the_program_and_leaves_nothing(tmp_path: FilePath) -> None:
    script = tmp_path / "program.py"
    script.write_text(
        "import rr1plan as rp\n"
        "viewer = rp.show(rp.load_scene('rr1_table'), options=rp.ViewOptions(port=0))\n"
        "viewer.wait()\n"
        "print('after', flush=True)\n"
    )
    with subprocess.Popen(
        [sys.executable, script],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")},
    ) as program:
        assert program.stdout is not None
        url = program.stdout.readline().removeprefix("page: ").strip()
        assert "MeshCat" in fetch(url)
        program.send_signal(signal.SIGINT)
        said, _ = program.communicate(timeout=60)
    assert (program.returncode, said) == (0, "after\n")
    with pytest.raises(urllib.error.URLError):
        fetch(url)
    # Nothing of its session is left.
    with pytest.raises(ProcessLookupError):
        os.killpg(program.pid, 0)


def test_a_forked_process_keeps_neither_the_port_nor_the_browsers(tmp_path: FilePath) -> None:
    script = tmp_path / "program.py"
    script.write_text(
        "import os, sys\n"
        "import rr1plan as rp\n"
        "viewer = rp.Viewer(rp.load_scene('rr1_table'), options=rp.ViewOptions(port=0))\n"
        "print(viewer.url, flush=True)\n"
        "sys.stdin.readline()\n"
        "if os.fork():\n"
        "    os._exit(0)\n"
        "print(viewer.closed, flush=True)\n"
        "with rp.Viewer(rp.load_scene('rr1_table'), options=rp.ViewOptions(port=0)) as own:\n"
        "    print(own.url != viewer.url, flush=True)\n"
        "sys.stdin.readline()\n"
    )
    with subprocess.Popen(
        [sys.executable, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        url = program.stdout.readline().strip()
        host, port = url.removeprefix("http://").rstrip("/").split(":")
        with socket.create_connection((host, int(port)), timeout=20) as browser:
            browser.sendall(f"GET /none HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
            assert b"404" in browser.recv(4096)
            program.stdin.write("\n")
            program.stdin.flush()
            assert [program.stdout.readline().strip() for _ in range(2)] == ["True", "True"]
            # The parent has ended, its child has not.
            assert browser.recv(4096) == b""
        with pytest.raises(urllib.error.URLError):
            fetch(url)
        program.stdin.write("\n")
        program.stdin.flush()
