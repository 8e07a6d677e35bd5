"""Writes the generated pages of docs/reference: `python -m dmfc.cli.reference docs/reference`."""

from __future__ import annotations

import sys
from pathlib import Path

import typer


def cli_page() -> str:
    """The page cli.md: every command with its arguments and options, from the Typer app."""
    from typer.cli import get_docs_for_click

    from dmfc.cli.main import app

    command = typer.main.get_command(app)
    context = typer.Context(command, info_name="dmfc")
    text = get_docs_for_click(obj=command, ctx=context, name="dmfc", title="Commands")
    head, _, rest = text.partition("\n")
    note = "<!-- Written by `make reference` from dmfc/cli: do not edit. -->"
    return f"{head}\n\n{note}\n{rest.rstrip()}\n"


def pages() -> dict[str, str]:
    """The generated pages by their names."""
    from dmfc.config.reference import settings_page

    return {"cli.md": cli_page(), "settings.md": settings_page()}


def main(folder: Path) -> None:
    """Write the pages into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
