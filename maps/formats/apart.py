"""A reader in a process of its own, where the library behind it can end its process, or never return."""

from __future__ import annotations

import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import BinaryIO

from maps.errors import InputError, WirelocError
from maps.formats.imported import Imported, ImportOptions

#: How long reading may take, from when the libraries are loaded: for any file, and for each of its megabytes.
SECONDS, SECONDS_PER_MB = 4.0, 60.0
#: How much more memory than the libraries', for any file, and for each of its bytes.
_BYTES, _BYTES_PER_BYTE = 2**30, 200
_READY = b"."


def imported_apart(importer: str) -> Callable[[Path, ImportOptions], Imported]:
    """Return an importer, named as `module:function`, that works in another process; `module.load()` loads libraries.

    It raises what the importer raises, and InputError where the process ends, or does not end in time.
    """

    def read(path: Path, options: ImportOptions) -> Imported:
        command = [sys.executable, "-m", "maps.formats.apart", importer, os.fspath(path)]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        # Without a buffer, or what is read ahead of the answer would be missing from it.
        with subprocess.Popen(command, bufsize=0, **pipes) as process:  # type: ignore[call-overload]
            try:
                answer = _answer(process, pickle.dumps(options), _seconds(path))
            except subprocess.TimeoutExpired:
                raise InputError(path, "", "damaged, or too large: reading it takes too long") from None
            finally:
                process.kill()
        try:
            result = pickle.loads(answer)
        except (pickle.UnpicklingError, EOFError):
            raise InputError(path, "", "damaged: the library that reads it gave up") from None
        if isinstance(result, WirelocError):
            raise result
        assert isinstance(result, Imported)
        return result

    return read


def _answer(process: subprocess.Popen[bytes], options: bytes, seconds: float) -> bytes:
    """Hand over the options, wait for the libraries, and then for the answer: TimeoutExpired."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(options)
    process.stdin.close()
    process.stdin = None
    process.stdout.read(len(_READY))
    return process.communicate(timeout=seconds)[0]


def _seconds(path: Path) -> float:
    return SECONDS + SECONDS_PER_MB * path.stat().st_size / 1e6


def main(importer: str, path: Path, answer: BinaryIO) -> None:
    """Read a file, and write what came of it: the other side of `imported_apart`."""
    options: ImportOptions = pickle.load(sys.stdin.buffer)
    module, _, name = importer.partition(":")
    read = getattr(import_module(module), name)
    import_module(module).load()
    answer.write(_READY)
    answer.flush()
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + _BYTES + _BYTES_PER_BYTE * path.stat().st_size
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
    try:
        result: Imported | WirelocError = read(path, options)
    except WirelocError as error:
        result = error
    except MemoryError:
        result = InputError(path, "", "damaged, or too large: it takes too much memory")
    answer.write(pickle.dumps(result))
    answer.flush()


if __name__ == "__main__":
    # What libraries print must not get into the answer.
    saved = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    main(sys.argv[1], Path(sys.argv[2]), saved)
