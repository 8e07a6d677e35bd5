"""Wrong command lines of every verb and kind of file: one line, status 1 or 2, nothing computed."""

from __future__ import annotations

import shlex
import signal

import pytest
import typer

from dmfc.cli.main import app
from dmfc.engine.engine import unfinished
from dmfc.engine.pools import LocalPool
from dmfc.engine.worker import Outcome
from dmfc.experiment.session import Session, require
from tests.support.malformed import lines, write_files

PATIENCE = 30
"""Seconds that a wrong line may take until it is told."""


def verbs(command=None, path=()):
    """(words, command) of every verb of the program."""
    command = command or typer.main.get_command(app)
    for name, sub in getattr(command, "commands", {}).items():
        yield from verbs(sub, (*path, name))
    if path and not hasattr(command, "commands"):
        yield path, command


def every_verb() -> list[str]:
    """Mistakes that can be made with any verb, as it declares its options."""
    found = []
    for path, command in verbs():
        words = " ".join(path)
        options = {option for param in command.params for option in param.opts}
        found.append(f"{words} --nonsense")
        required = [p for p in command.params if p.required]
        arguments = " ".join("x" for p in required if p.param_type_name == "argument")
        arguments += "".join(f" {p.opts[-1]} y" for p in required if p.opts[0].startswith("-"))
        if required:
            found.append(words)
        if "--store" in options:
            found.append(f"{words} {arguments} --store plain_file")
        if "--set" in options:
            found.append(f"{words} {arguments} --set training.sead=1")
            found.append(f"{words} {arguments} --preset nowhere")
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files, and a store with the hand and the object that imports of grasps need."""
    folder = tmp_path_factory.mktemp("malformed")
    write_files(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("dmfc.engine.engine.RayPool", LocalPool)
        session = Session.open("quick", [], folder / "store")
        stages = [
            session.builder.hand(session.config),
            *session.builder.selected_objects(session.config, ["procedural:1"]),
        ]
        require(session.make(stages), stages)
    return folder


def begun(targets, ledger, *_, **__):
    """In place of the stages: nothing is to be made for a wrong line but what is there."""
    missing = unfinished(targets, ledger)
    assert not missing, f"{len(missing)} stages were begun"
    return {stage.address: Outcome("done") for stage in targets}


@pytest.fixture
def patience():
    """Ends a line that hangs, by an error that is not expected."""

    def hung(*_):
        raise TimeoutError(f"still running after {PATIENCE} s")

    before = signal.signal(signal.SIGALRM, hung)
    signal.alarm(PATIENCE)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


LINES = list(dict.fromkeys([*every_verb(), *lines()]))


def test_the_table_is_long_and_names_every_verb():
    assert len(LINES) >= 300
    for path, _ in verbs():
        named = [line for line in LINES if line.split()[: len(path)] == list(path)]
        assert named, path


@pytest.mark.parametrize("line", LINES)
def test_a_wrong_line_is_told_on_one_line(dmfc, folder, monkeypatch, patience, line):
    monkeypatch.chdir(folder)
    monkeypatch.delenv("DMFC_STORE", raising=False)
    if line.startswith(ROWS):
        monkeypatch.setattr("dmfc.engine.engine.RayPool", LocalPool)
    else:
        monkeypatch.setattr("dmfc.engine.engine.run_stages", begun)
    before = set(folder.iterdir())
    status, out, err = dmfc(*shlex.split(line))
    assert status in (1, 2), f"accepted: {out}"
    assert "error: unexpected" not in err
    assert "Traceback" not in err
    if line.startswith(ROWS):
        assert err.startswith("error: ") or "1 of 1 objects failed" in err
    elif line not in HELP:
        assert err.startswith("error: ")
        assert err.count("\n") == 1, err
    made = set(folder.iterdir()) - before
    assert not {path.name for path in made} - {"store"}


ROWS = ("objects prepare folder:",)
"""An object that fails is a row with its reason on standard output."""
HELP = {path for path in ("", "sweep", "tracking", "assets")}
"""Lines that ask for nothing: the help says what there is."""
