"""Options of the command line that hold several numbers."""

from __future__ import annotations

import math

from maps.errors import InputError


def numbers(option: str, text: str, form: str, counts: tuple[int, ...]) -> list[float]:
    """Return the numbers of an option such as 1.5,2,0.3; InputError tells the form that was expected."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(math.isfinite(value) for value in values):
        raise InputError(option, "", f"expected {form} in numbers, not {text!r}")
    return values
