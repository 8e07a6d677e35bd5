"""Shipped models: which there are, and how a stage becomes one."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from safetensors.torch import load_file, save_file

from dmfc.engine.ledger import Ledger
from dmfc.engine.record import identity_key
from dmfc.errors import DmfcError
from dmfc.prediction import models
from dmfc.prediction.planner import load


def test_the_default_is_shipped_small_and_with_a_card():
    assert models.default_model() in models.shipped_models()
    for name in models.shipped_models():
        folder = models.SHIPPED / name
        assert (folder / models.WEIGHTS).stat().st_size < models.LARGEST_MB * 1e6
        card = (folder / models.CARD).read_text()
        assert f"# {name}\n" in card
        assert "evaluated" in card or "trials" in card


def test_an_exported_stage_predicts_as_the_stage_does(stage_folder, blob, tmp_path, monkeypatch):
    out = models.export_model(stage_folder, tmp_path / "mine", default=True)
    assert (tmp_path / models.DEFAULT).read_text() == "mine\n"
    monkeypatch.setattr(models, "SHIPPED", tmp_path)
    assert models.shipped_models() == ["mine"]
    ours = load()(blob)
    assert ours.model == "mine"
    np.testing.assert_array_equal(ours.T_cloud_palm, load(stage_folder)(blob).T_cloud_palm)
    card = (out / models.CARD).read_text()
    for part in (
        "10 scenes (multi) of 2 objects, 2048 points",
        "commit abcdef0",
        "pretrain/0123",
        "This model was not evaluated.",
    ):
        assert part in card


def test_a_card_says_what_was_measured(stage_folder, tmp_path):
    out = models.export_model(stage_folder, tmp_path / "mine", measured="Held 3 of 400.")
    card = (out / models.CARD).read_text()
    assert "Held 3 of 400." in card
    assert "not evaluated" not in card
    assert not (tmp_path / models.DEFAULT).exists()


def finished(store, stage_folder):
    """The weights as a stage that a ledger finished: with their digests."""
    ledger = Ledger(store)
    record = {"kind": "pretrain", "stage_version": 1, "config": {}, "inputs": {}}
    address = f"pretrain/{identity_key(record)}"
    with ledger.claim(address) as out:
        for name in (models.WEIGHTS, models.CONFIG):
            shutil.copyfile(stage_folder / name, out / name)
        ledger.commit(address, record)
    return ledger.folder(address)


@pytest.mark.parametrize("name", [models.WEIGHTS, models.CONFIG])
def test_a_damaged_stage_predicts_nothing(tmp_path, stage_folder, name):
    load(finished(tmp_path / "whole", stage_folder))
    folder = finished(tmp_path / "store", stage_folder)
    content = bytearray((folder / name).read_bytes())
    content[-1] ^= 1
    (folder / name).write_bytes(content)
    for use in (load, lambda path: models.export_model(path, tmp_path / "mine")):
        with pytest.raises(DmfcError, match=rf"{name}' has changed; `dmfc store repair`"):
            use(folder)
    elsewhere = shutil.copytree(folder, tmp_path / "elsewhere")
    with pytest.raises(DmfcError, match=rf"{name}' has changed; copy the folder again"):
        load(elsewhere)


def test_weights_that_are_not_finite_predict_nothing(tmp_path, stage_folder):
    folder = tmp_path / "mine"
    models.export_model(stage_folder, folder)
    tensors = load_file(folder / models.WEIGHTS)
    name = next(name for name, tensor in tensors.items() if tensor.ndim == 2)
    tensors[name][0, 0] = float("nan")
    save_file(tensors, folder / models.WEIGHTS)
    with pytest.raises(DmfcError, match=rf"mine/{models.WEIGHTS} .*'{name}' has 1 numbers"):
        load(folder)


def test_what_is_no_model_is_refused(tmp_path, stage_folder, monkeypatch):
    with pytest.raises(DmfcError, match=r"holds no weights\.safetensors"):
        models.model_folder(tmp_path)
    (tmp_path / models.WEIGHTS).write_bytes(b"junk")
    with pytest.raises(DmfcError, match="holds no trained network"):
        models.export_model(tmp_path, tmp_path / "out")
    monkeypatch.setattr(models, "LARGEST_MB", 0.001)
    with pytest.raises(DmfcError, match="shipped are at most"):
        models.export_model(stage_folder, tmp_path / "out")
    assert not (tmp_path / "out").exists()
