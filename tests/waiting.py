"""Waiting for what another process does."""

import time


def wait_until(happened, process=None, seconds=120):
    """Until something has happened; at most so long, and not where the process that was to do it has ended."""
    deadline = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < deadline, "it took too long"
        assert process is None or process.poll() is None, "the process has ended"
        time.sleep(0.005)
