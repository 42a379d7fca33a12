import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import match_samples
from match_samples import LENSES, write_binary_model, write_text_model
from nonsac.cameras import models
from nonsac.cameras.camera import Camera
from nonsac.io import InputError, open_matches, read_colmap_points, read_colmap_pose, read_points
from nonsac.layouts import POINTS


@pytest.fixture(params=[write_binary_model, write_text_model])
def model(request, tmp_path):
    return request.param(tmp_path / "sparse")


def check(matches):
    np.testing.assert_array_equal(matches.points2d, [[10.5, 20.5], [11, 21], [12, 22], [13, 23]])
    np.testing.assert_array_equal(matches.points3d, [[7, 8, 9], [1, 2, 3], [-4.5, 5, 6.25], [7, 8, 9]])
    assert matches.camera == {"model": "PINHOLE", "width": 800, "height": 600, "params": [700, 710, 400.5, 300.25]}
    assert matches.weights is None
    for points in (matches.points2d, matches.points3d):
        assert points.dtype == np.float64
        assert points.flags.c_contiguous


@pytest.mark.parametrize("image", ["b.jpg", 4, np.int64(4)])
def test_points(model, image):
    check(read_colmap_points(model, image))
    check(read_points(model, image))
    for path in model.iterdir():
        check(read_colmap_points(str(path), image))


def test_other_images(model):
    matches = read_colmap_points(model, "db/first.jpg")
    np.testing.assert_array_equal(matches.points2d, [[3, 4]])
    np.testing.assert_array_equal(matches.points3d, [[1, 2, 3]])
    assert matches.camera["params"] == [500, 320, 240, 0.1]
    empty = read_colmap_points(model, "empty.jpg")
    assert empty.points2d.shape == (0, 2)
    assert empty.points3d.shape == (0, 3)


def test_pose(model):
    pose = read_colmap_pose(model, "b.jpg")
    np.testing.assert_allclose(pose[:3, :3], Rotation.from_rotvec([0, 2 * np.arccos(0.8), 0]).as_matrix(), atol=1e-15)
    np.testing.assert_array_equal(pose[:, 3], [1, 2, 3, 1])
    np.testing.assert_array_equal(pose[3], [0, 0, 0, 1])
    np.testing.assert_array_equal(read_colmap_pose(model, 9), np.eye(4))


def test_text_of_other_writers(tmp_path):
    folder = write_text_model(tmp_path)
    for path in folder.iterdir():
        path.write_bytes(
            b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n").replace(b" -1", b" " + b"%d" % (2**64 - 1))
        )
    check(read_colmap_points(folder, "b.jpg"))
    images = folder / "images.txt"
    # No line for the keypoints of the last image, and a name with spaces and a number sign.
    images.write_text("3 1 0 0 0 1 2 3 1 a #1 of 2.jpg\n10 20 30\n4 1 0 0 0 1 2 3 1 b.jpg")
    assert len(read_colmap_points(folder, "a #1 of 2.jpg")) == 1
    assert len(read_colmap_points(folder, "b.jpg")) == 0


def test_binary_comes_first(tmp_path):
    write_binary_model(tmp_path)
    write_text_model(tmp_path)
    (tmp_path / "images.txt").write_text("# no images\n")
    check(read_colmap_points(tmp_path, 4))
    with pytest.raises(InputError, match=r"images.txt: holds no image 4 \(it holds none\)"):
        read_colmap_points(tmp_path / "cameras.txt", 4)


def test_unknown_names(model):
    with pytest.raises(
        InputError, match=r"images\.\w+: holds no image 'c.jpg' \(it holds db/first.jpg, b.jpg, wide.jpg, "
    ):
        read_colmap_points(model, "c.jpg")
    with pytest.raises(InputError, match=r"holds no image 5 \(it holds 9, 4, 6, 7 and 1 more\); check the name"):
        read_colmap_pose(model, 5)
    with pytest.raises(InputError, match="holds no image '4'"):
        read_colmap_points(model, "4")


def test_what_does_not_fit(model):
    with pytest.raises(InputError, match=r"cameras\.\w+: the camera has the model EQUIRECTANGULAR, but nonsac knows"):
        read_colmap_points(model, "wide.jpg")
    with pytest.raises(InputError, match=r"points3D\.\w+: holds no point 99, which image 'bad.jpg' shows; copy or"):
        read_colmap_points(model, "bad.jpg")
    with pytest.raises(InputError, match=r"images\.\w+: the pose of image 'bad.jpg' is not valid"):
        read_colmap_pose(model, "bad.jpg")


@pytest.mark.parametrize("line", LENSES.values(), ids=LENSES)
@pytest.mark.parametrize("write", [write_binary_model, write_text_model])
def test_cameras_of_all_models(tmp_path, monkeypatch, write, line):
    camera = Camera.parse(line)
    (number,) = (number for number, (name, _) in models._MODELS.items() if name == camera.model)
    monkeypatch.setitem(match_samples.MODEL_CAMERAS, 1, (number, camera.model, 640, 480, camera.params))
    assert Camera.parse(read_colmap_points(write(tmp_path), 4).camera) == camera


def test_a_camera_that_cannot_be_read_can_be_replaced(model):
    opened = open_matches(POINTS, [model], ["wide.jpg"])
    np.testing.assert_array_equal(opened.source.take(np.arange(1)), [[1, 2, 1, 2, 3]])
    with pytest.raises(InputError, match=r"cameras\.\w+: the camera has the model EQUIRECTANGULAR"):
        Camera.parse(opened.cameras[0])
    with pytest.raises(InputError, match=r"cameras\.\w+: the camera has the model EQUIRECTANGULAR"):
        read_points(model, "wide.jpg")
    (model / f"cameras{next(model.iterdir()).suffix}").unlink()
    assert len(open_matches(POINTS, [model], ["b.jpg"]).source) == 4


def test_places_that_hold_no_model(tmp_path, refused, make_file):
    assert "is no model of COLMAP: there is no images.bin or images.txt; give the folder" in refused(
        read_colmap_points, tmp_path, "b.jpg"
    )
    assert "no such file" in refused(read_colmap_points, tmp_path / "none", "b.jpg")
    assert "is no model of COLMAP" in refused(read_colmap_pose, make_file("a.ply", "ply\n"), "b.jpg")
    folder = write_binary_model(tmp_path / "part")
    (folder / "cameras.bin").unlink()
    with pytest.raises(InputError, match=r"cameras.bin: no such file"):
        read_colmap_points(folder, "b.jpg")


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_truncated_binary(tmp_path, name):
    folder = write_binary_model(tmp_path)
    path = folder / f"{name}.bin"
    whole = path.read_bytes()
    # What comes after the image or camera asked for is not read, but all points are.
    end = whole.index(b"wide.jpg") - struct.calcsize("<I7dI") if name == "images" else len(whole)
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        if size >= end:
            check(read_colmap_points(folder, "b.jpg"))
            continue
        with pytest.raises(InputError, match=r"is truncated or damaged|is empty") as caught:
            read_colmap_points(folder, "b.jpg")
        assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("name", ["cameras", "images", "points3D"])
def test_truncated_text(tmp_path, name):
    folder = write_text_model(tmp_path)
    path = folder / f"{name}.txt"
    lines = path.read_bytes().splitlines(keepends=True)
    last = next(number for number, line in enumerate(lines) if line.split()[:1] in ([b"1"], [b"4"], [b"30"]))
    for count in range(last + 1):
        path.write_bytes(b"".join(lines[:count]))
        with pytest.raises(InputError) as caught:
            read_colmap_points(folder, "b.jpg")
        assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("cameras", "1 PINHOLE 800 600 1 2 3\n", "a camera of model PINHOLE has 4 parameters, not 3"),
        ("cameras", "1 PINHOLE 800\n", "line 1, or the one that belongs to it, is truncated or not valid"),
        ("cameras", "1 PINHOLE 800 600 1 2 3 x\n", "line 1, or the one that"),
        ("cameras", "3 PINHOLE 800 600 1 2 3 4\n", "holds no camera 1 (it holds 3)"),
        ("cameras", "1 LENS 800 600 1 2 3 4\n", "the camera has the model LENS"),
        ("images", "4 1 0 0 0 1 2 3 1\n\n", "line 1, or the one that belongs to it, is truncated or not valid"),
        ("images", "# x\n4 1 0 0 0 1 2 3 1 b.jpg\n1 2 20 3\n", "line 2, or the one that"),
        ("images", "4 1 0 0 0 1 2 3 1 b.jpg\n1 2 x\n", "line 1, or the one that"),
        ("images", "4 1 0 0 0 1 2 x 1 b.jpg\n1 2 3\n", "line 1, or the one that"),
        ("images", "4 1 0 0 0 1 2 3 1 b.jpg\n1 2 99999999999999999999999\n", "line 1, or the one that"),
        ("points3D", "20 1 2 3 0 0 0\n", "line 1, or the one that"),
        ("points3D", "20 1 2 x 0 0 0 0\n", "line 1, or the one that"),
        ("points3D", "2x0 1 2 3 0 0 0 0\n", "line 1, or the one that"),
        ("points3D", b"\x00\x01", "is not a text table, it looks like an unknown binary file"),
    ],
)
def test_bad_text(tmp_path, name, content, expected):
    folder = write_text_model(tmp_path)
    path = folder / f"{name}.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as caught:
        read_colmap_points(folder, "b.jpg")
    assert str(caught.value).startswith(f"{path}: {expected}")


def test_bad_binary(tmp_path):
    folder = write_binary_model(tmp_path)
    cameras = folder / "cameras.bin"
    cameras.write_bytes(struct.pack("<QIiQQ", 1, 1, 99, 800, 600))
    with pytest.raises(InputError, match="the camera model 99 is not known"):
        read_colmap_points(folder, "b.jpg")
    (folder / "images.bin").write_bytes(b"\xff" * 500)
    with pytest.raises(InputError, match="the file is truncated or damaged: its 500 bytes end before its last row"):
        read_colmap_points(folder, "b.jpg")


@pytest.fixture(params=["bin", "txt"])
def foreign(request, tmp_path):
    """A model that COLMAP itself has made up and written, and COLMAP's own view of it."""
    pycolmap = pytest.importorskip("pycolmap")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_points3D = 30
    model = pycolmap.synthesize_dataset(options)
    (model.write_binary if request.param == "bin" else model.write_text)(tmp_path)
    return model, tmp_path


def test_what_colmap_wrote(foreign):
    model, folder = foreign
    assert model.images
    for number, image in model.images.items():
        matches = read_colmap_points(folder, image.name)
        seen = [point for point in image.points2D if point.has_point3D()]
        np.testing.assert_array_equal(matches.points2d, [point.xy for point in seen])
        np.testing.assert_array_equal(matches.points3d, [model.points3D[point.point3D_id].xyz for point in seen])
        assert 0 < len(matches) < len(image.points2D)
        camera = model.cameras[image.camera_id]
        assert matches.camera["model"] == camera.model.name
        np.testing.assert_array_equal(matches.camera["params"], camera.params)
        assert (matches.camera["width"], matches.camera["height"]) == (camera.width, camera.height)
        pose = read_colmap_pose(folder, number)
        np.testing.assert_allclose(pose[:3], image.cam_from_world().matrix(), atol=1e-14)
