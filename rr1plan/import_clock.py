"""Measurement of the time of lazy imports."""

from __future__ import annotations


class ImportClock:
    """Accumulates the wall time of imports until it is read.

    Attributes:
        seconds: Wall time so far [s].
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._was_read = False

    def read_once(self) -> float:
        """The wall time so far [s] at the first call, 0 at later ones."""
        seconds, self._was_read = 0.0 if self._was_read else self.seconds, True
        return seconds


import_clock = ImportClock()
