"""GraspIt! world files: one robot and one graspable body, poses in millimetres."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from dmfc.errors import DmfcError, one_line
from dmfc.geometry.transforms import inverse
from dmfc.grasps.exchange.foreign import ForeignGrasps, numbers, pose

SUFFIX = ".xml"
_TRANSFORM = re.compile(r"^\((.*)\)\s*\[(.*)\]$", re.DOTALL)


def read(paths: Sequence[Path]) -> ForeignGrasps:
    """One grasp per file. The object's frame is that of its geometry, as GraspIt! has it.

    Raises DmfcError if a file is not a world of one robot and one graspable body.
    """
    worlds = [_world(path) for path in paths]
    for path, (_, joints) in zip(paths, worlds, strict=True):
        if len(joints) != len(worlds[0][1]):
            raise DmfcError(
                f"{path}: {len(joints)} dofValues, but {paths[0]} has {len(worlds[0][1])}: "
                "the files are of different hands"
            )
    return ForeignGrasps.of(
        np.stack([pose for pose, _ in worlds]),
        np.stack([joints for _, joints in worlds]),
        [str(path) for path in paths],
    )


def _world(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """T_object_root [4, 4] and joint angles of a world."""
    try:
        text = path.read_bytes()
        if b"<!DOCTYPE" in text:  # a world has none; entities in it can grow without end
            raise DmfcError(f"{path}: not a GraspIt! world (it declares a document type)")
        root = ElementTree.fromstring(text)
    except OSError as error:
        raise DmfcError(f"{path}: cannot be read ({error})") from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise DmfcError(f"{path}: not XML ({one_line(error)})") from error
    robot, body = _only(root, "robot", path), _only(root, "graspableBody", path)
    values = robot.find("dofValues")
    if values is None:
        raise DmfcError(f"{path}: the robot has no dofValues")
    joints = _numbers(values.text, path)
    return inverse(_pose(body, path)) @ _pose(robot, path), joints


def _only(root: ElementTree.Element, tag: str, path: Path) -> ElementTree.Element:
    found = root.findall(tag)
    if len(found) != 1:
        raise DmfcError(f"{path}: {len(found)} <{tag}> in this world, expected one")
    return found[0]


def _pose(element: ElementTree.Element, path: Path) -> np.ndarray:
    """T_world_element [4, 4] from '(qw qx qy qz)[x y z]' in millimetres."""
    found = element.find("transform/fullTransform")
    match = _TRANSFORM.match((found.text or "").strip()) if found is not None else None
    if match is None:
        raise DmfcError(f"{path}: <{element.tag}> has no fullTransform (w x y z)[x y z]")
    quaternion, position = (_numbers(part, path) for part in match.groups())
    if len(quaternion) != 4 or len(position) != 3:
        raise DmfcError(f"{path}: <{element.tag}> has no fullTransform (w x y z)[x y z]")
    return pose(position / 1000, quaternion, str(path), f"<{element.tag}>")


def _numbers(text: str | None, path: Path) -> np.ndarray:
    return numbers((text or "").split(), None, str(path), "a row of numbers")
