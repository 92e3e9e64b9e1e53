"""Images as files hold them, for whoever makes or keeps images: the simulator and the recording."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from vision.images import GreyImage

#: Best first; below the last an image is no longer worth its bytes.
_QUALITIES = (75, 60, 45, 30, 20)
#: An image that takes less than this share of its limit may have been better; the next one shall.
_ROOM = 0.6
_JPEG_MAGIC = b"\xff\xd8\xff"


def jpeg(image: GreyImage, quality: int = 90) -> bytes:
    """Return a grey image (H, W) as a JPEG file's bytes; `quality` in 1..100."""
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"no JPEG of an image of shape {image.shape}")
    return data.tobytes()


class LeanImages:
    """Image files as JPEGs of a limited size; images of one drive are alike, so the last one's quality is a start."""

    def __init__(self, most_bytes: int) -> None:
        """Keep images to so many bytes each, but for those that no quality makes so small."""
        self._most_bytes = most_bytes
        self._step = 1

    def read(self, path: Path) -> bytes | None:
        """Return a file as it is where it is a small JPEG, else encoded anew; None where it cannot be read."""
        return self.lean(path.read_bytes())

    def lean(self, data: bytes) -> bytes | None:
        """Return a file's bytes as they are where they are a small JPEG, else encoded anew; None if no image."""
        if data.startswith(_JPEG_MAGIC) and len(data) <= self._most_bytes:
            return data
        # Its file is for people to look at: eight bits and its colours.
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
        if image is None:
            return None
        for step in range(self._step, len(_QUALITIES)):
            encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITIES[step]])[1].tobytes()
            self._step = step
            if len(encoded) <= self._most_bytes:
                break
        if len(encoded) < _ROOM * self._most_bytes:
            self._step = max(self._step - 1, 0)
        return encoded
