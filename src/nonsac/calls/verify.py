"""Geometric verification: which pairs of images show the same scene, which of their matches are right, and how."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nonsac.calls.fallback import check_fallback
from nonsac.calls.pair_records import VerifiedPair, row_of
from nonsac.calls.pair_task import PairItem, PairTask
from nonsac.calls.pooling import FIRST_PAIRS, pooled_noise
from nonsac.files.atomic import check_target, write_atomically
from nonsac.files.errors import FilePath, input_error
from nonsac.io.colmap_pairs import DatabasePairs, check_writable, is_same_file, write_geometries
from nonsac.io.image_pairs import ImagePair
from nonsac.method.settings import Settings, shows_settings
from nonsac.result import VERSION
from nonsac.running.executors import Workers, parsed
from nonsac.running.journal import Journal
from nonsac.running.many import pool_of, run_many
from nonsac.seeds import canonical_seed

Progress = Callable[[int, int], object]

# 20,000 minimal samples for a pair of some hundred matches: COLMAP draws 10,000 at most.
_MAX_SAMPLES = 2


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
        is_watermark = "watermark"
        reasons = (is_watermark if p.configuration == is_watermark else p.status for p in self.pairs if not p.kept)
        return Counter(reasons)

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
        lines += [f"  {count:9,}  left out: {name.replace('_', ' ')}" for name, count in self.left_out.most_common()]
        if self.unmatched:
            lines.append(f"  {self.unmatched:9,}  listed, but without matches")
        return "\n".join(lines)


@shows_settings(max_samples=_MAX_SAMPLES)
def verify(
    database: FilePath,
    output: FilePath,
    *,
    pairs: FilePath | None = None,
    noise: float | None = None,
    trust_focal_lengths: bool = False,
    fallback: str = "skip",
    workers: Workers = None,
    resume: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
    **settings: Any,
) -> Verification:
    """Verify the matched pairs of a COLMAP database, and write their geometries of two views for its mappers.

    Parameters
    ----------
    database : path
        With keypoints and matches. COLMAP may have it open.
    output : path
        A copy with the geometries, which appears when all is done; or the database itself, which is then changed in one
        transaction.
    pairs : path, optional
        A file with the names of two images in each line; all pairs by default.
    noise : float, optional
        Standard deviation of a right match, in pixels. By default the pairs with the most matches measure it, and
        the others start from the median; one that has support, but is doubted with it, is tried without it, too.
    trust_focal_lengths : bool
        Whether also those focal lengths are taken for true that COLMAP says it has guessed (prior_focal_length 0).
    fallback : "skip" or "pycolmap"
        What is done with pairs whose cameras are not known: their rows are left as they are, or come from COLMAP's own
        verification.
    workers : None, int, concurrent.futures.Executor, Dask client or str
        As for `estimate_many`: processes. The output does not depend on them.
    resume : bool
        Whether to go on where a run was stopped; what it had done is kept beside the output, with the suffix .partial.
    overwrite : bool
        Whether an output that is there is replaced.
    progress : callable, optional
        Called as `progress(done, total)`.
    max_samples : int
        Of 10,000 minimal samples, about, for a pair of some hundred matches: with two, one that has a fifth of right
        matches is found. More find more, and take as many times as long for each pair that shows no common scene.
    {others}
        As in `nonsac.relative_pose`, for each pair.

    Returns
    -------
    Verification

    Raises
    ------
    InputError
        If the database cannot be read, is locked, damaged or without matches, or the output cannot be written; it is
        never written in part.
    ValueError, TypeError
        If an argument is out of its range; the message names it.
    """
    check_fallback(fallback)
    own = {"max_samples": _MAX_SAMPLES} | settings
    Settings.of("verify", own | {"noise": noise})
    parsed(workers)
    own["rng"] = canonical_seed(settings.get("rng", 0))
    if noise is not None:
        own["noise"] = noise
    _check_output(database, output, overwrite)
    start = time.perf_counter()
    journal = Path(f"{output}.partial")
    with ExitStack() as stack:
        with DatabasePairs.open(database) as source:
            chosen, unmatched = source.chosen(pairs)
            work = _Work(source, chosen, trust_focal_lengths, fallback, own)
            kept = stack.enter_context(Journal(journal, work.settings, resume, "pairs", _check_record))
            with pool_of(workers) as pool:
                pooled = work.run(kept, pool, progress or _no_progress)
        write_geometries(database, output, _rows(chosen, kept))  # what is still read cannot be written
        found = tuple(VerifiedPair.of_record(record) for record in kept.records())
    journal.unlink()
    return Verification(found, unmatched, pooled if noise is None else noise, time.perf_counter() - start)


@dataclass(frozen=True)
class _Work:
    """The pairs to be verified, and how."""

    source: DatabasePairs
    chosen: Sequence[ImagePair]
    trusts_focal_lengths: bool
    fallback: str
    own: dict[str, Any]

    @property
    def settings(self) -> dict[str, Any]:
        """What the records depend on."""
        return {
            "database": self.source.fingerprint,
            "pairs": len(self.chosen),
            "fallback": self.fallback,
            "trust_focal_lengths": self.trusts_focal_lengths,
            "settings": {name: repr(value) for name, value in self.own.items()},
            "version": VERSION,
        }

    def run(self, kept: Journal, pool: Executor | None, progress: Progress) -> float | None:
        """Do what is missing; returns the noise that the pairs share."""
        first: list[int] = []
        if "noise" not in self.own:
            by_matches = sorted(range(len(self.chosen)), key=lambda k: -self.chosen[k].num_matches)
            first = sorted(by_matches[:FIRST_PAIRS])
        self._run_some(first, None, kept, pool, progress)
        measured = (record["noise"] for record in kept.records(first) if record["status"] == "ok")
        noise = pooled_noise(measured)
        self._run_some(range(len(self.chosen)), noise, kept, pool, progress)
        return noise

    def _run_some(
        self, numbers: Iterable[int], noise: float | None, kept: Journal, pool: Executor | None, progress: Progress
    ) -> None:
        missing = [number for number in numbers if number not in kept]
        items = (self._item(number) for number in missing)
        task = PairTask(noise, self.fallback, self.own)
        for number, (item, outcome) in zip(missing, run_many(task, items, pool, together=True), strict=True):
            kept.add(number, outcome if isinstance(outcome, dict) else item.failed(outcome))
            progress(kept.count, len(self.chosen))

    def _item(self, number: int) -> PairItem:
        pair = self.chosen[number]
        matches = self.source.read(pair)
        known = self.trusts_focal_lengths or self.source.is_calibrated(pair)
        return PairItem(pair.names, matches, known)


def _rows(chosen: Sequence[ImagePair], kept: Journal) -> Iterator[tuple[ImagePair, Any, dict[str, Any]]]:
    for pair, record in zip(chosen, kept.records(), strict=True):
        row = row_of(record)
        if row is not None:
            yield pair, *row


def _check_output(database: FilePath, output: FilePath, overwrite: bool) -> None:
    check_target(output)
    if is_same_file(database, output):
        check_writable(database)
    elif Path(output).exists() and not overwrite:
        raise input_error(output, "is there already", "give another name, or overwrite it (--overwrite)")


def _check_record(position: int, record: Any) -> None:
    VerifiedPair.of_record(record)
    row_of(record)


def _no_progress(done: int, total: int) -> None:
    return None
