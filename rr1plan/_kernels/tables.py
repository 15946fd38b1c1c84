# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc,no-any-return,attr-defined"
"""Array types whose elements kernels reach with the least arithmetic.

Numba asks of every index whether it is below zero, and multiplies it by a number of columns that it loads. In loops
that do little per element that is half the instructions. Here indices are never negative and the columns are known
when a kernel is compiled, so that an element is one address and of an array only the address is kept at hand.
"""

from __future__ import annotations

import operator
from typing import Any

import numba
from numba.core import types
from numba.extending import lower_builtin, models, register_model
from numba.np.arrayobj import make_array


class Table(types.Array):
    """Numba's type of a C array with so many columns; of one dimension with none.

    Args:
        dtype: Type of the elements.
        columns: How many of them are in each row.
    """

    def __init__(self, dtype, columns=None):
        super().__init__(dtype, 1 if columns is None else 2, "C", name=f"table({dtype}, {columns})")
        self.columns = columns

    @property
    def key(self):
        """What tells types apart."""
        return self.dtype, self.columns

    @property
    def mangling_args(self):
        """What tells the symbols of kernels apart."""
        return self.__class__.__name__, [self.dtype, str(self.columns)]


register_model(Table)(models.ArrayModel)


def floats(columns: int | None = None) -> Any:
    """A table of float64."""
    return Table(numba.float64, columns)


def whole(columns: int | None = None) -> Any:
    """A table of int64."""
    return Table(numba.int64, columns)


def small(columns: int | None = None) -> Any:
    """A table of int16."""
    return Table(numba.int16, columns)


# Numbers one after the other.
NUMBERS = floats()


def _element(context, builder, kind, array, index_kind, index):
    """Address of an element."""
    if kind.columns is None:
        place = context.cast(builder, index, index_kind, types.intp)
    else:
        row, column = (
            context.cast(builder, builder.extract_value(index, i), index_kind[i], types.intp) for i in range(2)
        )
        first = builder.mul(row, context.get_constant(types.intp, kind.columns), flags=("nsw",))
        place = builder.add(first, column, flags=("nsw",))
    return builder.gep(make_array(kind)(context, builder, array).data, [place], inbounds=True)


@lower_builtin(operator.getitem, Table, types.Integer)
@lower_builtin(operator.getitem, Table, types.UniTuple)
def _read(context, builder, sig, args):
    return builder.load(_element(context, builder, sig.args[0], args[0], sig.args[1], args[1]))


@lower_builtin(operator.setitem, Table, types.Integer, types.Any)
@lower_builtin(operator.setitem, Table, types.UniTuple, types.Any)
def _write(context, builder, sig, args):
    kind, index_kind, value_kind = sig.args
    value = context.cast(builder, args[2], value_kind, kind.dtype)
    builder.store(value, _element(context, builder, kind, args[0], index_kind, args[1]))
    return context.get_dummy_value()
