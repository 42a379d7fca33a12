"""What an input may do: which errors are documented, how long it may take and how much memory."""

from __future__ import annotations

import re
import traceback
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import nonsac

SECONDS = 5.0
BYTES = 256 * 2**20
_HOME = str(Path(nonsac.__file__).parent)
_LONGEST = 4000
_CONTROL = re.compile(r"[\x00-\x08\x0a-\x1f\x7f]")
_REFUSED = "it claims more memory than there is"  # by a library, before it took any
_NO_MEMORY = re.compile(r"[Uu]nable to allocate|malloc|memory allocation failed|[Oo]ut of memory|realloc of size")


@dataclass(frozen=True)
class Failure:
    """What was wrong with an input.

    Attributes
    ----------
    kind
        "error", "message", "warning", "wrong", "memory", "slow", "hang" or "crash".
    place
        The last line of the package that was reached, if it is known.
    detail
        What was seen.
    """

    kind: str
    place: str
    detail: str

    @property
    def signature(self) -> str:
        """The same for failures of one cause, most likely."""
        detail = self.detail.partition(":")[0] if self.kind in ("error", "memory", "hang") else self.detail
        detail = re.sub(r"\d+", "N", re.sub(r"/\S+|'[^']*'|\"[^\"]*\"|\[[^\]]*\]|\([^)]*\)", "_", detail))
        return f"{self.kind} | {self.place} | {detail[:70]}"


def judged(
    error: BaseException, documented: tuple[type[BaseException], ...], names: Iterable[str], hostile: bool
) -> Failure | None:
    """Whether an error is one that is documented: of a known type, with a sentence that names what is at fault.

    A sentence about a hostile file is short, too, and holds no control characters, which a terminal would obey.
    """
    place, text = _place(error), f"{type(error).__name__}: {error}"
    if isinstance(error, AssertionError) and not place.startswith("src"):
        return Failure("wrong", "", str(error)[:300])
    if no_memory(error) and _REFUSED not in text:
        return Failure("memory", place, text[:300])
    if any(isinstance(each, NameError) for each in _chain(error)):
        return Failure("error", place, f"a mistake in the code, taken for damage: {text[:300]}")
    if not isinstance(error, documented):
        return Failure("error", place, text[:300])
    message = str(error)
    if not any(_is_named(name, message) for name in names):
        return Failure("message", place, f"names neither file nor argument: {text[:300]}")
    if hostile and (_CONTROL.search(message) or len(message) > _LONGEST):
        return Failure("message", place, f"of {len(message)} characters, {text[:200]!a}")
    return None


def _is_named(name: str, message: str) -> bool:
    """Whether it is there, as far as it is printable and not too long."""
    start = name[:100]
    return (
        start in message or start.encode("unicode_escape").decode() in message or start.replace("\0", "\\0") in message
    )


def no_memory(error: BaseException) -> bool:
    """Whether memory ran out, even if this was then taken for a damaged file."""
    return any(isinstance(each, MemoryError) or _NO_MEMORY.search(str(each)) for each in _chain(error))


def _chain(error: BaseException | None) -> list[BaseException]:
    """An error and what it was raised in the place of."""
    chain: list[BaseException] = []
    while error is not None and error not in chain:
        chain.append(error)
        error = error.__cause__ or error.__context__
    return chain


def warned(warning: warnings.WarningMessage) -> Failure:
    place = warning.filename.replace(_HOME, "src")
    return Failure("warning", f"{place}:{warning.lineno}", f"{warning.category.__name__}: {warning.message}"[:300])


def _place(error: BaseException) -> str:
    """The last line of the package that was reached."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename.startswith(_HOME)]
    if not frames:
        return ""
    return f"{frames[-1].filename.replace(_HOME, 'src')}:{frames[-1].lineno} {frames[-1].name}"
