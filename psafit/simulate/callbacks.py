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
HOOKS = {"law": (2, 2), "stack_factor": (1, 1), "branch": (4, 1), "deceleration": (2, 1)}
"""Functions of causes that are compiled, with their arguments: numbers, and arrays; into a second array they write."""


def _result(kind: str) -> Any:
    return types.void if HOOKS[kind][1] > 1 else _NUMBER


@cache
def _compiled(kind: str, function: Callable[..., Any]) -> Any:
    n_numbers, n_lists = HOOKS[kind]
    signature = _result(kind)(*[_NUMBER] * n_numbers, *[_LIST] * n_lists)
    # error_model: a division by zero yields infinity, as in the engine; nothing can be raised through an address.
    try:
        return cfunc(signature, cache=True, error_model="numpy")(function)
    except RuntimeError:  # no place for the cache
        return cfunc(signature, error_model="numpy")(function)


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


def _caller(kind: str) -> Any:
    """An intrinsic that calls a function of this kind at an address."""
    result, (n_numbers, n_lists) = _result(kind), HOOKS[kind]

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


call_law, call_stack_factor, call_branch, call_deceleration = map(_caller, HOOKS)
