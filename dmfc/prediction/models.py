"""Models that are shipped inside the package, and how a trained stage becomes one.

A model is a folder `dmfc/models/NAME` with `weights.safetensors`, `config.yaml` (both as a training
stage leaves them) and `README.md`, its card; and, where it has an outcome predictor, with
`outcome.safetensors`, `outcome.json` and `OUTCOME.md`, the predictor's card.
`dmfc/models/default.txt` names the default.
"""

from __future__ import annotations

from pathlib import Path

from dmfc.errors import DmfcError, unknown_name
from dmfc.files.atomic import write_bytes, write_text
from dmfc.network.model_files import BACKBONE, CONFIG, WEIGHTS

SHIPPED = Path(__file__).resolve().parents[1] / "models"
CARD, DEFAULT = "README.md", "default.txt"
JUDGE_CARD = "OUTCOME.md"
LARGEST_MB = 10
"""Larger weights do not belong in a package."""


def shipped_models() -> list[str]:
    """Names of the models in the package."""
    return sorted(path.parent.name for path in SHIPPED.glob(f"*/{WEIGHTS}"))


def default_model() -> str:
    """Name of the model that is used where none is asked for."""
    return (SHIPPED / DEFAULT).read_text().strip()


def shipped_folder(name: str) -> Path | None:
    """The folder of a shipped model; None where none is called so."""
    return SHIPPED / name if name in shipped_models() else None


def model_folder(model: str | Path | None = None) -> Path:
    """The folder of a model: a shipped one's name, a folder's path, or None for the default."""
    name = default_model() if model is None else str(model)
    if name in shipped_models():
        return SHIPPED / name
    folder = Path(name).expanduser()
    if (folder / WEIGHTS).is_file():
        return folder.absolute()
    if folder.is_dir():
        raise DmfcError(f"the folder {folder} holds no {WEIGHTS} (--model)")
    raise unknown_name("model", name, shipped_models())


def export_model(stage: Path, out: Path, default: bool = False, measured: str = "") -> Path:
    """Make the model folder `out` from the folder of a finished training stage; gives `out`.

    `measured`: what is known of its rates, for the card. `default`: whether it is to be the default
    of the models beside it. Its card is written again. Raises DmfcError where `stage` holds no
    network, or one too large to be shipped.
    """
    from dmfc.network.checkpoint import load_alone
    from dmfc.prediction.card import model_card

    load_alone(stage)
    size = (stage / WEIGHTS).stat().st_size / 1e6
    if size > LARGEST_MB:
        raise DmfcError(f"{stage / WEIGHTS} has {size:.1f} MB; shipped are at most {LARGEST_MB} MB")
    card = model_card(stage, out.name, measured)
    out.mkdir(parents=True, exist_ok=True)
    files = (WEIGHTS, CONFIG, BACKBONE) if (stage / BACKBONE).is_file() else (WEIGHTS, CONFIG)
    for name in files:
        write_bytes(out / name, (stage / name).read_bytes())
    write_text(out / CARD, card)
    if default:
        write_text(out.parent / DEFAULT, f"{out.name}\n")
    return out


def add_judge(stage: Path, model: Path, measured: str = "") -> Path:
    """Copy the outcome predictor of a finished stage into the folder of a model; gives its card.

    `measured`: what is known of rates with it, for the card. Raises DmfcError where there is none.
    """
    from dmfc.outcome.files import ABOUT
    from dmfc.outcome.files import WEIGHTS as JUDGE
    from dmfc.outcome.judge import Judge
    from dmfc.prediction.card import judge_card

    Judge.load(stage)
    if not (model / WEIGHTS).is_file():
        raise DmfcError(f"the folder {model} holds no {WEIGHTS} (--model)")
    card = judge_card(stage, measured)
    for name in (JUDGE, ABOUT):
        write_bytes(model / name, (stage / name).read_bytes())
    write_text(model / JUDGE_CARD, card)
    return model / JUDGE_CARD
