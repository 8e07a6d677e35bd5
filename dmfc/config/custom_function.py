"""`file.py:function` or `file.py:Class`: what a setting or selector names in a user's file."""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dmfc.errors import DmfcError, unknown_name
from dmfc.files.digest import bytes_digest


@dataclass(frozen=True)
class CustomFunction:
    """A function, or a class, that is there, found without running anything of its file."""

    file: Path
    name: str
    digest: str
    """SHA-256 of the whole file: what the function calls in it counts too."""

    def load(self) -> Callable[..., Any]:
        """The function itself; its file is run, once per process and content."""
        module_name = f"dmfc_custom_{self.file.stem}_{self.digest}"
        if module_name not in sys.modules:
            spec = importlib.util.spec_from_file_location(module_name, self.file)
            assert spec is not None
            assert spec.loader is not None
            module = importlib.util.module_from_spec(spec)
            sys.modules[module_name] = module  # dataclasses look their own module up
            try:
                spec.loader.exec_module(module)
            except Exception as error:  # whatever the user's file raises
                del sys.modules[module_name]
                raise DmfcError(
                    f"{self.file} cannot be run: {type(error).__name__}: "
                    f"{' '.join(str(error).split())}"
                ) from error
        function: Callable[..., Any] = getattr(sys.modules[module_name], self.name)
        return function


def custom_function(text: str, where: str) -> CustomFunction:
    """The function that `text` names. `where`, a setting, stands at the beginning of errors.

    Raises DmfcError where there is no such file or it does not define such a function.
    """
    return _found(text, where, ast.FunctionDef, "function")


def custom_class(text: str, where: str) -> CustomFunction:
    """The class that `text` names, `file.py:Class`; as `custom_function`."""
    return _found(text, where, ast.ClassDef, "Class")


def is_custom(text: str) -> bool:
    """Whether a setting names something in a user's file."""
    return text.partition(":")[0].endswith(".py")


def _found(
    text: str, where: str, kind: type[ast.FunctionDef | ast.ClassDef], what: str
) -> CustomFunction:
    file_name, _, name = text.partition(":")
    if not file_name.endswith(".py") or not name:
        raise DmfcError(f"{where}: '{text}' is not of the form file.py:{what}")
    file = Path(file_name).expanduser().absolute()
    try:
        content = file.read_bytes()
        tree = ast.parse(content)
    except OSError as error:
        raise DmfcError(f"{where}: cannot read {file}: {error.strerror}") from error
    except (SyntaxError, ValueError) as error:
        raise DmfcError(f"{where}: {file} is not Python: {' '.join(str(error).split())}") from error
    defined = [node.name for node in tree.body if isinstance(node, kind)]
    if name not in defined:
        what = what.lower()
        raise DmfcError(f"{where}: {unknown_name(f'{what} of {file_name}', name, defined)}")
    return CustomFunction(file, name, bytes_digest(content))
