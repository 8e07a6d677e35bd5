"""Protocols: settings that hold only while grasps are executed.

Planning and training keep the settings of the preset, so that the same grasps and the same model
can be laid under another protocol.
"""

from __future__ import annotations

from dmfc.config.load import build_config, leaves, open_tree
from dmfc.config.plain_yaml import read_yaml
from dmfc.config.schema import Config
from dmfc.config.shipped import shipped_file
from dmfc.errors import DmfcError

GROUPS = ("physics.", "execution.", "closing.")
"""What a protocol may set."""
COUNTED = ("grasps_per_scene", "seed", "protocol", "changes")
"""Settings of execution that it may not: they say how many trials there are, and which."""


def executed(config: Config) -> Config:
    """`config` under `execution.protocol`, then under `execution.changes`.

    Raises DmfcError on an unknown protocol or setting, or one that is not for execution.
    """
    path = shipped_file("protocols", config.execution.protocol, "protocol")
    if not path.stat().st_size:
        raise DmfcError(f"protocol '{path}' is empty: it has 0 bytes (execution.protocol)")
    overlays = [
        (str(path), read_yaml(path) or {}),
        ("execution.changes", config.execution.changes),
    ]
    for where, values in overlays:
        for key, _ in leaves(open_tree(values, where)):
            counted = key in {f"execution.{name}" for name in COUNTED}
            if counted or not key.startswith(GROUPS):
                raise DmfcError(
                    f"{where}: '{key}' cannot be changed for execution alone "
                    f"(physics.*, closing.*, most of execution.*)"
                )
    return build_config(overlays, config)
