"""The one place where the compiler's flags live."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from numba import njit

# Everything in "fast" but the two flags that let the compiler assume that NaN and infinity do not occur.
_REORDER = {"nsz", "arcp", "contract", "afn", "reassoc"}
_CACHE = os.environ.get("NONSAC_CACHE", "1") != "0"


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a numerical kernel: releases the GIL, cached on disk, IEEE arithmetic in the written order.

    Inlined where another kernel calls it, since which of several compiled copies is used would depend on what was
    loaded first, and with it the last bits of the answer.
    """
    return njit(nogil=True, cache=_CACHE, error_model="numpy", forceinline=True)(function)


def reordered_kernel(function: Callable[..., Any]) -> Any:
    """Like `kernel`, for loops over residuals whose sums may be reordered so that they vectorise."""
    return njit(nogil=True, cache=_CACHE, error_model="numpy", fastmath=_REORDER, forceinline=True)(function)
