"""What lies outside the store: where it is missing or another on a machine, nothing is kept."""

import pytest
import trimesh

from dmfc.config.load import load_config
from dmfc.engine.engine import run_stages
from dmfc.errors import MachineError
from dmfc.pipeline.graph import GraphBuilder
from dmfc.pipeline.here import require_same, share_packs
from dmfc.pipeline.kinds import KINDS
from dmfc.pipeline.selection import list_refs


@pytest.mark.parametrize(
    ("happens", "told"), [("changed", "is not the same on"), ("removed", "does not exist")]
)
def test_a_mesh_that_is_another_here_is_an_error_of_the_machine(tmp_path, ledger, happens, told):
    path = tmp_path / "box.stl"
    trimesh.creation.box((0.05, 0.06, 0.07)).export(path)
    config = load_config("smoke", [])
    (stage,) = GraphBuilder(list_refs).selected_objects(config, [f"folder:{path}"])
    if happens == "changed":
        trimesh.creation.box((0.05, 0.06, 0.08)).export(path)
    else:
        path.unlink()
    outcome = run_stages([stage], ledger, config, KINDS, local=True)[stage.address]
    assert outcome.status == "failed"
    assert told in outcome.reason
    assert not outcome.kept
    assert not ledger.finished(stage.address)


def test_an_object_without_volume_is_kept(tmp_path, ledger):
    path = tmp_path / "flat.stl"
    trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]]).export(path)
    config = load_config("smoke", [])
    (stage,) = GraphBuilder(list_refs).selected_objects(config, [f"folder:{path}"])
    outcome = run_stages([stage], ledger, config, KINDS, local=True)[stage.address]
    assert outcome.kept
    assert ledger.failure(stage.address) == outcome.reason


def test_the_same_is_no_error_and_another_says_what_to_do():
    require_same("x", "digest", "digest")
    with pytest.raises(MachineError, match="run the same line again"):
        require_same("x", "digest", "other")


def test_packs_that_stages_use_are_put_into_the_store_and_no_others(tmp_path, shadow_hand_dir):
    config = load_config("smoke", [])
    builder = GraphBuilder(list_refs)
    share_packs([builder.hand(config), *builder.objects(config, "train")], tmp_path)
    (folder,) = (tmp_path / "packs").iterdir()
    assert folder.name == shadow_hand_dir.parent.name
    mine = {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    cached = shadow_hand_dir.parent
    assert mine == {p.relative_to(cached): p.read_bytes() for p in cached.rglob("*") if p.is_file()}
