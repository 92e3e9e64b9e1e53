"""Readers against broken files: only an answer or a WirelocError in time and in bounds is right."""

from __future__ import annotations

import contextlib
import hashlib
import resource
import shutil
import signal
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic

import numpy as np
from mutations import mutated
from readers import Reader

from maps.errors import WirelocError

#: No reader may take more memory over a small file, beyond what it had.
MOST_BYTES = 2**30


class HangError(BaseException):
    """A reader took too long; no `except Exception` stops it."""


@dataclass(frozen=True)
class Finding:
    """What went wrong with an input: where, and the input."""

    reader: str
    what: str
    data: bytes


def tried(reader: Reader, data: bytes, folder: Path) -> str | None:
    """Let a reader read an input in a folder; return what was wrong about how it took it, or None."""
    (folder / reader.file).write_bytes(data)
    try:
        with _alarm(reader.most_s), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            reader.read(folder)
    except WirelocError as error:
        return None if str(error).strip() else "an error that says nothing"
    except HangError as error:
        return f"longer than {reader.most_s:g} s at {_place(traceback.extract_tb(error.__traceback__))}"
    except (Exception, RecursionError) as error:  # noqa: BLE001 - whatever it is, it is what we look for
        return f"{type(error).__name__} at {_place(traceback.extract_tb(error.__traceback__))}: {error}"[:300]
    return None


def campaign(reader: Reader, seconds: float, seed: int, keep: Path) -> tuple[int, Counter[str]]:
    """Try a reader for a time in a process of its own; return inputs tried and findings by kind.

    The first input of each kind is kept. A reader that ends its process is found out, too.
    """
    tries, findings, end, turn = 0, Counter[str](), monotonic() + seconds, 0
    while monotonic() < end:
        ours, theirs = get_context("fork").Pipe()
        process = get_context("fork").Process(
            target=_work, args=(reader, end - monotonic(), (seed, turn), keep, theirs)
        )
        process.start()
        theirs.close()
        with contextlib.suppress(EOFError):
            while True:
                if not ours.poll(4.0 * reader.most_s):
                    # It hangs where no signal of Python's gets through.
                    process.kill()
                what = ours.recv()
                tries += 1
                if what is not None:
                    findings[what] += 1
        process.join()
        if process.exitcode:
            findings[f"the process ended with {process.exitcode}"] += 1
            last = keep / f"{reader.name.replace(' ', '_')}-last"
            last.replace(last.with_name(f"{last.name}-{turn}-ended"))
        turn += 1
    return tries, findings


def _work(reader: Reader, seconds: float, seed: tuple[int, int], keep: Path, told: Connection) -> None:
    rng, end, known = np.random.default_rng(seed), monotonic() + seconds, set()
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, resource.RLIM_INFINITY))
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        reader.lay(folder)
        while monotonic() < end:
            data = mutated(reader.seeds, rng)
            last = keep / f"{reader.name.replace(' ', '_')}-last"
            last.write_bytes(data)
            what = tried(reader, data, folder)
            if what is not None and (kind := what.split(": ")[0]) not in known:
                known.add(kind)
                name = hashlib.sha256(kind.encode()).hexdigest()[:8]
                shutil.copyfile(last, keep / f"{reader.name.replace(' ', '_')}-{name}")
            told.send(what and what[:160])
        last.unlink()


@contextlib.contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    def ring(*_: object) -> None:
        raise HangError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def _place(stack: traceback.StackSummary) -> str:
    """Return the innermost line of ours, and the innermost of all."""
    ours = [one for one in stack if any(f"/{part}/" in one.filename for part in ("maps", "runs", "vision"))]
    last = (ours or list(stack))[-1]
    return f"{Path(last.filename).name}:{last.lineno} ({Path(stack[-1].filename).name}:{stack[-1].lineno})"
