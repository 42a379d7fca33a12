"""nonsac simulate."""

import json
from pathlib import Path

import numpy as np
import pytest

from cli_samples import said
from nonsac import io, simulate


def arguments(problem="registration", n="1e3", output="rows.npy"):
    return ("simulate", problem, "-n", n, "--outlier-ratio", ".85", "--noise", ".0025", "--output", output)


@pytest.mark.parametrize("problem", ["relative-pose", "absolute-pose", "registration"])
def test_writes_what_the_library_writes_and_tells_the_truth(run, folder, problem):
    code, out, err = run(*arguments(problem), "--seed", "3", "--truth", "T.txt", "--dtype", "float32")
    assert (code, said(err)) == (0, [])
    T = simulate.to_file("same.npy", problem, 1000, 0.85, 0.0025, 3, dtype="float32")
    assert Path("rows.npy").read_bytes() == Path("same.npy").read_bytes()
    told = json.loads(out)
    assert (told["rows"], told["outliers"], told["problem"]) == (1000, 850, problem)
    assert told["T"] == T.tolist()
    np.testing.assert_array_equal(io.read_transform("T.txt"), T)


def test_truth_as_json_is_what_is_printed(run, folder):
    _, out, _ = run(*arguments(), "--truth", "truth.json")
    assert Path("truth.json").read_text() == out


def test_parquet_by_name(run, folder):
    parquet = pytest.importorskip("pyarrow.parquet")
    assert run(*arguments("absolute-pose", output="rows.parquet"), "--row-group", "400")[0] == 0
    table = parquet.ParquetFile("rows.parquet")
    assert table.schema_arrow.names == ["u", "v", "X", "Y", "Z"]
    assert table.metadata.num_row_groups == 3


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (arguments(n="1.5"), "'1.5' is not a whole number of at least 1, such as 1e8"),
        (arguments(n="many"), "'many' is not a whole number"),
        (arguments(n="nan"), "'nan' is not a whole number"),
        (arguments(n="inf"), "'inf' is not a whole number"),
        (arguments(n="0"), "'0' is not a whole number"),
        (arguments(n="1e15"), "GB are free there; make room, or write fewer rows"),
        (arguments(output="rows.csv"), "unknown suffix '.csv'; use one of .npy, .parquet"),
        (arguments("pnp"), "pnp"),
        ((*arguments(), "--truth", "rows.npy"), "end the name in .txt or .json"),
        ((*arguments(), "--truth", "none/T.txt"), "does not exist; create it first"),
        ((*arguments(), "--dtype", "int8"), "int8"),
    ],
)
def test_misuse(refused, changed, words):
    assert words in refused(*changed)
