"""What was found of all pairs of a database."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nonsac.calls.pair_records import VerifiedPair
from nonsac.files.atomic import write_atomically
from nonsac.files.errors import FilePath


@dataclass(frozen=True)
class Verification:
    """What was found of all pairs.

    Attributes
    ----------
    pairs : tuple of VerifiedPair
        In the order of the database.
    unmatched : int
        How many pairs were asked for that have no matches.
    noise : float or None
        In pixels, that the first pairs have measured, or that was given; None if each pair has measured its own.
    seconds : float
        How long it took, since it was resumed.
    """

    pairs: tuple[VerifiedPair, ...]
    unmatched: int = 0
    noise: float | None = None
    seconds: float = field(default=0.0, compare=False)

    @property
    def kept(self) -> tuple[VerifiedPair, ...]:
        """The pairs that a mapper gets."""
        return tuple(pair for pair in self.pairs if pair.kept)

    @property
    def configurations(self) -> Counter[str]:
        """How many pairs are kept, by the kind of their geometry."""
        return Counter(pair.configuration for pair in self.kept)

    @property
    def left_out(self) -> Counter[str]:
        """How many are not, by the reason."""
        watermark = "watermark"
        return Counter(watermark if p.configuration == watermark else p.status for p in self.pairs if not p.kept)

    @property
    def _reasons(self) -> Counter[str]:
        """As `left_out`, but why pairs were skipped."""
        reasons: Counter[str] = Counter()
        for status, count in self.left_out.items():
            if status != "skipped":
                reasons[status.replace("_", " ")] = count
        reasons.update(remark for pair in self.pairs if pair.status == "skipped" for remark in pair.remarks)
        return reasons

    def to_dict(self) -> dict[str, Any]:
        """What `print` shows, ready for JSON."""
        return {
            "pairs": len(self.pairs),
            "kept": dict(self.configurations),
            "left_out": dict(self.left_out),
            "unmatched": self.unmatched,
            "noise": self.noise,
            "seconds": self.seconds,
        }

    def write(self, path: FilePath) -> None:
        """Write a line of JSON for each pair, in the order of the database."""

        def write(temporary: Path) -> None:
            with temporary.open("w", encoding="utf-8", newline="\n") as file:
                file.writelines(json.dumps(pair.to_dict()) + "\n" for pair in self.pairs)

        write_atomically(path, write)

    def __str__(self) -> str:
        lines = [f"{len(self.pairs):,} pairs, {len(self.kept):,} kept"]
        if self.noise is not None:
            lines[0] += f"; noise {self.noise:.3g} pixels"
        lines += [f"  {count:9,}  {name.replace('_', ' ')}" for name, count in self.configurations.most_common()]
        lines += [f"  {count:9,}  left out: {reason}" for reason, count in self._reasons.most_common()]
        if self.unmatched:
            lines.append(f"  {self.unmatched:9,}  listed, but without matches")
        return "\n".join(lines)
