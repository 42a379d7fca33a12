"""Compiled kernels on disk, as numba keeps them; but none of its failures is an error, as all can be compiled again."""

from __future__ import annotations

import logging
import multiprocessing
import pickle
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, NullCache
from numba.core.runtime.nrt import rtsys

_logger = logging.getLogger("nonsac")
_told: set[str] = set()


def cache_of(function: Callable[..., Any]) -> Any:
    """The cache of a kernel; one that keeps nothing if there is no folder that can be written."""
    try:
        return _Cache(function)
    except (RuntimeError, OSError) as error:
        _tell_not_kept(error)
        return NullCache()


def _read_only(locator: Any) -> Any:
    """A place that need not be writable: kernels may have been compiled there by somebody who may write."""
    return type(f"_ReadOnly{locator.__name__}", (locator,), {"ensure_cache_path": lambda self: None})


class _Places(CompileResultCacheImpl):
    """Where numba keeps kernels; else where they can at least be read: in the given folder, or beside the source."""

    _locator_classes: Any = (
        *CompileResultCacheImpl._locator_classes,
        *map(_read_only, CompileResultCacheImpl._locator_classes[:2]),
    )


class _Cache(FunctionCache):
    """Kernels of a damaged cache are compiled again, and replace what is damaged."""

    _impl_class = _Places

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        name, stamp = self._impl.filename_base, self._impl.locator.get_source_stamp()
        self._cache_file = _CheckedFile(self.cache_path, f"{name}-checked", stamp)  # numba's own files have no checksum

    def holds_something(self) -> bool:
        """Whether there is a kernel on disk that is not older than its source."""
        try:
            return bool(self._cache_file._load_index())
        except Exception:  # it is damaged
            return False

    def load_overload(self, signature: Any, target: Any) -> Any:
        try:
            rtsys.initialize(target)  # what code on disk needs; numba's own cache makes the compiler ready, too
            with self._guard_against_spurious_io_errors():
                return self._load_overload(signature, target)
        except Exception:  # what damaged bytes raise when they are unpickled is anything
            _tell(f"compiled kernels in {self.cache_path} are damaged; they are compiled again (once)")
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        try:
            try:
                super().save_overload(signature, result)
            except OSError:
                raise
            except Exception:  # of the index: it is begun anew
                self.flush()
                super().save_overload(signature, result)
        except Exception as error:
            _tell_not_kept(error)


class _CheckedFile(IndexDataCacheFile):
    """Index and data end with a checksum: a flipped bit of machine code would run, and give anything."""

    def _dump(self, content: Any) -> bytes:
        data = super()._dump(content)
        return data + _checksum(data)

    def _load_index(self) -> Any:
        path = Path(self._index_path)
        if path.exists():
            with path.open("rb") as file:
                if pickle.load(file) == self._version:
                    _checked(file.read())
        return super()._load_index()

    def _load_data(self, name: str) -> Any:
        return pickle.loads(_checked(Path(self._data_path(name)).read_bytes()))


def _checksum(data: bytes) -> bytes:
    return zlib.crc32(data).to_bytes(4, "little")


def _checked(data: bytes) -> bytes:
    if _checksum(data[:-4]) != data[-4:]:
        raise ValueError("damaged")
    return data[:-4]


def _tell_not_kept(error: Exception) -> None:
    reason = error.strerror if isinstance(error, OSError) else None
    if isinstance(error, (RuntimeError, FileNotFoundError, PermissionError)) or reason is None:
        reason = "there is no folder for them that can be written"
    _tell(
        f"compiled kernels cannot be kept ({reason}), so that each run compiles them for ten seconds or more; "
        "set NUMBA_CACHE_DIR to a folder that can be written"
    )


def _tell(message: str) -> None:
    """Once, by the logger `nonsac`: on stderr if nobody has set it up; workers leave it to their parent."""
    if message not in _told and multiprocessing.parent_process() is None:
        _logger.warning("nonsac: %s", message)
    _told.add(message)
