"""How inner loops are compiled to machine code."""

import inspect
from collections.abc import Callable

from numba import njit


def kernel(function: Callable) -> Callable:
    """Compile `function` to machine code, inlined where it is called from another kernel, and
    cached on disk.
    """
    # Test runs wrap every function to check its argument types; numba wants the function itself.
    return njit(cache=True, nogil=True, error_model="numpy", forceinline=True)(
        inspect.unwrap(function)
    )
