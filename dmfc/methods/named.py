"""The benchmark with a name: its test sets, known by digest, and the version of its protocol."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources

import yaml

from dmfc.config.execution import ExecutionConfig
from dmfc.config.protocol import executed
from dmfc.config.schema import Config
from dmfc.engine.stage import plain, without
from dmfc.errors import DmfcError, unknown_name
from dmfc.files.digest import json_digest, text_digest
from dmfc.scenes.publish.digests import PARTS, set_digest
from dmfc.scenes.scene_set import Scene

SELECTION = (
    *("protocol", "changes", "score", "confidence_unit", "min_confidence", "most_confident"),
    *("cloud_check", "cloud_margin", "seed", "random_offset"),
)
"""Settings of execution that say which of the proposed grasps are executed: an entry's own."""
LENGTH = 16
"""Hexadecimal digits of a digest."""


@dataclass(frozen=True)
class TestSet:
    """Scenes of the benchmark."""

    title: str
    settings: tuple[str, ...]
    """key=value, over those of the benchmark."""
    scenes: str
    """Digest of layouts and clouds."""


@dataclass(frozen=True)
class Benchmark:
    """A version of the benchmark."""

    name: str
    version: int
    preset: str
    settings: tuple[str, ...]
    """key=value, over the preset."""
    protocol: str
    """Digest of how grasps are executed."""
    sets: Mapping[str, TestSet]

    def overrides(self, name: str, own: Iterable[str]) -> list[str]:
        """Settings of an entry on the set `name`; `own`: its own, key=value.

        Raises DmfcError for an unknown set, and for a setting that is not an entry's own.
        """
        if name not in self.sets:
            raise unknown_name(f"test set of {self.name}", name, self.sets)
        own = list(own)
        for text in own:
            key = text.partition("=")[0].strip()
            group, _, last = key.partition(".")
            if group != "outcome" and not (group == "execution" and last in SELECTION[2:]):
                raise DmfcError(
                    f"--set {key}: the benchmark fixes it; an entry may set outcome.* and, of "
                    f"execution.*, {', '.join(SELECTION[2:])}"
                )
        return [*self.settings, *self.sets[name].settings, *own]

    def require(self, name: str, config: Config, scenes: Iterable[Scene]) -> None:
        """Raise DmfcError where scenes or protocol are not those of this version."""
        if protocol_digest(config) != self.protocol:
            raise DmfcError(
                f"the protocol is not that of {self.name} version {self.version}: another version "
                "of dmfc executes grasps otherwise"
            )
        found = scenes_digest(set_digest(scenes))
        if found != self.sets[name].scenes:
            raise DmfcError(
                f"the scenes ({found}) are not those of {self.name} version {self.version}, set "
                f"'{name}' ({self.sets[name].scenes}): `dmfc scenes freeze --check` says which"
            )


def load_benchmark() -> Benchmark:
    """The benchmark of this version of dmfc."""
    text = (resources.files("dmfc.methods") / "benchmark.yaml").read_text(encoding="utf-8")
    values = yaml.safe_load(text)
    sets = {
        name: TestSet(item["title"], tuple(item["settings"]), item["scenes"])
        for name, item in values.pop("sets").items()
    }
    return Benchmark(**{**values, "settings": tuple(values["settings"])}, sets=sets)


def scenes_digest(parts: Mapping[str, str]) -> str:
    """Of what `set_digest` gives, or a record of test sets holds, of a set."""
    return text_digest("\n".join(parts[part] for part in PARTS))[:LENGTH]


def protocol_digest(config: Config) -> str:
    """Of hand, physics, closing and execution, without what an entry may choose."""
    under = executed(config)
    execution: ExecutionConfig = without(under.execution, *SELECTION)
    parts = {
        "hand": under.hand,
        "physics": under.physics,
        "closing": under.closing,
        "execution": execution,
    }
    return json_digest(plain(parts))[:LENGTH]
