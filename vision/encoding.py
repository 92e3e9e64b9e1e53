"""Images as files hold them, for whoever makes images: the simulator."""

from __future__ import annotations

import cv2

from vision.images import GreyImage


def jpeg(image: GreyImage, quality: int = 90) -> bytes:
    """Return a grey image (H, W) as a JPEG file's bytes; `quality` in 1..100."""
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"no JPEG of an image of shape {image.shape}")
    return data.tobytes()
