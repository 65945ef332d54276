"""32 small unsigned integers at a time, for kernels that numba compiles.

`Lanes` is a numba type held in vector registers. Inside a `@kernel`, `a + b`, `a - b`, `a << b`, `a
& b`, `a | b` and `a ^ b` work lane by lane and wrap around; the functions below do the rest. LLVM
maps them to whatever the processor has (AVX-512, AVX2, SSE, NEON), so one source serves all of them
and no C compiler is needed.
"""

import operator
from collections.abc import Callable

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

LANES = 32

_INDEX = ir.IntType(32)


class Lanes(types.Type):
    """The numba type of `LANES` unsigned integers of `bits` bits each."""

    def __init__(self, bits: int) -> None:
        self.bits = bits
        super().__init__(name=f"Lanes(uint{bits} x {LANES})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, lanes_type):
        super().__init__(manager, lanes_type, ir.VectorType(ir.IntType(lanes_type.bits), LANES))


_LANES_OF = {types.uint8: Lanes(8), types.uint16: Lanes(16)}


class _Lanewise(AbstractTemplate):
    """Types the operators: both sides of one lane width, and so the result."""

    def generic(self, args, kws):
        if len(args) == 2 and isinstance(args[0], Lanes) and args[0] == args[1]:
            return signature(args[0], *args)
        return None


def _define_operator(operation: Callable, instruction: str) -> None:
    infer_global(operation)(_Lanewise)  # pyright: ignore[reportOptionalCall]

    @lower_builtin(operation, Lanes, Lanes)
    def emit(context, builder, signature, operands):
        return getattr(builder, instruction)(*operands)


for _operation, _instruction in (
    (operator.add, "add"),
    (operator.sub, "sub"),
    (operator.lshift, "shl"),
    (operator.and_, "and_"),
    (operator.or_, "or_"),
    (operator.xor, "xor"),
):
    _define_operator(_operation, _instruction)


def _primitive(define: Callable) -> Callable:
    """What `define` types and emits, as a function for kernels: it is called without the typing
    context.
    """
    return intrinsic(define)


def _call(builder, name, result, *operands):
    """Call an LLVM intrinsic that is overloaded on the type of its first operand, such as
    `llvm.umin`.
    """
    vector = operands[0].type
    function_type = ir.FunctionType(result, [operand.type for operand in operands])
    full_name = f"llvm.{name}.v{vector.count}i{vector.element.width}"
    return builder.call(
        cgutils.get_or_insert_function(builder.module, function_type, full_name), operands
    )


def _address(context, builder, array_type, array, start, vector):
    """Pointer to the `vector` that begins at element `start` of a one-dimensional array."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [start]), vector.as_pointer())


@_primitive
def load(typing_context, array, start):
    """The lanes at `array[start : start + LANES]`; the array's end is not checked."""
    lanes = _LANES_OF[array.dtype]

    def emit(context, builder, signature, operands):
        data, first = operands
        address = _address(context, builder, array, data, first, context.get_value_type(lanes))
        return builder.load(address, align=1)

    return lanes(array, types.intp), emit


@_primitive
def store(typing_context, array, start, lanes):
    """Write `lanes` to `array[start : start + LANES]`; the array's end is not checked."""

    def emit(context, builder, signature, operands):
        data, first, value = operands
        builder.store(value, _address(context, builder, array, data, first, value.type), align=1)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), emit


@_primitive
def broadcast(typing_context, value):
    """All lanes equal to `value`, a uint8 or a uint16."""

    def emit(context, builder, signature, operands):
        vector = context.get_value_type(signature.return_type)
        undefined = ir.Constant(vector, ir.Undefined)
        first = builder.insert_element(undefined, operands[0], ir.Constant(_INDEX, 0))
        return builder.shuffle_vector(
            first, undefined, ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES)
        )

    return _LANES_OF[value](value), emit


@_primitive
def minimum(typing_context, a, b):
    """The smaller of `a` and `b`, lane by lane."""
    return a(a, a), lambda context, builder, signature, operands: _call(
        builder, "umin", operands[0].type, *operands
    )


@_primitive
def add_saturated(typing_context, a, b):
    """`a + b`, held at the largest value instead of wrapping around."""
    return a(a, a), lambda context, builder, signature, operands: _call(
        builder, "uadd.sat", operands[0].type, *operands
    )


@_primitive
def count_ones(typing_context, a):
    """The number of bits set in each lane."""
    return a(a), lambda context, builder, signature, operands: _call(
        builder, "ctpop", operands[0].type, *operands
    )


@_primitive
def smallest(typing_context, a):
    """The smallest of the lanes, a scalar."""
    scalar = next(scalar for scalar, lanes in _LANES_OF.items() if lanes == a)

    def emit(context, builder, signature, operands):
        return _call(builder, "vector.reduce.umin", ir.IntType(a.bits), *operands)

    return scalar(a), emit


def _window(first: int):
    """Emit `LANES` consecutive lanes of two operands laid end to end, from lane `first` on."""

    def emit(context, builder, signature, operands):
        picked = ir.Constant(ir.VectorType(_INDEX, LANES), list(range(first, first + LANES)))
        return builder.shuffle_vector(*operands, picked)

    return emit


@_primitive
def lanes_below(typing_context, before, here):
    """Every lane's predecessor: `here` moved up by one lane, its first filled from the end of
    `before`.
    """
    return here(before, here), _window(LANES - 1)


@_primitive
def lanes_above(typing_context, here, after):
    """Every lane's successor: `here` moved down by one lane, its last filled from the start of
    `after`.
    """
    return here(here, after), _window(1)


@_primitive
def widened(typing_context, a):
    """The same values as uint16 lanes."""
    wide = _LANES_OF[types.uint16]

    def emit(context, builder, signature, operands):
        return builder.zext(operands[0], context.get_value_type(wide))

    return wide(a), emit


@_primitive
def less(typing_context, a, b):
    """All bits set where `a < b`, none elsewhere."""

    def emit(context, builder, signature, operands):
        return builder.sext(builder.icmp_unsigned("<", *operands), operands[0].type)

    return a(a, a), emit


@_primitive
def chosen(typing_context, mask, a, b):
    """`a` where `mask` has its bits set, `b` where it has none."""

    def emit(context, builder, signature, operands):
        mask, a, b = operands
        return builder.select(builder.icmp_unsigned("!=", mask, ir.Constant(mask.type, None)), a, b)

    return a(mask, a, b), emit


@_primitive
def equal(typing_context, a, b):
    """A number whose bit i tells whether `a` and `b` are equal in lane i."""

    def emit(context, builder, signature, operands):
        bits = builder.bitcast(builder.icmp_unsigned("==", *operands), ir.IntType(LANES))
        return builder.zext(bits, ir.IntType(64))

    return types.int64(a, b), emit


@_primitive
def count_bits(typing_context, bits):
    """The number of bits set in a number."""
    return types.int64(types.int64), lambda context, builder, signature, operands: builder.ctpop(
        operands[0]
    )


@_primitive
def first_bit(typing_context, bits):
    """The place of the lowest bit set in a number other than 0."""
    false = ir.Constant(ir.IntType(1), 0)
    return types.int64(types.int64), lambda context, builder, signature, operands: builder.cttz(
        operands[0], false
    )
