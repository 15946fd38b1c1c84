"""Calls of native kernels, recorded with all memory that they receive, to be repeated by `core.wasm`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rr1plan.binding.c_memory import KernelStruct
from rr1plan.kernels import wasm_core
from rr1plan.kernels.planner_kernels import SOURCES, load_library


@dataclass(frozen=True, eq=False)
class Call:
    """One call.

    Args:
        question: Input of `replay` in `core_answers.js`: the kernel, a memory image, arguments, and writable parts.
        answer: The return value, and the numbers in structs and bytes of arrays after the call.
    """

    question: dict[str, Any]
    answer: list[Any]


class Recorder:
    """The native library, which records the calls of all kernels.

    Args:
        context: Addresses of a scene's tables and scratch memory, which have a separate image.
    """

    def __init__(self, context: tuple[int, int] = (0, 0)) -> None:
        self.calls: list[Call] = []
        self._context = dict(zip(context, ("scene", "scratch"), strict=True)) if any(context) else {}

    def __getattr__(self, kernel: str) -> Any:
        function = getattr(load_library(), kernel)
        return lambda *given: self._call(kernel, function, given)

    def questions(self) -> list[dict[str, Any]]:
        """The questions for `replay`."""
        return [call.question for call in self.calls]

    def answers(self) -> list[list[Any]]:
        """Results of the native kernels."""
        return [call.answer for call in self.calls]

    def _call(self, kernel: str, function: Any, given: Sequence[Any]) -> Any:
        roots: dict[str, Any] = {}
        arguments: list[Any] = []
        structs: dict[str, KernelStruct] = {}
        arrays: list[tuple[str, str | None, np.ndarray[Any, Any]]] = []
        for i, (one, kind) in enumerate(zip(given, SOURCES.prototypes[kernel].arguments, strict=True)):
            name = f"argument{i}"
            if isinstance(one, KernelStruct):
                roots[name] = structs[name] = one
                arrays += [(name, field, to) for field, to in one.targets.items() if isinstance(to, np.ndarray)]
            elif isinstance(one, np.ndarray):
                roots[name] = kind.removesuffix("*"), one
                arrays.append((name, None, one))
            arguments.append(name if name in roots else self._context.get(one, one))
        numbers = [(name, number_fields(struct)) for name, struct in structs.items()]
        sizes = [(name, field, array.nbytes) for name, field, array in arrays]
        question = {"kernel": kernel, "image": wasm_core.memory_image(**roots), "given": arguments}
        result = function(*given)
        answer = [result, *([float(getattr(structs[name].value, f)) for f in fields] for name, fields in numbers)]
        answer += [array.tobytes() for *_, array in arrays]
        self.calls.append(Call(question | {"numbers": numbers, "arrays": sizes}, answer))
        return result


def number_fields(struct: KernelStruct) -> list[str]:
    """The fields of a struct that are single numbers."""
    fields = SOURCES.structs[struct.name]
    return [f.name for f in fields if not f.pointer and isinstance(getattr(struct.value, f.name), int | float)]
