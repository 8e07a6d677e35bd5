"""Files that others wrote, byte by byte, and files that are not clouds."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import trimesh

from dmfc.errors import DmfcError
from dmfc.sensing.read_cloud import read_cloud

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


def test_pcd_compressed(tmp_path):
    """LZF of the columns, one after the other, as PCL writes it: here as literals alone."""
    columns = np.stack([POINTS[:, 2], POINTS[:, 0], POINTS[:, 1]]).astype("<f4").tobytes()
    runs = [columns[k : k + 32] for k in range(0, len(columns), 32)]
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    sizes = struct.pack("<2I", len(packed), len(columns))
    check(tmp_path / "a.pcd", pcd("binary_compressed", "z x y") + sizes + packed)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_with_upper_case_names_and_further_properties(tmp_path, encoding):
    kinds = [("Z", "double"), ("red", "uchar"), ("X", "float"), ("Y", "float")]
    order = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}[encoding]
    header = f"ply\nformat {encoding} 1.0\nelement vertex 4\n" + "".join(
        f"property {kind} {name}\n" for name, kind in kinds
    )
    if encoding == "ascii":
        body = "".join(f"{z} 7 {x} {y}\n" for x, y, z in POINTS).encode()
    else:
        body = b"".join(struct.pack(f"{order}dBff", z, 7, x, y) for x, y, z in POINTS)
    check(tmp_path / "a.ply", header.encode() + b"end_header\n" + body)


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
    fields = np.zeros((2, 2), dtype=[("rgb", "f4"), ("Y", "f8"), ("X", "f4"), ("z", "i2")])
    for name, axis in (("X", 0), ("Y", 1), ("z", 2)):
        fields[name] = np.nan_to_num(POINTS)[:, axis].reshape(2, 2)
    np.save(tmp_path / "ros.npy", fields)
    expected = np.nan_to_num(POINTS)
    expected[:, 2] = np.trunc(expected[:, 2])
    np.testing.assert_array_equal(read_cloud(tmp_path / "ros.npy"), expected)
    for name in ("a.npy", "b.npy", "c.npz", "d.npz"):
        np.testing.assert_array_equal(read_cloud(tmp_path / name), POINTS)


@pytest.mark.parametrize(("name", "between"), [("a.xyz", " "), ("b.txt", "\t"), ("c.csv", ", ")])
def test_text(tmp_path, name, between):
    rows = [between.join(map(str, [*row, 255])) for row in POINTS]
    check(tmp_path / name, ("# x y z red\n" + "\n".join(rows)).encode())


FAULTS = {
    "a.las": (b"0 0 0", r"unknown format of a cloud \(known: .ply, .pcd, .npy, .npz.*depth image"),
    "b.pcd": (pcd("binary_compressed") + b"1", r"cannot be read as a cloud \(pcd\)"),
    "c.pcd": (pcd("binary") + bytes(47), r"cannot be read as a cloud \(pcd\): buffer size"),
    "c36.pcd": (pcd("binary") + bytes(36), "holds 3 points, not the 4 it promises"),
    "d.pcd": (pcd("ascii") + b"1 2 3", "holds 1 points, not the 4 it promises"),
    "e.pcd": (pcd("ascii", "x y i") + b"1 2 3\n" * 4, "fields x y i, not the numbers x, y and z"),
    "f.pcd": (b"junk", "not a PCD header.*fields: Field required"),
    "g.pcd": (pcd("ascii", size="4 4") + b"1 2 3", "cannot be read as a cloud"),
    "h.ply": (b"ply\nbroken", r"cannot be read as a cloud \(ply\)"),
    "i.npy": (b"junk", r"cannot be read as a cloud \(npy\)"),
    "j.npz": (b"junk", r"cannot be read as a cloud \(npz\)"),
    "k.npy": (b"", "is empty: it has 0 bytes"),
    "l.xyz": (b"1 2\n3 4\n", "not points x y z per line"),
    "m.txt": (b"x y z\n", "cannot be read"),
    "n.csv": (b"# nothing\n", "not points x y z per line"),
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
    np.save(tmp_path / "array", POINTS)
    (tmp_path / "array.npy").rename(tmp_path / "array.npz")
    header = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar float points\n"
    (tmp_path / "list.ply").write_bytes(header + b"end_header\n3 1 2 3\n")
    (tmp_path / "folder.ply").mkdir()
    for name, told in (
        ("mesh.ply", "mesh of 12 faces, not a cloud"),
        ("depth.npy", "for a depth image give --intrinsics"),
        ("objects.npy", "cannot be read as a cloud"),
        ("two.npz", "unknown array in .*two.npz 'points'.*a, b"),
        ("array.npz", "holds one array: name the file .npy"),
        ("list.ply", "has the fields points, not the numbers x, y and z"),
        ("missing.ply", "there is no file"),
        ("folder.ply", "is a folder, not a file"),
    ):
        with pytest.raises(DmfcError, match=told):
            read_cloud(tmp_path / name)
