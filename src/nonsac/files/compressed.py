"""Whether compressed bytes are more than they should be, found out without taking room for them."""

import bz2
import lzma

_ZSTD, _BZIP2, _XZ = b"\x28\xb5\x2f\xfd", b"BZh", b"\xfd7zXZ\x00"
_DICTIONARY, _CONTENT = (0, 1, 2, 4), (0, 2, 4, 8)  # bytes of fields in the header of Zstandard
HEAD_LENGTH = 32


def expands_beyond(size: int, path: str) -> bool:
    """Whether a file is known to hold more than so many bytes, in a format that can expand ten thousand fold.

    These are Zstandard, whose header may say how many they are, and bzip2 and xz, which are decoded up to there.
    """
    with open(path, "rb") as file:
        head = file.read(HEAD_LENGTH)
        if head.startswith(_ZSTD):
            return _zstd_size(head) > size
        if head.startswith(_BZIP2):
            return len(bz2.BZ2Decompressor().decompress(head + file.read(), size + 1)) > size
        if head.startswith(_XZ):
            return len(lzma.LZMADecompressor().decompress(head + file.read(), size + 1)) > size
    return False


def _zstd_size(head: bytes) -> int:
    """The size of the content that a frame of Zstandard names; 0 if it names none."""
    flags = head[4] if len(head) > 4 else 0
    is_single = bool(flags & 32)
    length = _CONTENT[flags >> 6] or int(is_single)
    start = 5 + (not is_single) + _DICTIONARY[flags & 3]
    return int.from_bytes(head[start : start + length], "little") + (256 if length == 2 else 0)
