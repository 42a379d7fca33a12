"""Many pairs of images whose keypoints are matched: what databases of COLMAP and files of hloc have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from nonsac.files.content import read_content
from nonsac.files.errors import FilePath, input_error, not_held
from nonsac.io.correspondences import Matches

Image = int | str


@dataclass(frozen=True)
class ImagePair:
    """Two images, and how many matches they have.

    Attributes
    ----------
    images : two numbers or names
        As the source calls them.
    names : two names
    num_matches : int or None
        How many; None if that is not known before they are read.
    """

    images: tuple[Image, Image]
    names: tuple[str, str]
    num_matches: int | None


@dataclass(frozen=True)
class ImagePairs(ABC):
    """Pairs of images, in the order of their source.

    Attributes
    ----------
    path : path-like
        For messages.
    pairs : tuple of ImagePair
        Those that were matched, if only in vain.
    """

    path: FilePath
    pairs: tuple[ImagePair, ...]

    @abstractmethod
    def read(self, pair: ImagePair) -> Matches:
        """The matches of a pair, with cameras and with the indices of the keypoints."""

    def is_calibrated(self, pair: ImagePair, name: str | None = None) -> bool:
        """Whether the focal lengths of a pair, or of the image of this name, are known rather than guesses."""
        return True

    def chosen(self, listed: FilePath | None) -> tuple[tuple[ImagePair, ...], int]:
        """The pairs that a file lists, in the order of the source, or all; and how many more it lists.

        Each line of the file names two images, in either order, as COLMAP and hloc have it.

        Raises
        ------
        InputError
            If the file cannot be read, a line is something else, or names an image that is in no pair.
        """
        if listed is None:
            return self.pairs, 0
        known = {name for pair in self.pairs for name in pair.names}
        wanted = set()
        for line, names in listed_pairs(listed):
            for name in names:
                if name not in known:
                    raise not_held(self.path, f"matches of {name!r} ({listed}, line {line})", sorted(known))
            wanted.add(frozenset(names))
        found = tuple(pair for pair in self.pairs if frozenset(pair.names) in wanted)
        if not found:
            raise input_error(listed, f"lists no pair that {self.path} has matches of", "match these pairs first")
        return found, len(wanted) - len(found)


def listed_pairs(path: FilePath) -> Sequence[tuple[int, tuple[str, str]]]:
    """The pairs of names in a file, a pair in each line, with the numbers of the lines.

    Raises
    ------
    InputError
        If the file cannot be read, or a line does not hold two names.
    """
    text = read_content(path, "text table").decode("utf-8-sig", errors="replace")
    pairs = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if not words or line.startswith("#"):
            continue
        if len(words) != 2 or words[0] == words[1]:
            problem = f"line {number} holds {len(words)} names, not those of two images"
            raise input_error(path, problem, "write the names of two images in each line, separated by a space")
        pairs.append((number, (words[0], words[1])))
    return pairs
