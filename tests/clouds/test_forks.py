"""Raw clouds in forked processes, where OpenMP's threads are missing."""

import subprocess
import sys

import pytest

FORK = """
import multiprocessing, warnings
import nonsac
from nonsac import simulate

warnings.simplefilter("ignore")
scans = simulate.demo_scans(0)
pool = multiprocessing.get_context("fork").Pool

def register():
    return nonsac.register_clouds(scans.source, scans.target, samples=4).T.tobytes().hex()

if __name__ == "__main__":
    here = register()
    with pool(1) as workers:
        assert workers.apply_async(register).get(timeout=90) == here
    print("same")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="forks are the way of Linux")
def test_a_forked_process_gives_the_same_bits():
    done = subprocess.run([sys.executable, "-c", FORK], capture_output=True, text=True, timeout=200)
    assert (done.stdout, done.stderr) == ("same\n", "")
