"""Compile everything once."""

from __future__ import annotations

from nonsac.cli.messages import to_stdout
from nonsac.cli.session import session


def warmup() -> None:
    """Compile all kernels now, on all cores, so that no later run has to wait for it."""
    from nonsac.kernels.ahead import SIGNATURES, compile_side_by_side

    with session(False, "kernels") as progress:
        compile_side_by_side(SIGNATURES, progress)
    to_stdout("all kernels are compiled")
