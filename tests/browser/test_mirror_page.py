"""The page of a mirror, and sliders of a page that move simulated joints."""

from __future__ import annotations

from queue import Queue
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.playback.viewer.page_capture import wait_until

pytestmark = pytest.mark.browser

CONNECTED = "window.RR1 && RR1.ready && RR1.live.socket && RR1.live.socket.readyState === 1"


def test_the_panel_shows_deviations_and_turns_red_outside_the_corridor(tab: Any) -> None:
    scene = rp.load_scene("rr1_table")
    names = scene.joint_names()
    still = rp.Trajectory.from_samples(names, [0.0, 1.0], [scene.configuration()] * 2)
    page = tab.page
    with rp.Mirror(scene, still) as mirror:
        viewer = mirror.show(options=rp.ViewOptions(quiet=True, port=0))
        page.goto(viewer.url)
        wait_until(page, "window.RR1 && RR1.ready && RR1.live.socket && RR1.live.socket.readyState === 1")
        assert page.locator("#badge").is_hidden()  # it would say "Not checked" beside the verdict
        for k, off in enumerate((0.0, 0.001, 0.5)):
            q = scene.configuration() + off * np.eye(6)[0]
            mirror.receive(rp.StateMessage(float(k), names, q, received=float(k)))
            wait_until(page, f"document.querySelector('#panel-mirror .facts').textContent.startsWith('{k}.00 s')")
            verdict = tab.ask("document.querySelector('#panel-mirror .verdict').className")
            assert verdict == ("verdict bad" if off == 0.5 else "verdict good")
        wait_until(page, f"Math.abs(RR1.q[0] - {q[0]}) < 1e-9")
        shown = tab.ask("[...document.querySelectorAll('#panel-mirror .deviation')].map((row) => row.innerText)")
        assert shown[1].split() == ["shoulder_joint", "28.65°", "28.65°"]
        assert shown[2].split() == ["upper_arm_joint", "0.00°", "0.00°"]
        assert tab.ask("document.getElementById('clock').textContent") == "live"
        assert "left the certified corridor" in tab.ask("document.querySelector('#panel-mirror .event').textContent")
        fingers = (*names, "rr1/finger_joint")
        mirror.receive(rp.StateMessage(3.0, fingers, [*scene.configuration(), 0.3], received=3.0))
        wait_until(page, "document.querySelector('#panel-mirror .verdict').className === 'verdict open'")
        verdict = tab.ask("document.querySelector('#panel-mirror .verdict').textContent")
        assert verdict == "Not proven: the plan assumes rr1/finger_joint and rr1/opposite_finger_joint elsewhere"
        state = {"time": 4.0, "rate": 1.0, "delay": 0.0, "deviation": None, "use": None, "pair": None, "contacts": []}
        viewer.update_panel("mirror", {"state": {**state, "moved": ["a", "b", "c"]}})
        wait_until(page, "document.querySelector('#panel-mirror .verdict').innerText.endsWith('a, b and c elsewhere')")
    assert tab.complaints == []


def test_the_panel_says_that_messages_end(tab: Any) -> None:
    scene = rp.load_scene("rr1_table")
    names, q = scene.joint_names(), scene.configuration()
    still = rp.Trajectory.from_samples(names, [0.0, 1.0], [q, q])
    silence = rp.StreamError("silence", "no message for 1 s")
    panel = "document.querySelector('#panel-mirror')"

    def shown(part: str, begin: str) -> str:
        return f"{panel}.querySelector('.{part}').textContent.startsWith('{begin}')"

    with rp.Mirror(scene, still) as mirror:
        viewer = mirror.show(options=rp.ViewOptions(quiet=True, port=0))
        tab.open(viewer.url, CONNECTED)
        mirror.receive(silence)
        wait_until(tab.page, f"{shown('verdict', 'No usable message yet')} && {shown('event', '0.00 s: no message')}")
        # The second state soon follows the first one, and so is not shown before the silence.
        for k in (1.0, 1.01):
            mirror.receive(rp.StateMessage(k, names, q, received=k))
        wait_until(tab.page, f"{shown('facts', '1.00 s')} && {shown('verdict', 'Inside')}")
        mirror.receive(silence)
        wait_until(tab.page, f"{shown('facts', '1.01 s')} && {shown('verdict', 'No usable message since 1.01 s')}")
        assert tab.ask(f"{panel}.querySelector('.verdict').className") == "verdict open"
        mirror.run([rp.StateMessage(k, names, q, received=k) for k in (2.0, 2.01)])
        wait_until(tab.page, f"{shown('facts', '2.01 s')} && {shown('verdict', 'Inside')}")
    assert tab.complaints == []


def test_a_page_opened_again_replaces_the_first_and_shows_the_latest_state(tab: Any) -> None:
    scene = rp.load_scene("rr1_table")
    names, q = scene.joint_names(), np.array(scene.configuration())
    with rp.Mirror(scene) as mirror:
        first = mirror.show(options=rp.ViewOptions(quiet=True, port=0))
        mirror.receive(rp.StateMessage(0.5, names, q + 0.1, received=0.5))
        again = mirror.show(options=rp.ViewOptions(quiet=True, port=0))
        assert first.closed
        tab.open(again.url, CONNECTED)
        wait_until(tab.page, "document.querySelector('#panel-mirror .facts').textContent.startsWith('0.50 s')")
        wait_until(tab.page, f"Math.abs(RR1.q[0] - {q[0] + 0.1}) < 1e-9")
    assert again.closed


def test_deviations_of_slides_are_lengths(tab: Any) -> None:
    scene = rp.Scene().with_arm("arm", rp.planar_arm("PR"))
    names, q = scene.joint_names(), scene.configuration()
    still = rp.Trajectory.from_samples(names, [0.0, 1.0], [q, q])
    with rp.Mirror(scene, still) as mirror:
        viewer = mirror.show(options=rp.ViewOptions(quiet=True, port=0))
        tab.page.goto(viewer.url)
        wait_until(tab.page, "window.RR1 && RR1.ready && RR1.live.socket && RR1.live.socket.readyState === 1")
        mirror.receive(rp.StateMessage(0.0, names, np.add(q, [0.0125, -0.1]), received=0.0))
        wait_until(tab.page, "document.querySelector('#panel-mirror .facts').textContent.startsWith('0.00 s')")
        rows = "[...document.querySelectorAll('#panel-mirror .deviation')].slice(1)"
        shown = [text.split()[1] for text in tab.ask(f"{rows}.map((row) => row.innerText)")]
        assert shown == ["12.50", "−5.73°"]
        assert "12.50 mm" in tab.ask(f"{rows}[0].innerText")
        # Each bar is as long as the largest deviation of its kind.
        assert tab.ask(f"{rows}.map((row) => row.querySelector('b').style.width)") == ["50%", "50%"]
    assert tab.complaints == []


@pytest.mark.parametrize("planned", [False, True])
def test_measured_fingers_are_drawn(tab: Any, planned: bool) -> None:
    scene = rp.load_scene("rr1_table")
    names, q = scene.joint_names(), scene.configuration()
    still = rp.Trajectory.from_samples(names, [0.0, 1.0], [q, q]) if planned else None
    opened = scene.arms["rr1"].robot.with_locked_joints({"finger_joint": 0.3})
    with rp.Mirror(scene, still) as mirror:
        viewer = mirror.show(options=rp.ViewOptions(quiet=True, port=0))
        tab.open(viewer.url, CONNECTED)
        mirror.receive(rp.StateMessage(0.0, (*names, "rr1/finger_joint"), [*q, 0.3], received=0.0))
        wait_until(tab.page, "RR1.joints.length > 6 && Math.abs(RR1.q[6] - 0.3) < 1e-9")
        for link in ("finger_link", "opposite_finger_link"):
            drawn = np.reshape(tab.ask(f"RR1.linkPose('rr1/{link}')"), (4, 4)).T
            np.testing.assert_allclose(drawn, rp.Kinematics(opened).pose(q, link), atol=1e-6)
    assert tab.complaints == []


def test_a_slider_moves_a_simulated_joint(tab: Any) -> None:
    scene = rp.load_scene("rr1_table")
    sim, page = rp.Simulation(scene), tab.page
    manual = rp.ManualController(scene.joint_names(), speed=1.0)
    sim.activate(manual)
    moved_joints: Queue[str] = Queue()

    def move(joint: str, value: float) -> None:
        manual.move(joint, value)
        moved_joints.put(joint)

    with rp.show(scene, options=rp.ViewOptions(quiet=True, port=0)) as viewer:
        viewer.on_slider(move)
        sim.on_step(lambda now: viewer.update(now.configuration()))
        page.goto(viewer.url)
        wait_until(page, "window.RR1 && RR1.ready && RR1.live.socket && RR1.live.socket.readyState === 1")
        slider = page.locator("#joint-0")
        slider.focus()
        before = sim.configuration()[0]
        for _ in range(3):
            slider.press("ArrowRight")
            assert moved_joints.get(timeout=60) == "rr1/shoulder_joint"
            sim.run(duration=0.5)
        moved = sim.configuration()[0] - before
        assert moved > 0.01
        wait_until(page, f"Math.abs(RR1.q[0] - {sim.configuration()[0]}) < 1e-9")
    assert tab.complaints == []
