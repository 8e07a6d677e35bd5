"""The commands `dmfc predict` and `dmfc models`: grasps for a user's cloud."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli import complete
from dmfc.cli.common import AsJson
from dmfc.cli.outputs import file_to_write, folder_to_write, made
from dmfc.errors import DmfcError
from dmfc.experiment.console import show_rows, stderr

if TYPE_CHECKING:
    import numpy as np

    from dmfc.prediction.ranked import RankedGrasps

SHOWN = 10
"""Rows of the table for people."""
Cloud = Annotated[
    Path,
    typer.Argument(
        help="PLY, PCD, NPY, NPZ, XYZ, TXT or CSV; with --intrinsics a depth image: PNG or NPY."
    ),
]
Model = Annotated[
    str,
    typer.Option(
        "--model",
        help="A shipped model (dmfc models list), or a folder.",
        autocompletion=complete.models,
    ),
]
Unit = Annotated[
    str, typer.Option(help="m, cm, mm or inch; default: m, and mm for whole-number depth.")
]
DepthScale = Annotated[
    str, typer.Option(help="Length of one step of a depth image, in metres: 1/5000, 0.0001.")
]
Up = Annotated[
    str, typer.Option(help="Upward direction x,y,z in the cloud's frame; default 0,0,1.")
]
Intrinsics = Annotated[str, typer.Option(help="fx,fy,cx,cy of the depth camera, pixels.")]
Mask = Annotated[Path | None, typer.Option(help="Image that is not 0 on the objects.")]
Pose = Annotated[
    Path | None,
    typer.Option(help="T_world_camera, 4 x 4: text or .npy; grasps are in the world frame."),
]
Table = Annotated[str, typer.Option(help="A table in the cloud: refuse, remove or keep.")]
DropInvalid = Annotated[
    bool,
    typer.Option("--drop-invalid", help="Leave out points that are NaN, infinite or (0, 0, 0)."),
]

Check = Annotated[
    bool,
    typer.Option(
        "--check",
        help="Reject grasps that would collide with the cloud or a table at its lowest point.",
    ),
]

Score = Annotated[
    str,
    typer.Option(
        help="The confidence: outcome, the probability of being held by the model's predictor, or "
        "confidence, the network's own; default: outcome where the model has a predictor."
    ),
]

models_app = typer.Typer(help="Models that are shipped with dmfc.", no_args_is_help=True)


def predict(
    cloud: Cloud,
    model: Model = "",
    unit: Unit = "",
    depth_scale: DepthScale = "",
    up: Up = "",
    intrinsics: Intrinsics = "",
    mask: Mask = None,
    pose: Pose = None,
    table: Table = "refuse",
    drop_invalid: DropInvalid = False,
    check: Check = False,
    score: Score = "",
    top: Annotated[
        int, typer.Option(help="Number of grasps, the most confident ones; 0: all.")
    ] = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Write them as a grasp set (.parquet).",
            callback=file_to_write(".parquet"),
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Write a PNG of cloud and grasps.", callback=file_to_write(".png")),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Grasps of the objects in a point cloud or a depth image, the most confident first."""
    if top < 0:
        raise DmfcError(f"--top {top}: a number of grasps, or 0 for all")
    from dmfc.prediction.query import CloudQuery

    points, grasps = CloudQuery(
        file=cloud,
        model=model,
        unit=unit,
        depth_scale=depth_scale,
        up=up,
        intrinsics=intrinsics,
        mask=mask,
        pose=pose,
        table=table,
        drop_invalid=drop_invalid,
        check=check,
        score=score,
    ).answer()
    grasps = grasps[:top] if top else grasps
    if out is not None:
        grasps.save(made(out), object_id=f"cloud/{cloud.stem}")
    if picture is not None:
        from dmfc.visualization.prediction import grasp_picture

        grasp_picture(grasps, points, made(picture))
    if as_json:
        typer.echo(grasps.to_json())
        return
    show_rows(f"{cloud.name}: {len(grasps)} grasps by {grasps.model}", _rows(grasps), False)
    for path in (out, picture):
        if path is not None:
            stderr().print(f"written: {path}", markup=False, soft_wrap=True)


def _rows(grasps: RankedGrasps) -> list[dict[str, object]]:
    """The first few for people: position in metres, and where the palm faces."""
    import numpy as np

    from dmfc.hand.description import load_description

    normal = np.asarray(load_description(grasps.hand).palm_normal)
    return [
        {
            "rank": k + 1,
            "confidence": float(grasps.confidence[k]),
            "palm at (m)": _vector(grasps.T_cloud_palm[k, :3, 3]),
            "faces": _vector(grasps.T_cloud_palm[k, :3, :3] @ normal),
            "point": int(grasps.point[k]),
        }
        for k in range(min(len(grasps), SHOWN))
    ]


def _vector(values: np.ndarray) -> str:
    return " ".join(f"{value:+.3f}" for value in values)


@models_app.command("list")
def models_list(as_json: AsJson = False) -> None:
    """The models that `dmfc predict` and `dmfc.load` know by name."""
    from dmfc.network.model_files import WEIGHTS
    from dmfc.prediction.models import CARD, SHIPPED, default_model, shipped_models

    rows = [
        {
            "model": name,
            "default": name == default_model(),
            "megabytes": round((SHIPPED / name / WEIGHTS).stat().st_size / 1e6, 1),
            "card": str(SHIPPED / name / CARD),
        }
        for name in shipped_models()
    ]
    show_rows("models", rows, as_json)


@models_app.command("export")
def models_export(
    stage: Annotated[Path, typer.Argument(help="Folder that dmfc train printed.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", help="Folder to make: dmfc/models/NAME.", callback=folder_to_write()
        ),
    ],
    default: Annotated[
        bool, typer.Option("--default", help="Make it the default of the models beside it.")
    ] = False,
    measured: Annotated[
        str, typer.Option(help="What its card says of its rates; default: not evaluated.")
    ] = "",
) -> None:
    """Make a model that can be shipped: weights, settings and a card."""
    from dmfc.prediction.models import export_model

    typer.echo(f"written: {export_model(stage, out, default, measured)}")


@models_app.command("judge")
def models_judge(
    stage: Annotated[Path, typer.Argument(help="Folder that dmfc outcome train printed.")],
    model: Annotated[Path, typer.Option("--model", help="Folder of the model that gets it.")],
    measured: Annotated[str, typer.Option(help="What its card says of its rates.")] = "",
) -> None:
    """Give a model an outcome predictor, which then computes its confidence."""
    from dmfc.prediction.models import add_judge

    typer.echo(f"written: {add_judge(stage, model, measured)}")
