"""What all benchmarks share: one thread."""

from __future__ import annotations

import cv2
import pytest


@pytest.fixture(autouse=True)
def one_thread():
    """OpenCV shall not help itself to a second core."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)
