# mypy: disable-error-code="no-untyped-call,no-any-return,misc"
"""Functions as units of machine code, so that each is optimised and translated once.

Numba makes machine code of every function by itself, and then, with all that it calls, once more for each caller. Here
a function is one of two:

* a part has no machine code of its own: numba types it and writes it down, and it becomes code within each unit that
  calls it;
* a unit is a function with all the parts it calls. Other units call it by its address. Its symbol is named by its text,
  so that kept code finds it again in another process.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult, Flags, compile_extra
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack
from numba.core.types.misc import unliteral
from numba.core.typing.templates import AbstractTemplate, make_concrete_template, signature

# What loads or compiles a unit that others call, by its identity.
_builders: dict[str, Callable[[], object]] = {}
_known_calls: dict[tuple[int, ...], Any] = {}


class Unit(JITCodeLibrary):
    """Machine code of a function and of all parts it calls.

    Attributes:
        identity: Of the function and all that it calls; "" where nobody else can name it.
        needs: Identities of the units that it calls.
    """

    identity = ""
    needs: tuple[str, ...] = ()

    def finalize(self) -> None:
        """Optimise and translate it, with the parts linked in."""
        linked = _linked(self)
        self.needs = tuple(library.identity for library in linked if isinstance(library, Unit))
        for library in linked:
            if isinstance(library, _Part):
                self._final_module.link_in(library._final_module, preserve=True)
        self._linking_libraries = [library for library in linked if not isinstance(library, (_Part, Unit))]
        super().finalize()

    def _get_module_for_linking(self) -> Any:
        """Nothing: others call it by its address."""
        return llvm.parse_assembly(str(self._codegen._create_empty_module(self.name)))


class _Part(JITCodeLibrary):
    """A function that is written down, neither optimised as a whole nor translated."""

    _shared_module: Any

    def finalize(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """The function and all parts it calls, for callers that numba compiles in its own way."""
        if self._shared_module is None:
            whole = self._final_module.clone()
            for library in _linked(self):
                inner = library._final_module if isinstance(library, _Part) else library._get_module_for_linking()
                whole.link_in(inner, preserve=True)
            self._shared_module = whole
        return self._shared_module


def _linked(library: Any) -> list[Any]:
    """What a library calls, and what the parts among that call, each once."""
    seen: dict[Any, None] = {}
    ahead = library._linking_libraries[::-1]
    while ahead:
        one = ahead.pop()
        if one not in seen:
            seen[one] = None
            if isinstance(one, _Part):
                ahead += one._linking_libraries[::-1]
    return list(seen)


def unit_compiler(identity: str = "", stamp: str | None = None) -> type[Compiler]:
    """How numba compiles a unit: `numba.njit(pipeline_class=unit_compiler())`.

    Args:
        identity: See `Unit`.
        stamp: A word for the text of the function and of all that it calls, which becomes part of its symbol.
    """

    class UnitCompiler(Compiler):
        def __init__(self, typing: Any, target: Any, library: Any, *rest: Any) -> None:
            super().__init__(typing, target, library, *rest)
            self.state.library = Unit(target.codegen(), identity or "unit")
            self.state.library.identity = identity
            self.state.library.enable_object_caching()

        def _compile_bytecode(self) -> Any:
            if stamp is not None:
                self.state.func_id.unique_id = stamp
            return super()._compile_bytecode()

    return UnitCompiler


def lower_part(function: Any, options: dict[str, Any], arguments: Iterable[Any], result: Any = None) -> CompileResult:
    """Type a function and write it down as a part.

    Args:
        function: The function.
        options: Numba's options.
        arguments: Types of its arguments.
        result: Type of its result; None finds it.
    """
    flags, context = Flags(), cpu_target.target_context
    cpu_target.options.parse_as_flags(flags, {"nopython": True, "boundscheck": None, **options})
    flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
    library = _Part(context.codegen(), function.__qualname__)
    made = compile_extra(cpu_target.typing_context, context, function, tuple(arguments), result, flags, {}, library)
    library.finalize()
    return made


def callable_type(name: str, key: object, its_signature: Any, made: CompileResult) -> Any:
    """The type by which others call what was compiled for one signature.

    Args:
        name: Of the function, for messages.
        key: The function, as numba finds it in those that call it.
        its_signature: Numba's types of result and arguments.
        made: A part or a unit.
    """
    cpu_target.target_context.insert_user_function(key, made.fndesc, [made.library])
    return types.Function(make_concrete_template(name, key, [its_signature]))


def generic_type(its_key: object, lower: Callable[[tuple[Any, ...]], CompileResult]) -> Any:
    """The type by which others call a part for whatever types they have.

    Args:
        its_key: The function, as numba finds it in those that call it.
        lower: Writes it down for types of arguments.
    """
    signatures: dict[tuple[Any, ...], Any] = {}

    class Template(AbstractTemplate):
        key = its_key

        def generic(self, arguments: Any, keywords: Any) -> Any:
            known = tuple(unliteral(kind) for kind in arguments)
            if known not in signatures and not keywords:
                made = lower(known)
                cpu_target.target_context.insert_user_function(its_key, made.fndesc, [made.library])
                signatures[known] = signature(made.fndesc.restype, *made.fndesc.argtypes)
            return None if keywords else signatures[known]

    return types.Function(Template)


def offer(identity: str, build: Callable[[], object]) -> None:
    """Say how a unit is made ready when kept code calls it."""
    _builders[identity] = build


def make_ready(identities: Iterable[str]) -> bool:
    """Load or compile units; False if one of them is not known."""
    builders = [_builders.get(identity) for identity in identities]
    for build in builders:
        if build is None:
            return False
        build()
    return True


@contextmanager
def sooner() -> Iterator[None]:
    """Compile inside this without what takes numba a third of its time.

    Garbage is left alone, of which a compiler makes little. What a call of a function with certain types gives is
    remembered: numba works it out some fifteen times, from all that is known by the function's name.
    """
    if _known_calls:
        yield
        return
    functions: Any = types.BaseFunction
    was, ask = gc.isenabled(), functions.get_call_type

    def remembered(self: Any, context: Any, arguments: Any, keywords: Any) -> Any:
        if keywords:
            return ask(self, context, arguments, keywords)
        # Equal types are one object; the options of each function that is compiled another one.
        options = ConfigStack.top_or_none()
        key = (id(options), id(self), *map(id, arguments))
        if key not in _known_calls:
            answer = ask(self, context, arguments, keywords)
            _known_calls[key] = answer, self._impl_keys[answer.args], (options, self, arguments)
        answer, self._impl_keys[answer.args], _ = _known_calls[key]
        return answer

    _known_calls[()] = None
    gc.disable()
    functions.get_call_type = remembered
    try:
        yield
    finally:
        functions.get_call_type = ask
        _known_calls.clear()
        if was:
            gc.enable()
