"""The verbs for who has a cloud and wants grasps: predict, and models."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import AsJson
from dmfc.errors import DmfcError
from dmfc.experiment.console import show_rows, stderr

if TYPE_CHECKING:
    import numpy as np

    from dmfc.prediction.ranked import RankedGrasps

SHOWN = 10
"""Rows of the table for people."""
Cloud = Annotated[
    Path, typer.Argument(help="PLY, PCD, NPY or NPZ; with --intrinsics a depth image: PNG or NPY.")
]
Model = Annotated[
    str,
    typer.Option("--model", help="A shipped model (dmfc models list), or a folder."),
]
Unit = Annotated[str, typer.Option(help="m, cm or mm; default: m, and mm for whole-number depth.")]
Up = Annotated[str, typer.Option(help="x,y,z against gravity in the cloud's frame; default 0,0,1.")]
Intrinsics = Annotated[str, typer.Option(help="fx,fy,cx,cy of the depth camera, pixels.")]
Mask = Annotated[Path | None, typer.Option(help="Image that is not 0 at the objects.")]
Pose = Annotated[
    Path | None, typer.Option(help="T_world_camera, 4 x 4: text or .npy; grasps are in world.")
]
Table = Annotated[str, typer.Option(help="A table in the cloud: refuse, remove or keep.")]
DropInvalid = Annotated[
    bool, typer.Option("--drop-invalid", help="Leave points out that are NaN or infinite.")
]

Check = Annotated[
    bool,
    typer.Option(
        "--check",
        help="Leave out grasps that the points, or the table under the lowest, are in the way of.",
    ),
]

models_app = typer.Typer(help="Models that are shipped with dmfc.", no_args_is_help=True)


def predict(
    cloud: Cloud,
    model: Model = "",
    unit: Unit = "",
    up: Up = "",
    intrinsics: Intrinsics = "",
    mask: Mask = None,
    pose: Pose = None,
    table: Table = "refuse",
    drop_invalid: DropInvalid = False,
    check: Check = False,
    top: Annotated[int, typer.Option(help="Only so many, the most confident; 0: all.")] = 0,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write them as a grasp set (.parquet).")
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="Write a PNG of cloud and grasps.")] = None,
    as_json: AsJson = False,
) -> None:
    """Grasps of the objects in a point cloud or a depth image, the most confident first."""
    points, grasps = predicted(
        cloud, model, unit, up, intrinsics, mask, pose, table, drop_invalid, check
    )
    if top < 0:
        raise DmfcError(f"--top {top}: a number of grasps, or 0 for all")
    grasps = grasps[:top] if top else grasps
    if out is not None:
        grasps.save(out, object_id=f"cloud/{cloud.stem}")
    if picture is not None:
        from dmfc.visualization.prediction import grasp_picture

        grasp_picture(grasps, points, picture)
    if as_json:
        typer.echo(grasps.to_json())
        return
    show_rows(f"{cloud.name}: {len(grasps)} grasps by {grasps.model}", _rows(grasps), False)
    for path in (out, picture):
        if path is not None:
            stderr().print(f"written: {path}", markup=False, soft_wrap=True)


def predicted(
    cloud: Path,
    model: str,
    unit: str,
    up: str,
    intrinsics: str,
    mask: Path | None,
    pose: Path | None,
    table: str,
    drop_invalid: bool,
    check: bool = False,
) -> tuple[np.ndarray, RankedGrasps]:
    """The finite points [N, 3] of the file in metres, in the frame of the grasps; the grasps."""
    import numpy as np

    from dmfc.prediction.checks import UNITS
    from dmfc.prediction.planner import load

    points, natural = _points(cloud, intrinsics, mask)
    unit = unit or natural
    if pose is not None:
        from dmfc.geometry.transforms import apply
        from dmfc.prediction.depth_image import read_pose

        T_world_camera = read_pose(pose)
        points, unit = apply(T_world_camera, points * UNITS.get(unit, 1.0)), "m"
    elif intrinsics and not up:
        raise DmfcError(
            "a depth image does not say which way is up: give its camera's pose (--pose FILE), or "
            "the direction in the camera's frame (--up 0,-1,0 for a level camera)"
        )
    # One cloud: compiling loops would take longer than doing without.
    planner = load(model or None, compiled=False)
    grasps = planner(
        points,
        unit=unit,
        up=direction(up),
        table=table,
        drop_invalid=drop_invalid,
        check=check,
    )
    if not len(grasps):
        raise DmfcError(
            "the cloud's points, or the table under the lowest of them, are in the way of every "
            "grasp: go without --check, or look whether --up and the table are right"
        )
    finite = points[np.isfinite(points).all(1)]
    return finite * UNITS[unit], grasps


def _points(cloud: Path, intrinsics: str, mask: Path | None) -> tuple[np.ndarray, str]:
    """Points [N, 3] of the file, and the unit that they have by custom."""
    if not intrinsics:
        from dmfc.prediction.read_cloud import read_cloud

        if mask is not None:
            raise DmfcError("--mask belongs to a depth image: give --intrinsics fx,fy,cx,cy too")
        return read_cloud(cloud), "m"
    from dmfc.prediction.depth_image import Intrinsics, cloud_of_depth, depth_unit, read_image

    camera = Intrinsics.parse(intrinsics)
    depth = read_image(cloud)
    seen = cloud_of_depth(depth, camera, None if mask is None else read_image(mask))
    return seen, depth_unit(depth)


def direction(text: str) -> tuple[float, ...]:
    """'x,y,z' as numbers; upwards where there is no text."""
    from dmfc.prediction.planner import UP

    if not text:
        return UP
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise DmfcError(f"--up wants three numbers such as 0,0,1, not '{text}'") from None


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
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to make: dmfc/models/NAME.")],
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
