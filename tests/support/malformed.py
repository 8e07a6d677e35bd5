"""Command lines that are wrong, and the files that they name, as one table.

A line stands for a kind of mistake. Its words are those of a shell; the files are those of
`write_files`, in the folder where the lines are run.
"""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path

import numpy as np
import torch
import trimesh
from PIL import Image
from safetensors.torch import save_file

from tests.support import clouds

DAMAGES = ("missing", "empty", "junk", "text", "folder", "cut")
"""What is wrong with the file of a `READERS` line: `DAMAGE.SUFFIX`."""

READERS = {
    "ply": ["predict {}", "view {}", "scenes import {} -o new"],
    "pcd": ["predict {}", "scenes import {} -o new"],
    "npy": [
        "predict {}",
        "scenes import {} -o new",
        "predict {} --intrinsics 277,277,160,120 --up 0,-1,0",
        "predict depth.png --intrinsics 277,277,160,120 --up 0,-1,0 --mask {}",
        "predict good.npy --pose {}",
        "view {}",
        "grasps import dexgraspnet {} --object procedural:1 -o new.parquet",
        "grasps import dexgraspbench {} --object procedural:1 -o new.parquet",
    ],
    "npz": ["predict {}", "scenes import {} -o new"],
    "xyz": ["predict {}", "scenes import {} -o new"],
    "csv": ["scenes import {} -o new"],
    "png": [
        "predict {} --intrinsics 277,277,160,120 --up 0,-1,0",
        "predict depth.png --intrinsics 277,277,160,120 --up 0,-1,0 --mask {}",
        "view {} --intrinsics 277,277,160,120 --up 0,-1,0",
    ],
    "txt": ["predict good.npy --pose {}"],
    "xml": ["grasps import graspit {} --object procedural:1 -o new.parquet"],
    "obj": ["objects prepare folder:{}"],
    "stl": ["objects prepare folder:{}"],
    "glb": ["objects prepare folder:{}"],
    "parquet": ["evaluate {}", "compare {} {}", "compare {}:all rows.parquet"],
    "yaml": [
        "sweep {}",
        "sweep {} --dry-run",
        "train --preset {}",
        "evaluate planner --protocol {}",
        "grasps import graspit good.xml --object procedural:1 -o new.parquet --hand-map {}",
    ],
    "json": ["scenes freeze {} --check"],
    "tar": ["store import {}"],
    "gz": ["store import {}"],
    "pt": ["train --replay {}"],
}
"""Lines that read a file, by its suffix."""

LINES = [
    # clouds
    "predict wall.npy", "predict pixel.npy", "predict zeros.npy", "predict few.npy",
    "predict same.npy", "predict nan.npy", "predict allnan.npy --drop-invalid",
    "predict map32.npy", "predict mm.npy", "predict good.npy --unit mm",
    "predict good.npy --unit feet", "predict good.npy --unit M", "predict good.npy --unit ''x",
    "predict good.npy --unit feet --pose pose.txt", "predict good.npy --unit mm --pose pose.txt",
    "predict table.npy", "predict good.npy --table drop", "predict good.npy --up 0,0",
    "predict good.npy --up 0,0,0", "predict good.npy --up nan,0,1", "predict good.npy --up up",
    "predict good.npy --up 0,0,1,0", "predict good.npy --up inf,0,0", "predict good.npy --top -1",
    "predict good.npy --top many", "predict good.npy --model nothing",
    "predict good.npy --model empty_folder", "predict good.npy --model bad_model",
    "predict good.npy --model cut_model", "predict good.npy --model nan_model",
    "predict good.npy --model good.npy",
    "predict good.npy --mask mask.png", "predict good.npy --depth-scale 0.001",
    "predict good.npy --out plain_file/x.parquet", "predict good.npy --out grasps.csv",
    "predict good.npy --out .", "predict good.npy --out /proc/none/x.parquet",
    "predict good.npy --picture x.jpeg2", "predict good.npy --picture plain_file/x.png",
    "predict good.npy --picture empty_folder", "predict mesh.ply", "predict objects.npy",
    "predict image.npy", "predict colour.npy", "predict strings.npy", "predict complex.npy",
    "predict bools.npy", "predict two.npz", "predict scalar.npy", "predict none.npy",
    "predict columns.npy", "predict rows.parquet", "predict .", "predict ''", "predict good",
    "predict nofields.ply", "predict intensity.pcd", "predict words.xyz", "predict short.xyz",
    "predict huge.ply", "predict huge.pcd", "predict huge.npy", "predict large.npy",
    "predict good.npy more.npy",
    # depth images
    "predict depth.png --intrinsics 277,277,160,120",
    "predict depth.png --intrinsics 1,2,3 --up 0,-1,0",
    "predict depth.png --intrinsics a,b,c,d --up 0,-1,0",
    "predict depth.png --intrinsics nan,277,160,120 --up 0,-1,0",
    "predict depth.png --intrinsics inf,inf,160,120 --up 0,-1,0",
    "predict depth.png --intrinsics 277,277,1600,120 --up 0,-1,0",
    "predict depth.png --intrinsics 554,554,319.5,239.5 --up 0,-1,0",
    "predict depth.png --intrinsics 277,27,160,120 --up 0,-1,0",
    "predict depth.png --intrinsics -277,277,160,120 --up 0,-1,0",
    "predict tum.png --intrinsics 277,277,160,120 --up 0,-1,0",
    "predict tum.png --intrinsics 277,277,160,120 --up 0,-1,0 --depth-scale 5000",
    "predict tum.png --intrinsics 277,277,160,120 --up 0,-1,0 --depth-scale 1/0",
    "predict tum.png --intrinsics 277,277,160,120 --up 0,-1,0 --depth-scale one",
    "predict tum.png --intrinsics 277,277,160,120 --up 0,-1,0 --depth-scale 1 ",
    "predict tum.png --intrinsics 277,277,160,120 --up 0,-1,0 --unit mm --depth-scale 1/5000",
    "predict depth8.png --intrinsics 277,277,160,120 --up 0,-1,0",
    "predict colour.png --intrinsics 277,277,160,120 --up 0,-1,0",
    "predict nothing.png --intrinsics 277,277,160,120 --up 0,-1,0",
    "predict saturated.png --intrinsics 277,277,160,120 --up 0,-1,0",
    "predict depth.png --intrinsics 277,277,160,120 --up 0,-1,0 --mask nomask.png",
    "predict depth.png --intrinsics 277,277,160,120 --up 0,-1,0 --mask small.png",
    "predict depth.png --intrinsics 277,277,160,120 --up 0,-1,0 --unit feet",
    "predict good.npy --intrinsics 277,277,160,120 --up 0,-1,0",
    "predict good.ply --intrinsics 277,277,160,120 --up 0,-1,0",
    "predict good.npy --pose scaled.txt", "predict good.npy --pose short.txt",
    "predict good.npy --pose nan.txt", "predict good.npy --pose good.npy",
    "predict good.npy --pose mirrored.txt",
    # view
    "view", "view good.npy --export .", "view good.npy --export plain_file/x.html",
    "view good.npy --export x.pdf", "view good.npy --port 70000", "view good.npy --port -1",
    "view good.npy --port x", "view good.npy --up a,b,c", "view good.npy --unit feet",
    "view good.npy --set training.seed=1", "view good.npy --preset smoke", "view zeros.npy",
    "view planner --scene -1", "view planner --scene x", "view planner --trial 3",
    "view planner --trial a:b", "view planner --trial 3:0 --scene 3", "view plannr --scene 0",
    "view planner --scene 0 --mask mask.png", "view planner --scene 0 --check",
    "view good.npy --export x.html --host",
    # scenes
    "scenes import good.npy", "scenes import -o new", "scenes import zeros.npy -o new",
    "scenes import few.npy -o new", "scenes import same.npy -o new",
    "scenes import nan.npy -o new", "scenes import mm.npy -o new",
    "scenes import good.npy -o plain_file", "scenes import good.npy -o new --unit feet",
    "scenes import good.npy -o new --above x", "scenes import good.npy -o new --above nan",
    "scenes import good.npy -o new --above 5", "scenes import struct.npy missing.npy -o new",
    "scenes import good.npy -o new --preset nowhere", "scenes import mesh.ply -o new",
    "scenes import aside.npy -o new", "scenes import below.npy -o new",
    "scenes show", "scenes show -1", "scenes show x", "scenes show 0 --at nowhere",
    "scenes show 0 --at bad_set", "scenes show 0 --at json_set", "scenes show 0 --at list_set",
    "scenes show 0 --at gone_set", "scenes show 0 --at plain_file", "scenes show 9 --at bad_set",
    "scenes show 0 --at s4://bucket", "scenes show 0 --split tset",
    "scenes show 0 --at bad_set -o x.pdf", "scenes show 0 -o plain_file/x.png",
    "scenes stats --at nowhere", "scenes stats --at bad_set", "scenes stats --at json_set",
    "scenes stats --at list_set", "scenes stats --at gone_set --verify", "scenes stats",
    "scenes stats --split tset", "scenes make --split tset", "scenes make --out plain_file",
    "scenes make --out plain_file/x", "scenes make --set scenes.train.kind=many",
    "scenes make --set scenes.points=0",
    "scenes freeze", "scenes freeze list.json --check", "scenes freeze object.json --check",
    "scenes freeze plain_file/x.json", "scenes freeze .",
    # models and training
    "models export", "models export missing -o new", "models export empty_folder -o new",
    "models export bad_model -o new", "models export cut_model -o new",
    "models export nan_model -o new", "models export bad_model",
    "models export bad_model -o plain_file", "models lst",
    "train --stage pretrian", "train --stage ''", "train --set training.batch_size=0",
    "train --set training.batch_size=x", "train --set training.batch_size=",
    "train --set training.batch_size", "train --set =3", "train --set a=1",
    "train --set losses.weights.colision=1", "train --set training.learning_rate=nan",
    "train --set training.learning_rate=-1", "train --set training.epochs=-3",
    "train --set 'training.seed=[1'", "train --set training.seed=1e400",
    "train --set hand.name=shadwo", "train --set 'objects.train=[]'",
    "train --set 'objects.train=[ycp:mug]'", "train --set 'objects.train=[folder:nowhere]'",
    "train --set objects.train=3", "train --set network.levels=[]",
    "train --set network.levels=[8,16]", "train --set 'run.tracking_uri=${oc.env:HOME}'",
    "train --set physics.timestep=0", "train --set execution.waypoints=0",
    "train --set execution.min_confidence=1.5", "train --set execution.grasps_per_scene=1e21",
    "train --set physics.hand_friction=-1", "train --set execution.hold_time=-1",
    "train --preset smok", "train --preset bad_key.yaml", "train --preset list.yaml",
    "train --preset loop.yaml", "train --preset tag.yaml", "train --replay depth.png",
    # evaluation
    "evaluate plannner", "evaluate empty_folder", "evaluate bad_model", "evaluate cut_model",
    "evaluate good.npy", "evaluate rows.parquet", "evaluate grasp_folder",
    "evaluate planner --scenes many", "evaluate planner --scenes multi:x",
    "evaluate planner --scenes multi:0", "evaluate planner --scenes multi:-1",
    "evaluate planner --scenes multi:1.5", "evaluate planner --protocol papr",
    "evaluate planner --only 0", "evaluate planner --only a:b", "evaluate planner --only 0:0:0",
    "evaluate planner --only -1:0", "evaluate planner --only 0:-1",
    "evaluate planner --only 99:0 --preset smoke", "evaluate planner --dense 99 --preset smoke",
    "evaluate planner --dense -1", "evaluate planner --dense x",
    "evaluate planner --only 0:0 --dense 0", "evaluate planner --video trial.gif",
    "evaluate planner --picture x.png", "evaluate planner --detailed",
    "evaluate planner --only 0:0 --video x.mp4", "evaluate planner --only 0:0 --picture x.txt",
    "evaluate planner --only 0:0 --picture plain_file/x.png",
    "evaluate planner --only 0:0 --out new", "evaluate planner --dense 0 --out new",
    "evaluate planner --dense 0 --video x.gif", "evaluate planner --out plain_file",
    "evaluate planner --out plain_file/x", "evaluate planner random",
    "compare rows.parquet", "compare rows.parquet rows.parquet:none",
    "compare rows.parquet other.parquet", "compare empty_folder rows.parquet",
    "compare columns.parquet columns.parquet", "compare norows.parquet norows.parquet",
    "compare good.npy good.npy",
    # sweeps
    "sweep", "sweep tabel1", "sweep table1 --preset smok", "sweep table1 --set a.b=1",
    "sweep table1 tabel2", "sweep table1 --presett smoke", "sweep run", "sweep run tabel1",
    "sweep bad_key.yaml", "sweep list.yaml", "sweep loop.yaml", "sweep tag.yaml",
    "sweep both.yaml", "sweep huge_matrix.yaml", "sweep deep.yaml", "sweep badcell.yaml",
    "sweep nocells.yaml", "sweep badmodel.yaml", "sweep badseed.yaml", "sweep env.yaml",
    "sweep badsearch.yaml", "sweep badset.yaml", "sweep table1 --set execution.waypoints=0",
    "sweep table1 --dry-run --set training.batch_size=0",
    "sweep status nothing",
    "sweep status --store empty_folder",
    "tables --store empty_folder", "tables nothing", "ui --store empty_folder",
    "ui --port x", "ui --port 70000", "ui --port -5",
    "tracking", "tracking sync nothing", "tracking rebuild nothing", "tracking rebild",
    "tracking sync --uri ftp://nowhere nothing", "tracking rebuild --uri",
    # stores
    "store list objct", "store show", "store show nothing", "store show object/0123",
    "store show ../..", "store show ''", "store verify --store empty_folder", "store verify objct",
    "store prune --older-than x", "store prune --older-than -1", "store prune --older-than nan",
    "store prune --keep nothing", "store export", "store export new.tar nothing",
    "store export plain_file/x.tar", "store export .", "store export s4://x/y.tar",
    "store import", "store import empty_folder", "store import other.tar",
    "store import outside.tar", "store import s4://x/y.tar", "store lst",
    # objects, grasps, assets
    "objects list ycp:mug", "objects list ycb:nothing", "objects list ycb/nothing",
    "objects list procedural:x", "objects list procedural:-1", "objects list procedural:0",
    "objects list folder:nowhere", "objects list folder:", "objects list folder:meshes?unit=feet",
    "objects list folder:meshes?scale=2", "objects list folder:empty_folder", "objects list ''",
    "objects prepare ycp:mug", "objects prepare folder:flat.obj", "objects prepare folder:nan.obj",
    "objects prepare folder:index.obj", "objects prepare folder:points.ply",
    "objects prepare folder:good.npy", "objects prepare folder:box.obj?unit=m",
    "objects lst",
    "grasps plan ycp:mug", "grasps plan procedural:x", "grasps plan --out plain_file",
    "grasps plan --set grasps.per_object=-1", "grasps stats ycp:mug", "grasps stats",
    "grasps stats --scenes -1", "grasps stats --scenes x", "grasps stats --sheet x.pdf",
    "grasps stats --sheet plain_file/x.png", "grasps export", "grasps export ycp:mug -o new",
    "grasps export ycb/mug", "grasps export ycb/mug -o plain_file",
    "grasps export procedural:1 -o new --hand-map nothing",
    "grasps import", "grasps import graspt good.xml --object procedural:1 -o new.parquet",
    "grasps import graspit good.xml --object procedural:1",
    "grasps import graspit good.xml -o new.parquet",
    "grasps import graspit good.xml --object procedural:3 -o new.parquet",
    "grasps import graspit good.xml --object ycp:mug -o new.parquet",
    "grasps import graspit good.xml --object procedural:1 -o new.csv",
    "grasps import graspit good.xml --object procedural:1 -o plain_file/new.parquet",
    "grasps import graspit good.xml --object procedural:1 -o new.parquet --scale 2",
    "grasps import graspit good.xml --object procedural:1 -o new.parquet --scale 0",
    "grasps import graspit good.xml --object procedural:1 -o new.parquet --tolerance -1",
    "grasps import graspit good.xml --object procedural:1 -o new.parquet --tolerance nan",
    "grasps import graspit good.xml --object procedural:1 -o new.parquet --hand-map nothing",
    "grasps import dexgraspnet empty_folder --object procedural:1 -o new.parquet",
    "grasps import dexgraspnet dict.npy --object procedural:1 -o new.parquet",
    "grasps import dexgraspbench list.npy --object procedural:1 -o new.parquet",
    "assets pull ycbb", "assets verify ycbb", "assets lst", "assets",
    "docter", "", "--nonsense", "doctor --store plain_file", "doctor more",
]  # fmt: skip


def lines() -> list[str]:
    """All lines that are written down here."""
    damaged = [
        line.format(*[f"{damage}.{suffix}"] * line.count("{}"))
        for suffix, templates in READERS.items()
        for line in templates
        for damage in DAMAGES
    ]
    return [*damaged, *LINES]


def write_files(folder: Path) -> None:
    """Every file that the lines name, but those that are to be missing."""
    for suffix in READERS:
        (folder / f"empty.{suffix}").touch()
        (folder / f"junk.{suffix}").write_bytes(bytes(range(7, 256)) * 3)
        (folder / f"text.{suffix}").write_text("not what the name says\n: [{ ,\n")
        (folder / f"folder.{suffix}").mkdir()
    for name in ("empty_folder", "meshes", "grasp_folder"):
        (folder / name).mkdir()
    (folder / "plain_file").write_text("a file\n")
    _write_clouds(folder)
    _write_images(folder)
    _write_meshes(folder)
    _write_models(folder)
    _write_rows(folder)
    _write_yaml(folder)
    _write_archives(folder)
    for suffix, whole in WHOLE.items():
        content = (folder / whole).read_bytes()
        (folder / f"cut.{suffix}").write_bytes(content[: len(content) * 2 // 3])


WHOLE = {
    "ply": "good.ply", "pcd": "good.pcd", "npy": "good.npy", "npz": "good.npz",
    "xyz": "ragged.xyz", "csv": "ragged.xyz", "png": "depth.png", "txt": "pose.txt",
    "xml": "good.xml", "obj": "open.obj", "stl": "box.stl", "glb": "box.glb",
    "parquet": "rows.parquet", "yaml": "open.yaml", "json": "open.json", "tar": "whole.tar",
    "gz": "whole.tar.gz", "pt": "batch.pt",
}  # fmt: skip
"""Of which file `cut.SUFFIX` is the first two thirds."""


def _write_clouds(folder: Path) -> None:
    good = clouds.blob() - [0.1, -0.2, 0]
    wall = np.random.default_rng(0).uniform(size=(1000, 3)) * [3, 0, 2] + [-1.5, 3, 0]
    arrays = {
        "good": good,
        "wall": np.concatenate([good, wall]),
        "pixel": np.concatenate([good, [[0, 0, 8.0]]]),
        "zeros": np.concatenate([good, np.zeros((900, 3))]),
        "few": good[:100],
        "same": np.resize(good[:20], (2000, 3)),
        "nan": np.concatenate([good, np.full((3, 3), np.nan)]),
        "allnan": np.full((300, 3), np.nan),
        "map32": (good + np.array([5.4e6, 3e5, 0])).astype(np.float32),
        "mm": good * 1000,
        "large": good * 1e308,
        "table": clouds.cloud(clouds.box_on_table(), stride=7),
        "aside": good + np.array([0.5, 0, 0]),
        "below": good - np.array([0, 0, 0.1]),
        "image": np.zeros((48, 64)),
        "colour": np.zeros((4, 5, 4)),
        "strings": np.full((200, 3), "x"),
        "complex": good.astype(complex),
        "bools": good > 0,
        "scalar": np.float64(3),
        "none": np.zeros((0, 3)),
        "columns": np.zeros((200, 6)),
        "struct": np.zeros(200, dtype=[("a", "f4"), ("b", "f4")]),
    }
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)
    for name, value in (("objects", {}), ("dict", {"qpos": 1}), ("list", [1, 2])):
        np.save(folder / f"{name}.npy", np.array(value, dtype=object), allow_pickle=True)
    np.savez(folder / "two.npz", a=good, b=good)
    np.savez(folder / "good.npz", good)
    (folder / "good.ply").write_bytes(
        trimesh.exchange.ply.export_ply(trimesh.PointCloud(good), encoding="binary")
    )
    header = "VERSION 0.7\nFIELDS {} \nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {}\nHEIGHT 1\n"
    header += "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\nDATA binary\n"
    body = good.astype("<f4").tobytes()
    for name, fields, count in (
        ("good", "x y z", 3000),
        ("intensity", "x y i", 3000),
        ("huge", "x y z", 10**15),
    ):
        text = header.format(fields, count, count).encode()
        (folder / f"{name}.pcd").write_bytes(text + body)
    for name, count, axes in (("nofields", 4, "uvw"), ("huge", 10**15, "xyz")):
        properties = "".join(f"property float {axis}\n" for axis in axes)
        text = f"ply\nformat ascii 1.0\nelement vertex {count}\n{properties}end_header\n"
        (folder / f"{name}.ply").write_text(text + "1 2 3\n" * 4)
    head = np.lib.format.magic(1, 0) + b"\x76\x00"
    shape = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000, 3), }"
    (folder / "huge.npy").write_bytes(head + shape.ljust(117) + b"\n" + bytes(100))
    (folder / "words.xyz").write_text("x y z\none two three\n")
    (folder / "short.xyz").write_text("1 2\n" * 200)
    (folder / "ragged.xyz").write_text("1 2 3\n" * 300 + "1 2\n" + "1 2 3\n" * 40)


def _write_images(folder: Path) -> None:
    depth = np.zeros((240, 320), dtype=np.uint16)
    depth[80:160, 110:210] = 600 + np.arange(100)
    pictures = {
        "depth": depth,
        "tum": depth * 5,
        "depth8": (depth // 4).astype(np.uint8),
        "colour": np.zeros((240, 320, 3), dtype=np.uint8),
        "nothing": depth * 0,
        "saturated": depth * 0 + 65535,
        "mask": (depth > 0).astype(np.uint8) * 255,
        "nomask": np.zeros((240, 320), dtype=np.uint8),
        "small": np.full((24, 32), 255, dtype=np.uint8),
    }
    for name, picture in pictures.items():
        Image.fromarray(picture).save(folder / f"{name}.png")
    T = clouds.CAMERAS[0].T_world_camera
    poses = {
        "pose": T,
        "scaled": T * 1.5,
        "short": T[:3],
        "nan": T * np.nan,
        "mirrored": T * [[1], [1], [-1], [1]],
    }
    for name, pose in poses.items():
        np.savetxt(folder / f"{name}.txt", pose)


def _write_meshes(folder: Path) -> None:
    for suffix in ("obj", "stl", "glb"):
        trimesh.creation.box((0.05, 0.06, 0.08)).export(folder / f"box.{suffix}")
    (folder / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    (folder / "index.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 7\n")
    (folder / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "points.ply").write_bytes((folder / "good.ply").read_bytes())
    trimesh.creation.box().export(folder / "mesh.ply")
    # A box of 50 m, as a file in millimetres is when it is read in metres.
    trimesh.creation.box((50, 60, 80)).export(folder / "box.obj")


def _write_models(folder: Path) -> None:
    from dmfc.prediction.models import SHIPPED, default_model

    shipped = SHIPPED / default_model()
    weights = (shipped / "weights.safetensors").read_bytes()
    for name in ("bad_model", "cut_model", "nan_model"):
        (folder / name).mkdir()
        (folder / name / "config.yaml").write_bytes((shipped / "config.yaml").read_bytes())
    (folder / "bad_model" / "weights.safetensors").write_bytes(b"junk")
    (folder / "cut_model" / "weights.safetensors").write_bytes(weights[: len(weights) // 2])
    from safetensors.torch import load

    tensors = load(weights)
    name = next(key for key, value in tensors.items() if value.is_floating_point())
    tensors[name] = torch.full_like(tensors[name], torch.nan)
    save_file(tensors, folder / "nan_model" / "weights.safetensors")
    torch.save({"what": "loss"}, folder / "batch.pt")


def _write_rows(folder: Path) -> None:
    import pandas as pd

    rows = pd.DataFrame({"seed": 0, "scene": range(30), "trial": 0, "held": True, "planned": True})
    rows.to_parquet(folder / "rows.parquet")
    rows.assign(scene=rows["scene"] + 1).to_parquet(folder / "other.parquet")
    rows[["seed"]].to_parquet(folder / "columns.parquet")
    rows[:0].to_parquet(folder / "norows.parquet")
    (folder / "grasp_folder" / "a.parquet").write_bytes(b"junk")
    (folder / "good.xml").write_text("<world><graspableBody/></world>")


def _write_yaml(folder: Path) -> None:
    cells = "cells:\n  a: {model: pretrained}\n"
    files = {
        "bad_key": "trainnig: {seed: 1}\n",
        "list": "- a\n- b\n",
        "loop": "a: &a\n  b: *a\n",
        "tag": "a: !!python/object/apply:os.system ['true']\n",
        "both": "cells: [a, b]\nmatrix: {training.seed: [1, 2]}\n",
        "huge_matrix": "matrix:\n" + "".join(
            f"  {key}: [{', '.join(map(str, range(1, 60)))}]\n"
            for key in ("training.seed", "training.epochs", "training.batch_size")
        ),
        "deep": "a: " + "[" * 3000 + "]" * 3000 + "\n",
        "badcell": "cells:\n  a: 3\n",
        "nocells": "name: x\n",
        "badmodel": "cells:\n  a: {model: pretraned}\n",
        "badseed": cells + "seeds: [x]\n",
        "env": "cells:\n  a: {model: pretrained, set: {run.tracking_uri: '${oc.env:HOME}'}}\n",
        "badsearch": "kind: search\nsearch: {trials: -1}\n",
        "badset": "cells:\n  a: {model: pretrained, set: {a.b: 1}}\n",
        "open": "a: [1, 2\nb: {c: " * 9,
    }  # fmt: skip
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(text)
    for name, content in (("list", []), ("object", {}), ("open", {"a": list(range(99))})):
        (folder / f"{name}.json").write_text(json.dumps(content))
    for name, text in (
        ("bad_set", "{}"),
        ("json_set", "{"),
        ("list_set", "[]"),
        ("gone_set", json.dumps({"kind": "dmfc.scene_set", "version": 2})),
    ):
        (folder / name).mkdir()
        (folder / name / "manifest.json").write_text(text)


def _write_archives(folder: Path) -> None:
    for name, mode in (("whole.tar", "w"), ("whole.tar.gz", "w:gz")):
        with tarfile.open(folder / name, mode) as archive:
            archive.add(folder / "good.npy", "stages/object/0123/object.npz")
    with tarfile.open(folder / "other.tar", "w") as archive:
        archive.add(folder / "good.npy", "good.npy")
    with tarfile.open(folder / "outside.tar", "w") as archive:
        manifest = json.dumps({"version": 1, "stages": [], "sweeps": [], "files": {"../x": "0"}})
        member = tarfile.TarInfo("manifest.json")
        member.size = len(manifest)
        archive.addfile(member, io.BytesIO(manifest.encode()))
        member = tarfile.TarInfo("../x")
        archive.addfile(member, io.BytesIO(b""))
