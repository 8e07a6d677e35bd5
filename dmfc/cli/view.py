"""The verb that shows grasps in a browser: view."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import PRESET, STORE, Overrides, Port, Preset, Store
from dmfc.cli.outputs import file_to_write, made
from dmfc.cli.predict import (
    Check,
    DepthScale,
    DropInvalid,
    Intrinsics,
    Mask,
    Model,
    Pose,
    Score,
    Table,
    Unit,
    Up,
)
from dmfc.errors import DmfcError

if TYPE_CHECKING:
    from dmfc.config.presets import Presets
    from dmfc.prediction.query import CloudQuery
    from dmfc.view.data import View


def view(
    source: Annotated[
        str,
        typer.Argument(
            help="A cloud or depth image, as for dmfc predict; with --scene or --trial a model or "
            "row, as for dmfc evaluate."
        ),
    ],
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
    scene: Annotated[
        int | None, typer.Option(help="A test scene, with the grasps that SOURCE proposes.")
    ] = None,
    trial: Annotated[
        str, typer.Option(help="scene:trial of the evaluation of SOURCE to play.")
    ] = "",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    export: Annotated[
        Path | None,
        typer.Option(
            help="Write the page to this file, without serving it.",
            callback=file_to_write(".html", ".htm"),
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; any other shows the page to other machines.")
    ] = "127.0.0.1",
    port: Port = 0,
    open_page: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
) -> None:
    """Show a cloud or scene, all its grasps and their hands in the browser; play a trial."""
    from dmfc.prediction.query import CloudQuery
    from dmfc.view.page import make_page

    if trial and scene is not None:
        raise DmfcError("--trial names its scene itself: leave --scene out")
    query = CloudQuery(
        file=Path(source),
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
    )
    if trial or scene is not None:
        if query != CloudQuery(file=query.file):
            raise DmfcError("--scene and --trial show no cloud of a file: leave its options out")
        shown = _of_evaluation(source, scene, trial, preset, overrides or [], store)
    else:
        if overrides or preset != PRESET:
            raise DmfcError("--preset and --set belong to --scene or --trial, not to a cloud")
        shown = _of_cloud(query)
    page = make_page(shown).encode()
    if export is None:
        _serve(page, host, port, open_page)
        return
    try:
        made(export).write_bytes(page)
    except OSError as error:
        raise DmfcError(f"{export} cannot be written: {error.strerror} (--export)") from error
    typer.echo(f"written: {export} ({len(page) / 1e6:.1f} MB)")


def _of_cloud(query: CloudQuery) -> View:
    points, grasps = query.answer()

    from dmfc.config.hand import HandConfig
    from dmfc.hand.build import build_hand
    from dmfc.view.data import cloud_view

    # Meshes and joints are all that a picture needs of the hand: coarse grids are quick to make.
    hand = build_hand(HandConfig(name=grasps.hand, link_sdf_spacing=0.02))
    return cloud_view(points, grasps, hand, query.file.name, query.direction)


def _of_evaluation(
    source: str, scene: int | None, trial: str, preset: Presets, overrides: list[str], store: Path
) -> View:
    from dmfc.experiment.evaluation import evaluated
    from dmfc.pipeline.replay import find_scene, parse_trial
    from dmfc.view.scene import evaluated_view

    which = None
    if trial:
        scene, which = parse_trial(trial, "--trial")
    assert scene is not None
    session, stages = evaluated(source, preset, overrides, store, (scene, which or 0))
    option = "--trial scene:trial" if trial else "--scene"
    _, evaluation, found = find_scene(session.ledger, stages, scene, option)
    return evaluated_view(evaluation, found, which, Path(source).name)


def _serve(page: bytes, host: str, port: int, open_page: bool) -> None:
    """Until Ctrl-C."""
    import webbrowser

    from dmfc.view.serve import address, page_server

    with page_server(page, host, port) as server:
        typer.echo(f"view: {address(server)}")
        typer.echo("Ctrl-C ends it")
        if open_page:
            webbrowser.open(address(server))
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            typer.echo("ended")
