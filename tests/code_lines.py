"""Code lines and statements of every package: ``python -m tests.code_lines [PATH ...]``.

A code line is a line that ruff's formatter writes and that is neither blank nor a comment nor part
of a docstring; pragmas that switch the formatter off are taken out first. A statement is a node of
the syntax tree that is one, docstrings left out.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
PACKAGES = ("designopt", "kinematics", "optics", "perception", "studies", "tests")
OWN_LINES = re.compile(r"\s*# fmt: (skip|off|on)$", re.MULTILINE)
EMPTY = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip


class Count(NamedTuple):
    """Size of some files."""

    files: int
    code_lines: int
    statements: int


def count(path: Path) -> Count:
    """The size of one file."""
    text = _formatted(OWN_LINES.sub("", path.read_text(encoding="utf-8")))
    tree = ast.parse(text)
    lines, written = set(), text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in EMPTY:
            lines.update(range(token.start[0], token.end[0] + 1))
    lines = {line for line in lines if written[line - 1].strip()}
    docstrings = [part for node in ast.walk(tree) for part in _docstrings(node)]
    for part in docstrings:
        lines.difference_update(range(part.lineno, (part.end_lineno or part.lineno) + 1))
    statements = sum(isinstance(node, ast.stmt) for node in ast.walk(tree))
    return Count(1, len(lines), statements - len(docstrings))


def _formatted(text: str) -> str:
    settings = str(ROOT / "pyproject.toml")
    command = [sys.executable, "-m", "ruff", "format", "--config", settings, "-"]
    return subprocess.check_output(command, input=text, text=True)


def _docstrings(node: ast.AST) -> Iterable[ast.Expr]:
    # As Sphinx takes them: also a string that stands alone behind an assignment.
    match node:
        case ast.Expr(value=ast.Constant(value=str())):
            yield node


def total(paths: Iterable[Path]) -> Count:
    """The size of all Python files at and under ``paths``."""
    counts = [count(file) for path in paths for file in sorted(_files(path))]
    return Count(*map(sum, zip(*counts, strict=True))) if counts else Count(0, 0, 0)


def _files(path: Path) -> Iterable[Path]:
    return [path] if path.is_file() else path.rglob("*.py")


def main(arguments: list[str]) -> None:
    """Print a line for every path; without one, for every package, every study and all tests."""
    show = {path: total([ROOT / path]) for path in arguments}
    if not arguments:
        show |= {name: total([ROOT / name]) for name in PACKAGES}
        inner = sorted(path for path in (ROOT / "studies").iterdir() if path.is_dir())
        show |= {str(path.relative_to(ROOT)): total([path]) for path in inner}
        library = [ROOT / name for name in PACKAGES if name != "tests"]
        show["library (all packages but tests)"] = total(library)
        rest = [path for path in inner if path.name not in ("models", "oracles")]
        show["studies without models and oracles"] = total([*rest, ROOT / "studies/__init__.py"])
    print(f"{'files':>6} {'code lines':>11} {'statements':>11}")
    for name, size in show.items():
        print(f"{size.files:>6} {size.code_lines:>11,} {size.statements:>11,}  {name}")


if __name__ == "__main__":
    main(sys.argv[1:])
