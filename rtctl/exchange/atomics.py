"""Atomic 64-bit words of an int64 array, for kernels.

Two processes that share memory need more than plain loads and stores: the compiler may merge, repeat or
move those, and the processor may reorder them. On x86-64 none of these costs an instruction more than
the plain access. The index is an integer or a tuple, never negative; bounds are not checked.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

WORD = np.dtype(np.int64)


def word_intrinsic(definition: Callable[..., Any]) -> Any:
    """numba's `intrinsic`, for a type checker: kernels call the result without the leading typing context."""
    return intrinsic(definition)


@word_intrinsic
def load_acquire(_typing: Any, words: Any, index: Any) -> Any:
    """The word at `index`; what comes later in the program is not read before it."""
    if not _is_word_array(words, index):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _pointer(context, builder, signature, arguments)
        return builder.load_atomic(pointer, "acquire", WORD.itemsize)

    return types.int64(words, index), generate


@word_intrinsic
def store_release(_typing: Any, words: Any, index: Any, value: Any) -> Any:
    """Write `value` at `index`; what came earlier in the program is visible to whoever reads it there."""
    if not _is_word_array(words, index) or not isinstance(value, types.Integer | types.IntEnumMember):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _pointer(context, builder, signature, arguments)
        word = context.cast(builder, arguments[2], signature.args[2], types.int64)
        builder.store_atomic(word, pointer, "release", WORD.itemsize)
        return context.get_dummy_value()

    return types.void(words, index, value), generate


@word_intrinsic
def fence_release(_typing: Any) -> Any:
    """No write that follows becomes visible before a write that came earlier."""

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        builder.fence("release")
        return context.get_dummy_value()

    return types.void(), generate


@word_intrinsic
def words_of(_typing: Any, record: Any) -> Any:
    """The bytes of a structured record as an int64 array, shape (size / 8,), without a copy."""
    if not isinstance(record, types.Record) or record.size % WORD.itemsize:
        return None
    array_type = types.Array(types.int64, 1, "C")

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        array = make_array(array_type)(context, builder)
        populate_array(
            array,
            data=builder.bitcast(arguments[0], ir.IntType(64).as_pointer()),
            shape=[context.get_constant(types.intp, record.size // WORD.itemsize)],
            strides=[context.get_constant(types.intp, WORD.itemsize)],
            itemsize=context.get_constant(types.intp, WORD.itemsize),
            meminfo=None,
        )
        return array._getvalue()

    return array_type(record), generate


def _is_word_array(words: Any, index: Any) -> bool:
    dimensions = len(index) if isinstance(index, types.BaseTuple) else 1
    return isinstance(words, types.Array) and words.dtype == types.int64 and words.ndim == dimensions


def _pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    array_type, index_type = signature.args[:2]
    array = make_array(array_type)(context, builder, arguments[0])
    values, kinds = [arguments[1]], [index_type]
    if isinstance(index_type, types.BaseTuple):
        values, kinds = cgutils.unpack_tuple(builder, arguments[1]), list(index_type)
    indices = [context.cast(builder, v, k, types.intp) for v, k in zip(values, kinds, strict=True)]
    return cgutils.get_item_pointer(context, builder, array_type, array, indices)
