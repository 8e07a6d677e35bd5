"""Where objects come from, and the selectors that name them.

A selector is one of

    ycb                     all objects of a source
    random:485              the first 485, in the source's fixed order
    ycb:mug, ycb/mug        one object
    ycb:test                a named subset: the 16 test objects of the paper
    procedural:20?from=100  twenty generated objects, beginning with number 100
    procedural:20?from=100&size=large   the same, scaled to what a hand just spans
    folder:/path?unit=mm    the user's own mesh file or folder of mesh files (m, cm, mm, inch)
    folder:/path?scale=0.06 their meshes times a number (after the unit), such as normalised ones
    rings.py:rings          what a function in the user's file lists (`dmfc.objects.custom`)
    rings.py:rings/small    one of them

Listing reads no mesh, but downloads the pack of a source that needs one.
"""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from dmfc.assets import get_pack, pull
from dmfc.errors import DmfcError, unknown_name
from dmfc.objects.source import ObjectSource

if TYPE_CHECKING:
    pass

YCB_TEST = (
    "master_chef_can",
    "mustard_bottle",
    "potted_meat_can",
    "banana",
    "bleach_cleanser",
    "mug",
    "skillet_lid",
    "wood_block",
    "mini_soccer_ball",
    "softball",
    "baseball",
    "tennis_ball",
    "c_cups",
    "e_cups",
    "f_cups",
    "i_cups",
)
"""The test objects of the paper, in its order."""

RANDOM_SCALE = 0.015
"""Of the `random` pack's files, as its URDFs give it."""
_NOT_HOUSEHOLD = ("hand", "headphones")
"""Folders of the household pack that hold no object to grasp, or more than a hand can hold."""


def list_objects(selectors: Iterable[str]) -> list[ObjectSource]:
    """The objects that the selectors name, in their order, each once.

    Raises DmfcError for an unknown source or name, for a selector that names nothing, and if
    nothing is named at all.
    """
    found: dict[str, ObjectSource] = {}
    for selector in selectors:
        for source in _select(selector):
            known = found.setdefault(source.id, source)
            if known.digest != source.digest:
                raise DmfcError(
                    f"two different objects have the id '{source.id}' "
                    f"({known.selector} and {source.selector}); rename one of the files"
                )
    if not found:
        raise DmfcError("the list of objects is empty (settings objects.train, objects.test)")
    return list(found.values())


def find_object(selector: str) -> ObjectSource:
    """The one object of a selector or id; DmfcError if it names none or several."""
    found = list_objects([selector])
    if len(found) > 1:
        raise DmfcError(f"'{selector}' names {len(found)} objects where one is wanted")
    return found[0]


def _select(selector: str) -> list[ObjectSource]:
    head, colon, rest = selector.partition(":")
    if not colon and "/" in selector and not head.endswith(".py"):
        head, _, rest = selector.partition("/")
        by_name = True
    else:
        by_name = not re.fullmatch(r"\d+", rest.partition("?")[0])
    if head == "folder":
        from dmfc.objects.folder import folder_sources

        return folder_sources(rest, selector)
    if head == "procedural":
        return _procedural(rest, selector, by_name)
    if head.endswith(".py"):
        from dmfc.objects.custom import custom_sources

        return custom_sources(head, rest, selector)
    makers = {"ycb": _ycb, "household": _household, "random": _random}
    if head not in makers:
        raise unknown_name("object source", head, [*makers, "procedural", "folder", "FILE.py"])
    everything = makers[head]()
    if not rest:
        return everything
    if not by_name:
        return everything[: _count(rest, selector, len(everything))]
    if head == "ycb" and rest == "test":
        named = {source.id: source for source in everything}
        return [named[f"ycb/{name}"] for name in YCB_TEST]
    for source in everything:
        if source.id == f"{head}/{rest}":
            return [source]
    names = [source.id.split("/", 1)[1] for source in everything]
    raise unknown_name(f"object of source '{head}'", rest, names)


def _count(text: str, selector: str, limit: int) -> int:
    count = int(text)
    if count == 0:
        raise DmfcError(f"object selector '{selector}' selects no object")
    if count > limit:
        raise DmfcError(f"object selector '{selector}': the source has only {limit} objects")
    return count


def _ycb() -> list[ObjectSource]:
    folder = pull("ycb")
    masses = _data("ycb_masses.yaml")
    files = sorted(folder.glob("*.stl"))
    # Files are named "025_mug.stl" and "065-c_cups.stl".
    named = {re.sub(r"^\d+[-_]", "", path.stem): path for path in files}
    return [_from_pack("ycb", name, [path], masses.get(name)) for name, path in named.items()]


def _household() -> list[ObjectSource]:
    sources = []
    for folder in sorted(path for path in pull("household").iterdir() if path.is_dir()):
        files = sorted(p for p in folder.glob("*.stl") if not p.name.startswith("contact"))
        if files and folder.name not in _NOT_HOUSEHOLD:
            sources.append(_from_pack("household", folder.name, files))
    return sources


def _random() -> list[ObjectSource]:
    folder = pull("random")
    unusable = set(_data("random_unusable.yaml") or [])
    names = sorted(path.stem for path in folder.glob("*/*.obj"))
    return [
        _from_pack("random", name, [folder / name / f"{name}.obj"], None, RANDOM_SCALE)
        for name in names
        if name not in unusable
    ]


def _from_pack(
    pack_name: str, name: str, paths: list[Path], mass: float | None = None, scale: float = 1.0
) -> ObjectSource:
    from dmfc.objects.mesh_file import load_mesh

    pack = get_pack(pack_name)
    content = f"{pack.sha256} {pack.subfolder} {name} {scale} {mass}"
    return ObjectSource(
        id=f"{pack_name}/{name}",
        licence=pack.licence,
        mass=mass,
        digest=hashlib.sha256(content.encode()).hexdigest(),
        selector=f"{pack_name}/{name}",
        loader=functools.partial(load_mesh, paths, scale),
    )


def _procedural(rest: str, selector: str, by_name: bool) -> list[ObjectSource]:
    from dmfc.objects import procedural

    text, _, option = rest.partition("?")
    if by_name:
        if not text:
            raise DmfcError("object selector 'procedural' needs a number, as in 'procedural:20'")
        numbers, large = [procedural.number_of(text)], procedural.is_large(text)
    else:
        match = re.fullmatch(r"(?:from=(\d+))?(?:(?:^|&)size=(large))?", option)
        if match is None:
            raise DmfcError(
                f"object selector '{selector}': expected '?from=NUMBER' or '?size=large' at the "
                "end, or both with & between"
            )
        first, large = int(match.group(1) or 0), bool(match.group(2))
        numbers = list(range(first, first + _count(text, selector, 100_000)))
    sources = []
    for number in numbers:
        name = procedural.name_of(number, large)
        content = f"procedural {procedural.VERSION} {name}"
        sources.append(
            ObjectSource(
                id=f"procedural/{name}",
                licence="Apache-2.0",
                mass=None,
                digest=hashlib.sha256(content.encode()).hexdigest(),
                selector=f"procedural/{name}",
                loader=functools.partial(procedural.generate, number, large),
            )
        )
    return sources


@functools.cache
def _data(name: str):  # type: ignore[no-untyped-def]
    """A YAML file of `dmfc/objects/data`."""
    return yaml.safe_load((resources.files("dmfc.objects") / "data" / name).read_text("utf-8"))
