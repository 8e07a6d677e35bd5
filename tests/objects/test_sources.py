"""Selectors, sources and generated shapes. The packs' own files are replaced by small folders."""

from __future__ import annotations

import dataclasses
from unittest.mock import ANY

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dmfc.errors import DmfcError
from dmfc.objects import procedural, sources
from dmfc.objects.mesh import clean
from dmfc.objects.sources import YCB_TEST, find_object, list_objects


@pytest.fixture
def pretend_packs(tmp_path, monkeypatch):
    """Folders laid out like the packs, with boxes for meshes."""
    box = trimesh.creation.box((4, 5, 6))
    ycb, household, random = (tmp_path / name for name in ("ycb", "household", "random"))
    ycb.mkdir()
    for number, name in enumerate(YCB_TEST):
        mark = "-" if name.endswith("cups") else "_"
        box.copy().apply_scale(0.01).export(ycb / f"{number:03d}{mark}{name}.stl")
    box.copy().apply_scale(0.01).export(ycb / "030_fork.stl")
    for name in ("hammer", "hand"):
        (household / name).mkdir(parents=True)
        box.copy().apply_scale(0.01).export(household / name / f"{name}_head.stl")
        box.copy().apply_scale(0.01).export(household / name / "contact0.stl")
    for name in ("000", "001", "168", "002"):
        (random / name).mkdir(parents=True)
        box.export(random / name / f"{name}.obj")
    monkeypatch.setattr(sources, "pull", lambda name: tmp_path / name)


def ids(*selectors: str) -> list[str]:
    return [source.id for source in list_objects(selectors)]


def test_pack_selectors(pretend_packs):
    assert ids("ycb:test") == [f"ycb/{name}" for name in YCB_TEST]
    assert len(ids("ycb")) == 17
    assert ids("ycb:mug", "ycb/mug", "ycb/c_cups") == ["ycb/mug", "ycb/c_cups"]
    assert ids("household") == ["household/hammer"]
    assert ids("random") == ["random/000", "random/001", "random/002"]
    assert ids("random:2") == ["random/000", "random/001"]
    assert ids("random/002") == ["random/002"]
    assert find_object("ycb:c_cups").mass == 0.017
    assert find_object("ycb:fork").mass is None
    np.testing.assert_allclose(find_object("ycb:mug").load().extents, [0.04, 0.05, 0.06], rtol=1e-5)
    np.testing.assert_allclose(find_object("random/000").load().extents, [0.06, 0.075, 0.09])
    digests = {source.digest for source in list_objects(["ycb", "random", "household"])}
    assert len(digests) == 21


@pytest.mark.parametrize(
    ("selector", "message"),
    [
        ("ycb:mugg", "did you mean 'mug'"),
        ("yc", "unknown object source 'yc'; did you mean 'ycb'"),
        ("random:4", "only 3 objects"),
        ("random:0", "selects no object"),
        ("procedural", "needs a number"),
        ("procedural:bottl-0002", "unknown procedural object"),
        ("procedural:3?form=2", "from=NUMBER"),
        ("folder:/nowhere/at/all", "does not exist"),
        ("folder:/tmp?unit=foot", "unit="),
    ],
)
def test_wrong_selectors(pretend_packs, selector, message):
    with pytest.raises(DmfcError, match=message) as info:
        list_objects([selector])
    assert "\n" not in str(info.value)


def test_no_selector_is_an_error():
    with pytest.raises(DmfcError, match="list of objects is empty"):
        list_objects([])


def test_procedural_selectors():
    assert ids("procedural:3") == [
        "procedural/box-0000",
        "procedural/cup-0001",
        "procedural/bottle-0002",
    ]
    assert ids("procedural:2?from=13") == ["procedural/cup-0013", "procedural/bottle-0014"]
    assert ids("procedural/cup-0013") == ["procedural/cup-0013"]
    assert ids("procedural:2?size=large") == [
        "procedural/box-0000-large",
        "procedural/cup-0001-large",
    ]
    assert ids("procedural:1?from=13&size=large") == ids("procedural/cup-0013-large")


def test_folder(tmp_path):
    box = trimesh.creation.box((40, 50, 60))
    (tmp_path / "sub").mkdir()
    box.export(tmp_path / "my box.stl")
    box.export(tmp_path / "sub" / "other.obj")
    (tmp_path / "notes.txt").write_text("no mesh")
    found = list_objects([f"folder:{tmp_path}?unit=mm"])
    assert [source.id for source in found] == ["folder/my-box", "folder/sub-other"]
    np.testing.assert_allclose(found[0].load().extents, [0.04, 0.05, 0.06], rtol=1e-5)
    assert find_object(found[0].selector).digest == found[0].digest
    with pytest.raises(DmfcError, match="two different objects"):
        list_objects([f"folder:{tmp_path}?unit=mm", f"folder:{tmp_path}"])
    (tmp_path / "bad.stl").write_bytes(b"")
    with pytest.raises(DmfcError, match=r"bad\.stl"):
        find_object(f"folder:{tmp_path / 'bad.stl'}").load()
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(DmfcError, match="no mesh file"):
        list_objects([f"folder:{empty}"])
    (tmp_path / "my box.stl").unlink()
    with pytest.raises(DmfcError, match="does not exist"):
        found[0].load()


def boxes_at(*paths):
    """Boxes of different sizes in files; returns the folder of the first."""
    for number, path in enumerate(paths, start=4):
        path.parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box((0.04, 0.05, number / 100)).export(path)
    return paths[0].parent


@pytest.mark.parametrize(
    "names",
    [
        ["кружка", "чаша"],
        ["杯子", "碗"],
        ["κούπα", "μπολ"],
        ["فنجان", "وعاء"],
        ["tasse à thé", "tässe ä thé"],
        ["काला", "काली"],
    ],
)
def test_names_in_any_script_are_names(tmp_path, names):
    folder = boxes_at(*(tmp_path / f"{name}.stl" for name in names))
    found = list_objects([f"folder:{folder}"])
    expected = {f"folder/{name.replace(' ', '-')}" for name in names}
    assert {source.id for source in found} == expected
    for source in found:
        assert find_object(source.selector).id == source.id


def test_one_name_written_in_two_ways_is_one_name(tmp_path):
    """macOS writes é as e and an accent."""
    folder = boxes_at(tmp_path / "a" / "th\u00e9.stl", tmp_path / "b" / "the\u0301.stl")
    (one,) = list_objects([f"folder:{folder}"])
    (other,) = list_objects([f"folder:{tmp_path / 'b'}"])
    assert one.id == other.id == "folder/th\u00e9"


def test_links_to_folders_are_followed_and_hidden_files_left_out(tmp_path):
    real = boxes_at(tmp_path / "real" / "deep" / "box.obj", tmp_path / "real" / "ball.stl")
    seen = tmp_path / "seen"
    seen.mkdir()
    (seen / "link").symlink_to(tmp_path / "real", target_is_directory=True)
    (real / "round").symlink_to(seen, target_is_directory=True)  # links may go round
    (seen / "._box.obj").write_bytes(b"\x00\x05\x16\x07")
    (seen / ".git").mkdir()
    (seen / ".git" / "old.stl").write_bytes(b"")
    (seen / "broken.stl").symlink_to(tmp_path / "nowhere.stl")
    found = list_objects([f"folder:{seen}"])
    assert [source.id for source in found] == ["folder/link-ball", "folder/link-deep-box"]
    assert [len(source.load().faces) for source in found] == [12, 12]


def test_a_folder_may_have_any_name(tmp_path):
    folder = boxes_at(tmp_path / "what? 50% #1 & [a,b]" / "x=1.stl", tmp_path / "c.stl")
    (found,) = list_objects([f"folder:{folder}"])
    assert find_object(found.selector) == dataclasses.replace(found, loader=ANY)
    (in_mm,) = list_objects([f"folder:{folder}?unit=mm"])
    assert find_object(in_mm.selector).digest == in_mm.digest != found.digest


def test_normalised_meshes_get_their_size_by_a_scale(tmp_path):
    folder = boxes_at(tmp_path / "sub" / "box.stl", tmp_path / "sub" / "deep" / "box.stl").parent
    small, _ = list_objects([f"folder:{folder}?scale=0.5"])
    large, _ = list_objects([f"folder:{folder}?unit=cm&scale=50"])
    assert [small.id, large.id] == ["folder/sub-box-0.5", "folder/sub-box-50"]
    np.testing.assert_allclose(small.load().extents, [0.02, 0.025, 0.02], rtol=1e-5)
    np.testing.assert_allclose(large.load().extents, [0.02, 0.025, 0.02], rtol=1e-5)
    assert find_object(large.selector) == dataclasses.replace(large, loader=ANY)
    assert len(list_objects([f"folder:{folder}?scale=0.5", f"folder:{folder}?scale=0.6"])) == 4
    for wrong in ("scale=0", "scale=-1", "scale=nan", "scale=x", "scale=1e999", "size=2", ""):
        with pytest.raises(DmfcError, match="folder"):
            list_objects([f"folder:{folder}?{wrong}"])


OWN = """
import trimesh
from dmfc.objects.custom import CustomObject

def boxes():
    return [CustomObject(f"box-{n}", lambda: trimesh.creation.box((0.04, 0.05, 0.06)), mass=0.2)
            for n in (1, 2)] + [CustomObject("odd", lambda: 1)]

def named():
    return [CustomObject("кружка", lambda: None)]

def wrong():
    return [CustomObject("a b", lambda: None)]

def twice():
    return 2 * boxes()

def nothing():
    return {}
"""


def test_a_source_of_the_users_own(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    found = list_objects(["mine.py:boxes"])
    assert [source.id for source in found] == ["own/box-1", "own/box-2", "own/odd"]
    assert len({source.digest for source in found}) == 3
    assert ids("mine.py:named") == ["own/кружка"]
    (one,) = list_objects(["mine.py:boxes/box-2"])
    assert (one.digest, one.mass) == (found[1].digest, 0.2)
    np.testing.assert_allclose(one.load().extents, [0.04, 0.05, 0.06])
    monkeypatch.chdir("/")
    assert find_object(one.selector).digest == one.digest  # as a worker elsewhere finds it
    (tmp_path / "mine.py").write_text(OWN.replace("0.06", "0.07"))
    assert find_object(one.selector).digest != one.digest
    np.testing.assert_allclose(find_object(one.selector).load().extents, [0.04, 0.05, 0.07])


@pytest.mark.parametrize(
    ("selector", "message"),
    [
        ("mine.py:boxes/box-3", "unknown object of 'mine.py:boxes' 'box-3'; did you mean"),
        ("mine.py:boxs", "unknown function of mine.py 'boxs'; did you mean 'boxes'"),
        ("mine.py", "not of the form file.py:function"),
        ("./mine.py", "not of the form file.py:function"),
        ("mine.py:wrong", "'a b' is not a valid name"),
        ("mine.py:twice", "given twice"),
        ("mine.py:nothing", r"nothing\(\) must give a list of CustomObject"),
    ],
)
def test_wrong_sources_of_the_users_own(tmp_path, monkeypatch, selector, message):
    (tmp_path / "mine.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DmfcError, match=message) as raised:
        list_objects([selector])
    assert "\n" not in str(raised.value)


@settings(max_examples=40, deadline=None)
@given(number=st.integers(0, 5000))
def test_generated_shapes(number):
    name = procedural.name_of(number)
    mesh = procedural.generate(number)
    assert procedural.number_of(name) == number
    assert mesh.is_watertight
    assert mesh.body_count == 1
    assert len(mesh.faces) <= 4000
    assert mesh.bounds[0, 2] == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(mesh.bounds.mean(axis=0)[:2], 0, atol=1e-6)
    assert mesh.extents.max() < 0.3
    hollow = name.split("-")[0] in ("bowl", "lid", "ring", "cup", "mug")
    assert hollow or 0.015 < np.sort(mesh.extents)[0] < 0.105
    cleaned = clean(mesh, name)
    assert cleaned.watertight
    assert not cleaned.notes
    np.testing.assert_array_equal(procedural.generate(number).vertices, mesh.vertices)


def test_families_go_round():
    names = [procedural.name_of(i).split("-")[0] for i in range(24)]
    assert names[:12] == names[12:]
    assert len(set(names)) == 12


def test_a_large_object_is_the_same_shape_scaled_and_another_source():
    (large,) = list_objects(["procedural/can-0005-large"])
    (usual,) = list_objects(["procedural/can-0005"])
    assert large.digest != usual.digest
    scale = np.linalg.norm(large.load().vertices) / np.linalg.norm(usual.load().vertices)
    assert 1.25 <= scale <= 1.65
    np.testing.assert_allclose(large.load().vertices, scale * usual.load().vertices, atol=1e-9)
