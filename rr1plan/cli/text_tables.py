"""Tables as text of a given width."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from textwrap import wrap

_GAP = "  "


def table_lines(columns: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> list[str]:
    """The lines of a table, first that of the names of its columns.

    Cells are wrapped where the table would be wider than `width`, but words stay whole: with long words, lines may be
    longer.

    Args:
        columns: Names of the columns.
        rows: Cells of each row.
        width: Width to fit into [characters].
    """
    widths = _widths([columns, *rows], width - len(_GAP) * (len(columns) - 1))
    return [line for row in (columns, *rows) for line in _row_lines(row, widths)]


def _widths(rows: Sequence[Sequence[str]], total: int) -> list[int]:
    """Widths of the columns: the widest are narrowed first, down to their longest words."""
    cells = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in cells]
    words = [max((len(word) for cell in column for word in cell.split()), default=0) for column in cells]
    while sum(widths) > total:
        wide = [k for k, w in enumerate(widths) if w > words[k]]
        if not wide:
            break
        widths[max(wide, key=widths.__getitem__)] -= 1
    return widths


def _row_lines(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    cells = [
        wrap(cell, max(w, 1), break_long_words=False, break_on_hyphens=False)
        for cell, w in zip(row, widths, strict=True)
    ]
    lines = zip_longest(*cells, fillvalue="")
    return [_GAP.join(part.ljust(w) for part, w in zip(line, widths, strict=True)).rstrip() for line in lines]
