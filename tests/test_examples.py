"""The examples run, and find what they say."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SAID = {  # lines that it prints, as patterns
    "line.py": [rf"{angle} deg, noise {noise}: 0.0\d deg off, ok" for angle in (0, 30, 90) for noise in (0.005, None)],
    "plane.py": [rf"{name}, noise {noise}: 0.0\d deg off, ok" for name in ("ground", "ramp") for noise in (0.02, None)],
    "homography.py": [rf"noise {noise}: H is off by 0.000\d, ok" for noise in (0.002, None)],
}


def test_every_example_is_tested():
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(SAID)


@pytest.mark.parametrize("name", SAID)
@pytest.mark.slow
def test_example(name):
    command = [sys.executable, "-W", "error", str(EXAMPLES / name)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ, timeout=300)
    assert done.returncode == 0, done.stderr
    for pattern in SAID[name]:
        assert re.search(pattern, done.stdout), done.stdout
