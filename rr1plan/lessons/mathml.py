"""Formulas of lessons as MathML, which browsers typeset without a library."""

from __future__ import annotations

import html
import re

_FENCES = "|(){}[]"


def math(*parts: str, block: bool = False) -> str:
    """A formula: `math("r", "≤", sub("l", 1), "+", sub("l", 2))`.

    Args:
        parts: Symbols, numbers and operators, or results of the functions below.
        block: Whether it is on a separate line.
    """
    display = ' display="block"' if block else ""
    return f"<math{display}>{''.join(map(_token, parts))}</math>"


def sub(symbol: str, index: str | int) -> str:
    """A symbol with an index."""
    return f"<msub>{_token(symbol)}{_token(str(index))}</msub>"


def power(symbol: str, exponent: str | int) -> str:
    """A symbol with an exponent."""
    return f"<msup>{_token(symbol)}{_token(str(exponent))}</msup>"


def root(*parts: str) -> str:
    """A square root."""
    return f"<msqrt>{''.join(map(_token, parts))}</msqrt>"


def fraction(above: str, below: str) -> str:
    """A fraction of two parts; `row` combines several parts into one."""
    return f"<mfrac>{_token(above)}{_token(below)}</mfrac>"


def row(*parts: str) -> str:
    """Several parts as one."""
    return f"<mrow>{''.join(map(_token, parts))}</mrow>"


def matrix(*rows: tuple[str, ...]) -> str:
    """A matrix in brackets."""
    cells = "".join(f"<mtr>{''.join(f'<mtd>{_token(cell)}</mtd>' for cell in line)}</mtr>" for line in rows)
    return f"<mrow><mo>[</mo><mtable>{cells}</mtable><mo>]</mo></mrow>"


def _token(part: str) -> str:
    if part.startswith("<m"):
        return part
    text = html.escape(part)
    if re.fullmatch(r"[\d.,]+", part):
        return f"<mn>{text}</mn>"
    if part in _FENCES:
        return f'<mo stretchy="false" lspace="0" rspace="0">{text}</mo>'
    # Names of functions are upright: MathML sets only single letters in italics.
    return f"<mi>{text}</mi>" if part.isalpha() else f"<mo>{text}</mo>"
