"""Types of the values of options: file names and numbers, checked while the command line is parsed."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any


def file_name(text: str) -> str:
    """A file name; "-" is standard output."""
    if not text or "\0" in text:
        raise argparse.ArgumentTypeError(f"{text!r} is not a file name")
    return text


def named_file(text: str) -> str:
    """A file or folder other than standard output."""
    if file_name(text) == "-":
        raise argparse.ArgumentTypeError("'-' is standard output, expected a name")
    return text


def file_of(*suffixes: str) -> Callable[[str], str]:
    """A file name that ends in one of some suffixes."""

    def check(text: str) -> str:
        if not file_name(text).lower().endswith(suffixes):
            raise argparse.ArgumentTypeError(f"{text!r} does not end in {' or '.join(suffixes)}")
        return text

    return check


def _number(text: str, kind: Callable[[str], float], accept: Callable[[float], bool], wanted: str) -> Any:
    try:
        value = kind(text)
        valid = math.isfinite(value) and accept(value)
    except (ValueError, OverflowError):  # not a number; an integer beyond the range of float
        valid = False
    if not valid:
        raise argparse.ArgumentTypeError(f"{text.strip()!r} is not {wanted}")
    return value


def finite(text: str) -> float:
    """A finite number."""
    return float(_number(text, float, lambda v: True, "a finite number"))


def positive(text: str) -> float:
    """A finite number above zero."""
    return float(_number(text, float, lambda v: v > 0.0, "a number above zero"))


def time_limit(text: str) -> float:
    """A number above zero, or "inf" for no limit."""
    return math.inf if text.strip() == "inf" else positive(text)


def distance(text: str) -> float:
    """A finite number, zero or above."""
    return float(_number(text, float, lambda v: v >= 0.0, "a distance >= 0"))


def count(text: str) -> int:
    """A whole number above zero."""
    return int(_number(text, int, lambda v: v > 0, "a whole number above zero"))


def seed(text: str) -> int:
    """A whole number, zero or above."""
    return int(_number(text, int, lambda v: v >= 0, "a seed, a whole number >= 0"))
