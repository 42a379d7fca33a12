"""Options of all commands that estimate from rows."""

import json

import numpy as np
import pytest

import nonsac
from nonsac import simulate


@pytest.fixture(autouse=True)
def rows(tmp_path, monkeypatch, rng):
    monkeypatch.chdir(tmp_path)
    pairs = simulate.registration(150_000, 0.6, 0.01, rng)
    np.save("pairs.npy", np.hstack([pairs.source, pairs.target]))


@pytest.mark.parametrize(("refine", "seen"), [("union", 4000), ("polish", 100_000), ("full", 150_000), ("none", 4000)])
def test_how_many_rows_the_last_fit_sees(run, refine, seen):
    code, out, _ = run("register-pairs", "pairs.npy", "--noise", 0.01, "--refine", refine)
    assert code == 0
    assert f" of {seen} (" in out


def test_memory_bounds_the_last_fit(run):
    code, out, _ = run("register-pairs", "pairs.npy", "--noise", 0.01, "--max-memory", "16 MB")
    assert code == 0
    assert int(out.split(" of ")[1].split()[0]) <= 20_833


def test_blocks_may_be_drawn(run, monkeypatch):
    monkeypatch.setattr("nonsac.method.budget.LARGEST_SIZE", 10)
    monkeypatch.setattr("nonsac.sources.records._RUN", 10**5)
    drawn = [
        run("register-pairs", "pairs.npy", "--noise", 0.01, "--json", "--draw", draw) for draw in ("blocks", "rows")
    ]
    assert [code for code, _, _ in drawn] == [0, 0]
    blocks, rows = (json.loads(out)["info"] for _, out, _ in drawn)
    assert 40 < blocks["blocks"] < 60
    assert "blocks" not in rows
    expected = nonsac.register_pairs(nonsac.open_source("pairs.npy"), noise=0.01, draw="blocks")
    assert json.loads(drawn[0][1])["T"] == expected.T.tolist()


@pytest.mark.parametrize("name", ["ransac", "pcr99"])
def test_an_estimator_by_name(run, name):
    code, out, err = run("register-pairs", "pairs.npy", "--noise", 0.01, "--estimator", name, "--json")
    assert code == 0, err
    report, rows = json.loads(out), np.load("pairs.npy")
    expected = nonsac.register_pairs(rows[:, :3], rows[:, 3:], noise=0.01, estimator=name)
    assert report["T"] == expected.T.tolist()
    assert report["info"]["estimator"] == {"ransac": "Ransac", "pcr99": "Pcr99"}[name]


@pytest.mark.parametrize("name", ["most_inliers", "minimum_median", "tlp_0.5"])
def test_a_rule_by_name(run, name):
    options = ("--noise", 0.01, "--samples", 6, "--sample-size", 100, "--refine", "none", "--rule", name)
    code, out, _ = run("register-pairs", "pairs.npy", *options, "--json")
    report, rows = json.loads(out), np.load("pairs.npy")
    chosen = {"noise": 0.01, "samples": 6, "sample_size": 100, "refine": "none"}
    expected = nonsac.register_pairs(rows[:, :3], rows[:, 3:], rule=name, **chosen)
    assert code == (0 if expected.success else 1)
    assert report["T"] == expected.T.tolist()
    assert [each["score"] for each in report["hypotheses"]] == [each.score for each in expected.hypotheses]


def test_workers_are_a_number_or_an_address(run):
    assert run("register-pairs", "pairs.npy", "--noise", 0.01, "--workers", 2)[0] == 0


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--refine", "best", "'--refine': 'best' is not one of union, polish, full, none"),
        ("--estimator", "lmeds", "'--estimator': 'lmeds' is not one of ransac, pcr99"),
        ("--estimator", "", "'--estimator': '' is not one of ransac, pcr99"),
        ("--draw", "groups", "'--draw': 'groups' is not one of rows, blocks"),
        ("--rule", "best", "'--rule': rule must be one of most_inliers, closest_pair, closest_triplet, "),
        ("--rule", "tlp_0", "'--rule': rule must be one of most_inliers, "),
        ("--max-memory", "lots", "'lots' is no number of bytes, such as 500000000 or '500 MB'"),
        ("--max-memory", "5 MB", "max_memory is too little for"),
        ("--workers", "0", "'0' is neither a number of at least 1 nor an address (tcp://host:8786)"),
        ("--workers", "many", "'many' is neither a number"),
    ],
)
def test_wrong_values_are_one_line(run, option, value, message):
    code, out, err = run("register-pairs", "pairs.npy", option, value)
    assert (code, out) == (2, "")
    assert message in err
    assert err.strip().count("\n") == 0
