"""Objects for the graph: ids from selectors, without loading a mesh."""

from __future__ import annotations

from collections.abc import Sequence

from dmfc.pipeline.graph_data import ObjectRef


def list_refs(selectors: Sequence[str]) -> list[ObjectRef]:
    """The objects that `selectors` name, in their order. Raises DmfcError if one names none."""
    from dmfc.objects.sources import list_objects

    return [ObjectRef(item.id, item.digest, item.selector) for item in list_objects(selectors)]
