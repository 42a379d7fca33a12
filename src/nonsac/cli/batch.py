"""Many pairs in one run."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nonsac.calls.registry import CALLS
from nonsac.cli.batch_run import FACTS, BatchRun
from nonsac.cli.messages import to_stderr
from nonsac.cli.options import Quiet, positive
from nonsac.cli.session import session
from nonsac.files.identity import identity_of

if TYPE_CHECKING:
    from nonsac.cli.manifest import Manifest
    from nonsac.running.journal import Journal

_SUFFIXES = (".jsonl", ".parquet")


CallName = StrEnum("CallName", {call.name: call.command for call in CALLS.values()})  # type: ignore[misc]


def batch(
    manifest: Annotated[
        Path,
        typer.Argument(
            metavar="MANIFEST",
            help="One pair in each row (.csv with a header, or .jsonl). The columns are named as the arguments and "
            "options of the calls; file names are relative to the manifest.",
        ),
    ],
    output: Annotated[
        Path, typer.Option(metavar="FILE", help="Write one line for each pair, in their order (.jsonl or .parquet).")
    ],
    call: Annotated[
        CallName | None, typer.Option(show_default="the column 'call'", help="The call of rows that name none.")
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, show_default="all cores", help="Number of processes.")] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(
            parser=positive,
            metavar="SECONDS",
            show_default="none",
            help="For each pair: begin no further sample after this time.",
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where a run with the same manifest and output was stopped.")
    ] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an output that is complete.")] = False,
    quiet: Quiet = False,
) -> None:
    """Run many pairs, each on one process; one that fails never stops the others.

    What is done is kept in FILE.partial; FILE appears when all is done.

    A run that was stopped goes on with --resume, and ends with the same file, byte for byte, as one that was not.
    """
    journal = output.with_name(output.name + ".partial")
    _check_output(manifest, output)
    _check_progress(output, journal, resume, overwrite)
    with session(quiet, "pairs") as progress:
        from nonsac.cli.manifest import Manifest
        from nonsac.running.many import pool_of

        pairs = Manifest.read(manifest, call)
        _check_inputs(output, pairs)
        if time_limit is not None and "register-clouds" in pairs.calls:
            to_stderr("register-clouds takes no time limit: its pairs run to their end")
        with _open(journal, pairs, time_limit, resume) as kept, pool_of(workers) as pool:
            try:
                BatchRun(pairs, kept, pool, time_limit, progress).complete()
            except BaseException:
                to_stderr(f"{kept.count} of {pairs.count} pairs are kept in {journal}; --resume goes on there")
                raise
        counts = _deliver(kept, output)
    journal.unlink()
    trusted = counts["trusted"] == pairs.count
    if not (quiet and trusted):
        to_stderr(f"{_told(counts, pairs.count)}; wrote {output}")
    raise typer.Exit(0 if trusted else 1)


def _check_output(manifest: Path, output: Path) -> None:
    from nonsac.files.atomic import check_target

    if output.suffix.lower() not in _SUFFIXES:
        raise _bad(
            "--output", f"{output}: results are written as {' or '.join(_SUFFIXES)}; end the name in one of these"
        )
    if output.suffix.lower() == ".parquet":
        from nonsac.files.parquet import import_parquet

        import_parquet(output)
    if identity_of(output) == identity_of(manifest):
        raise _bad("--output", f"{output} is the manifest")
    try:
        check_target(output)
    except ValueError as error:
        raise _bad("--output", str(error)) from error


def _check_progress(output: Path, journal: Path, resume: bool, overwrite: bool) -> None:
    """Refuse to replace what is complete; say if there is nothing to resume."""
    nothing = resume and not journal.exists()
    if output.exists() and not overwrite:
        if nothing:
            raise _bad("--resume", f"{output} is complete, and nothing is left to resume; remove it to run all anew")
        raise _bad("--output", f"{output} is there already; --overwrite replaces it")
    if nothing:
        to_stderr(f"nothing to resume at {journal}: starting anew")


def _check_inputs(output: Path, pairs: Manifest) -> None:
    """Refuse to replace the data of a pair."""
    if not output.exists():
        return
    replaced = identity_of(output)
    for job in pairs.jobs():
        if replaced in map(identity_of, job.data):
            raise _bad("--output", f"{output} is read for the pair {job.name!r}")


def _bad(option: str, message: str) -> typer.BadParameter:
    return typer.BadParameter(message, param_hint=repr(option))


def _open(path: Path, pairs: Manifest, time_limit: float | None, resume: bool) -> Journal:
    from nonsac.running.journal import Journal
    from nonsac.values.version import VERSION

    settings = {"manifest": pairs.digest[:16], "--call": pairs.call, "--time-limit": time_limit, "version": VERSION}

    def check(position: int, record: Any) -> None:
        if not 0 <= position < pairs.count or not {"success", "status", "error"} <= record.keys():
            raise ValueError("a pair")

    return Journal(path, settings, resume, "pairs", check)


# --- the whole -----------------------------------------------------------------------------


def _deliver(kept: Journal, output: Path) -> Counter[str]:
    """Write all that is kept; returns how many pairs ended in which way."""
    from nonsac.files.atomic import write_atomically

    counts: Counter[str] = Counter()

    def records() -> Iterator[dict[str, Any]]:
        counts.clear()
        for record in kept.records():
            counts["trusted" if record["success"] else "failed" if record["error"] else record["status"]] += 1
            yield record

    write = _write_parquet if output.suffix.lower() == ".parquet" else _write_lines
    write_atomically(output, lambda temporary: write(temporary, records()))
    return counts


def _write_lines(path: Path, records: Iterator[dict[str, Any]]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(json.dumps(record) + "\n" for record in records)


def _write_parquet(path: Path, records: Iterator[dict[str, Any]]) -> None:
    """T as 16 numbers, row by row, or the numbers of another model; null if there is none."""
    from itertools import islice

    import pyarrow as pa
    from pyarrow.parquet import ParquetWriter

    kinds = dict.fromkeys(("name", "call", "status", "error"), pa.string()) | {
        "success": pa.bool_(),
        "T": pa.list_(pa.float64(), 16),
        "model": pa.list_(pa.float64()),
        "num_inliers": pa.int64(),
        "num_rows": pa.int64(),
        "remarks": pa.list_(pa.string()),
    }
    names = ("name", "call", *FACTS, "remarks", "error")
    schema = pa.schema([(name, kinds.get(name, pa.float64())) for name in names])
    with ParquetWriter(path, schema) as writer:
        while some := list(islice(records, 10_000)):
            writer.write_table(pa.Table.from_pylist([_flat(record) for record in some], schema))


def _flat(record: dict[str, Any]) -> dict[str, Any]:
    return record | {name: _numbers(record[name]) for name in ("T", "model")}


def _numbers(nested: list[Any] | None) -> list[float] | None:
    """The numbers of a matrix or vector, row by row; None if there is none, or if it was not found."""
    import numpy as np

    numbers = np.array(nested if nested is not None else [np.nan], np.float64)  # None becomes NaN
    return numbers.ravel().tolist() if np.isfinite(numbers).all() else None


def _told(counts: Counter[str], total: int) -> str:
    """The last line: how many pairs ended in which way."""
    trusted, failed = counts["trusted"], counts["failed"]
    kinds = [f"{count:,} {kind}" for kind, count in sorted(counts.items()) if kind not in ("trusted", "failed")]
    detail = f" ({', '.join(kinds)})" if kinds else ""
    return f"{total:,} pairs: {trusted:,} trusted, {total - trusted - failed:,} not trusted{detail}, {failed:,} failed"
