"""The one place where the compiler's flags live."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from numba import njit

from nonsac.kernels._cache import cache_of

# Everything in "fast" but the two flags that let the compiler assume that NaN and infinity do not occur.
_REORDER = {"nsz", "arcp", "contract", "afn", "reassoc"}
_CACHE = os.environ.get("NONSAC_CACHE", "1") != "0"


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a numerical kernel: releases the GIL, cached on disk, IEEE arithmetic in the written order."""
    return _compiled(function)


def reordered_kernel(function: Callable[..., Any]) -> Any:
    """Like `kernel`, for loops over residuals whose sums may be reordered so that they vectorise.

    Not for what other kernels call: a caller's compiled module has a copy of its own, optimised there in another way,
    and which copy a process uses, and with it the last bits of the answer, depends on what it loaded first.
    """
    return _compiled(function, fastmath=_REORDER)


def _compiled(function: Callable[..., Any], **flags: Any) -> Any:
    dispatcher = njit(nogil=True, error_model="numpy", **flags)(function)
    if _CACHE:
        dispatcher._cache = cache_of(function)
    return dispatcher
