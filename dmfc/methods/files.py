"""A test set as files, and the grasps of a method as files: .npz or Parquet, one per scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from dmfc.errors import DmfcError
from dmfc.files.atomic import write_json, write_text, written_whole
from dmfc.files.below import files_below
from dmfc.files.foreign import reading
from dmfc.hand.model import HandModel
from dmfc.methods.answer import checked
from dmfc.methods.ask import Answered
from dmfc.methods.observation import Observation

SUFFIXES = (".npz", ".parquet")
HAND, README = "hand.json", "README.md"
PALM = ("palm_x", "palm_y", "palm_z")
"""Columns of a Parquet file: the palm's origin, metres."""
TURN = ("palm_qw", "palm_qx", "palm_qy", "palm_qz")
"""Columns of a Parquet file: R_world_palm as a unit quaternion."""


def write_observation(seen: Observation, folder: Path) -> Path:
    """Write scene_ID.npz, all that a method may see of a scene."""
    path = folder / f"scene_{seen.id}.npz"
    with written_whole(path) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(
            stream,
            id=seen.id,
            points=seen.points,
            normals=seen.seen_normals,
            segments=seen.seen_segments,
            point_camera=seen.point_camera,
            cameras=seen.cameras,
        )
    return path


def write_hand(hand: HandModel, folder: Path) -> None:
    """Write hand.json: joints and limits, the tree of links, points on the hand."""
    names = (
        *("lower", "upper", "open_joints", "flexion", "parents", "T_parent_link", "joint_axis"),
        *("joint_dof", "joint_scale", "palm_reference", "palm_normal", "collision_link"),
        *("collision_points", "inner_link", "inner_points", "inner_normals"),
    )
    arrays = {name: np.asarray(getattr(hand, name)).tolist() for name in names}
    known = {"name": hand.name, "joint_names": hand.dof_names, "link_names": hand.link_names}
    write_json(folder / HAND, known | arrays)


def write_readme(folder: Path, title: str, score: str) -> None:
    """Write README.md: what the files hold, and the command `score` that counts answers."""
    text = (resources.files("dmfc.methods") / "export_readme.md").read_text()
    write_text(folder / README, text.format(title=title, score=score))


def read_answers(paths: Sequence[Path], observations: Iterable[Observation]) -> dict[str, Answered]:
    """The checked answers in files and folders, by the id of their scene.

    Raises DmfcError on a file that is refused, on two of one scene, and on one of another set.
    """
    files = [
        file
        for path in paths
        for file in (files_below(path, list(SUFFIXES)) if path.is_dir() else [path])
    ]
    if not files:
        raise DmfcError(f"no file of grasps ({' or '.join(SUFFIXES)}) in {paths[0]}")
    known = {seen.id: seen for seen in observations}
    found: dict[str, Answered] = {}
    origin: dict[str, Path] = {}
    for file in files:
        values = _values(file)
        scene = _text(values.pop("id", ""))
        if scene not in known:
            raise DmfcError(
                f"{file}: its id '{scene}' is none of the {len(known)} scenes of this test set: "
                "were they exported with the same --preset, --set and --scenes?"
            )
        if scene in found:
            raise DmfcError(f"{file} and {origin[scene]} are both of scene {scene}")
        try:
            found[scene] = _answered(values, known[scene])
        except DmfcError as error:
            raise DmfcError(f"{file}: {error}") from error
        origin[scene] = file
    return found


def _answered(values: dict[str, Any], seen: Observation) -> Answered:
    seconds = np.asarray(values.pop("seconds", np.nan))
    used = _text(values.pop("used", ""))
    if seconds.size != 1 or seconds.dtype.kind not in "fiu":
        raise DmfcError(f"seconds is one number, not {list(seconds.shape)}")
    return Answered(checked(values, seen), float(seconds.reshape(())), "", used)


def _values(file: Path) -> dict[str, Any]:
    """The arrays of a file under the names of an answer."""
    if file.suffix == ".npz":
        with reading(file, "grasps (.npz)"), np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays}
    if file.suffix == ".parquet":
        import pyarrow.parquet as pq

        with reading(file, "grasps (Parquet)"):
            table = pq.read_table(file)
            return _columns({name: table[name].to_numpy() for name in table.column_names}, file)
    raise DmfcError(f"{file}: files of grasps end in {' or '.join(SUFFIXES)}")


def _columns(columns: Mapping[str, np.ndarray], file: Path) -> dict[str, Any]:
    """The columns of a Parquet file as arrays; a column of another name is a joint's."""
    lacking = [name for name in ("id", *PALM, *TURN, "score") if name not in columns]
    if lacking:
        raise DmfcError(f"{file} has no column {lacking[0]}")
    if not len(columns["id"]):
        raise DmfcError(f"{file} holds no grasp: leave the file out, or write .npz")
    once = [name for name in ("id", "seconds", "used", "frame") if name in columns]
    for name in once:
        if len(set(columns[name].tolist())) > 1:
            raise DmfcError(f"{file}: the column {name} has one value in all rows")
    point = {"point": columns["point"]} if "point" in columns else {}
    taken = {*once, *PALM, *TURN, "score", *point}
    joints = [name for name in columns if name not in taken]
    return {
        **{name: columns[name][0] for name in once},
        **point,
        "position": np.stack([columns[name] for name in PALM], axis=1),
        "quaternion": np.stack([columns[name] for name in TURN], axis=1),
        "joints": np.stack([columns[name] for name in joints], axis=1) if joints else [],
        "joint_names": joints,
        "score": columns["score"],
    }


def _text(value: Any) -> str:
    return str(np.asarray(value).reshape(-1)[0]) if np.size(value) else ""
