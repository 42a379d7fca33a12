"""LICENSES.md names every optional package, once, with all the extras that install it."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

import pytest

from nonsac.estimators.named import ESTIMATORS

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
PAGE = (ROOT / "LICENSES.md").read_text(encoding="utf-8").split("## Not used")
LINES = [
    [cell.strip() for cell in line.strip("|").split("|")] for line in PAGE[0].splitlines() if line.startswith("| ")
]
TABLE = {package: (licence, extras.split(", ")) for package, licence, extras, _ in LINES[2:]}
PERMISSIVE = {"Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "MIT", "MPL-2.0"}


def installed_by():
    """Package -> the extras that install it."""
    packages: dict[str, list[str]] = {}
    for extra, requirements in EXTRAS.items():
        for requirement in requirements:
            packages.setdefault(re.match(r"[\w-]+", requirement).group(), []).append(extra)
    return packages


def test_every_package_of_every_extra_is_there():
    told = {package: sorted(extras) for package, (_, extras) in TABLE.items()}
    assert told == {package: sorted(extras) for package, extras in installed_by().items()}
    assert len(LINES) - 2 == len(TABLE)


def test_all_licences_are_permissive():
    assert {licence for licence, _ in TABLE.values()} <= PERMISSIVE


@pytest.mark.parametrize("package", TABLE)
def test_the_licence_is_the_one_that_the_package_states(package):
    try:
        told = metadata(package)
    except PackageNotFoundError:
        pytest.skip(f"{package} is not installed")
    stated = " ".join(
        [told.get("License-Expression") or "", *told.get_all("Classifier", []), told.get("License") or ""]
    )
    family = TABLE[package][0].split("-")[0]
    assert family in stated or f"{family} " in stated.replace("Mozilla Public License", "MPL")


def test_every_estimator_of_another_library_has_an_extra():
    for named in ESTIMATORS.values():
        assert named.extra is None or named.extra in EXTRAS


def test_what_is_not_used_is_said():
    assert re.search(r"pmc.*GPL", PAGE[1])
