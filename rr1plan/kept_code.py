# mypy: disable-error-code="no-untyped-call,no-any-return,misc"
"""Machine code that numba kept, loaded for calls alone.

Before numba looks for kept code it makes its tables of all it can compile, with `scipy.linalg` among them; then it
reads the code once more in the form in which other functions are compiled with it. Both take longer than the
rest, and nobody needs them who only calls a function. Units that the code calls by address are made ready before it.
"""

from __future__ import annotations

from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys

from rr1plan.code_units import Unit, make_ready

# Another number whenever something else is kept.
_FORMAT = 2


class _Code(CompileResultCacheImpl):
    """Of what numba keeps that which calls need."""

    def reduce(self, data: Any) -> Any:
        library, descriptor = data.library, data.fndesc
        # Numba does not keep them either.
        descriptor.typemap = descriptor.calltypes = None
        function = (descriptor, data.environment, data.signature, data.objectmode)
        return library.identity, library._get_compiled_object(), function, data.reload_init, library.needs

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        # Unknown ones belong to another text.
        return _callable(target_context, *payload) if make_ready(payload[-1]) else None


class _Kept(FunctionCache):
    _impl_class = _Code

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return *super()._index_key(sig, codegen), _FORMAT

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)
        return self._load_overload(sig, target_context)


def keep(dispatcher: Any) -> str:
    """Keep the code of a unit on disk.

    Args:
        dispatcher: What `numba.njit` with `code_units.unit_compiler` makes of the function.

    Returns:
        The folder that keeps it.

    Raises:
        RuntimeError: there is no folder to keep it in.
    """
    dispatcher._cache = _Kept(dispatcher.py_func)
    return dispatcher._cache.cache_path


def is_kept(dispatcher: Any, signature: Any) -> bool:
    """Whether code of a function that is kept on disk is there."""
    cache = dispatcher._cache
    return cache._index_key(signature, dispatcher.targetctx.codegen()) in cache._cache_file._load_index()


def _callable(context: Any, identity: str, code: bytes, function: Any, starts: Any, needs: Any) -> CompileResult:
    """A function whose machine code is handed to the linker, and no more."""
    descriptor, environment, signature, in_python = function
    for start in starts:
        start()
    library = Unit(context.codegen(), identity or "unit")
    library.identity, library.needs = identity, needs
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
