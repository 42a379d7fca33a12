"""The library that reads and writes Parquet files."""

from typing import Any

from nonsac.files.errors import FilePath, library_missing


def import_parquet(path: FilePath) -> Any:
    """The module `pyarrow.parquet`, or the error that says how to install it."""
    try:
        from pyarrow import parquet  # type: ignore[import-untyped,unused-ignore]
    except ImportError as error:
        raise library_missing(path, "Parquet files", "pyarrow", "parquet") from error
    return parquet
