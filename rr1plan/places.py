# mypy: disable-error-code="no-untyped-call,no-any-return,misc,attr-defined,untyped-decorator"
"""Named tuples of arrays by their address, between compiled functions.

Numba hands a tuple of fifty arrays over as four hundred numbers, in every call. To write that down takes longer than to
compile what the functions do. Here one address goes over, and each function reads the fields it uses.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, register_model


class Place(types.Type):
    """Numba's type of the address of a named tuple.

    Args:
        kind: Numba's type of the tuple.
        fixed: What is there never changes, not even before the function is called.
    """

    def __init__(self, kind: Any, fixed: bool) -> None:
        super().__init__(name=f"place({kind}, {fixed})")
        self.kind, self.fixed = kind, fixed

    @property
    def mangling_args(self) -> Any:
        """What tells the symbols of functions apart; names of all fields would make them endless."""
        return self.__class__.__name__, [self.kind.instance_class.__name__]


def place(kinds: Iterable[Any], named: Any) -> Place:
    """The type of the address of a named tuple that never changes.

    Args:
        kinds: Numba's types of its fields.
        named: The class of the tuple.
    """
    return Place(types.NamedTuple(kinds, named), True)


@intrinsic
def placed(typing_context: Any, value: Any) -> Any:
    """Put a named tuple into memory, for as long as the function runs. Somebody else has to keep its arrays alive."""

    def lower(context: Any, builder: Any, its_signature: Any, arguments: Any) -> Any:
        return cgutils.alloca_once_value(builder, arguments[0])

    return Place(value, False)(value), lower


def read(context: Any, builder: Any, kind: Any, address: Any, fixed: bool = True) -> Any:
    """Code that reads what is in memory.

    Args:
        context: Numba's context of the target.
        builder: Where the code goes.
        kind: Numba's type of it; of what is kept by its address, a `Place`.
        address: Where it is.
        fixed: See `Place`.
    """
    if isinstance(kind, Place):
        return address
    if not isinstance(kind, (types.BaseTuple, types.Array)):
        value = builder.load(address)
        if fixed:
            value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value
    whole = ir.Constant(context.get_value_type(kind), ir.Undefined)
    for i, (name, its_kind) in enumerate(_fields_of(context, kind)):
        if name in ("meminfo", "parent"):
            # Nobody owns an array, as far as these functions know.
            part = context.get_constant_null(its_kind)
        else:
            part = read(context, builder, its_kind, cgutils.gep_inbounds(builder, address, 0, i), fixed)
        whole = builder.insert_value(whole, part, i)
    return whole


def _fields_of(context: Any, kind: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(kind, types.BaseTuple):
        return (("", part) for part in kind)
    model = context.data_model_manager[kind]
    return zip(model._fields, model._members, strict=True)


def layout(context: Any, kind: Any) -> Any:
    """LLVM's type of what `read` finds in memory."""
    if isinstance(kind, Place):
        return context.get_value_type(kind.kind)
    if isinstance(kind, types.BaseTuple) and not isinstance(kind, types.UniTuple):
        return ir.LiteralStructType([layout(context, part) for part in kind])
    return context.get_value_type(kind)


@register_model(Place)
class _Address(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, manager.lookup(kind.kind).get_value_type().as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):
    key = Place

    def generic_resolve(self, kind: Any, name: str) -> Any:
        fields = kind.kind.fields
        return kind.kind[fields.index(name)] if name in fields else None


@lower_getattr_generic(Place)
def _field(context: Any, builder: Any, kind: Any, address: Any, name: str) -> Any:
    i = kind.kind.fields.index(name)
    return read(context, builder, kind.kind[i], cgutils.gep_inbounds(builder, address, 0, i), kind.fixed)
