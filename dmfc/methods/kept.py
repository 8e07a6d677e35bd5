"""Checked answers kept in a folder of a store, named by the digest of their grasps."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dmfc.errors import DmfcError
from dmfc.files.atomic import write_bytes
from dmfc.methods.answer import Answer, nothing
from dmfc.methods.ask import NO_FILE, Answered

ARRAYS = ("position", "rotation", "joints", "score", "point")


def answers_digest(answers: Mapping[str, Answered]) -> str:
    """SHA-256 of the grasps and failures of all scenes. How long they took is no part of it."""
    hashed = hashlib.sha256()
    for scene in sorted(answers):
        found = answers[scene]
        hashed.update(f"{scene}\n{found.failure}\n{found.used}\n{len(found.answer)}\n".encode())
        for name in ARRAYS:
            hashed.update(np.ascontiguousarray(getattr(found.answer, name)).tobytes())
    return hashed.hexdigest()


def keep_answers(answers: Mapping[str, Answered], store: Path) -> Path:
    """Write the answers below `store`, where they are not there yet; gives their folder."""
    folder = store / "answers" / answers_digest(answers)[:32]
    folder.mkdir(parents=True, exist_ok=True)
    for scene, found in answers.items():
        path = folder / f"{scene}.npz"
        if not path.is_file():
            write_bytes(path, _packed(found))
    return folder


def load_answers(folder: Path, dofs: int) -> dict[str, Answered]:
    """The answers in a folder by the id of their scene. Raises DmfcError where one is damaged."""
    found = {}
    for path in sorted(folder.glob("*.npz")):
        try:
            with np.load(path, allow_pickle=False) as arrays:
                answer = Answer(**{name: arrays[name] for name in ARRAYS})
                told = (float(arrays["seconds"]), str(arrays["failure"]), str(arrays["used"]))
        except (OSError, ValueError, KeyError) as error:
            raise DmfcError(f"the answers in {path} are damaged: score them again") from error
        if answer.joints.shape[1:] != (dofs,):
            raise DmfcError(f"the answers in {path} are of another hand")
        found[path.stem] = Answered(answer, *told)
    return found


def left_out(dofs: int) -> Answered:
    """For a scene that has no file."""
    return Answered(nothing(dofs), failure=NO_FILE)


def _packed(found: Answered) -> bytes:
    buffer = io.BytesIO()
    arrays = {name: getattr(found.answer, name) for name in ARRAYS}
    np.savez(buffer, **arrays, seconds=found.seconds, failure=found.failure, used=found.used)
    return buffer.getvalue()
