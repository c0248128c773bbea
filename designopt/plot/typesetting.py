"""Names and symbols of plain text, set for a reader: in HTML, in a figure, over a table's column.

Plain text, as in ``results.json`` and on a terminal, writes a subscript as ``μ_C`` and puts what is
typed literally between backticks. Here both become what a book prints.
"""

from __future__ import annotations

import html
import re

SYMBOL = re.compile(r"(?<![\w.])([Δδ]?[^\W\d_])_([A-Za-z0-9]{1,3}'?)(?![\w/]|\.\w)")
"""A letter, perhaps after a Δ, with a subscript of up to three: identifiers are longer."""

LITERAL = re.compile(r"`([^`]+)`")

UNITS = {
    "px_per_deg_mm": "px/(° mm)",
    "px_per_deg2": "px/°²",
    "px_per_deg": "px/°",
    "px_per_mm": "px/mm",
    "mm_per_deg": "mm/°",
    "mm_per_px": "mm/px",
    "n_mm": "N mm",
    "mm3": "mm³",
    "mm2": "mm²",
    "mm": "mm",
    "cm": "cm",
    "um": "µm",
    "px": "px",
    "deg": "°",
    "percent": "%",
    "us": "µs",
    "ms": "ms",
    "kB": "kB",
    "s": "s",
    "n": "N",
}
"""Units as a column's name ends in them, and as people write them; longer ones come first."""

GREEK = {"delta_l": "Δl", "delta": "δ", "eta": "η", "theta": "θ", "gamma": "γ", "phi": "φ"}
"""Letters as columns name them; a subscript of one or two letters may follow."""

_LETTER = re.compile(rf"(?<![^_])({'|'.join(GREEK)})(?:_([a-z]{{1,2}}))?(?![^_])")


def as_html(text: str) -> str:
    """Plain text as HTML: escaped, with subscripts, and with literal parts as ``code``."""
    parts = [html.escape(part, quote=False) for part in LITERAL.split(text)]
    parts[::2] = [SYMBOL.sub(r"\1<sub>\2</sub>", part) for part in parts[::2]]
    parts[1::2] = [f"<code>{part}</code>" for part in parts[1::2]]
    return "".join(parts)


def as_mathtext(text: str) -> str:
    """Plain text as Matplotlib draws it, with subscripts; a ``$`` in it stays one."""
    return SYMBOL.sub(r"\1$_{\\mathrm{\2}}$", drawn_name(text))


def drawn_name(name: str) -> str:
    """A name from a file for Matplotlib to draw as it is written.

    Between two ``$`` Matplotlib would set formulas, and it leaves a label out of a legend that
    begins with an underscore.
    """
    hidden = "\N{ZERO WIDTH SPACE}" if name.startswith("_") else ""
    return hidden + name.replace("$", r"\$")


def heading(column: str) -> str:
    """What stands over a table's column of this name: words, symbols and the unit in brackets.

    A key with dots is a setting, which is typed as it stands.

    Example:
        >>> heading("worst_px_per_mm"), heading("paper_delta_l_d_cm"), heading("μ_C_deg")
        ('worst (px/mm)', 'paper Δl_D (cm)', 'μ_C (°)')
    """
    if "." in column:
        return f"`{column}`"
    suffix = _unit_suffix(column)
    name = column.removesuffix(f"_{suffix}") if suffix else column
    return spell_out(name) + (f" ({UNITS[suffix]})" if suffix else "")


def unit_of(name: str) -> str:
    """The unit in which a name ends; empty of a pure number.

    Example:
        >>> unit_of("worst_px_per_mm"), unit_of("cells_matched")
        ('px/mm', '')
    """
    return UNITS.get(_unit_suffix(name), "")


def _unit_suffix(name: str) -> str:
    return next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")


def spell_out(name: str) -> str:
    """A name in ``snake_case`` as words, its symbols as plain text writes them."""
    name = _LETTER.sub(lambda found: _symbol(found[1], found[2]), name)
    name = re.sub(r"(?<!Δl)(?<![α-ω])_|_(?![A-Z])", " ", name)
    return re.sub(r"\b(pip|dip)\b", lambda joint: joint[1].upper(), name)


def _symbol(letter: str, subscript: str | None) -> str:
    return GREEK[letter] + (f"_{subscript.upper()}" if subscript else "")
