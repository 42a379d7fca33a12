"""What columns are usually called, and in which units: the one table by which the columns of all files are found."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

# For the columns on the left, other names that leave no doubt, if a file has all of a line. They are compared without
# regard to case, spaces, underscores and hyphens; those on the left are, too.
_POINT = (
    "easting northing height",
    "easting northing elevation",
    "easting northing altitude",
    "easting northing z",
    "east north up",
    "posx posy posz",
    "pos.x pos.y pos.z",
    "positionx positiony positionz",
    "position.x position.y position.z",
    "coordx coordy coordz",
    "xcoord ycoord zcoord",
    "xcoordinate ycoordinate zcoordinate",
    "points:0 points:1 points:2",
    "pointsmxyz:0 pointsmxyz:1 pointsmxyz:2",
)
_USUAL = {
    "x y z": _POINT,
    "x1 y1 x2 y2": ("x0 y0 x1 y1", "x y x' y'"),
    "u v X Y Z": ("x y X Y Z", "x2d y2d x3d y3d z3d", *(f"u v {point}" for point in _POINT)),
    "x1 y1 z1 x2 y2 z2": (
        "x0 y0 z0 x1 y1 z1",
        "x y z x' y' z'",
        "sourcex sourcey sourcez targetx targety targetz",
        "xsource ysource zsource xtarget ytarget ztarget",
        "srcx srcy srcz tgtx tgty tgtz",
        "xsrc ysrc zsrc xtgt ytgt ztgt",
        "srcx srcy srcz dstx dsty dstz",
        "xsrc ysrc zsrc xdst ydst zdst",
    ),
    "weight": ("weights",),
}
_UNITS = {
    "m": ("m", "meter", "meters", "metre", "metres"),
    "mm": ("mm", "millimeter", "millimeters", "millimetre", "millimetres"),
    "cm": ("cm", "centimeter", "centimeters", "centimetre", "centimetres"),
    "km": ("km", "kilometer", "kilometers", "kilometre", "kilometres"),
    "ft": ("ft", "foot", "feet"),
    "in": ("in", "inch", "inches"),
    "px": ("px", "pix", "pixel", "pixels"),
}
_UNIT_OF = {spelling: unit for unit, spellings in _UNITS.items() for spelling in spellings}
# What else heads the columns of such tables: enough to tell a line of names from a remark.
_OTHERS = """
    id index i idx point name label class classification time timestamp gpstime lat latitude lon long lng longitude alt
    h e n r g b red green blue rgb rgba intensity reflectance reflectivity amplitude nx ny nz normalx normaly normalz
    score confidence error inlier distance range ring row column
"""
_SIGNS = re.compile(r"^(?:#|%|//|;)+\s*")
_IN_BRACKETS = re.compile(r"\s*[\[(<{]\s*(\w+)\s*[])>}]$")
_APPENDED = re.compile(r"(?<=\w)[_/ ](mm|cm|km|m|ft|px|pix|pixels?)$")
_QUOTED = re.compile(r"^([\"'])(.*)\1$")
_BETWEEN = re.compile(r"[\s_-]+")
_NAMES_SHOWN, _LETTERS_SHOWN = 20, 40


def find_places(names: Sequence[str], wanted: Sequence[str], split: int | None = None) -> list[int | None]:
    """Where columns are, by their names or, failing that, by others that are usual for all of them.

    Parameters
    ----------
    names
        What the columns of the file are called. Units may follow (`x [m]`, `x(m)`, `x_m`).
    wanted
        The columns looked for. A name that is written in the same way is preferred.
    split
        Where those of a second thing begin, which may have another unit.

    Returns
    -------
    list of int or None
        For each column wanted its place; None for those that are not there.

    Raises
    ------
    ValueError
        If several columns could be meant, or if their units differ.
    """
    held = _Places(names)
    candidates = [held.of(word) for word in wanted]
    for word, found in zip(wanted, candidates, strict=True):
        if len(found) > 1:
            raise ValueError(f"several columns could be {word} ({listing([names[place] for place in found], ', ')})")
    places: list[int | None] = [found[0] if found else None for found in candidates]
    if None in places:
        places = _by_usual_names(held, names, wanted) or places
    _check_units([None if place is None else _unit(names[place]) for place in places], split)
    return places


def place_of(name: str, names: Sequence[str]) -> int | None:
    """Where the one column is that a name can mean; None if there is none, or if there are several."""
    found = _Places(names).of(name)
    return found[0] if len(found) == 1 else None


def is_usual(names: Sequence[str]) -> bool:
    """Whether words are the names of columns: two or more of coordinates, or nothing but names of some kind."""
    words = {_word(name) for name in names}
    return len(words & _COORDINATES) > 1 or (bool(words) and words <= _COORDINATES | {"weight", *_OTHERS.split()})


def is_wanted_anywhere(name: str) -> bool:
    """Whether a name is one of the coordinates or weights that are looked for in some file."""
    return _word(name) in _COORDINATES | {"weight", "weights"}


def listing(names: Sequence[str], separator: str = " ") -> str:
    """Names for a message, of which some are left out if there are many."""
    some = separator.join(name[:_LETTERS_SHOWN] for name in names[:_NAMES_SHOWN])
    return some if len(names) <= _NAMES_SHOWN else f"{some} and {len(names) - _NAMES_SHOWN} more"


def unquoted(name: str) -> str:
    """A name without the quotes around it; an apostrophe behind it is its own."""
    return _QUOTED.sub(r"\2", name.strip()).strip()


def _by_usual_names(held: _Places, names: Sequence[str], wanted: Sequence[str]) -> list[int | None] | None:
    """The places of the only line of other names that the file has."""
    fitting: dict[tuple[int, ...], None] = {}
    for others in _USUAL.get(" ".join(wanted), ()):
        found = [held.of(word) for word in others.split()]
        if all(len(each) == 1 for each in found) and len({each[0] for each in found}) == len(found):
            fitting[tuple(each[0] for each in found)] = None
    if len(fitting) > 1:
        sets = " or ".join(listing([names[place] for place in places]) for places in fitting)
        raise ValueError(f"several columns could be {' '.join(wanted)} ({sets})")
    return list(next(iter(fitting))) if fitting else None


class _Places:
    """Where names are, by how they are spelled: exactly, in any case, or with units and separators."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._found: dict[Callable[[str], str], dict[str, list[int]]] = {}

    def of(self, name: str) -> list[int]:
        """The columns of exactly this name, else those in another case, else those with a unit or other separators."""
        return next(filter(None, (self._by(spelled).get(spelled(name)) for spelled in (str, str.lower, _word))), [])

    def _by(self, spelled: Callable[[str], str]) -> dict[str, list[int]]:
        if spelled not in self._found:
            found: dict[str, list[int]] = {}
            for place, name in enumerate(self._names):
                found.setdefault(spelled(name), []).append(place)
            self._found[spelled] = found
        return self._found[spelled]


def _check_units(units: Sequence[str | None], split: int | None) -> None:
    for part in (units,) if split is None else (units[:split], units[split:]):
        told = sorted({unit for unit in part if unit is not None})
        if len(told) > 1:
            raise ValueError(f"the units of the coordinates differ ({', '.join(told)})")


def _word(name: str) -> str:
    """A name without what may differ: case, signs of comments, units and separators."""
    return _parsed(name)[0]


def _unit(name: str) -> str | None:
    return _parsed(name)[1]


def _parsed(name: str) -> tuple[str, str | None]:
    text = _SIGNS.sub("", unquoted(name).lower())
    found = _IN_BRACKETS.search(text) or _APPENDED.search(text)
    unit = _UNIT_OF.get(found[1]) if found else None
    if found and unit:
        text = text[: found.start()]
    return _BETWEEN.sub("", text), unit


_COORDINATES = frozenset(
    word.lower()
    for wanted, others in _USUAL.items()
    if wanted != "weight"
    for line in (wanted, *others)
    for word in line.split()
)
