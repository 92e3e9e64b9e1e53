"""A session to which something is done: what was recorded, and what the pictures and the map become."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from maps.mapdocument import MapDocument, read_document
from runs.opening import Reading, open_session
from runs.session import Frame, RecordedFix, Session
from runs.tables import Times
from vision.images import GreyImage

#: Makes another picture of one, (H, W) grey, same size.
Edit = Callable[[GreyImage], GreyImage]


@dataclass(frozen=True, slots=True)
class Span:
    """When something is wrong: stamps of odometry's clock, the end left out."""

    start_ns: int
    end_ns: int

    def holds(self, stamps_ns: Times | int) -> NDArray[np.bool_]:
        """Tell which stamps, (N,) or one, lie in it."""
        stamps = np.asarray(stamps_ns)
        return np.asarray((stamps >= self.start_ns) & (stamps < self.end_ns))


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A session and what is to become of it.

    `edits`: one a frame, None for a picture that stays. `document`: the map as its file has it, None without one.
    """

    session: Session
    edits: tuple[Edit | None, ...]
    document: MapDocument | None

    @property
    def span(self) -> Span:
        """From the first event to just past the last."""
        looks = [frame.stamp_ns for frame in self.session.frames]
        looks += [fix.stamp_ns for fix in self.session.fixes]
        return Span(self.session.start_ns, max(int(self.session.odometry.stamps_ns[-1]), *looks) + 1)

    def with_edits(self, span: Span, edit: Callable[[int], Edit]) -> Recording:
        """Return it with the pictures of a span edited; `edit` makes the edit of the frame of that number."""
        edits = [
            edit(number) if span.holds(frame.stamp_ns) else before
            for number, (frame, before) in enumerate(zip(self.session.frames, self.edits, strict=True))
        ]
        return replace(self, edits=tuple(edits))

    def with_looks(
        self, frames: list[tuple[Frame, Edit | None]], fixes: list[RecordedFix] | None = None
    ) -> Recording:
        """Return it with other frames, each with its edit, and other fixes."""
        session = replace(
            self.session,
            frames=tuple(frame for frame, _ in frames),
            fixes=self.session.fixes if fixes is None else tuple(fixes),
        )
        return replace(self, session=session, edits=tuple(edit for _, edit in frames))


def read_recording(path: Path, reading: Reading | None = None) -> Recording:
    """Read a drive of any kind; InputError names the file, and the line, key or topic, of what cannot be."""
    session = open_session(path, reading)
    document = read_document(session.map_path) if session.map_path is not None else None
    return Recording(session, (None,) * len(session.frames), document)
