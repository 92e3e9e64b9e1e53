"""A session whose images are the frames of one video file, with a table of their stamps."""

from __future__ import annotations

import logging
from collections import OrderedDict
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import Lock

from maps.errors import InputError
from vision.rawimages import plain_file
from vision.video import Video

logger = logging.getLogger(__name__)

SUFFIXES = (".avi", ".mkv", ".mov", ".mp4", ".m4v", ".webm")
#: Frames kept for whoever asks again: the recording looks at what the matcher saw.
_KEPT = 8


@dataclass(frozen=True, slots=True)
class VideoPicture:
    """One frame of a video, by its number from 0."""

    path: Path
    number: int

    def read(self) -> bytes:
        """Return the frame as a file's bytes; InputError where it cannot be read."""
        return _reel(self.path).read(self.number)


@dataclass(frozen=True, slots=True)
class Filmed:
    """A video's frames: a name for each, and where its picture is."""

    filenames: tuple[str, ...]
    pictures: tuple[VideoPicture, ...]


def folder_video(folder: Path, count: int) -> Filmed:
    """Return the first frames of a folder's one video; InputError where it has none, several or fewer frames."""
    videos = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    if len(videos) != 1:
        what = (
            f"several videos: {', '.join(path.name for path in videos)}"
            if videos
            else "no video in the folder"
        )
        raise InputError(folder / "frames.csv", "line 1", f"no column filename, and {what}")
    video = Video(videos[0])
    if 0 < video.count < count:
        raise InputError(
            folder / "frames.csv", "", f"{count} stamps for the {video.count} frames of {videos[0].name}"
        )
    if video.count > count:
        logger.warning("%s: %d frames, and stamps for the first %d", videos[0], video.count, count)
    place, numbers = videos[0].resolve(), range(count)
    return Filmed(
        tuple(f"images/{number:06d}.png" for number in numbers),
        tuple(VideoPicture(place, number) for number in numbers),
    )


class _Reel:
    """A video that any thread may ask for frames."""

    def __init__(self, path: Path) -> None:
        self._lock, self._video = Lock(), Video(path)
        self._recent: OrderedDict[int, bytes] = OrderedDict()

    def read(self, number: int) -> bytes:
        with self._lock:
            if number not in self._recent:
                self._recent[number] = plain_file(self._video.frame(number))
            while len(self._recent) > _KEPT:
                self._recent.popitem(last=False)
            return self._recent[number]


@lru_cache(maxsize=4)
def _reel(path: Path) -> _Reel:
    """One for all who ask: the threads of a run look at pictures in one order."""
    return _Reel(path)
