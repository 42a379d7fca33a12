"""SciPy's special functions, imported on first use: that takes as long as importing NumPy."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    import scipy.special

    return getattr(scipy.special, name)
