"""YAML as people read it: `012` is twelve or text, `yes` a word, a key given twice an error.

YAML 1.1, which PyYAML follows, reads `012` as ten, `yes` as true and `1:30` as ninety. Here only
true/false, decimal numbers and null differ from text (the core schema of YAML 1.2).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from dmfc.errors import DmfcError, first_line

DEEPEST = 20
"""Most levels of lists and mappings inside each other."""
MOST = 50_000
"""Most values of one text, those that an alias repeats counted again."""


class _PlainLoader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2, without repeated keys, and with bounds."""

    depth = 0
    count = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self.depth += 1
        self.count += 1
        if self.depth > DEEPEST:
            raise DmfcError(f"more than {DEEPEST} levels of nesting")
        _check_count(self.count)
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None:
            _check_count(_size(node, {}))
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: dict[str, int] = {}
        for key_node, _ in node.value:
            key, line = str(key_node.value), key_node.start_mark.line + 1
            if key in seen:
                raise DmfcError(f"'{key}' is given twice, on lines {seen[key]} and {line}")
            seen[key] = line
        return super().construct_mapping(node, deep)


def _check_count(count: int) -> None:
    if count > MOST:
        raise DmfcError(f"more than {MOST:,} values")


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """Number of values in `node`. Raises DmfcError where it contains itself."""
    if known.get(id(node)) == 0:
        raise DmfcError("an alias is inside the value that it repeats")
    if id(node) not in known:
        known[id(node)] = 0  # until it is known
        children: list[yaml.Node] = []
        if isinstance(node, yaml.SequenceNode):
            children = node.value
        elif isinstance(node, yaml.MappingNode):
            children = [child for pair in node.value for child in pair]
        known[id(node)] = 1 + sum(_size(child, known) for child in children)
    return known[id(node)]


_PlainLoader.yaml_implicit_resolvers = {}
for _tag, _pattern, _first in [
    ("tag:yaml.org,2002:bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("tag:yaml.org,2002:int", r"[-+]?(0|[1-9][0-9_]*)", "-+0123456789"),
    (
        "tag:yaml.org,2002:float",
        r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[-+]?[0-9]+[eE][-+]?[0-9]+",
        "-+.0123456789",
    ),
    ("tag:yaml.org,2002:null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
]:
    _PlainLoader.add_implicit_resolver(_tag, re.compile(rf"^(?:{_pattern})$"), list(_first))


def parse_yaml(text: str, where: str) -> Any:
    """The value of the YAML in `text`; errors are one line that names `where` it came from."""
    try:
        return yaml.load(text, Loader=_PlainLoader)
    except DmfcError as error:
        raise DmfcError(f"{where}: {error}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" on line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or first_line(error)
        raise DmfcError(f"{where}: not valid YAML{line}: {problem}") from error
    except (ValueError, TypeError, AttributeError) as error:  # of a value with a tag: !!int abc
        raise DmfcError(f"{where}: not valid YAML: {' '.join(str(error).split())}") from error


def read_yaml(path: Path) -> Any:
    """The value of the YAML file at `path`."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DmfcError(f"cannot read '{path}': {reason}") from error
    return parse_yaml(text, str(path))
