"""From what docstrings and theory notes hold to the Markdown of a page."""

from __future__ import annotations

import html
import re
from collections.abc import Callable

from latex2mathml.converter import convert

FENCE = re.compile(r"(^```.*?^```[^\n]*$|`[^`\n]+`)", re.DOTALL | re.MULTILINE)
DISPLAY = re.compile(r"\$\$(.+?)\$\$", re.DOTALL)
INLINE = re.compile(r"(?<![\\$\w])\$([^$\n]+?)\$(?!\w)")


def outside_code(text: str, change: Callable[[str], str]) -> str:
    """A page with everything changed but its code."""
    parts = FENCE.split(text)
    return "".join(part if number % 2 else change(part) for number, part in enumerate(parts))


def math_to_mathml(text: str) -> str:
    """A page whose TeX, ``$…$`` and ``$$…$$``, is MathML, which browsers draw without a script."""

    def change(part: str) -> str:
        part = DISPLAY.sub(lambda found: f"\n<div>{_mathml(found[1], 'block')}</div>\n", part)
        # A line that begins with <math> would be a block of its own.
        return INLINE.sub(lambda found: f"<span>{_mathml(found[1], 'inline')}</span>", part)

    return outside_code(text, change)


def _mathml(tex: str, display: str) -> str:
    # Markdown reads these three even between the tags of an inline formula.
    made = convert(" ".join(tex.split()), display=display)
    return made.replace("*", "&#42;").replace("_", "&#95;").replace("\\", "&#92;")


def docstring_text(text: str) -> str:
    """A docstring's paragraphs as Markdown: its literals are in double backticks."""
    return text.replace("``", "`").replace("\\", "\\\\")


def cell(text: str) -> str:
    """Text for a cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(map(cell, line))} |\n" for line in lines)


def plain(text: str) -> str:
    """Text in which Markdown and HTML find no mark-up."""
    return re.sub(r"([\\`*_{}\[\]<>#|])", r"\\\1", html.unescape(text))
