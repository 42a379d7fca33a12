"""nonsac localize: what it prints, writes and refuses."""

import json
from pathlib import Path

import pytest

import nonsac
from database_samples import hloc_files, name_of, write_model
from nonsac.simulate.photos import Photos


@pytest.fixture
def arguments(folder):
    """Three photos in a model, and two others, whose matches are right by half."""
    photos = Photos.taken(5, 500, 0.7, 3)
    write_model(Path("sparse"), photos, 3)
    hloc_files(folder, photos, {(a, b): 0.5 for b in (3, 4) for a in range(3)})
    return ("sparse", "features.h5", "matches.h5", "--pairs", "pairs.txt", "--cameras", str(photos.camera))


def test_poses_and_report(run, arguments):
    code, out, _ = run("localize", *arguments, "--output", "a.txt", "--report", "images.jsonl", "--workers", "1")
    assert code == 0
    lines = out.splitlines()
    assert lines[0].startswith("2 images, 2 localized")
    assert lines[1].endswith("images/s")
    assert lines[2:] == ["wrote a.txt: the poses of 2 images", "wrote images.jsonl: a line for each image"]
    settings = {"pairs": "pairs.txt", "cameras": arguments[-1], "workers": 1}
    found = nonsac.localize(*arguments[:3], output="b.txt", **settings)
    assert Path("a.txt").read_text() == Path("b.txt").read_text()
    images = [json.loads(line) for line in Path("images.jsonl").read_text().splitlines()]
    assert images == [json.loads(json.dumps(image.to_dict())) for image in found.images]
    assert [image["name"] for image in images] == [name_of(3), name_of(4)]


def test_json_and_a_folder(run, arguments):
    code, out, _ = run("localize", *arguments, "--output", "found", "--json", "--noise", "0.7", "--workers", "1")
    facts = json.loads(out)
    assert (code, facts["statuses"], facts["noise"]) == (0, {"ok": 2}, 0.7)
    assert Path("found/images.txt").exists()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ((), "give a file that ends in .txt, or the name of a new folder"),
        (("--output", "a.txt", "--report", "b.txt"), "end the name in .jsonl"),
        (("--output", "none/a.txt"), "does not exist"),
        (("--output", "sparse"), "is there already"),
        (("--output", "a.txt", "--noise", "no"), "--noise"),
    ],
)
def test_refused(refused, arguments, more, message):
    assert message in refused("localize", *arguments, *more)


def test_failures_are_said_and_exit_1(run, arguments):
    Path("tables").mkdir()
    Path("tables/a.csv").write_text("u,v,X,Y,Z\n1,2,3,4,5\n")
    code, out, err = run("localize", "tables", "--output", "a.txt", "--workers", "1")
    assert code == 1
    assert "nonsac: a: failed: there is no camera; give it with cameras (--cameras)" in err
    assert out.startswith("1 images, 0 localized\n          1  failed\n")
