"""The verb that shows grasps in a browser: view."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import PRESET, STORE, Overrides, Preset, Store
from dmfc.cli.predict import DropInvalid, Intrinsics, Mask, Model, Pose, Table, Unit, Up
from dmfc.errors import DmfcError

if TYPE_CHECKING:
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
    up: Up = "",
    intrinsics: Intrinsics = "",
    mask: Mask = None,
    pose: Pose = None,
    table: Table = "refuse",
    drop_invalid: DropInvalid = False,
    scene: Annotated[
        int | None, typer.Option(help="A test scene, with what SOURCE proposes in it.")
    ] = None,
    trial: Annotated[
        str, typer.Option(help="scene:trial of the evaluation of SOURCE, to be played.")
    ] = "",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    export: Annotated[
        Path | None, typer.Option(help="Write the page to this file, and serve nothing.")
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; others than this let other machines see it.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="0 takes a free one.")] = 0,
    open_page: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
) -> None:
    """Show a cloud or scene, all its grasps and their hands in the browser; play a trial."""
    from dmfc.view.page import make_page

    if trial and scene is not None:
        raise DmfcError("--trial names its scene itself: leave --scene out")
    if trial or scene is not None:
        shown = _of_evaluation(source, scene, trial, preset, overrides or [], store)
    else:
        depth = (intrinsics, mask, pose)
        shown = _of_cloud(Path(source), model, unit, up, depth, table, drop_invalid)
    page = make_page(shown).encode()
    if export is None:
        _serve(page, host, port, open_page)
        return
    try:
        export.parent.mkdir(parents=True, exist_ok=True)
        export.write_bytes(page)
    except OSError as error:
        raise DmfcError(f"{export} cannot be written: {error.strerror} (--export)") from error
    typer.echo(f"written: {export} ({len(page) / 1e6:.1f} MB)")


def _of_cloud(
    cloud: Path,
    model: str,
    unit: str,
    up: str,
    depth: tuple[str, Path | None, Path | None],
    table: str,
    drop_invalid: bool,
) -> View:
    from dmfc.cli.predict import direction, predicted

    points, grasps = predicted(cloud, model, unit, up, *depth, table, drop_invalid)

    from dmfc.config.hand import HandConfig
    from dmfc.hand.build import build_hand
    from dmfc.view.data import cloud_view

    # Meshes and joints are all that a picture needs of the hand: coarse grids are quick to make.
    hand = build_hand(HandConfig(name=grasps.hand, link_sdf_spacing=0.02))
    return cloud_view(points, grasps, hand, cloud.name, direction(up))


def _of_evaluation(
    source: str, scene: int | None, trial: str, preset: str, overrides: list[str], store: Path
) -> View:
    from dmfc.experiment.evaluation import evaluated
    from dmfc.pipeline.replay import find_scene, parse_trial
    from dmfc.view.scene import evaluated_view

    which = None
    if trial:
        scene, which = parse_trial(trial, "--trial")
    assert scene is not None
    session, stages = evaluated(source, preset, overrides, store)
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
