"""The frames of a video file, one after the other, or again from the beginning."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from maps.errors import InputError
from vision.images import muted


class Video:
    """Reads a video's frames by their number, counted from 0; best in rising order.

    Frames in between are passed over one by one: looking a place up by its number is not exact with most codecs.
    """

    def __init__(self, path: Path) -> None:
        """Open it; InputError where it is no video that can be read."""
        self.path = path
        self._next = 0
        self._capture = self._opened()

    @property
    def count(self) -> int:
        """How many frames the file says it has; 0 where it does not say."""
        return max(int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)

    def frame(self, number: int) -> NDArray[np.uint8]:
        """Return a frame, (H, W) or (H, W, 3) blue, green, red; InputError where the video ends before it."""
        if number < self._next:
            self._capture.release()
            self._capture, self._next = self._opened(), 0
        with muted():
            while self._next < number and self._capture.grab():
                self._next += 1
            there, image = self._capture.read()
        if not there or image is None:
            raise InputError(self.path, "", f"ends, or is damaged, before frame {number}")
        self._next += 1
        return np.asarray(image, np.uint8)

    def _opened(self) -> cv2.VideoCapture:
        try:
            with muted():
                capture = cv2.VideoCapture(str(self.path))
        except cv2.error:
            raise InputError(self.path, "", "not a video that can be read") from None
        if not capture.isOpened():
            raise InputError(self.path, "", "not a video that can be read")
        return capture
