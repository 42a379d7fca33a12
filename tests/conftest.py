"""Fixtures shared by all tests."""

import os
import shutil
import tempfile
import zlib
from pathlib import Path

# Before nonsac is imported: numba's disk cache does not see edits in other files, so every run compiles afresh.
_NUMBA_CACHE = tempfile.mkdtemp(prefix="nonsac-numba-")
os.environ["NUMBA_CACHE_DIR"] = _NUMBA_CACHE

import hypothesis  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

# The first example compiles a kernel, so no deadline; the same examples in every run.
hypothesis.settings.register_profile("nonsac", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("nonsac")

_DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", type=int, default=0, help="varies the random numbers of all tests (default 0)")


def pytest_unconfigure() -> None:
    shutil.rmtree(_NUMBA_CACHE, ignore_errors=True)


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A random generator with a seed of its own for each test, the same in every run with the same --seed."""
    seed = request.config.getoption("--seed")
    request.node.add_report_section("setup", "random numbers", f"replay: pytest '{request.node.nodeid}' --seed {seed}")
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()) + seed)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real data, which is not part of the repository."""
    folder = Path(os.environ.get("NONSAC_DATA", _DEFAULT_DATA))
    if not folder.is_dir():
        pytest.skip(f"no real data: {folder} is missing; set NONSAC_DATA to its folder")
    return folder
