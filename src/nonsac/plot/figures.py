"""What all pictures share: colours, figures without a display, and files."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from nonsac.files.atomic import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# The blue and the orange of the Okabe-Ito palette: told apart with every kind of colour blindness.
ORANGE = np.array([0xE6, 0x9F, 0x00]) / 255
BLUE = np.array([0x00, 0x72, 0xB2]) / 255
INK = "#333333"
_DPI = 150


def render(figure: Figure, suffix: str) -> bytes:
    """Bytes of a picture file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    suffix : str
        ``.png``, ``.pdf`` or ``.svg``.

    Returns
    -------
    bytes

    Raises
    ------
    ValueError
        For any other suffix.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    undated: dict[str, dict[str, Any]] = {".png": {}, ".pdf": {"CreationDate": None}, ".svg": {"Date": None}}
    if suffix not in undated:
        raise ValueError(f"suffix is {suffix!r}; expected .png, .pdf or .svg")
    FigureCanvasAgg(figure)
    buffer = io.BytesIO()
    with rc_context({"svg.hashsalt": "nonsac"}):
        figure.savefig(buffer, format=suffix[1:], dpi=_DPI, metadata=undated[suffix])
    return buffer.getvalue()


def picture_suffix(path: str | os.PathLike[str]) -> str:
    """Suffix of the path of a picture, in lower case.

    Raises
    ------
    ValueError
        If it is not .png, .pdf or .svg.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".png", ".pdf", ".svg"):
        raise ValueError(f"path is {os.fspath(path)!r}; expected a picture that ends in .png, .pdf or .svg")
    return suffix


def write(path: str | os.PathLike[str], figure: Figure, suffix: str) -> None:
    content = render(figure, suffix)
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def new_figure(width: float, height: float) -> Figure:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("pictures need matplotlib: pip install matplotlib") from error
    return Figure(figsize=(width, height), facecolor="white")


def write_text(figure: Figure, x: float, y: float, text: str, size: float, **look: Any) -> None:
    figure.text(x, y, text, fontsize=size, **{"ha": "center", "va": "center", "color": INK, **look})


def plain_axes(axes: Axes) -> None:
    """A pale grid, and no frame at the top and on the right."""
    axes.grid(color="#e5e5e5")
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, length=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#bbbbbb")


def only_ticks(axes: Axes, name: str, ticks: Sequence[float]) -> None:
    """Ticks at these places of the axis "x" or "y", and nowhere else; the limits stay."""
    from matplotlib.ticker import NullLocator

    axis = axes.xaxis if name == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    axis.set_ticks(list(ticks), [f"{tick:g}" for tick in ticks], fontsize=9)
    axis.set_minor_locator(NullLocator())
    (axes.set_xlim if name == "x" else axes.set_ylim)(low, high)
