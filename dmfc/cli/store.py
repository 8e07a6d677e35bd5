"""The verbs around finished stages: list, show, verify, repair, prune, export, import."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import STORE, AsJson, Store, number
from dmfc.cli.outputs import file_to_write
from dmfc.errors import DmfcError
from dmfc.experiment.console import answer, show_rows

if TYPE_CHECKING:
    from dmfc.engine.ledger import Ledger

store_app = typer.Typer(
    name="store", help="Finished stages: list, check, and move them.", no_args_is_help=True
)

Kind = Annotated[str | None, typer.Argument(help="A kind of stage; default: a line per kind.")]
Sweeps = Annotated[
    list[str] | None, typer.Argument(help="Ids of sweeps, or their names (the latest of each).")
]


@store_app.command("list")
def list_(kind: Kind = None, store: Store = STORE, as_json: AsJson = False) -> None:
    """Count the finished stages by kind, or list those of one kind."""
    from dmfc.engine.ledger import Ledger
    from dmfc.engine.store import entries, known_kind

    ledger = Ledger(store)
    found = list(entries(ledger, known_kind(ledger, kind) if kind else "*"))
    if kind:
        rows = [
            {
                "address": entry.address,
                "name": entry.name,
                "made": entry.made,
                "seconds": entry.seconds,
                "kB": round(entry.bytes / 1e3, 1),
                "failure": entry.failure,
            }
            for entry in found
        ]
        show_rows(f"finished stages of kind {kind}", rows, as_json)
        return
    rows = []
    for name in sorted({entry.address.partition("/")[0] for entry in found}):
        of_kind = [entry for entry in found if entry.address.startswith(f"{name}/")]
        rows.append(
            {
                "kind": name,
                "stages": len(of_kind),
                "failed": sum(entry.failure is not None for entry in of_kind),
                "hours": round(sum(entry.seconds for entry in of_kind) / 3600, 3),
                "MB": round(sum(entry.bytes for entry in of_kind) / 1e6, 2),
            }
        )
    show_rows("finished stages", rows, as_json)


@store_app.command("show")
def show(
    stage: Annotated[str, typer.Argument(help="kind/key, or the first digits of a key.")],
    store: Store = STORE,
) -> None:
    """Print the record of one stage: settings, inputs, where and when it was made, its files."""
    from dmfc.engine.ledger import Ledger
    from dmfc.engine.store import find

    ledger = Ledger(store)
    address = find(ledger, stage)
    answer({"folder": str(ledger.folder(address)), **ledger.record(address)})


@store_app.command("verify")
def verify(kind: Kind = None, store: Store = STORE, as_json: AsJson = False) -> None:
    """Compare every file with the digest that was kept when its stage was finished.

    Goes on to the end whatever is damaged; status 1 if anything is.
    """
    from dmfc.engine.ledger import Ledger
    from dmfc.engine.store import known_kind
    from dmfc.engine.store import verify as check

    ledger = Ledger(store)
    checked = list(check(ledger, ledger.present(known_kind(ledger, kind) if kind else "*")))
    if not checked:
        raise DmfcError(f"no finished stages in the store '{ledger.store}' (see --store)")
    bad = [{"stage": address, "wrong": "; ".join(wrong)} for address, wrong in checked if wrong]
    if as_json:
        answer({"stages": len(checked), "damaged": bad})
    else:
        if bad:
            show_rows("damaged stages", bad, as_json=False)
        typer.echo(f"{len(checked)} stages checked, {len(bad)} damaged")
        if bad:
            typer.echo("`dmfc store repair` sets them aside, so that they are made again")
    if bad:
        raise typer.Exit(1)


@store_app.command("repair")
def repair(kind: Kind = None, store: Store = STORE, as_json: AsJson = False) -> None:
    """Set damaged stages aside (STORE/damaged), so that they are made again; say how.

    What else lies in the store stays: the lines that are printed make the damaged stages alone.
    """
    from dmfc.engine.ledger import Ledger
    from dmfc.engine.store import known_kind
    from dmfc.engine.store import repair as set_aside
    from dmfc.report.collect import sweeps_using

    ledger = Ledger(store)
    found = list(set_aside(ledger, list(ledger.present(known_kind(ledger, kind) if kind else "*"))))
    rows = [
        {"stage": one.address, "wrong": "; ".join(one.wrong), "now at": one.aside or "in use"}
        for one in found
    ]
    lines = sweeps_using(ledger, [one.address for one in found])
    if as_json:
        answer({"damaged": rows, "again": lines})
        return
    show_rows("damaged stages", rows, as_json=False) if rows else typer.echo("nothing is damaged")
    if found and not lines:
        typer.echo("the line that made them makes them again")
    for line in lines:
        typer.echo(f"make them again with: {line}")


@store_app.command("prune")
def prune(
    keep: Annotated[
        list[str] | None,
        typer.Option("--keep", help="Sweeps to keep; repeatable; default: all in the store."),
    ] = None,
    older_than: Annotated[
        float,
        typer.Option(help="Only stages older than so many days.", callback=number(least=0)),
    ] = 0.0,
    failed: Annotated[
        bool, typer.Option("--failed", help="Kept failures instead, to try them again.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Remove them; otherwise only list.")] = False,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Remove stages that no sweep refers to."""
    from dmfc.engine import store as stored
    from dmfc.engine.ledger import Ledger
    from dmfc.report.collect import list_sweeps, resolve_sweeps

    ledger = Ledger(store)
    kept = resolve_sweeps(ledger, keep) if keep else list_sweeps(ledger)
    needed = [] if failed else _targets(ledger, kept)
    doomed = stored.prunable(ledger, needed, older_than, failed)
    if yes:
        doomed = stored.prune(ledger, doomed)
    rows = [{"stage": e.address, "name": e.name, "kB": round(e.bytes / 1e3, 1)} for e in doomed]
    show_rows("removed" if yes else "would be removed (add --yes)", rows, as_json)


@store_app.command("export")
def export(
    archive: Annotated[
        str,
        typer.Argument(
            help="File to write, .tar or .tar.gz: a path or a URL (s3://...).",
            callback=file_to_write(),
        ),
    ],
    sweeps: Sweeps = None,
    store: Store = STORE,
) -> None:
    """Write sweeps and all stages that they are made of into one archive; default: all sweeps."""
    from dmfc.engine.archive import export_to
    from dmfc.engine.ledger import Ledger
    from dmfc.engine.store import referred
    from dmfc.report.collect import list_sweeps, resolve_sweeps

    ledger = Ledger(store)
    chosen = resolve_sweeps(ledger, sweeps) if sweeps else list_sweeps(ledger)
    count = export_to(ledger, referred(ledger, _targets(ledger, chosen)), chosen, archive)
    typer.echo(f"{archive}: {count} stages of {', '.join(chosen)}")


def _targets(ledger: Ledger, sweep_ids: Sequence[str]) -> list[str]:
    """The stages that the cells of those sweeps name."""
    from dmfc.report.collect import read_sweep

    return [address for sweep_id in sweep_ids for address in read_sweep(ledger, sweep_id).targets]


@store_app.command("import")
def import_(
    archive: Annotated[
        str, typer.Argument(help="What `dmfc store export` wrote: a path or a URL.")
    ],
    store: Store = STORE,
) -> None:
    """Take in an archive: every file and key is checked before anything is added."""
    from dmfc.engine.archive import fetched, take_in
    from dmfc.engine.ledger import Ledger

    ledger = Ledger(store)
    with fetched(ledger, archive) as local:
        brought = take_in(ledger, local)
    typer.echo(
        f"{len(brought.stages)} stages added, {len(brought.known)} were there, "
        f"sweeps: {', '.join(brought.sweeps)}"
    )
