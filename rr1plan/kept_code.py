# mypy: disable-error-code="no-untyped-call,no-any-return,misc"
"""Machine code that numba kept, loaded for calls alone.

Before numba looks for kept code it makes its tables of all it can compile, with `scipy.linalg` among them; then it
reads the code once more in the form in which other functions are compiled with it. Both take longer than the
rest, and nobody needs them who only calls a function.
"""

from __future__ import annotations

import pickle
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

# Another number whenever something else is kept.
_FORMAT = 1
# In what numba keeps: its function, and what has to run before it.
_FUNCTION, _STARTS = slice(1, 5), 7


class _Parts(CompileResultCacheImpl):
    """What numba keeps, with that which only compiling needs as bytes that are not looked at."""

    def reduce(self, data: Any) -> Any:
        whole = super().reduce(data)
        name, kind, (code, module) = whole[0]
        return name, code, whole[_FUNCTION], whole[_STARTS], dumps(((name, kind, (None, module)), *whole[1:]))

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        try:
            return _callable(target_context, *payload[:-1])
        except (AttributeError, TypeError):
            # A numba that does this another way.
            return _linkable(target_context, payload)


class _Whole(_Parts):
    """The same, read as a whole."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        return _linkable(target_context, payload)


class _ForCompiling(FunctionCache):
    _impl_class = _Whole

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return *super()._index_key(sig, codegen), _FORMAT


class _ForCalls(_ForCompiling):
    _impl_class = _Parts

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)
        return self._load_overload(sig, target_context)


def keep(dispatcher: Any, for_compiling: bool = False) -> None:
    """Keep the code of a function on disk.

    Args:
        dispatcher: What `numba.njit` makes of the function.
        for_compiling: Code that is kept is loaded so that other functions can be compiled with it.

    Raises:
        RuntimeError: there is no folder to keep it in.
    """
    dispatcher._cache = (_ForCompiling if for_compiling else _ForCalls)(dispatcher.py_func)


def is_kept(dispatcher: Any, signature: Any) -> bool:
    """Whether code of a function that is kept on disk is there."""
    cache = dispatcher._cache
    return cache._index_key(signature, dispatcher.targetctx.codegen()) in cache._cache_file._load_index()


def _callable(context: Any, name: str, code: bytes, function: Any, starts: Any) -> CompileResult:
    """A function whose machine code is handed to the linker, and no more."""
    descriptor, environment, signature, in_python = function
    for start in starts:
        start()
    library = context.codegen().create_library(name)
    library.enable_object_caching()
    library._set_compiled_object(code)
    library._finalize_final_module()
    # The only name that is asked for.
    library.codegen._engine._defined_symbols.add(descriptor.llvm_cpython_wrapper_name)
    known = {
        "target_context": context,
        "typing_context": context.typing_context,
        "library": library,
        "environment": environment,
        "entry_point": context.get_executable(library, descriptor, environment),
        "fndesc": descriptor,
        "signature": signature,
        "objectmode": in_python,
        "lifted": (),
        "reload_init": starts,
        "referenced_envs": (),
    }
    return CompileResult(**{field: known.get(field) for field in CompileResult._fields})


def _linkable(context: Any, payload: Any) -> CompileResult:
    """The same as numba makes it."""
    _, code, _, _, rest = payload
    (name, kind, (_, module)), *others = pickle.loads(rest)
    return CompileResult._rebuild(context, (name, kind, (code, module)), *others)
