"""The code on the pages of docs/ runs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from nonsac.estimators.named import ESTIMATORS

DOCS = Path(__file__).resolve().parents[1] / "docs"
RUN = ["choosing.md", "compare.md", "cores.md", "extending.md", "matchers.md"]


@pytest.mark.parametrize("page", RUN)
def test_code_runs(page, tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert blocks
    script = tmp_path / "page.py"
    script.write_text("\n".join(blocks), encoding="utf-8")
    command = [sys.executable, "-W", "error", str(script)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ, cwd=tmp_path, timeout=300)
    assert done.returncode == 0, done.stderr


CALLS = {"RelativePose": "`relative_pose`", "AbsolutePose": "`absolute_pose`", "Registration": "`register_pairs`"}


def test_estimators_of_other_libraries_are_all_in_the_table():
    page = (DOCS / "extending.md").read_text(encoding="utf-8")
    lines = (
        page.split("| name | what it is | calls | extra |\n| --- | --- | --- | --- |\n")[1]
        .split("\n\n")[0]
        .splitlines()
    )
    assert lines == [
        f"| `{name}` | {named.about} | {', '.join(CALLS[kind] for kind in named.problems)} | `{named.extra}` |"
        for name, named in ESTIMATORS.items()
        if named.where.startswith("others.")
    ]
