"""A fixture for tests of hostile files."""

from pathlib import Path

import pytest


@pytest.fixture
def little_memory():
    """The address space may grow by 1 GB: what allocates what a header promises fails in another way."""
    resource = pytest.importorskip("resource")
    status = Path("/proc/self/status")
    if not status.exists():
        pytest.skip("the system does not tell how large this process is")
    held = next(line for line in status.read_text().split("\n") if line.startswith("VmSize"))
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (int(held.split()[1]) * 1024 + (1 << 30), limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, limits)
