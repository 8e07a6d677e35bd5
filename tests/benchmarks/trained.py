"""A trained model of a store with its scenes and objects, for the scripts that look into it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dmfc.config.schema import Config
from dmfc.engine.ledger import Ledger
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.model import HandModel
from dmfc.network.checkpoint import load_network
from dmfc.network.model import DmfcGraspNet
from dmfc.objects.atlas import ObjectAtlas
from dmfc.pipeline.artifacts import GRASPS, SCENES
from dmfc.pipeline.graph import GraphBuilder
from dmfc.pipeline.replay import input_folders
from dmfc.pipeline.selection import list_refs
from dmfc.pipeline.stages import present
from dmfc.pipeline.stages_training import training_geometry
from dmfc.scenes.scene_set import SceneSet
from dmfc.training.batch import Batch, collate
from dmfc.training.data import SceneDataset


@dataclass(frozen=True)
class Trained:
    """A network in evaluation mode, its hand, objects and training scenes, as they were made."""

    net: DmfcGraspNet
    hand: HandModel
    atlas: ObjectAtlas
    scenes: SceneDataset

    def batches(self, size: int) -> Iterator[Batch]:
        """All scenes in their order, `size` at a time."""
        for start in range(0, len(self.scenes), size):
            yield collate(
                [self.scenes[i] for i in range(start, min(start + size, len(self.scenes)))]
            )


def trained(config: Config, model: str, name: str, store: Path) -> Trained:
    """The finished `model` (pretrained, finetuned) of cell `name` in a store."""
    ledger = Ledger(store)
    stage = GraphBuilder(list_refs).cell(config, model, name).model
    assert stage is not None, f"'{model}' is not trained"
    inputs = input_folders(ledger, stage.inputs)
    hand, atlas = training_geometry(inputs)
    scenes, grasps = inputs["scenes"], inputs["grasps"]
    assert isinstance(scenes, list)
    assert isinstance(grasps, list)
    sets = [GraspSet.load(folder / GRASPS) for folder in present(grasps)]
    dataset = SceneDataset(
        SceneSet.open([folder / SCENES for folder in scenes]),
        {found.object_id: found for found in sets},
        atlas.ids,
        hand.palm_reference,
        config.matching,
        config.scenes.cameras,
        num_seeds=config.network.levels[0],
    )
    return Trained(load_network(ledger.folder(stage.address), hand), hand, atlas, dataset)
