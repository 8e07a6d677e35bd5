"""What executes a row: a stage of ours, a trained model as it is, or a foreign method."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from dmfc.config.custom_function import custom_function
from dmfc.errors import DmfcError, unknown_name

MODELS = ("pretrained", "finetuned", "planner", "random")
GIVEN = "given"
"""A shipped model or a folder: what is there, is executed."""
METHOD = "method"
"""A function that answers with grasps."""
FUNCTION = "predict"
"""Name of the function in each shipped method's file."""


@dataclass(frozen=True)
class Source:
    """Where the grasps of a row come from."""

    kind: str
    """One of MODELS, or GIVEN, or METHOD."""
    weights: Path | None = None
    """Folder of a trained model that is executed as it is."""
    method: str = ""
    """'file.py:function'."""


def source_of(model: str, where: str) -> Source:
    """What a row's `model` names. Raises DmfcError, which `where` begins, if there is none."""
    if model in MODELS:
        return Source(model)
    method = method_text(model)
    if method:
        custom_function(method, f"{where}: model")
        return Source(METHOD, method=method)
    return Source(GIVEN, weights=_weights(model, where))


def method_text(model: str) -> str:
    """'file.py:function' of a method or of a shipped one's name; empty: it names no method."""
    if model in shipped_methods():
        return f"{shipped_methods()[model]}:{FUNCTION}"
    file, colon, _ = model.partition(":")
    return model if colon and file.endswith(".py") else ""


def shipped_methods() -> dict[str, Path]:
    """Files of the baselines that come with the package, by name."""
    folder = Path(str(resources.files("dmfc.methods") / "baselines"))
    return {path.stem: path for path in sorted(folder.glob("[a-z]*.py"))}


def _weights(model: str, where: str) -> Path:
    """The folder of a trained model: a shipped one's name, or a path."""
    from dmfc.network.model_files import WEIGHTS
    from dmfc.prediction.models import model_folder, shipped_models

    folder = Path(model).expanduser()
    if model in shipped_models() or (folder / WEIGHTS).is_file():
        return model_folder(model)
    if len(folder.parts) > 1:
        raise DmfcError(f"{where}: model: the folder {model} holds no {WEIGHTS}")
    known = [*MODELS, *shipped_methods(), *shipped_models()]
    raise DmfcError(f"{where}: {unknown_name('model', model, known)}")
