"""The one place where the compiler's flags live."""

from __future__ import annotations

import functools
import gc
import os
import threading
from collections.abc import Callable
from typing import Any

# Everything in "fast" but the two flags that let the compiler assume that NaN and infinity do not occur.
_REORDER = {"nsz", "arcp", "contract", "afn", "reassoc"}
_CACHE = os.environ.get("NONSAC_CACHE", "1") != "0"
_lock = threading.RLock()


class Kernel:
    """A numerical kernel: releases the GIL, cached on disk, IEEE arithmetic in the written order.

    It is compiled when it is called first, and importing it does not import numba. Kernels that call it have it as a
    part of their own code, without what only Python needs to call it, and without a file.
    """

    def __init__(self, function: Callable[..., Any], **flags: Any) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self.flags = function, flags

    def __call__(self, *arguments: Any) -> Any:
        return self.entry(*arguments)

    def __reduce__(self) -> str:
        return self.py_func.__qualname__

    @functools.cached_property
    def entry(self) -> Any:
        """What Python calls."""
        from nonsac.kernels._cache import cache_of

        with _lock:
            if "entry" in self.__dict__:  # another thread has made it meanwhile
                return self.__dict__["entry"]
            dispatcher = self._dispatcher()
            if _CACHE:
                dispatcher._cache = cache_of(self.py_func)
            self.__dict__["entry"] = dispatcher
            return dispatcher

    @functools.cached_property
    def part(self) -> Any:
        """What kernels call."""
        from nonsac.kernels._parts import Pipeline, hand_out_unfinished

        dispatcher = self._dispatcher(no_cpython_wrapper=True, pipeline_class=Pipeline)
        hand_out_unfinished(dispatcher)
        return dispatcher

    @property
    def _numba_type_(self) -> Any:
        """How numba, which compiles one kernel at a time, finds it in another one."""
        return self.part._numba_type_

    def _dispatcher(self, **flags: Any) -> Any:
        import numba

        njit: Any = numba.njit
        dispatcher = njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **self.flags, **flags)(self.py_func)
        if hasattr(dispatcher, "_compiler"):  # else numba's compiler is turned off
            dispatcher._compiler.compile = _without_collecting(dispatcher._compiler.compile)
        return dispatcher


def kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a numerical kernel."""
    return Kernel(function, fastmath=False)  # else it would have the flags of the kernel that makes numba compile it


def reordered_kernel(function: Callable[..., Any]) -> Kernel:
    """Like `kernel`, for loops over residuals whose sums may be reordered so that they vectorise.

    Not for what several kernels call, or kernels and Python: a caller's compiled module has a copy of its own,
    optimised there in another way, and which copy a process uses, and with it the last bits of the answer, depends on
    what it loaded first.
    """
    return Kernel(function, fastmath=_REORDER)


def _without_collecting(compile: Callable[..., Any]) -> Callable[..., Any]:
    """Garbage is not collected meanwhile: numba makes a million objects, and keeps most of them."""

    @functools.wraps(compile)
    def compiled(*arguments: Any) -> Any:
        if not gc.isenabled():
            return compile(*arguments)
        gc.disable()
        try:
            return compile(*arguments)
        finally:
            gc.enable()

    return compiled
