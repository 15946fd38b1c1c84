"""Tables on terminals of any width: no word is lost."""

from __future__ import annotations

import pytest

from rr1plan.cli.text_tables import table_lines

COLUMNS = ("scene", "queries", "description")
ROWS = [
    ("one", "over_the_seam, to_a_point", "A planar 2R arm among five round obstacles, whose ends are both free."),
    ("number_two", "", "An RR1."),
]


@pytest.mark.parametrize("width", [10, 40, 50, 60, 80, 10_000])
def test_a_table_keeps_every_word_at_any_width(width: int) -> None:
    names, *lines = table_lines(COLUMNS, ROWS, width)
    assert names.split() == list(COLUMNS)
    starts = [names.index(name) for name in COLUMNS] + [None]
    second = next(k for k, line in enumerate(lines) if line.startswith("number_two"))
    for row, own in zip(ROWS, (lines[:second], lines[second:]), strict=True):
        for cell, begin, end in zip(row, starts[:-1], starts[1:], strict=True):
            assert " ".join(line[begin:end].strip() for line in own).split() == cell.split()
    longest = max(map(len, lines))
    assert longest <= max(width, len("number_two  over_the_seam,  description"))
    assert (len(lines) == len(ROWS)) == (width == 10_000)
