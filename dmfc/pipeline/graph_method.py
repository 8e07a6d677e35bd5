"""What an evaluation of a foreign method depends on: its file, or its answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dmfc.config.custom_function import custom_function

METHOD, ANSWERS = "method", "answers"
"""Rows of a method that is a function, and of one whose grasps lie in files."""


def method_settings(method: str | Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Settings and hints of an evaluation of `method`: 'file.py:function', or the folder of kept
    answers, which is named by their digest.

    Raises DmfcError where there is no such function.
    """
    if isinstance(method, Path):
        return {"row": ANSWERS, "answers": method.name}, {"answers": str(method)}
    function = custom_function(method, "model")
    settings = {"row": METHOD, "method": function.digest, "function": function.name}
    return settings, {"method": f"{function.file}:{function.name}"}
