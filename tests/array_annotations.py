"""The type checker under which the tests import the package: dtypes and shapes of arrays.

JAX takes plain numbers and NumPy arrays wherever it takes its own, and so do the tests; what is not an array
is left to pyright.
"""

import functools
import operator
import types
from typing import Any, Union, get_args, get_origin

import jax
from beartype import beartype
from jax.typing import ArrayLike
from jaxtyping import AbstractArray


def check(function):
    """`function`, the annotations of whose arrays are checked at each call."""
    hints = function.__annotations__
    if not any(map(_has_array, hints.values())):
        return function
    function.__annotations__ = {
        name: _welcoming(hint) if _has_array(hint) else Any for name, hint in hints.items()
    }
    return beartype(function)


def _has_array(hint):
    return _is_array(hint) or any(map(_has_array, get_args(hint)))


def _is_array(hint):
    return isinstance(hint, type) and issubclass(hint, AbstractArray)


def _welcoming(hint):
    """`hint` with what JAX takes for an array in place of its own arrays."""
    if _is_array(hint):
        return hint.dtype[ArrayLike, hint.dim_str] if hint.array_type is jax.Array else hint
    if not _has_array(hint):
        return hint
    inner = tuple(map(_welcoming, get_args(hint)))
    if get_origin(hint) in (Union, types.UnionType):
        return functools.reduce(operator.or_, inner)
    return get_origin(hint)[inner]
