"""Whether the objects of a scene set overlap, and whether they rest: the worst of all scenes.

    python -m analysis.scene_properties --preset medium --split test

Overlap by trimesh's signed distance of surface points; rest in the world that trials are run in.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import trimesh

from dmfc.config.schema import Config
from dmfc.experiment.session import Session
from dmfc.hand.description import load_description
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World
from dmfc.pipeline.artifacts import load_object, load_scenes
from dmfc.scenes.scene_set import Scene

SECONDS = 2.0


def overlap(scene: Scene, objects: Mapping[str, ObjectModel]) -> float:
    """Depth of the deepest surface point of an object in the mesh of another; metres, 0: apart."""
    deepest = 0.0
    placed = [
        (trimesh.Trimesh(objects[n].vertices, objects[n].faces, process=False), objects[n], T)
        for n, T in zip(scene.object_ids, scene.T_world_object, strict=True)
    ]
    for i, (mesh, _, T_world_a) in enumerate(placed):
        low, high = mesh.bounds
        for j, (_, other, T_world_b) in enumerate(placed):
            T_a_b = np.linalg.inv(T_world_a) @ T_world_b
            points = other.surface_points @ T_a_b[:3, :3].T + T_a_b[:3, 3]
            near = points[((points > low) & (points < high)).all(1)]
            if i != j and len(near) and mesh.is_watertight:
                depth = trimesh.proximity.signed_distance(mesh, near)
                deepest = max(deepest, float(depth.max()))
    return deepest


def movement(scene: Scene, objects: Mapping[str, ObjectModel], config: Config) -> dict[str, float]:
    """Object -> how far its centre of mass moves in 2 s in the world of a trial, metres."""
    hand = load_description(config.hand.name)
    models = [objects[name] for name in scene.object_ids]
    world = World(hand, models, config.physics, table_size=config.scenes.table_size)
    world.reset()
    away = np.eye(4)
    away[2, 3] = 2.0
    world.place_palm(away, np.zeros(len(hand.dofs)))
    for k, T_world_object in enumerate(scene.T_world_object):
        world.place_object(k, T_world_object)
    mujoco.mj_forward(world.model, world.data)
    start = world.data.xipos[world.index.object_body].copy()
    mujoco.mj_step(world.model, world.data, nstep=round(SECONDS / config.physics.timestep))
    moved = np.linalg.norm(world.data.xipos[world.index.object_body] - start, axis=1)
    return dict(zip(scene.object_ids, moved.tolist(), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description="Overlap and rest of the objects of a scene set.")
    parser.add_argument("--store", type=Path, default=Path("store"))
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--split", default="train")
    parser.add_argument("--limit", type=int, default=100, help="scenes looked at")
    given = parser.parse_args()
    session = Session.open(given.preset, given.set, given.store)
    folder = session.ledger.folder
    stages = session.builder.objects(session.config, given.split)
    objects = {s.name: load_object(folder(s.address)) for s in stages}
    shards = session.builder.scenes(session.config, given.split)
    scenes = load_scenes(folder(shard.address) for shard in shards)
    chosen = scenes[: given.limit]
    overlaps = [overlap(scene, objects) for scene in chosen]
    moved = [
        (way, name)
        for scene in chosen
        for name, way in movement(scene, objects, session.config).items()
    ]
    ways = np.array([way for way, _ in moved])
    print(f"{len(chosen)} scenes, {len(moved)} objects")
    print(f"deepest overlap {1e3 * max(overlaps):.4f} mm")
    print(f"moved in 2 s: median {1e3 * np.median(ways):.3f} mm, most {1e3 * ways.max():.2f} mm")
    print(f"moved 2 mm or more: {sum(ways >= 0.002)}")
    for way, name in sorted(moved, reverse=True)[:5]:
        print(f"  {name} {1e3 * way:.2f} mm")


if __name__ == "__main__":
    main()
