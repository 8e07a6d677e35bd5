"""A retrained confidence head: what it sees, what it learns, and that its files say the same."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from dmfc.config.outcome import OutcomeConfig
from dmfc.errors import DmfcError
from dmfc.network.model import DmfcGraspNet
from dmfc.outcome.features import SeededGrasps
from dmfc.outcome.head import HeadJudge, fit_head, load_judge, read_rows
from dmfc.scenes.scene_set import Scene, write_shard
from tests.network.test_model import network

CONFIG = OutcomeConfig(members=3, epochs=40, batch_size=64, learning_rate=1e-2)
SCENES = 12


@pytest.fixture(scope="module")
def net() -> DmfcGraspNet:
    return network(dtype=torch.float32)


@pytest.fixture(scope="module")
def files(net: DmfcGraspNet, tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Path, Path]]:
    """All predictions of a few scenes; held are those that another head calls confident."""
    folder = tmp_path_factory.mktemp("executed")
    other = network(dtype=torch.float32, seed=5).confidence_head
    rows, scenes = [], []
    for number in range(SCENES):
        scene = _scene(number)
        taught = _with_head(net, other)
        with torch.no_grad():
            said = taught.eval()(torch.as_tensor(scene.points)[None])
        seeds = said.seed_index[0].numpy()
        rows.append(
            pd.DataFrame(
                {
                    "scene": number,
                    "object": f"shape/{number}",
                    "choice": "uniform",
                    "seed_point": seeds,
                    "planned": True,
                    "logit": said.logit[0].numpy(),
                }
            )
        )
        scenes.append(scene)
    table = pd.concat(rows, ignore_index=True)
    table["held"] = table["logit"] > table["logit"].median()
    table.to_parquet(folder / "rollouts.parquet")
    write_shard(folder / "scenes.parquet", scenes, {})
    return [(folder / "rollouts.parquet", folder / "scenes.parquet")]


def _scene(number: int) -> Scene:
    generator = np.random.default_rng(number)
    none = np.zeros(0, dtype=np.int32)
    points = generator.uniform(0.1, 0.3, (100, 3)).astype(np.float32)
    return Scene(
        scene=number,
        object_ids=[f"shape/{number}"],
        T_world_object=np.eye(4)[None],
        points=points,
        normals=np.tile(np.float32([0, 0, 1]), (100, 1)),
        point_object=np.zeros(100, dtype=np.uint8),
        point_camera=np.zeros(100, dtype=np.uint8),
        grasp_object=none.astype(np.uint8),
        grasp_index=none,
        dropped={},
    )


def _with_head(net: DmfcGraspNet, head: torch.nn.Sequential) -> DmfcGraspNet:
    made = network(dtype=torch.float32)
    made.load_state_dict(net.state_dict())
    made.confidence_head = head
    return made.eval()


def test_it_sees_what_the_confidence_head_saw(net: DmfcGraspNet, files) -> None:
    rows, trials = read_rows(net, files)
    table = pd.read_parquet(files[0][0])
    assert len(rows) == len(trials) == len(table)
    scene = _scene(3)
    with torch.no_grad():
        said = net.eval()(torch.as_tensor(scene.points)[None])
        again = net.confidence_head(rows[torch.from_numpy(trials.scene == 3)])[:, 0]
    logit = dict(zip(said.seed_index[0].tolist(), said.logit[0].tolist(), strict=True))
    expected = [logit[p] for p in table[table["scene"] == 3]["seed_point"]]
    # Points are stored in steps of a hundredth of a millimetre.
    np.testing.assert_allclose(again.numpy(), expected, rtol=0.02, atol=0.05)


def test_it_learns_the_rule_and_leaves_all_else_as_it_was(net, files, tmp_path) -> None:
    before = {name: value.clone() for name, value in net.state_dict().items()}
    made, calibration, report = fit_head(net, files, CONFIG, 0)
    assert report.held_auc > 0.85  # on objects that the head had not seen
    assert report.objects == SCENES
    assert calibration[0] > 0
    after = made.state_dict()
    same = [name for name in before if torch.equal(before[name], after[name])]
    assert {name for name in before if not name.startswith("confidence_head")} <= set(same)
    assert all(torch.equal(before[name], value) for name, value in net.state_dict().items())
    again, _, _ = fit_head(net, files, CONFIG, 0)
    assert all(torch.equal(value, again.state_dict()[name]) for name, value in after.items())

    judge = HeadJudge(made, "a hand", *calibration)
    judge.save(report, tmp_path)
    points = _scene(1).points
    with torch.no_grad():
        said = made.eval()(torch.as_tensor(points)[None])
    seeds = said.seed_index[0].numpy()
    n = len(seeds)
    grasps = SeededGrasps(
        np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 18)), seeds, np.ones(n)
    )
    loaded = load_judge(tmp_path)
    assert loaded.hand == "a hand"
    np.testing.assert_array_equal(loaded(grasps, points).held, judge(grasps, points).held)
    assert (np.argsort(judge(grasps, points).held) == np.argsort(said.logit[0].numpy())).all()
    elsewhere = np.setdiff1d(np.arange(len(points)), seeds)[:n]
    with pytest.raises(DmfcError, match="the network's own seeds alone"):
        loaded(dataclasses.replace(grasps, seed_point=np.resize(elsewhere, n)), points)


def test_a_damaged_folder_is_one_line(tmp_path) -> None:
    (tmp_path / "outcome.json").write_text('{"form": "head"}')
    with pytest.raises(DmfcError, match="holds no retrained confidence head"):
        load_judge(tmp_path)
