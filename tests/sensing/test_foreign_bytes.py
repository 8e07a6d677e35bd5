"""Any bytes as a cloud, image, mask or pose: an array, or one line that names the file."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from dmfc.errors import DmfcError
from dmfc.prediction.depth_image import depth_in_metres, read_image, read_pose
from dmfc.sensing.check_cloud import check_cloud
from dmfc.sensing.read_cloud import READERS, read_cloud

POINTS = np.random.default_rng(0).normal(size=(150, 3)).astype("<f4")


def in_memory(write) -> bytes:
    buffer = io.BytesIO()
    write(buffer)
    return buffer.getvalue()


def pcd(kind: str, body: bytes) -> bytes:
    header = (
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 150\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 150\nDATA {kind}\n"
    )
    return header.encode() + body


def ply(kind: str, body: bytes) -> bytes:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    return f"ply\nformat {kind} 1.0\nelement vertex 150\n{axes}end_header\n".encode() + body


TEXT = in_memory(lambda file: np.savetxt(file, POINTS))
COLUMNS = np.ascontiguousarray(POINTS.T).tobytes()
PACKED = b"".join(bytes([31]) + COLUMNS[k : k + 32] for k in range(0, 1792, 32))
PACKED += bytes([7]) + COLUMNS[1792:1800]
WHOLE = [
    (".ply", ply("ascii", TEXT)),
    (".ply", ply("binary_little_endian", POINTS.tobytes())),
    (".pcd", pcd("ascii", TEXT)),
    (".pcd", pcd("binary", POINTS.tobytes())),
    (".pcd", pcd("binary_compressed", struct.pack("<2I", len(PACKED), 1800) + PACKED)),
    (".npy", in_memory(lambda file: np.save(file, POINTS))),
    (".npz", in_memory(lambda file: np.savez_compressed(file, points=POINTS))),
    (".xyz", TEXT),
    (".csv", TEXT.replace(b" ", b",")),
]
IMAGES = [
    (".png", in_memory(lambda f: Image.fromarray(np.full((9, 7), 600, "u2")).save(f, "PNG"))),
    (".npy", in_memory(lambda f: np.save(f, np.full((9, 7), 0.6)))),
]
POSES = [
    (".txt", in_memory(lambda f: np.savetxt(f, np.eye(4)))),
    (".npy", in_memory(lambda f: np.save(f, np.eye(4)))),
]


@st.composite
def damaged(draw, files):
    """(suffix, bytes): a whole file, cut off, with bytes changed, or any bytes at all."""
    suffix, content = draw(st.sampled_from(files))
    how = draw(st.sampled_from(["cut", "changed", "header", "any"]))
    if how == "any":
        return suffix, draw(st.binary(max_size=300))
    if how == "cut":
        return suffix, content[: draw(st.integers(0, len(content) - 1))]
    end = min(len(content), 220) if how == "header" else len(content)
    changed = bytearray(content)
    for place in draw(st.lists(st.integers(0, end - 1), min_size=1, max_size=6)):
        changed[place] = draw(st.integers(0, 255))
    return suffix, bytes(changed)


def told(call, *given):
    """(what is answered, the line that says why not), one of them None."""
    try:
        return call(*given), None
    except DmfcError as error:
        return None, str(error)


def require_line(line: str, name: str = "") -> None:
    assert line
    assert "\n" not in line
    assert name in line


MANY = settings(
    max_examples=300,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.mark.parametrize(("suffix", "content"), WHOLE, ids=range(len(WHOLE)))
def test_what_is_damaged_below_was_whole(tmp_path, suffix, content):
    path = tmp_path / f"cloud{suffix}"
    path.write_bytes(content)
    np.testing.assert_allclose(read_cloud(path), POINTS, rtol=1e-6)


def test_every_reader_is_tried():
    assert {suffix for suffix, _ in WHOLE} | {".txt"} == set(READERS)


@MANY
@given(damaged(WHOLE))
def test_a_cloud_is_read_or_told(tmp_path, file):
    path = tmp_path / f"cloud{file[0]}"
    path.write_bytes(file[1])
    points, line = told(read_cloud, path)
    if points is None:
        require_line(line, path.name)
        return
    assert points.ndim == 2
    assert points.shape[1] == 3
    cloud, line = told(check_cloud, points, "m", True)
    if cloud is None:
        require_line(line)
        return
    assert np.isfinite(cloud.points).all()


@MANY
@given(damaged(IMAGES))
def test_an_image_is_read_or_told(tmp_path, file):
    path = tmp_path / f"image{file[0]}"
    path.write_bytes(file[1])
    image, line = told(read_image, path)
    if image is None:
        require_line(line, path.name)
        return
    assert image.ndim == 2
    depth, line = told(depth_in_metres, image)
    if depth is None:
        require_line(line)
        return
    assert depth.shape == image.shape


@MANY
@given(damaged(POSES))
def test_a_pose_is_rigid_or_told(tmp_path, file):
    path = tmp_path / f"pose{file[0]}"
    path.write_bytes(file[1])
    T, line = told(read_pose, path)
    if T is None:
        require_line(line, path.name)
        return
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=5e-3)
