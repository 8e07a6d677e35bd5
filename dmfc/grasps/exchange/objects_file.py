"""`.npy` files that hold Python objects, read without executing code in them.

NumPy stores such an array as a pickle, and a pickle can call anything. Here it can call only what
rebuilds arrays and numbers.
"""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from dmfc.errors import DmfcError, one_line

_REBUILD = {
    ("multiarray", "_reconstruct"): np.zeros(0).__reduce__()[0],
    ("multiarray", "scalar"): np.float64(0).__reduce__()[0],
    ("numeric", "_frombuffer"): np.zeros(0).__reduce_ex__(5)[0],
}
"""What NumPy itself names in a pickle, in the modules of `_CORES`."""
_CORES = ("numpy.core.", "numpy._core.")  # of NumPy 1 and of NumPy 2
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def load_objects(path: Path) -> list[Any]:
    """The elements of the object array in a `.npy` file: dicts, lists, numbers, text and arrays.

    Raises DmfcError if the file is missing, damaged, holds no objects, or asks for anything else.
    """
    try:
        with open(path, "rb") as file:
            version = npy.read_magic(file)
            if version not in _HEADERS:
                raise DmfcError(f"{path}: .npy format {version} is not read")
            _, _, dtype = _HEADERS[version](file)
            if not dtype.hasobject:
                raise DmfcError(f"{path}: an array of {dtype}, not of grasps (a pickled dict)")
            array = _Unpickler(file).load()
    except DmfcError:
        raise
    except Exception as error:  # a damaged pickle can raise anything
        reason = one_line(error)
        raise DmfcError(f"{path}: cannot be read as a .npy file of objects ({reason})") from error
    if not isinstance(array, np.ndarray):
        raise DmfcError(f"{path}: holds a {type(array).__name__}, not an array")
    return list(array.ravel())


class _Unpickler(pickle.Unpickler):
    """Rebuilds NumPy arrays and scalars; refuses every other name."""

    def find_class(self, module: str, name: str) -> Any:
        if module == "numpy" and name in ("ndarray", "dtype"):
            return getattr(np, name)
        for core in _CORES:
            if (module.removeprefix(core), name) in _REBUILD:
                return _REBUILD[module.removeprefix(core), name]
        if (module, name) == ("_codecs", "encode"):
            return _latin1
        raise DmfcError(
            f"refused: the file asks for '{module}.{name}', which grasps have no use for"
        )


def _latin1(text: str, encoding: str) -> bytes:
    """How Python 2 pickles bytes; other codecs are refused."""
    if encoding != "latin1":
        raise DmfcError(f"refused: the file asks for the codec '{encoding}'")
    return text.encode("latin1")
