"""Latency of messages from the planner to the viewer."""

from __future__ import annotations

import asyncio
import json
import queue
import threading
import time

import numpy as np
from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import WebSocketClientConnection, websocket_connect

from rr1plan.errors import BackendError
from rr1plan.playback.viewer.live_viewer import Viewer
from rr1plan.playback.viewer.view_options import Panel, ViewOptions
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_robot

_PATIENCE = 30.0  # [s]
_WARM_UP = 5  # messages that do not count
_LARGEST = 1 << 30  # largest message that the client accepts [bytes]
_PANEL = "latency"


def measure_latency(size: int, *, repeats: int = 200, seed: int = 0) -> dict[str, float]:
    """Send messages from a live viewer to a client on this machine, one after the other.

    The client takes the place of the page: it connects to the same websocket, parses each message and acknowledges it.

    Args:
        size: Approximate size of a message [bytes].
        repeats: Number of messages.
        seed: Seed of their content.

    Returns:
        Measurements by name: times from before a message is created until it is parsed, and until its acknowledgment.
    """
    letters = np.random.default_rng(seed).integers(97, 123, size, dtype=np.uint8).tobytes().decode()
    arrivals: queue.Queue[float] = queue.Queue()
    acknowledged: queue.Queue[float] = queue.Queue()
    options = ViewOptions(port=0, panels=(Panel(_PANEL, "Latency", data={}),))
    scene = Scene().with_arm("rr1", load_robot("rr1"))
    arrived, returned = [], []
    with Viewer(scene, options=options) as viewer:
        viewer.on_slider(lambda _joint, _value: acknowledged.put(time.perf_counter()))
        client = threading.Thread(target=lambda: asyncio.run(_acknowledge(viewer.url, arrivals)), daemon=True)
        client.start()
        _wait_for_page(viewer)
        for i in range(_WARM_UP + repeats):
            sent = time.perf_counter()
            viewer.update_panel(_PANEL, {"number": i, "content": letters})
            try:
                returned.append(acknowledged.get(timeout=_PATIENCE) - sent)
            except queue.Empty:
                raise BackendError(f"no acknowledgment of message {i} within {_PATIENCE:g} s") from None
            arrived.append(arrivals.get(timeout=_PATIENCE) - sent)
    client.join(_PATIENCE)
    one_way, round_trip = (1e3 * np.array(times[_WARM_UP:]) for times in (arrived, returned))
    return {
        "bytes": size,
        "messages": repeats,
        "latency_median_ms": float(np.median(one_way)),
        "latency_p95_ms": float(np.percentile(one_way, 95)),
        "round_trip_median_ms": float(np.median(round_trip)),
        "round_trip_p95_ms": float(np.percentile(round_trip, 95)),
    }


def _wait_for_page(viewer: Viewer) -> None:
    end = time.monotonic() + _PATIENCE
    while viewer.pages == 0:
        if time.monotonic() > end:
            raise BackendError(f"the client did not connect to {viewer.url} within {_PATIENCE:g} s")
        time.sleep(0.01)


async def _acknowledge(url: str, arrivals: queue.Queue[float]) -> None:
    """Acknowledge messages to the panel by moves of a slider, until the viewer closes."""
    page = (await AsyncHTTPClient().fetch(url)).body.decode()
    token = page.partition('"token":"')[2].partition('"')[0]  # the server requires the page's token
    address = f"{url.replace('http://', 'ws://')}updates?token={token}"
    connection: WebSocketClientConnection = await websocket_connect(address, max_message_size=_LARGEST)
    try:
        while (text := await connection.read_message()) is not None:
            message = json.loads(text)
            if message["type"] == "panels":
                number = message["value"][_PANEL]["number"]
                arrivals.put(time.perf_counter())
                await connection.write_message(json.dumps({"type": "slider", "column": 0, "value": number}))
    finally:
        connection.close()
