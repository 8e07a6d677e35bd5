"""Files that others wrote, byte by byte, and files that are not clouds."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import trimesh

from dmfc.errors import DmfcError
from dmfc.prediction.read_cloud import read_cloud

POINTS = np.array([[0.5, -1.25, 2.0], [3.0, 0.0, -0.125], [7.5, 8.0, 9.0], [np.nan, 1.0, 2.0]])
HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS {fields}
SIZE {size}
TYPE {type}
COUNT {count}
WIDTH 4
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 4
DATA {data}
"""


def pcd(data, fields="x y z", size="4 4 4", type="F F F", count="1 1 1"):
    return HEADER.format(fields=fields, size=size, type=type, count=count, data=data).encode()


def check(path, content):
    path.write_bytes(content)
    np.testing.assert_array_equal(read_cloud(path), POINTS)


def test_pcd_ascii(tmp_path):
    rows = "\n".join(" ".join(map(str, row)) for row in POINTS)
    check(tmp_path / "a.pcd", pcd("ascii") + rows.encode())
    wide = "\n".join(f"{z} 1 2 {x} {y}" for x, y, z in POINTS)
    header = pcd("ascii", "z normal x y", "4 4 4 4", "F F F F", "1 2 1 1")
    check(tmp_path / "b.pcd", header + wide.encode())


def test_pcd_binary(tmp_path):
    rows = b"".join(struct.pack("<3f", *row) for row in POINTS)
    check(tmp_path / "a.pcd", pcd("binary") + rows)
    header = pcd("binary", "_ z rgb x y _", "1 8 4 4 8 1", "U F U F F U", "3 1 1 1 1 2")
    rows = b"".join(struct.pack("<3BdIfd2B", 1, 2, 3, z, 7, x, y, 4, 5) for x, y, z in POINTS)
    check(tmp_path / "b.pcd", header + rows)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply(tmp_path, encoding):
    path = tmp_path / "a.ply"
    path.write_bytes(
        trimesh.exchange.ply.export_ply(trimesh.PointCloud(POINTS[:3]), encoding=encoding)
    )
    np.testing.assert_allclose(read_cloud(path), POINTS[:3], atol=1e-6)


def test_numpy(tmp_path):
    np.save(tmp_path / "a.npy", POINTS)
    np.save(tmp_path / "b.npy", POINTS.reshape(2, 2, 3))
    np.savez(tmp_path / "c.npz", other=np.zeros(2), points=POINTS)
    np.savez(tmp_path / "d.npz", anything=POINTS)
    for name in ("a.npy", "b.npy", "c.npz", "d.npz"):
        np.testing.assert_array_equal(read_cloud(tmp_path / name), POINTS)


FAULTS = {
    "a.xyz": (b"0 0 0", r"unknown format of a cloud \(known: .ply, .pcd, .npy, .npz.*depth image"),
    "b.pcd": (pcd("binary_compressed") + b"1", "DATA binary_compressed is not read; save it as"),
    "c.pcd": (pcd("binary") + bytes(47), "47 bytes, not the 48 it promises"),
    "d.pcd": (pcd("ascii") + b"1 2 3", "holds 3 numbers, not the 4 x 3"),
    "e.pcd": (pcd("ascii", "x y intensity") + b"1 2 3", "fields x y intensity, not x, y and z"),
    "f.pcd": (b"junk", "header lacks FIELDS"),
    "g.pcd": (pcd("ascii", size="4 4") + b"1 2 3", "do not fit"),
    "h.ply": (b"ply\nbroken", "cannot be read as ply"),
    "i.npy": (b"junk", "cannot be read as npy"),
    "j.npz": (b"junk", "cannot be read as npz"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_are_told_on_one_line(tmp_path, name):
    content, told = FAULTS[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DmfcError, match=told) as error:
        read_cloud(tmp_path / name)
    assert "\n" not in str(error.value)


def test_what_is_no_cloud_is_refused(tmp_path):
    trimesh.creation.box().export(tmp_path / "mesh.ply")
    np.save(tmp_path / "depth.npy", np.zeros((48, 64)))
    np.save(tmp_path / "objects.npy", np.array([{}], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "two.npz", a=POINTS, b=POINTS)
    for name, told in (
        ("mesh.ply", "mesh of 12 faces, not a cloud"),
        ("depth.npy", "for a depth image give --intrinsics"),
        ("objects.npy", "cannot be read as npy"),
        ("two.npz", "unknown array in two.npz 'points'.*a, b"),
        ("missing.ply", "there is no file"),
    ):
        with pytest.raises(DmfcError, match=told):
            read_cloud(tmp_path / name)
