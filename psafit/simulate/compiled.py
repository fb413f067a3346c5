"""Compilation of the engine: once for all causes, kept on disk, and never stale."""

from __future__ import annotations

import hashlib
import logging
import operator
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import extending, njit, types
from numba.core import cgutils, event
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import lower_builtin, models, register_model

__all__ = [
    "LANES", "WIDTH", "compiled", "fma", "last", "least", "load", "size", "solve", "splat", "store", "times",
    "total",
]  # fmt: skip

_SOURCES = ("callbacks", "closed_form", "collocation", "command", "compiled", "drive", "flight", "stepper")


def _stamp() -> bytes:
    """Return a fingerprint of all compiled sources."""
    folder = Path(__file__).parent
    return hashlib.sha256(b"".join((folder / f"{name}.py").read_bytes() for name in _SOURCES)).digest()


_STAMP = _stamp()


class _Announced(event.Listener):
    """Logs, once, that the engine is being compiled: a silent minute looks like a fault."""

    said = False

    def on_start(self, begun: event.Event) -> None:
        if not self.said and str(begun.data["dispatcher"].py_func.__module__).startswith(f"{__package__}."):
            self.said = True
            logging.getLogger(__name__).info("compiling the simulator: up to a minute")

    def on_end(self, ended: event.Event) -> None:
        pass


event.register("numba:compile", _Announced())


def compiled(function: Callable[..., Any] | None = None, *, borrows: bool = False, inside: bool = False) -> Any:
    """Compile with numba, IEEE division, without the interpreter's lock, and with a cache on disk.

    Numba renews a cached function when its own file changes, not when a function it calls does; here the stamp is
    that of the whole engine. Where no folder can be written to, the function is compiled in every process.

    Parameters
    ----------
    function : callable
    borrows : bool
        The function makes no array, so that no references to those it is given need be counted.
    inside : bool
        Make the function, which borrows, part of whatever calls it.
    """
    if function is None:
        return lambda inner: compiled(inner, borrows=borrows, inside=inside)
    options: dict[str, Any] = {
        "nogil": True,
        "forceinline": inside,
        "_nrt": not (borrows or inside),
        "error_model": "numpy",
    }
    if inside:
        return njit(**options)(function)
    try:
        dispatcher = njit(cache=True, **options)(function)
    except RuntimeError:  # no place for the cache
        return njit(**options)(function)
    cache: Any = getattr(dispatcher, "_cache")  # noqa: B009 - numba does not declare it
    cache._cache_file._source_stamp = _STAMP
    return dispatcher


# --- eight numbers at once ------------------------------------------------------------------------------

WIDTH = 8
"""Numbers in one register of the widest processors; narrower ones take two or four."""


class _Lanes(types.Type):
    pass


LANES = _Lanes("lanes")
intrinsic: Any = extending.intrinsic
_NUMBER = types.float64
_ir: Any = getattr(cgutils, "ir")  # noqa: B009 - llvmlite's, which numba brings
_DOUBLE, _INDEX = _ir.DoubleType(), _ir.IntType(32)
_VECTOR = _ir.VectorType(_DOUBLE, WIDTH)


@register_model(_Lanes)
class _Register(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)  # type: ignore[no-untyped-call]


def _splat(builder: Any, x: Any) -> Any:
    if x.type == _VECTOR:
        return x
    one = builder.insert_element(_ir.Constant(_VECTOR, _ir.Undefined), x, _ir.Constant(_INDEX, 0))
    order = _ir.Constant(_ir.VectorType(_INDEX, WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, one, order)


def _lane(builder: Any, v: Any, k: int) -> Any:
    """One lane in all places."""
    return builder.shuffle_vector(v, v, _ir.Constant(_ir.VectorType(_INDEX, WIDTH), [k] * WIDTH))


def _fma(builder: Any, a: Any, b: Any, c: Any) -> Any:
    kind = _ir.FunctionType(_VECTOR, [_VECTOR] * 3)
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fmuladd.v{WIDTH}f64")
    return builder.call(function, [a, b, c])


def _arithmetic(operation: Any, name: str) -> None:
    """Give an operator a meaning between registers, and between a register and a number."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return getattr(builder, name)(*(_splat(builder, x) for x in values))

    pairs = [(LANES, LANES), (LANES, _NUMBER), (_NUMBER, LANES)]
    for pair in pairs:
        lower_builtin(operation, *pair)(generate)
    infer_global(operation)(type(name, (ConcreteTemplate,), {"cases": [LANES(*pair) for pair in pairs]}))


for _operation, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _arithmetic(_operation, _name)


def _address(context: Any, builder: Any, kind: Any, array: Any, first: Any, offset: int = 0) -> Any:
    """Where the register begins that lies `offset` registers behind the place `first` of an array's memory."""
    data = context.make_array(kind)(context, builder, array).data
    at = builder.add(first, _ir.Constant(first.type, offset * WIDTH))
    return builder.bitcast(builder.gep(data, [at]), _VECTOR.as_pointer())


def _column(context: Any, builder: Any, kind: Any, array: Any, first: Any, k: int) -> Any:
    return builder.load(_address(context, builder, kind, array, first, k), align=8)


@intrinsic
def splat(typing, x):  # type: ignore[no-untyped-def]
    """Return one number in all lanes."""
    return LANES(_NUMBER), lambda context, builder, signature, values: _splat(builder, values[0])


@intrinsic
def load(typing, array, first):  # type: ignore[no-untyped-def]
    """Eight numbers of an array's memory, from place `first`."""

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        return _column(context, builder, signature.args[0], values[0], values[1], 0)

    return LANES(array, types.intp), generate


@intrinsic
def store(typing, array, first, v):  # type: ignore[no-untyped-def]
    """Write eight numbers into an array's memory, from place `first`."""

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        builder.store(values[2], _address(context, builder, signature.args[0], values[0], values[1]), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, LANES), generate


@intrinsic
def times(typing, array, first, v):  # type: ignore[no-untyped-def]
    """Product of a matrix, stored by columns from place `first` of an array's memory, and a vector."""

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        array, first, v = values
        # Two sums, so that one need not wait for the other.
        sums = [None, None]
        for k in range(WIDTH):
            column, x = _column(context, builder, signature.args[0], array, first, k), _lane(builder, v, k)
            before = sums[k % 2]
            sums[k % 2] = builder.fmul(column, x) if before is None else _fma(builder, column, x, before)
        return builder.fadd(*sums)

    return LANES(array, types.intp, LANES), generate


@intrinsic
def fma(typing, a, b, c):  # type: ignore[no-untyped-def]
    """``a b + c``."""
    numbers = tuple(LANES if x == LANES else _NUMBER for x in (a, b, c))

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        return _fma(builder, *(_splat(builder, x) for x in values))

    return LANES(*numbers), generate


@intrinsic
def size(typing, v):  # type: ignore[no-untyped-def]
    """Magnitudes."""

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        kind = _ir.FunctionType(_VECTOR, [_VECTOR])
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.fabs.v{WIDTH}f64"), values)

    return LANES(LANES), generate


def _folded(join: Any) -> Any:
    @intrinsic
    def fold(typing, v):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
            v, width = values[0], WIDTH
            while width > 1:
                width //= 2
                halves = [
                    builder.shuffle_vector(
                        v, v, _ir.Constant(_ir.VectorType(_INDEX, width), [k + at for k in range(width)])
                    )
                    for at in (0, width)
                ]  # fmt: skip
                v = join(builder, *halves)
            return builder.extract_element(v, _ir.Constant(_INDEX, 0))

        return _NUMBER(LANES), generate

    return fold


total = _folded(lambda builder, a, b: builder.fadd(a, b))
least = _folded(lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b))


@intrinsic
def last(typing, v):  # type: ignore[no-untyped-def]
    """The last lane."""

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        return builder.extract_element(values[0], _ir.Constant(_INDEX, WIDTH - 1))

    return _NUMBER(LANES), generate


@intrinsic
def solve(typing, one, first, by_one, two, second, by_two, b):  # type: ignore[no-untyped-def]
    """Solution of ``(1 + diag(by_one) one + diag(by_two) two) x = b``.

    Gauss and Jordan's elimination, all in registers. Without exchanges of rows: what a small pivot costs in digits,
    Newton's method makes good.
    """

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        one, first, by_one, two, second, by_two, b = values
        columns = []
        for k in range(WIDTH):
            unit = _ir.Constant(_VECTOR, [float(i == k) for i in range(WIDTH)])
            x = _fma(builder, by_one, _column(context, builder, signature.args[0], one, first, k), unit)
            columns.append(_fma(builder, by_two, _column(context, builder, signature.args[3], two, second, k), x))
        ones = _ir.Constant(_VECTOR, [1.0] * WIDTH)
        diagonal = ones
        for k in range(WIDTH):
            # The row itself stays: its factor is zero.
            here = _ir.Constant(_ir.VectorType(_ir.IntType(1), WIDTH), [i == k for i in range(WIDTH)])
            inverse = builder.fdiv(ones, _lane(builder, columns[k], k))
            diagonal = builder.select(here, inverse, diagonal)
            factor = builder.fmul(columns[k], inverse)
            factor = builder.fneg(builder.select(here, _ir.Constant(_VECTOR, [0.0] * WIDTH), factor))
            for j in range(k + 1, WIDTH):
                columns[j] = _fma(builder, factor, _lane(builder, columns[j], k), columns[j])
            b = _fma(builder, factor, _lane(builder, b, k), b)
        return builder.fmul(b, diagonal)

    return LANES(one, types.intp, LANES, two, types.intp, LANES, LANES), generate
