"""Self-contained web pages: one file, no outside requests, readable on a phone, in the dark and in print."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from html import escape

#: How a spread of errors is told, by its fields: the columns of every table of errors.
STATISTICS = {"median": "median", "p95": "95 %", "max": "max", "rmse": "RMSE"}

_SHELL = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<style>
:root {{ color-scheme: light dark; --ink: #1f2328; --paper: #ffffff; --faint: #59636e; --line: #d1d9e0; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #e6e8eb; --paper: #15181c; --faint: #a3adb8; --line: #3a424c; }}
}}
body {{ margin: 0 auto; padding: 1rem; max-width: 46rem; background: var(--paper); color: var(--ink);
  font: 1rem/1.5 system-ui, sans-serif; }}
h1 {{ font-size: 1.5rem; line-height: 1.2; margin: .5rem 0 1rem; }}
h2 {{ font-size: 1.15rem; margin: 2rem 0 .5rem; }}
svg {{ display: block; width: 100%; max-width: 42rem; height: auto; margin: 1rem auto; }}
.scroll {{ overflow-x: auto; }}
table {{ border-collapse: collapse; width: 100%; margin: 0 0 1rem; font-size: .9rem;
  font-variant-numeric: tabular-nums; }}
th, td {{ padding: .3rem .5rem; text-align: right; white-space: nowrap;
  border-bottom: 1px solid var(--line); }}
th:first-child, td:first-child {{ text-align: left; }}
th {{ color: var(--faint); font-weight: 600; }}
figure {{ margin: 1rem 0; }}
figure img {{ display: block; width: 100%; height: auto; border-radius: .4rem; }}
figcaption {{ color: var(--faint); font-size: .9rem; margin-top: .3rem; }}
p.note {{ color: var(--faint); font-size: .9rem; }}
dl {{ display: grid; grid-template-columns: repeat(auto-fit, minmax(min(13rem, 45%), 1fr));
  gap: .75rem; margin: 0; }}
dl div {{ border: 1px solid var(--line); border-radius: .4rem; padding: .5rem .75rem; }}
dt {{ color: var(--faint); font-size: .8rem; }}
dd {{ margin: 0; font-size: 1.25rem; font-weight: 600; }}
pre {{ overflow-x: auto; font-size: .8rem; line-height: 1.4; border: 1px solid var(--line);
  border-radius: .4rem; padding: .75rem; }}
</style>
</head>
<body>
<h1>{title}</h1>
{body}
</body>
</html>
"""


def page(title: str, parts: Iterable[str]) -> str:
    """Return a whole page from its parts, which are HTML already."""
    return _SHELL.format(title=escape(title), body="\n".join(parts))


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of texts; one that is wider than the screen scrolls by itself."""
    head = "".join(f"<th>{escape(text)}</th>" for text in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>\n" for row in rows)
    return f'<div class="scroll"><table>\n<tr>{head}</tr>\n{body}</table></div>'


def headlines(figures: Iterable[tuple[str, str]]) -> str:
    """Return the few figures that matter most, each with its name."""
    cells = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(text)}</dd></div>" for name, text in figures)
    return f"<dl>{cells}</dl>"


def note(text: str) -> str:
    """Return a remark in small print."""
    return f'<p class="note">{escape(text)}</p>'


def picture(jpeg: bytes, caption: str) -> str:
    """Return a JPEG inside the page, with a line below it."""
    data = b64encode(jpeg).decode("ascii")
    source = f'<img alt="{escape(caption)}" src="data:image/jpeg;base64,{data}">'
    return f"<figure>{source}<figcaption>{escape(caption)}</figcaption></figure>"


def heading(text: str) -> str:
    """Return a section's heading."""
    return f"<h2>{escape(text)}</h2>"


def verbatim(text: str) -> str:
    """Return a text as it is, line by line."""
    return f"<pre>{escape(text)}</pre>"


def number(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Write a figure with its unit; a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f}{unit}"
