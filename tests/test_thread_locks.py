"""Objects with locks are created and deleted while Ctrl-C is pressed."""

from __future__ import annotations

import os
import signal
import time
from threading import Lock, Timer

import pytest

from rr1plan.thread_locks import per_process


class Owner:
    """An object with a lock."""

    def __init__(self) -> None:
        self.lock = per_process(self, "lock", Lock)


def make_owners(seconds: float, timer: Timer) -> None:
    timer.start()  # not before: on a busy machine Ctrl-C might come where nobody expects it
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        Owner()


def test_no_ctrl_c_is_lost_while_objects_with_locks_are_deleted() -> None:
    for _ in range(30):
        timer = Timer(0.005, os.kill, (os.getpid(), signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            make_owners(5.0, timer)
        timer.join()
