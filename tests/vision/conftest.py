"""The toy building, read once."""

from __future__ import annotations

import pytest
from toy_building import toy_building

from maps.wiremap import WireMap


@pytest.fixture(scope="session")
def toy_map(tmp_path_factory: pytest.TempPathFactory) -> WireMap:
    return toy_building().read(tmp_path_factory.mktemp("toy"))
