"""Matching equals brute force; labels return to their object's frame; collisions are dropped."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
import trimesh

from dmfc.config.scenes import MatchingConfig, ScenesConfig
from dmfc.geometry import transforms
from dmfc.hand.kinematics import HandKinematics
from dmfc.scenes.labels import HandAtGrasps, surviving_labels
from dmfc.scenes.matching import ObservedPoints, match_grasps
from dmfc.scenes.publish.stats import scene_stats, stats_rows
from dmfc.scenes.scene_grasps import SceneGrasps, grasps_in_scene
from tests.support import scene_shapes


def labels_of(scene, grasps, hand):
    return grasps_in_scene(
        scene.object_ids,
        scene.T_world_object,
        scene.grasp_object,
        scene.grasp_index,
        grasps,
        hand.palm_reference,
    )


@pytest.mark.parametrize("mode", ["patch", "projected", "literal"])
def test_matching_equals_brute_force(mode, scenes, grasps, hand):
    config = MatchingConfig(mode=mode, distance=0.02)
    found = 0
    for scene in scenes[:2]:
        labels = labels_of(scene, grasps, hand)
        seeds = ObservedPoints.of(scene, np.arange(200))
        points, normals, owner = seeds.points, seeds.normals, seeds.point_object
        table = match_grasps(config, seeds, labels)
        expected = np.zeros((200, len(labels)), dtype=bool)
        for g, (p_p, hit) in enumerate(zip(labels.palm_reference, labels.palm_hit, strict=True)):
            mine = np.flatnonzero(owner == labels.object_index[g])
            faces = [n @ (p_p - p) > 0 for p, n in zip(points[mine], normals[mine], strict=True)]
            mine = mine[faces]
            centres = {"patch": np.linspace(p_p, hit, 4001), "projected": hit, "literal": p_p}
            away = np.array([_nearest(p, centres[mode]) for p in points[mine].astype(float)])
            if mode == "patch":
                size = round(config.share * (owner == labels.object_index[g]).sum())
                order = np.argsort(away)[: max(1, size)]
                expected[mine[order], g] = away[order] <= config.reach
            else:
                expected[mine, g] = away <= config.distance
        assert (table == expected).all()
        found += int(expected.sum())
    assert found > 20


def palms(reference: np.ndarray, hit: np.ndarray, object_index: np.ndarray) -> SceneGrasps:
    """Grasps of which nothing but the palm counts."""
    count = len(reference)
    return SceneGrasps(
        position=reference,
        rotation=np.tile(np.eye(3), (count, 1, 1)),
        joints=np.zeros((count, 0)),
        palm_reference=reference,
        palm_hit=hit,
        object_index=object_index,
    )


def _nearest(point, centres):
    """Distance of a point [3] to the nearest of the centres [3] or [n, 3]."""
    return np.linalg.norm(np.atleast_2d(centres) - point, axis=1).min()


def test_a_patch_is_the_points_under_the_palm():
    """A plate seen from above, a palm 5 cm over it: the tenth of its points below the palm, unless
    they are out of reach; a point of the underside is never among them."""
    x, y = np.meshgrid(np.arange(-9.5, 10) * 0.01, np.arange(-9.5, 10) * 0.01)
    plate = np.stack([x.ravel(), y.ravel(), np.zeros(400)], axis=1)
    normals = np.tile([0, 0, 1.0], (400, 1))
    normals[0:400:3] *= -1
    reference, hit = np.array([[0, 0, 0.05]]), np.zeros((1, 3))
    seen, palm = ObservedPoints(plate, normals, np.zeros(400)), palms(reference, hit, np.zeros(1))
    away = np.linalg.norm(plate, axis=1)
    up = normals[:, 2] > 0
    rows = np.flatnonzero(match_grasps(MatchingConfig(), seen, palm)[:, 0])
    assert 0 < len(rows) < 40  # 3 cm end before a tenth of the points is found
    assert set(rows) == set(np.flatnonzero(up & (away <= 0.03)))
    rows = np.flatnonzero(match_grasps(MatchingConfig(reach=1.0), seen, palm)[:, 0])
    assert len(rows) >= 40  # and those as near as the fortieth
    assert away[rows].max() == pytest.approx(np.sort(away[up])[39])
    assert up[rows].all()
    rim = np.array([[0.02, 0.0, 0.03]])  # nearer to the palm's axis than to where it ends
    one = ObservedPoints(rim, normals[1:2], np.zeros(1))
    assert match_grasps(MatchingConfig(), one, palm).all()


def test_matching_by_hand():
    """One point, its normal up; grasps above, above another object, beneath, and without a hit."""
    point, normal = np.zeros((1, 3)), np.array([[0, 0, 1.0]])
    reference = np.array([[0, 0, 0.06], [0, 0, 0.06], [0, 0, -0.06], [0, 0, 0.06]])
    hit = np.array([[0, 0.004, 0], [0, 0.004, 0], [0, 0.004, 0], [np.nan, np.nan, np.nan]])
    seen = ObservedPoints(point, normal, np.zeros(1))
    above = palms(reference, hit, np.array([0, 1, 0, 0]))
    for mode in ("patch", "projected"):
        config = MatchingConfig(mode=mode)
        table = match_grasps(config, seen, above)
        assert table.tolist() == [[True, False, False, False]]
    literal = MatchingConfig(mode="literal")
    assert not match_grasps(literal, seen, above).any()


def test_labels_taken_back_equal_the_stored_grasps(scenes, grasps, hand):
    for scene in scenes:
        own = labels_of(scene, grasps, hand)
        assert len(own.position) == len(scene.grasp_index) > 0
        T_world_palm = transforms.transform(own.rotation, own.position)
        for row, (index, stored) in enumerate(
            zip(scene.grasp_object, scene.grasp_index, strict=True)
        ):
            T_object_world = np.linalg.inv(scene.T_world_object[index])
            back = T_object_world @ T_world_palm[row]
            expected = grasps[scene.object_ids[index]]
            assert np.allclose(back, expected.T_object_palm[stored], atol=1e-12)
            assert np.allclose(own.joints[row], expected.joints[stored])
            hit = transforms.apply(T_object_world, own.palm_hit[row][None])[0]
            assert np.allclose(hit, expected.palm_hit[stored], atol=1e-12, equal_nan=True)


def test_dropped_labels_are_those_in_collision(scenes, objects, grasps, hand):
    """Against trimesh's signed distance, for all grasps of the objects of two scenes."""
    config = ScenesConfig()
    kinematics = HandKinematics(hand)
    for scene in scenes[:2]:
        models = [objects[name] for name in scene.object_ids]
        labels = surviving_labels(config, models, scene.T_world_object, grasps, HandAtGrasps(hand))
        kept = set(zip(labels.grasp_object.tolist(), labels.grasp_index.tolist(), strict=True))
        expected, table, neighbour = set(), 0, 0
        for index, model in enumerate(models):
            own = grasps[model.id]
            T_world_palm = torch.as_tensor(scene.T_world_object[index] @ own.T_object_palm)
            points = kinematics.collision_points(T_world_palm, torch.as_tensor(own.joints))
            lowest = points[..., 2].amin(1).numpy()
            deepest = _deepest(points.numpy(), models, scene.T_world_object, index)
            assert np.abs(lowest).min() > 1e-6  # no case is too close to call
            table += int((lowest < 0).sum())
            neighbour += int(((lowest >= 0) & (deepest > 0)).sum())
            clear = np.flatnonzero((lowest >= 0) & (deepest <= 0)).tolist()
            expected |= {(index, row) for row in clear}
        assert labels.dropped["table"] == table > 0
        # a grid of 3 mm may misjudge a hand that just touches an edge of a neighbour
        assert len(kept ^ expected) <= 0.01 * 80 * len(models)
        assert abs(labels.dropped["neighbour"] - neighbour) <= 0.01 * 80 * len(models)
        assert len(kept) + sum(labels.dropped.values()) == 80 * len(models)


def _deepest(points, models, T_world_object, index):
    """[n] depth of points [n, P, 3] in the meshes of the other objects, by trimesh."""
    deepest = np.full(len(points), -np.inf)
    for other, model in enumerate(models):
        if other == index:
            continue
        mesh = trimesh.Trimesh(model.vertices, model.faces)
        local = transforms.apply(np.linalg.inv(T_world_object[other]), points.reshape(-1, 3))
        near = mesh.bounding_box.contains(local)
        depth = np.full(len(local), -np.inf)
        if near.any():
            depth[near] = trimesh.proximity.signed_distance(mesh, local[near])
        deepest = np.maximum(deepest, depth.reshape(len(points), -1).max(1))
    return deepest


def test_the_most_robust_are_kept(objects, grasps, hand):
    model = objects["shape/box"]
    own = grasps[model.id]
    high = np.eye(4)[None].copy()
    high[0, 2, 3] = 1.0
    config = ScenesConfig(max_grasps=5)
    labels = surviving_labels(config, [model], high, grasps, HandAtGrasps(hand))
    assert (labels.grasp_index == np.argsort(-own.robustness)[:5]).all()
    assert labels.dropped == {"table": 0, "neighbour": 0, "limit": len(own) - 5}


def test_the_tolerance_allows_some_penetration(objects, hand):
    model = objects["shape/box"]
    grasps = {model.id: scene_shapes.grasps_around(model, 200)}
    stands = np.eye(4)[None].copy()
    stands[0, 2, 3] = 0.075
    dropped = []
    for tolerance in (0.0, 0.01, 1.0):
        config = dataclasses.replace(ScenesConfig(), approach_tolerance=tolerance)
        labels = surviving_labels(config, [model], stands, grasps, HandAtGrasps(hand))
        dropped.append(labels.dropped["table"])
    assert dropped[0] > dropped[1] > dropped[2] == 0


def test_objects_without_grasps_have_no_labels(objects, hand):
    models = list(objects.values())[:2]
    T = np.tile(np.eye(4), (2, 1, 1))
    labels = surviving_labels(ScenesConfig(), models, T, {}, HandAtGrasps(hand))
    assert len(labels.grasp_index) == 0
    own = grasps_in_scene([m.id for m in models], T, *[labels.grasp_index] * 2, {}, np.zeros(3))
    assert own.position.shape == (0, 3)


def test_statistics_count_what_is_there(scenes, grasps, hand):
    stats = scene_stats(scenes, grasps, hand.palm_reference, MatchingConfig())
    assert stats["scenes"] == 7
    assert stats["points"] == 7 * 2048
    assert stats["grasps"] == sum(len(scene.grasp_index) for scene in scenes)
    total = stats["grasps"] + sum(stats["dropped"].values())
    assert total == 80 * sum(len(scene.object_ids) for scene in scenes)
    rates = stats["matching"]["projected"]
    assert 0 < rates["positive_grasps_of_seeds"] <= rates["positive_grasps"] <= 1
    assert stats["matching"]["literal"]["positive_points"] < rates["positive_points"]
    rows = {row["quantity"]: row["value"] for row in stats_rows(stats)}
    assert rows["dropped table"] == str(stats["dropped"]["table"])
    assert rows["matching projected positive points"] == f"{rates['positive_points']:.3f}"
