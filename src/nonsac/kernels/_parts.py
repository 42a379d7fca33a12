"""Kernels as parts of other kernels: no machine code of their own, no wrappers for Python, and nothing optimised twice.

Numba would compile each of them to the end, then merge its code into the caller's and optimise that again: of the time
to compile, a third. With the same instructions in the same order, the answers are the same to the last bit.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler


class _Unfinished(JITCodeLibrary):
    """Code that is only merged into that of callers."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class Pipeline(Compiler):
    """Numba's compiler, with a library of that kind."""

    def __init__(self, typing: Any, target: Any, library: Any, *rest: Any) -> None:
        super().__init__(typing, target, library or _Unfinished(target.codegen(), "part"), *rest)
        self.state.flags.no_compile = True
        self.state.library.enable_object_caching()


def hand_out_unfinished(dispatcher: Any) -> None:
    """Make a dispatcher give callers the code that there is: no function that Python could call."""

    def add_overload(result: Any) -> None:
        place = object()  # what numba finds the code by
        result.target_context.insert_user_function(place, result.fndesc, [result.library])
        dispatcher.overloads[tuple(result.signature.args)] = result._replace(entry_point=place)

    dispatcher.add_overload = add_overload
