"""One writer a folder: a lock that goes when its process goes, however that ends, and leaves no file behind."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from maps.errors import InputError

_TRIES = 10
#: Some network file systems have no locks; there, nobody is refused.
_NO_LOCKS = (errno.ENOTSUP, errno.ENOLCK, errno.ENOSYS)


def lock_folder(folder: Path, named: Path) -> int:
    """Make a folder and hold it for this process alone; return the handle, whose closing lets go.

    InputError, naming `named`, where another process holds it, or it cannot be made.
    """
    for _ in range(_TRIES):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(folder, os.O_RDONLY)
        except OSError as error:
            raise InputError(folder, "", error.strerror or str(error)) from None
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise InputError(named, "", "another run is writing there") from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                os.close(handle)
                raise InputError(folder, "", error.strerror or str(error)) from None
        if _still(folder, handle):
            return handle
        # Another run was done in between and put it in its place; the next try makes it anew.
        os.close(handle)
    raise InputError(named, "", "other runs are writing there")


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Make a folder and hold it for this process alone; InputError where another one holds it."""
    handle = lock_folder(folder, folder)
    try:
        yield
    finally:
        os.close(handle)


def _still(folder: Path, handle: int) -> bool:
    """Tell whether a path is still the folder that was opened: another writer may have put it in its place."""
    try:
        return os.path.samestat(os.stat(folder), os.fstat(handle))
    except FileNotFoundError:
        return False
