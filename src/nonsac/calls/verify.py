"""Geometric verification: which pairs of images show the same scene, which of their matches are right, and how."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from nonsac.calls.fallback import check_fallback
from nonsac.calls.pair_records import VerifiedPair, row_of, with_checksum
from nonsac.calls.pair_task import PairItem, PairTask
from nonsac.calls.pooling import FIRST_PAIRS, pooled_noise
from nonsac.calls.run_arguments import Progress, RunArguments, check_no_input, digest_of, settings_of_each
from nonsac.calls.verification import Verification
from nonsac.cameras.camera import CameraLike
from nonsac.files.atomic import check_target
from nonsac.files.errors import FilePath, input_error
from nonsac.io.camera_lists import cameras_of
from nonsac.io.colmap_pairs import DatabasePairs, Found, check_writable, is_same_file, write_geometries
from nonsac.io.hloc_pairs import HlocPairs
from nonsac.io.image_pairs import ImagePair
from nonsac.kernels.ahead import compile_for
from nonsac.method.settings import shows_settings
from nonsac.running.executors import Workers
from nonsac.running.journal import Journal
from nonsac.running.many import pool_of, run_many
from nonsac.values.checks import file_name, flag
from nonsac.values.version import VERSION

# 20,000 minimal samples for a pair of some hundred matches: COLMAP draws 10,000 at most.
_MAX_SAMPLES = 2


@shows_settings(max_samples=_MAX_SAMPLES)
def verify(
    database: FilePath | tuple[FilePath, FilePath],
    output: FilePath,
    *,
    pairs: FilePath | None = None,
    cameras: FilePath | CameraLike | None = None,
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
    database : path, or two of them
        With keypoints and matches. COLMAP may have it open. Or the features and the matches of hloc, of which a
        database is made: `output`.
    output : path
        A copy with the geometries, which appears when all is done; or the database itself, which is then changed in one
        transaction.
    pairs : path, optional
        A file with the names of two images in each line; all pairs of a database by default.
    cameras : path or camera, optional
        For hloc: a list of images and their cameras (a name and a line of COLMAP's cameras.txt in each), or the camera
        of all, with the size of its images.
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
    flag("trust_focal_lengths", trust_focal_lengths)
    own = settings_of_each("verify", {"max_samples": _MAX_SAMPLES} | settings, noise)
    run = RunArguments(output, pairs, workers, resume, overwrite, progress)
    check_no_input(output, (*(database if isinstance(database, (tuple, list)) else ()), pairs, cameras))
    start = time.perf_counter()
    with ExitStack() as stack:
        path = stack.enter_context(_database_of(database, output, pairs, cameras))
        _check_output(path, output, overwrite)
        with DatabasePairs.open(path) as source:
            chosen, unmatched = source.chosen(pairs)
            work = _Work(source, chosen, trust_focal_lengths, fallback, own)
            check = partial(_check_record, len(chosen))
            kept = stack.enter_context(Journal(run.journal, work.settings, resume, "pairs", check))
            with pool_of(workers) as pool:
                pooled = work.run(kept, pool, run.tell)
        write_geometries(path, output, _rows(chosen, kept))  # what is still read cannot be written
        found = tuple(VerifiedPair.of_record(record) for record in kept.records())
    run.journal.unlink()
    return Verification(found, unmatched, pooled if noise is None else noise, time.perf_counter() - start)


@contextmanager
def _database_of(
    database: FilePath | tuple[FilePath, FilePath],
    output: FilePath,
    pairs: FilePath | None,
    cameras: FilePath | CameraLike | None,
) -> Iterator[FilePath]:
    """The database, or one that is made of files of hloc for the time being."""
    if not isinstance(database, (tuple, list)):
        file_name("database", database)
        if cameras is not None:
            raise ValueError("cameras are those of the database; leave them out, or change the database")
        yield database
        return
    if pairs is None or cameras is None:
        raise ValueError("files of hloc need pairs, a list of them, and cameras, which they do not hold")
    if len(database) != 2:
        raise ValueError(
            f"database must be one file, or the features and the matches of hloc, got {len(database)} files"
        )
    check_target(output)
    with TemporaryDirectory(dir=Path(output).absolute().parent, prefix=".nonsac-") as folder:
        made = Path(folder) / "database.db"
        with HlocPairs.open(*database, pairs, cameras_of(cameras)) as source:
            source.write_database(made)
        yield made


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
            "pairs": digest_of([pair.names for pair in self.chosen]),
            "fallback": self.fallback,
            "trust_focal_lengths": self.trusts_focal_lengths,
            "settings": {name: repr(value) for name, value in self.own.items()},
            "version": VERSION,
        }

    def run(self, kept: Journal, pool: Executor | None, progress: Progress) -> float | None:
        """Do what is missing; returns the noise that the pairs share."""
        first: list[int] = []
        if "noise" not in self.own:
            known = [number for number, pair in enumerate(self.chosen) if self._relies_on(pair)]
            first = sorted(sorted(known, key=lambda k: -(self.chosen[k].num_matches or 0))[:FIRST_PAIRS])
        self._run_some(first, None, kept, pool, progress)
        measured = (record["noise"] for record in kept.records(first) if record["status"] == "ok")
        noise = pooled_noise(measured)
        self._run_some(range(len(self.chosen)), noise, kept, pool, progress)
        return noise

    def _run_some(
        self, numbers: Iterable[int], noise: float | None, kept: Journal, pool: Executor | None, progress: Progress
    ) -> None:
        missing = [number for number in numbers if number not in kept]
        if missing:  # workers would each compile it for themselves
            compile_for("relative_pose", noise)
        items = (self._item(number) for number in missing)
        task = PairTask(noise, self.fallback, self.own)
        for number, (item, outcome) in zip(missing, run_many(task, items, pool, together=True), strict=True):
            record = outcome if isinstance(outcome, dict) else item.failed(outcome)
            kept.add(number, with_checksum(record, item.matches))
            progress(kept.count, len(self.chosen))

    def _item(self, number: int) -> PairItem:
        pair = self.chosen[number]
        return PairItem(pair.names, self.source.read(pair), self._relies_on(pair))

    def _relies_on(self, pair: ImagePair) -> bool:
        return self.trusts_focal_lengths or self.source.is_calibrated(pair)


def _rows(chosen: Sequence[ImagePair], kept: Journal) -> Iterator[Found]:
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


def _check_record(count: int, position: int, record: Any) -> None:
    if not 0 <= position < count:
        raise ValueError("a pair")
    VerifiedPair.of_record(record)
    row_of(record)
