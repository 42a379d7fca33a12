"""The files that a command writes: all are checked before the work, and written after the result is printed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from nonsac.cli.messages import to_stderr, to_stdout, wrote
from nonsac.files.identity import identity_of

if TYPE_CHECKING:
    from nonsac.result import Result

Draw = Callable[[Path, str], object]


@dataclass(frozen=True)
class Outputs:
    """The files asked for. All are checked before the computation, so that nobody waits for a mistyped suffix."""

    transform: Path | None = None
    aligned: Path | None = None
    inliers: Path | None = None
    picture: Path | None = None
    hypotheses: Path | None = None
    report: Path | None = None

    def check(self, inputs: Iterable[tuple[str, str | Path | None]]) -> None:
        """Refuse unknown suffixes, missing folders, and the same path twice; `inputs` are names and paths."""
        from nonsac.files.atomic import check_target

        taken = {identity_of(path): name for name, path in inputs if path is not None}
        for option, path, check_suffix in self._wanted():
            try:
                check_suffix(path)
                check_target(path)
            except ValueError as error:
                raise typer.BadParameter(str(error), param_hint=repr(option)) from error
            other = taken.setdefault(identity_of(path), option)
            if other != option:
                raise typer.BadParameter(f"{path} is already used for {other}", param_hint=repr(option))

    def _wanted(self) -> Iterator[tuple[str, Path, Callable[[Path], object]]]:
        from nonsac.files.masks import check_mask_suffix
        from nonsac.files.paths import choose_by_suffix
        from nonsac.io.clouds import WRITERS
        from nonsac.plot import picture_suffix

        checks: tuple[tuple[str, Path | None, Callable[[Path], object]], ...] = (
            ("--output", self.transform, _text_suffix),
            ("--save-aligned", self.aligned, lambda path: choose_by_suffix(path, WRITERS)),
            ("--save-inliers", self.inliers, check_mask_suffix),
            ("--picture", self.picture, picture_suffix),
            ("--picture-hypotheses", self.hypotheses, picture_suffix),
            ("--json", self.report, lambda path: None),
        )
        return ((option, path, check) for option, path, check in checks if path is not None)

    def write(self, result: Result, draw: Draw | None, quietly: bool) -> None:
        """Write the transform, the inliers and the pictures, and say so; there is no `draw` for data without points."""
        from nonsac.io import write_transform

        if self.transform is not None and worth_writing(self.transform, "T", result):
            write_transform(self.transform, result.T)
            wrote(self.transform, "T", quietly)
        if self.inliers is not None and worth_writing(self.inliers, "the inliers of T", result):
            result.write_inliers(self.inliers)
            wrote(self.inliers, "which rows are inliers", quietly)
        if self.picture is not None:
            _write_picture(self.picture, result, draw, quietly)
        if self.hypotheses is not None:
            from nonsac import plot

            plot.hypotheses(self.hypotheses, result)
            wrote(self.hypotheses, "what came of each sample", quietly)


def show(result: Result, text: str, more: dict[str, Any], as_json: bool) -> None:
    """Print a result, before any file is written, so that a full disk cannot take it away."""
    to_stdout(json.dumps(result.to_dict() | more, indent=1, allow_nan=False) if as_json else text)
    if not result.success:
        to_stderr(f"NOT TRUSTED ({result.status}): {result.status.explanation}")


def exit_code(result: Result) -> typer.Exit:
    return typer.Exit(0 if result.success else 1)


def matrix_text(result: Result) -> str:
    return "\n".join("  " + " ".join(f"{x:15.9g}" for x in row) for row in result.T)


def worth_writing(path: Path, what: str, result: Result) -> bool:
    """Whether there is an answer; says loudly if there is none, or one that is not to be trusted."""
    if not result.found:
        to_stderr(f"{path} is NOT WRITTEN: no answer was found")
    elif not result.success:
        to_stderr(f"{path} holds {what}, and T is a guess that is NOT TRUSTED")
    return result.found


def _write_picture(path: Path, result: Result, draw: Draw | None, quietly: bool) -> None:
    if draw is None:
        to_stderr(f"{path} is NOT WRITTEN: there is no finite point to draw")
        return
    title = f"trusted, {100 * result.inlier_ratio:.0f} % inliers"
    if not result.success:
        title = f"NOT TRUSTED: {result.status.replace('_', ' ')}"
    draw(path, title)
    wrote(path, "the picture", quietly)


def _text_suffix(path: Path) -> None:
    from nonsac.io.clouds import READERS, TEXT_SUFFIXES

    others = {*READERS, ".png", ".pdf", ".svg", ".parquet", ".h5", ".db"} - set(TEXT_SUFFIXES)
    if path.suffix.lower() in others:
        raise ValueError(f"{path}: T is written as text; end the name in .txt")


def check_report(report: Path | None, others: Iterable[Path | None], plot: Path | None = None) -> None:
    """Refuse to write lines and pictures of many pairs over another file, and unknown suffixes, before the work."""
    from nonsac.files.atomic import check_target
    from nonsac.plot import picture_suffix

    taken = {identity_of(path) for path in others if path is not None}
    checks: tuple[tuple[str, Path | None, Callable[[Path], object]], ...] = (
        ("--report", report, _lines_suffix),
        ("--plot", plot, picture_suffix),
    )
    for option, path, check in checks:
        if path is None:
            continue
        try:
            check(path)
            check_target(path)
        except ValueError as error:
            raise typer.BadParameter(str(error), param_hint=repr(option)) from error
        if identity_of(path) in taken:
            raise typer.BadParameter(f"{path} is used already", param_hint=repr(option))
        taken.add(identity_of(path))


def tell_of_rest(target: Path) -> None:
    """Say where what was done is kept."""
    rest = target.with_name(target.name + ".partial")
    if rest.exists():
        to_stderr(f"what is done is kept in {rest}; --resume goes on there")


def _lines_suffix(path: Path) -> None:
    if path.suffix.lower() != ".jsonl":
        raise ValueError(f"{path}: they are written as lines of JSON; end the name in .jsonl")
