"""Mesh files of others, and what is wrong with them: against the boxes and balls that they hold."""

from __future__ import annotations

import itertools
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dmfc.errors import DmfcError
from dmfc.objects.mesh import clean
from dmfc.objects.mesh_file import MESH_SUFFIXES, load_mesh
from tests.support.foreign import attempted

SIZE = np.array([0.04, 0.05, 0.06])
VOLUME = float(np.prod(SIZE))


def box(x: float = 0.0, size=SIZE) -> trimesh.Trimesh:
    made = trimesh.creation.box(size)
    made.apply_translation([x, 0, 0])
    return made


def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(3, 0.03)


def inverted(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    turned = mesh.copy()
    turned.invert()
    return turned


def joined(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(meshes)


# ── bodies ───────────────────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("wrong", list(itertools.product([False, True], repeat=3)))
def test_bodies_that_are_inside_out_are_turned(wrong):
    """Three bodies apart, any of them inside out: the volume is that of all three."""
    bodies = [box(0.0), box(0.1), box(0.2, SIZE / 2)]
    given_bodies = [inverted(b) if turn else b for b, turn in zip(bodies, wrong, strict=True)]
    mesh = clean(joined(*given_bodies), "three")
    assert mesh.closed
    assert mesh.trimesh.volume == pytest.approx(VOLUME * (2 + 1 / 8), rel=1e-5)
    outward = mesh.trimesh.triangles_center + 1e-4 * mesh.trimesh.face_normals
    assert not mesh.trimesh.contains(outward).any()


def test_overlapping_bodies_of_which_one_is_inside_out_are_united():
    mesh = clean(joined(box(), inverted(box(0.02))), "two")
    assert mesh.trimesh.volume == pytest.approx(0.06 * 0.05 * 0.06, rel=1e-5)
    assert mesh.trimesh.body_count == 1


@pytest.mark.parametrize("outer", [box, lambda: inverted(box())])
def test_a_cavity_stays_a_cavity(outer):
    """A body inside another one, wound the other way, is hollow, however the pair is wound."""
    inner = box(size=SIZE / 2)
    inner = inner if outer().volume < 0 else inverted(inner)
    beside = box(0.1)
    mesh = clean(joined(outer(), inner, beside), "hollow")
    assert mesh.trimesh.volume == pytest.approx(VOLUME * (1 - 1 / 8 + 1), rel=1e-5)


@pytest.mark.parametrize("shape", [box, ball])
@pytest.mark.parametrize("times", [2, 3])
def test_faces_given_more_than_once_count_once(shape, times):
    mesh = clean(joined(*[shape()] * times), "doubled")
    assert mesh.trimesh.volume == pytest.approx(shape().volume, rel=1e-6)
    assert len(mesh.faces) == len(shape().faces)
    assert any("given twice" in note for note in mesh.notes)


@pytest.mark.parametrize("shape", [box, ball, lambda: inverted(ball())])
def test_faces_in_both_windings_are_kept_outwards(shape):
    mesh = clean(joined(shape(), inverted(shape())), "double-sided")
    assert mesh.trimesh.volume == pytest.approx(abs(shape().volume), rel=1e-6)
    assert mesh.watertight
    assert any("both windings" in note for note in mesh.notes)


def test_two_bodies_in_both_windings():
    both = joined(box(), box(0.1), inverted(box()), inverted(box(0.1)))
    assert clean(both, "two").trimesh.volume == pytest.approx(2 * VOLUME, rel=1e-5)


def test_a_sheet_in_both_windings_has_no_volume():
    sheet = trimesh.creation.box(SIZE)
    sheet.update_faces(sheet.triangles_center[:, 2] < 0.029)  # without its top
    with pytest.raises(DmfcError, match="'cup': its mesh has no volume"):
        clean(joined(sheet, inverted(sheet)), "cup")


def test_boxes_that_share_a_face_are_left_as_they_are():
    """The shared face is there in both windings, and encloses nothing."""
    mesh = clean(joined(box(), box(0.04)), "row")
    assert mesh.trimesh.volume == pytest.approx(2 * VOLUME, rel=1e-5)


# ── files ────────────────────────────────────────────────────────────────────────────────────────


def relative_obj(*meshes: trimesh.Trimesh) -> str:
    """Vertices and faces in turns, faces counted back from where they stand."""
    lines = []
    for mesh in meshes:
        lines += [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
        lines += ["f " + " ".join(str(i - len(mesh.vertices)) for i in f) for f in mesh.faces]
    return "\n".join(lines)


def test_relative_numbers_of_an_obj_count_from_where_they_stand(tmp_path):
    (tmp_path / "two.obj").write_text(relative_obj(box(), box(0.1)))
    found = load_mesh([tmp_path / "two.obj"])
    np.testing.assert_allclose(found.bounds, joined(box(), box(0.1)).bounds)
    assert found.volume == pytest.approx(2 * VOLUME)


def test_relative_and_absolute_numbers_with_textures_and_normals(tmp_path):
    text = relative_obj(box()).replace("f ", "vt 0 0\nvn 0 0 1\nf ")
    corners = [
        line if line[0] != "f" else " ".join(["f", *(f"{w}/-1/-1" for w in line.split()[1:])])
        for line in text.splitlines()
    ]
    second = [f"v {x} {y} {z}" for x, y, z in box(0.1).vertices]
    second += ["f " + " ".join(f"{i + 9}//" for i in face) for face in box().faces]
    (tmp_path / "two.obj").write_text("\n".join(corners + second))
    assert load_mesh([tmp_path / "two.obj"]).volume == pytest.approx(2 * VOLUME)


def test_polygons_of_an_obj_all_become_triangles(tmp_path):
    corners = np.array(list(itertools.product([0, 1], repeat=3))) * SIZE
    sides = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {side}" for side in sides]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    found = load_mesh([tmp_path / "box.obj"])
    assert len(found.faces) == 12
    assert abs(found.volume) == pytest.approx(VOLUME)


@pytest.mark.parametrize("number", ["0", "9", "-9", "99999999999999999999", "x", "1.5"])
def test_an_obj_with_a_wrong_number_is_named(tmp_path, number):
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in box().vertices) + f"f 1 2 {number}\n"
    (tmp_path / "wrong.obj").write_text(text)
    with pytest.raises(DmfcError, match=r"wrong\.obj cannot be read") as raised:
        load_mesh([tmp_path / "wrong.obj"])
    assert "\n" not in str(raised.value)


def ascii_stl(mesh: trimesh.Trimesh) -> bytes:
    return trimesh.exchange.stl.export_stl_ascii(mesh).encode()


FILES = {
    "binary.stl": ball().export(file_type="stl"),
    "ascii.stl": ascii_stl(ball()),
    "ascii.ply": trimesh.exchange.ply.export_ply(ball(), encoding="ascii"),
    "binary.ply": trimesh.exchange.ply.export_ply(ball()),
    "ball.off": trimesh.exchange.off.export_off(ball()).encode(),
    "ball.glb": ball().export(file_type="glb"),
    "ball.obj": trimesh.exchange.obj.export_obj(ball()).encode(),
}


@pytest.mark.parametrize("name", FILES)
def test_whole_files_are_read(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    assert load_mesh([tmp_path / name]).volume == pytest.approx(ball().volume, rel=1e-3)


@pytest.mark.parametrize("name", sorted(set(FILES) - {"ball.obj"}))
@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.7, 0.95])
def test_a_file_that_is_cut_off_is_named(tmp_path, name, share):
    """An OBJ does not say how much it holds: cut off, it is a mesh with a hole."""
    (tmp_path / name).write_bytes(FILES[name][: int(share * len(FILES[name]))])
    with pytest.raises(DmfcError, match=name) as raised:
        load_mesh([tmp_path / name])
    assert "\n" not in str(raised.value)


def test_an_ascii_stl_cut_off_between_two_triangles_is_named(tmp_path):
    text = FILES["ascii.stl"]
    (tmp_path / "a.stl").write_bytes(text[: text.index(b"facet normal", len(text) // 2)])
    with pytest.raises(DmfcError, match="cut off or damaged"):
        load_mesh([tmp_path / "a.stl"])


def test_a_compressed_glb_is_refused(tmp_path):
    json = b'{"asset":{"version":"2.0"},"extensionsUsed":["KHR_draco_mesh_compression"]}'
    json += b" " * (-len(json) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(json), len(json), 0x4E4F534A)
    (tmp_path / "a.glb").write_bytes(head + json)
    with pytest.raises(DmfcError, match="compressed by KHR_draco"):
        load_mesh([tmp_path / "a.glb"])


def test_vertices_without_a_third_coordinate_are_refused(tmp_path):
    """A reader takes the number of coordinates from the first vertex, whatever the others have."""
    flat = b"v 0 0\n" + b"\n".join(FILES["ball.obj"].splitlines()[1:])
    (tmp_path / "flat.obj").write_bytes(flat)
    with pytest.raises(DmfcError, match=r"without all three coordinates|cannot be read"):
        clean(load_mesh([tmp_path / "flat.obj"]), "flat")


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(suffix=st.sampled_from(MESH_SUFFIXES), data=st.binary(max_size=400))
def test_any_bytes_are_a_mesh_or_one_line(tmp_path, suffix, data):
    read(tmp_path / f"any{suffix}", data)


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(name=st.sampled_from(sorted(FILES)), data=st.data())
def test_a_damaged_file_is_a_mesh_or_one_line(tmp_path, name, data):
    """Some bytes of a good file replaced, inserted or dropped."""
    content = FILES[name]
    start = data.draw(st.integers(0, len(content)) | st.integers(0, 300), label="start")
    length = data.draw(st.integers(0, 20), label="length")
    inserted = data.draw(st.binary(max_size=20), label="inserted")
    read(tmp_path / name, content[:start] + inserted + content[start + length :])


def read(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    mesh, message = attempted(lambda: clean(load_mesh([path]), "foreign"))
    if mesh is None:
        assert path.name in message or "foreign" in message
    else:
        assert np.isfinite(mesh.vertices).all()
        assert abs(mesh.trimesh.volume) > 0
