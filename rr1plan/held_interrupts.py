"""Ctrl-C where it must not take effect at once: in a step of a simulation, or in imports that ignore it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Self


class HeldInterrupts:
    """Holds back a Ctrl-C in the main thread while its `with` block is executed; a second one takes effect at once."""

    def __init__(self) -> None:
        self._inside = False
        self._held: tuple[int, FrameType | None] | None = None
        self._handler: Callable[[int, FrameType | None], object] = signal.default_int_handler

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Handle Ctrl-C, which takes 30 us to set up; no effect in other threads, or if Ctrl-C is ignored."""
        before = signal.getsignal(signal.SIGINT)
        if threading.current_thread() is not threading.main_thread() or not callable(before):
            yield
            return

        self._handler = before

        def handle(number: int, frame: FrameType | None) -> None:
            if self._inside and self._held is None:
                self._held = number, frame
            else:
                before(number, frame)

        signal.signal(signal.SIGINT, handle)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, before)

    def __enter__(self) -> Self:
        self._inside, self._held = True, None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._inside = False
        held, self._held = self._held, None
        if held is not None and kind is None:
            self._handler(*held)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Context at whose end a Ctrl-C in the main thread takes effect, for imports of modules that catch all errors."""
    held = HeldInterrupts()
    with held.installed(), held:
        yield
