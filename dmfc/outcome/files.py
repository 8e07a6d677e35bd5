"""Names of the files of an outcome predictor, and what can be read of it without torch."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from dmfc.errors import DmfcError

WEIGHTS = "outcome.safetensors"
"""The file by which it is known."""
ABOUT = "outcome.json"
FEATURES_VERSION = 2
"""Of the list of features (`FeatureMaker.names`): a trained predictor knows the one it is for."""


def refuse_learned(folder: Path, names: Iterable[str], setting: str) -> None:
    """Raise DmfcError where the predictor in a folder learned from one of the objects `names`.

    `setting` is where the names come from. A predictor that does not say what it learned from is
    let through.
    """
    path = folder / ABOUT
    learned = json.loads(path.read_text()).get("objects", []) if path.is_file() else []
    shared = set(learned) & set(names)
    if shared:
        raise DmfcError(
            f"the predictor in {folder} learned from '{min(shared)}', which is in {setting}: it "
            "must not be asked about what it has seen"
        )
