"""Fixtures shared by all tests."""

import hashlib
import os
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path

_SRC = Path(__file__).resolve().parents[1] / "src" / "nonsac"


def _numba_cache() -> str:
    """A folder for compiled kernels that is named by the source: numba itself does not see edits in other files."""
    digest = hashlib.sha256()
    for path in sorted(_SRC.rglob("*.py")):
        digest.update(str(path.relative_to(_SRC)).encode() + path.read_bytes())
    folder = Path(os.environ.get("NONSAC_TEST_CACHE", tempfile.gettempdir()))
    return str(folder / f"nonsac-tests-{os.getuid()}-{digest.hexdigest()[:16]}")


os.environ["NUMBA_CACHE_DIR"] = _numba_cache()  # before nonsac is imported

import hypothesis  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402

import nonsac  # noqa: E402
from nonsac.kernels.ahead import SIGNATURES, compile_side_by_side  # noqa: E402

# The first example compiles a kernel, so no deadline; the same examples in every run.
hypothesis.settings.register_profile("nonsac", deadline=None, derandomize=True, database=None)
hypothesis.settings.load_profile("nonsac")

_DEFAULT_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile once what the tests share, on all cores, before several processes would each begin with the same."""
    if session.config.getoption("numprocesses", None) and not hasattr(session.config, "workerinput"):
        compile_side_by_side(SIGNATURES)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "data" in getattr(item, "fixturenames", ()):  # real data
            item.add_marker("slow")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--seed", type=int, default=0, help="varies the random numbers of all tests (default 0)")
    parser.addoption(
        "--fuzz", type=int, default=0, help="damaged files and odd arguments to try (default: some thousand)"
    )


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


@pytest.fixture
def make_file(tmp_path: Path) -> Callable[[str, bytes | str], Path]:
    """Write a file of given content byte by byte and return its path."""

    def make(name: str, content: bytes | str) -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return make


@pytest.fixture
def refused() -> Callable[..., str]:
    """Call a function that has to raise a one-line InputError naming the file, and return the message."""

    def call(function: Callable[..., object], path: object, *rest: object) -> str:
        with pytest.raises(nonsac.InputError) as caught:
            function(path, *rest)
        message = str(caught.value)
        assert "\n" not in message
        assert message.startswith(f"{path}: ")
        assert "; " in message
        return message

    return call
