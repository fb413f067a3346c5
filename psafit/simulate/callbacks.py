"""Functions of the causes as machine code behind an address, so that the engine is compiled once for all of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import cfunc, types
from numba.core import cgutils
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from psafit.errors import InputError
from psafit.plugins import message_of

_NUMBER = types.float64
_LIST = types.CPointer(types.float64)
SIGNATURES = {
    "law": types.void(_NUMBER, _NUMBER, _LIST, _LIST),
    "stack_factor": _NUMBER(_NUMBER, _LIST),
    "branch": _NUMBER(_NUMBER, _NUMBER, _NUMBER, _NUMBER, _LIST),
    "deceleration": _NUMBER(_NUMBER, _NUMBER, _LIST),
}


@cache
def _compiled(kind: str, function: Callable[..., Any]) -> Any:
    # error_model: a division by zero yields infinity, as in the engine; nothing can be raised through an address.
    try:
        return cfunc(SIGNATURES[kind], cache=True, error_model="numpy")(function)
    except RuntimeError:  # no place for the cache
        return cfunc(SIGNATURES[kind], error_model="numpy")(function)


def address(kind: str, function: Callable[..., Any]) -> int:
    """Address of a slot's function, compiled on first use and kept on disk.

    Raises
    ------
    InputError
        If it cannot be compiled.
    """
    try:
        return int(_compiled(kind, function).address)
    except NumbaError as error:
        code = function.__code__
        raise InputError(
            f"{kind} cannot be compiled ({message_of(error)})",
            "keep to numbers, `math`, and indices of the arguments",
            file=code.co_filename,
            line=code.co_firstlineno,
        ) from error


def _caller(result: Any, n_numbers: int, n_lists: int) -> Any:
    """An intrinsic that calls ``result f(double x n_numbers, double* x n_lists)`` at an address."""

    @intrinsic
    def call(typing, where, *arguments):  # type: ignore[no-untyped-def]
        flat = arguments[0].types if len(arguments) == 1 and hasattr(arguments[0], "types") else arguments
        signature = result(where, types.BaseTuple.from_types(flat))

        def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
            ir: Any = getattr(cgutils, "ir")  # noqa: B009 - llvmlite's, which numba brings
            double = ir.DoubleType()
            pointer = double.as_pointer()
            out = ir.VoidType() if result == types.void else double
            kind = ir.FunctionType(out, [double] * n_numbers + [pointer] * n_lists)
            items = cgutils.unpack_tuple(builder, values[1])
            numbers = list(items[:n_numbers])
            lists = [builder.inttoptr(item, pointer) for item in items[n_numbers:]]
            function = builder.inttoptr(values[0], kind.as_pointer())
            back = builder.call(function, numbers + lists)
            return context.get_dummy_value() if result == types.void else back

        return signature, generate

    return call


call_law = _caller(types.void, 2, 2)
call_stack_factor = _caller(types.float64, 1, 1)
call_branch = _caller(types.float64, 4, 1)
call_deceleration = _caller(types.float64, 2, 1)
