"""What goes to stdout, and what goes to stderr."""

from __future__ import annotations

from pathlib import Path

import typer


def to_stdout(text: str) -> None:
    """On stdout."""
    typer.echo(text)


def to_stderr(message: str) -> None:
    """One line on stderr."""
    line = " ".join(message.split()).replace("\0", "\\0")
    typer.echo(f"nonsac: {line}", err=True)


def wrote(path: Path, what: str, quietly: bool) -> None:
    if not quietly:
        to_stdout(f"wrote {path}: {what}")
