"""`python tests/fuzz [--seconds N] [--seed S] [--keep FOLDER] [--only READER]`: how readers take broken files."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from campaign import campaign
from readers import readers


def main() -> int:
    """Try all readers in turn, print a row each, and return 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, default=Path("results/fuzz"), help="where inputs are kept")
    parser.add_argument("--only", help="one reader")
    options = parser.parse_args()
    # What is said of files that are read all the same is not asked here.
    logging.disable(logging.WARNING)
    options.keep.mkdir(parents=True, exist_ok=True)
    chosen = [reader for reader in readers() if options.only in (None, reader.name)]
    failed = False
    print(f"{'reader':<14} {'inputs':>7} {'findings':>9}")
    for reader in chosen:
        tries, findings = campaign(reader, options.seconds / len(chosen), options.seed, options.keep)
        print(f"{reader.name:<14} {tries:>7} {sum(findings.values()):>9}", flush=True)
        for what, count in findings.most_common():
            print(f"    {count} x {what}")
        failed |= bool(findings)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
