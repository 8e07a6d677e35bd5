"""Objects that a custom function makes: the selector `file.py:function`.

def rings() -> list[CustomObject]: ...
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dmfc.config.custom_function import custom_function
from dmfc.errors import DmfcError, unknown_name
from dmfc.files.digest import text_digest
from dmfc.objects.source import ObjectSource, as_name

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class CustomObject:
    """One object of a custom source."""

    name: str
    """Letters, marks and digits of any script and _ . -, given once; the id is own/<name>."""
    make: Callable[[], trimesh.Trimesh]
    """Its mesh, in metres. Called when it is prepared, not when it is listed."""
    mass: float | None = None
    """kg where it is known, else the setting objects.prepare.density gives it."""
    licence: str = "user's own"
    digest: str = ""
    """Changes when `make` reads something else than before; that the file changed is seen."""


def custom_sources(file: str, rest: str, selector: str) -> list[ObjectSource]:
    """The objects of a selector 'file:rest', `rest` being 'function' or 'function/name'.

    Raises DmfcError where there is no such function or object, or it lists something else.
    """
    name, _, wanted = rest.partition("/")
    where = f"object selector '{selector}'"
    function = custom_function(f"{file}:{name}", where)
    listed = function.load()()
    if not isinstance(listed, list) or not all(isinstance(item, CustomObject) for item in listed):
        raise DmfcError(f"{where}: {name}() must give a list of CustomObject")
    names = [item.name for item in listed]
    for item_name in names:
        if not item_name or as_name(item_name) != item_name or names.count(item_name) > 1:
            raise DmfcError(f"{where}: '{item_name}' is not a valid name, or is given twice")
    if wanted and wanted not in names:
        raise unknown_name(f"object of '{file}:{name}'", wanted, names)
    return [
        ObjectSource(
            id=f"own/{item.name}",
            licence=item.licence,
            mass=item.mass,
            digest=text_digest(f"{function.digest} {name} {item.name} {item.mass} {item.digest}"),
            selector=f"{function.file}:{name}/{item.name}",
            loader=item.make,
        )
        for item in listed
        if wanted in ("", item.name)
    ]
