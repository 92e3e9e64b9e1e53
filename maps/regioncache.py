"""View regions built once per map: a cache that nobody has to manage.

The key is everything that the regions depend on, so a map that changes has other regions. A file is written
aside and renamed, so two processes that build at once, or one that dies while writing, do no harm; one that
cannot be read is built anew.
"""

from __future__ import annotations

import hashlib
import logging
import os
import sys
import tempfile
import zipfile
from dataclasses import astuple
from pathlib import Path

import numpy as np

from maps.partition import PartitionConfig
from maps.regions import ViewRegions, assemble, build_regions
from maps.wiremap import WireMap

#: Raised whenever the same map would give other regions.
_VERSION = 1
_FIELDS = ("corners", "corner_starts", "rows", "ranges", "row_starts")

_log = logging.getLogger(__name__)


def cached_regions(
    wire_map: WireMap, heights_m: tuple[float, float], config: PartitionConfig | None = None
) -> ViewRegions:
    """Return a map's regions from the cache, or build and keep them; without a place to keep them, build."""
    config = config or PartitionConfig()
    path = cache_folder() / f"regions-{_key(wire_map, heights_m, config)}.npz"
    regions = _load(path, heights_m, len(wire_map))
    if regions is None:
        regions = build_regions(wire_map, heights_m, config)
        _save(path, regions)
    return regions


def cache_folder() -> Path:
    """Return where the caches lie: as the XDG base directories say, or as the platform's users expect."""
    if chosen := os.environ.get("XDG_CACHE_HOME"):
        return Path(chosen) / "wireloc"
    home = Path.home()
    return (home / "Library" / "Caches" if sys.platform == "darwin" else home / ".cache") / "wireloc"


def _key(wire_map: WireMap, heights_m: tuple[float, float], config: PartitionConfig) -> str:
    digest = hashlib.sha256(repr((_VERSION, heights_m, astuple(config))).encode())
    for array in (
        wire_map.endpoints,
        wire_map.sight_endpoints,
        wire_map.walls,
        wire_map.wall_tops_m,
        wire_map.lintels,
        wire_map.lintel_bottoms_m,
    ):
        digest.update(repr(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _load(path: Path, heights_m: tuple[float, float], segments: int) -> ViewRegions | None:
    """Read regions; None where there are none, or where the file is not whole."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in _FIELDS}
            build_seconds = float(stored["build_seconds"])
        if len(arrays["rows"]) and arrays["rows"].max() >= segments:
            return None
        return assemble(heights_m, **arrays, build_seconds=build_seconds)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, IndexError, EOFError, zipfile.BadZipFile) as error:
        _log.warning("%s: not readable (%s), built anew", path, error)
        return None


def _save(path: Path, regions: ViewRegions) -> None:
    """Write regions aside and rename; a full or read-only disk only costs the next build."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, aside = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".tmp")
    except OSError as error:
        _log.warning("%s: regions not kept: %s", path.parent, error)
        return
    try:
        with os.fdopen(handle, "wb") as file:
            fields = {name: getattr(regions, name) for name in _FIELDS}
            np.savez(file, build_seconds=np.float64(regions.build_seconds), **fields)
        os.replace(aside, path)
    except OSError as error:
        _log.warning("%s: regions not kept: %s", path, error)
        Path(aside).unlink(missing_ok=True)
