"""What goes wrong at the boundary: one error root, few subclasses."""

from __future__ import annotations

from pathlib import Path


class WirelocError(Exception):
    """Root of every error that wireloc raises on purpose; the command line shows it in one line."""


class InputError(WirelocError):
    """Bad input, told as `file: where: what`, with `where` the line or the key."""

    def __init__(self, path: Path | str, where: str, what: str) -> None:
        self.path, self.where, self.what = str(path), where, what
        super().__init__(": ".join(part for part in (self.path, where, what) if part))

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        """Pickle by the three parts: errors come back from other processes."""
        return type(self), (self.path, self.where, self.what)


class MissingExtraError(WirelocError):
    """A library or program that this command needs is not installed; names the command that does it."""
