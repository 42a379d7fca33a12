"""Fixtures of the tests of sources."""

import os

import pytest

from nonsac.io import InputError


@pytest.fixture
def refused():
    """Call what has to raise a one-line InputError about a file, and return the message."""

    def call(path, function, *rest, **named):
        with pytest.raises(InputError) as caught:
            function(*rest, **named)
        message = str(caught.value)
        assert message.startswith(f"{path}: ")
        assert "; " in message
        assert "\n" not in message
        return message

    return call


def touch(path):
    """Let a file look as if it had just been written again."""
    status = path.stat()
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns + 1_000_000))


def cut(path):
    """Take the last bytes of a file away, and hide it."""
    status = path.stat()
    os.truncate(path, status.st_size - 5)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def lengthen(path):
    with path.open("ab") as file:
        file.write(b"more")


@pytest.fixture(params=[touch, cut, lengthen], ids=lambda change: change.__name__)
def change(request):
    """Changes a file."""
    return request.param
