"""Fixtures of the io tests."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from nonsac.io import InputError

# For io_samples, whatever import mode pytest is run in.
sys.path.insert(0, str(Path(__file__).parent))

MakeFile = Callable[[str, bytes | str], Path]


@pytest.fixture
def make_file(tmp_path: Path) -> MakeFile:
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
        with pytest.raises(InputError) as caught:
            function(path, *rest)
        message = str(caught.value)
        assert "\n" not in message
        assert message.startswith(f"{path}: ")
        assert "; " in message
        return message

    return call
