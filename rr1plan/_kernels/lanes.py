# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc"
"""A number type for kernels that is `WIDTH` numbers side by side, one for each configuration.

A kernel on `LANES` reads like one on floats and compiles to the machine's vector instructions, with
no loop for the compiler to fail to recognise. Sums of products may be fused: that rounds less, so
every error bound for separate operations holds.
"""

from __future__ import annotations

import operator

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing import signature
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, models, register_model

WIDTH = 8

_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_FUSED = ("contract",)


class LanesType(types.Type):
    """Numba's type of `WIDTH` float64 side by side."""

    def __init__(self):
        super().__init__(name="Lanes")


LANES = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _VECTOR)


def _spread(builder, value):
    """A float as lanes that are all equal."""
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), zeros)


def _lanes(builder, value, kind):
    return value if isinstance(kind, LanesType) else _spread(builder, value)


def _define(operation, emit):
    """Let numba apply a binary operator to lanes, or to lanes and a float."""

    class _Rule(ConcreteTemplate):
        cases = (
            signature(LANES, LANES, LANES),
            signature(LANES, LANES, types.float64),
            signature(LANES, types.float64, LANES),
        )

    infer_global(operation)(_Rule)

    def lower(context, builder, sig, args):
        a, b = (_lanes(builder, value, kind) for value, kind in zip(args, sig.args, strict=True))
        return emit(builder, a, b)

    for case in _Rule.cases:
        lower_builtin(operation, *case.args)(lower)


_define(operator.add, lambda builder, a, b: builder.fadd(a, b, flags=_FUSED))
_define(operator.sub, lambda builder, a, b: builder.fsub(a, b, flags=_FUSED))
_define(operator.mul, lambda builder, a, b: builder.fmul(a, b, flags=_FUSED))
_define(operator.truediv, lambda builder, a, b: builder.fdiv(a, b))


@infer_global(operator.neg)
class _Negation(ConcreteTemplate):
    cases = (signature(LANES, LANES),)


@lower_builtin(operator.neg, LANES)
def _negate(context, builder, sig, args):
    return builder.fneg(args[0])


def _call(builder, name, value):
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(_VECTOR, [_VECTOR]), f"llvm.{name}.v{WIDTH}f64"
    )
    return builder.call(function, [value])


def _unary(name):
    @intrinsic
    def apply(typing_context, value):
        def lower(context, builder, sig, args):
            return _call(builder, name, args[0])

        return LANES(LANES), lower

    return apply


size_of = _unary("fabs")
root = _unary("sqrt")
floor = _unary("floor")


def _chosen(comparison):
    """The lesser or the greater of two, lane by lane; a float counts for all lanes."""

    @intrinsic
    def apply(typing_context, one, other):
        def lower(context, builder, sig, args):
            a, b = (_lanes(builder, value, kind) for value, kind in zip(args, sig.args, strict=True))
            return builder.select(builder.fcmp_ordered(comparison, a, b), a, b)

        kinds = [LANES if isinstance(kind, LanesType) else types.float64 for kind in (one, other)]
        return LANES(*kinds), lower

    return apply


lesser = _chosen("<")
greater = _chosen(">")


@intrinsic
def choose(typing_context, a, b, one, other):
    """`one` in lanes where a < b, else `other`; floats count for all lanes."""

    def lower(context, builder, sig, args):
        a, b, one, other = (_lanes(builder, value, kind) for value, kind in zip(args, sig.args, strict=True))
        return builder.select(builder.fcmp_ordered("<", a, b), one, other)

    kinds = [LANES if isinstance(kind, LanesType) else types.float64 for kind in (a, b, one, other)]
    return LANES(*kinds), lower


@intrinsic
def fill(typing_context, value):
    """Lanes that all hold one float."""

    def lower(context, builder, sig, args):
        return _spread(builder, args[0])

    return LANES(types.float64), lower


def _address(context, builder, kind, array, index):
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _VECTOR.as_pointer())


@intrinsic
def load(typing_context, array, index):
    """`WIDTH` numbers of a one-dimensional array, from an index on."""

    def lower(context, builder, sig, args):
        value = builder.load(_address(context, builder, sig.args[0], args[0], args[1]))
        value.align = 8
        return value

    return LANES(array, types.int64), lower


@intrinsic
def store(typing_context, array, index, value):
    """Write lanes into a one-dimensional array, from an index on."""

    def lower(context, builder, sig, args):
        instruction = builder.store(args[2], _address(context, builder, sig.args[0], args[0], args[1]))
        instruction.align = 8
        return context.get_dummy_value()

    return types.void(array, types.int64, LANES), lower


@intrinsic
def below(typing_context, value, bound):
    """Which lanes are not at least `bound` (a NaN is not): bit i stands for lane i."""

    def lower(context, builder, sig, args):
        bits = builder.fcmp_unordered("<", args[0], _lanes(builder, args[1], sig.args[1]))
        word = builder.bitcast(bits, ir.IntType(WIDTH))
        return builder.zext(word, ir.IntType(64))

    return types.int64(LANES, LANES if isinstance(bound, LanesType) else types.float64), lower


def _reduced(name):
    @intrinsic
    def apply(typing_context, value):
        def lower(context, builder, sig, args):
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(ir.DoubleType(), [_VECTOR]), f"llvm.vector.reduce.{name}.v{WIDTH}f64"
            )
            return builder.call(function, [args[0]], fastmath=("nnan",))

        return types.float64(LANES), lower

    return apply


least = _reduced("fmin")
most = _reduced("fmax")


@intrinsic
def first_bit(typing_context, word):
    """The number of the lowest bit that is set in a word that is not zero."""

    def lower(context, builder, sig, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), lower
