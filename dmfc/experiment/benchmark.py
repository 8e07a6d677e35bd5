"""Other methods on our test scenes: writes the scenes as files, and reads grasps from files."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.errors import DmfcError
from dmfc.experiment.session import Session, require
from dmfc.pipeline.artifacts import load_hand, load_scenes

if TYPE_CHECKING:
    from dmfc.config.presets import Presets
    from dmfc.engine.stage import Stage
    from dmfc.methods.ask import Answered
    from dmfc.methods.observation import Observation
    from dmfc.scenes.scene_set import SceneSet

ROW = "method"
"""What the row of a method is called where nobody names it."""


def observations(session: Session) -> list[Observation]:
    """What is seen of every test scene, made where it is missing."""
    from dmfc.methods.observation import observe

    hand_stage = session.builder.hand(session.config)
    require(session.make([hand_stage]), [hand_stage])
    hand = load_hand(session.ledger.verified(hand_stage.address), session.config.closing)
    scenes = test_scenes(session)
    manifest = scenes.manifests[0]
    return [observe(scene, hand, manifest) for scene in scenes]


def test_scenes(session: Session) -> SceneSet:
    """The test scenes of a session, made where they are missing."""
    shards = _test_shards(session)
    require(session.make(shards), shards)
    return load_scenes([session.ledger.verified(shard.address) for shard in shards])


def _test_shards(session: Session) -> list[Stage]:
    """The shards that every row but the planner's is tested on."""
    found = []
    for stage in session.builder.cell(session.config, "random", "random").evaluations:
        shard = stage.inputs["scenes"]
        assert not isinstance(shard, tuple)
        found.append(shard)
    return found


def export_scenes(session: Session, folder: Path, options: Sequence[str]) -> list[Path]:
    """Write the test scenes, the hand and a README; `options` make the same scenes again."""
    from dmfc.methods.files import write_hand, write_observation, write_readme

    seen = observations(session)
    folder.mkdir(parents=True, exist_ok=True)
    written = [write_observation(one, folder) for one in seen]
    write_hand(seen[0].hand, folder)
    title = f"{len(seen)} scenes, kind {session.config.scenes.test.kind}"
    score = shlex.join(["dmfc", "benchmark", "score", "my_grasps", *options])
    write_readme(folder, title, score)
    return written


def score_files(
    paths: Sequence[Path], preset: Presets, overrides: Sequence[str], store: Path, name: str
) -> tuple[Session, tuple[Stage, ...]]:
    """The finished evaluations of grasps in files. Raises DmfcError on a file that is refused."""
    from dmfc.methods.files import read_answers

    session = Session.open(preset, overrides, store)
    answers = read_answers(paths, observations(session))
    return session, scored(session, answers, name)


def score_function(
    predict: Callable[[Observation], Any],
    preset: Presets,
    overrides: Sequence[str],
    store: Path,
    name: str,
) -> tuple[Session, tuple[Stage, ...]]:
    """The finished evaluations of what a function of this process answers.

    Raises DmfcError, with the first reason, where it fails in every scene.
    """
    from dmfc.methods.ask import ask

    session = Session.open(preset, overrides, store)
    answers = {seen.id: ask(predict, seen) for seen in observations(session)}
    failures = [found.failure for found in answers.values() if found.failure]
    if len(failures) == len(answers):
        raise DmfcError(f"{name} fails in every scene: {failures[0]}")
    return session, scored(session, answers, name)


def scored(session: Session, answers: Mapping[str, Answered], name: str) -> tuple[Stage, ...]:
    """The finished evaluations of answers, which the store keeps."""
    from dmfc.methods.kept import keep_answers

    session.ledger.prepare()
    folder = keep_answers(answers, session.ledger.store.absolute())
    stages = session.builder.cell(session.config, ROW, name, method=folder).evaluations
    require(session.make(stages), stages)
    return stages
