"""Pages of measured accuracy and speed, from the results in ``docs/measured``."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docs.generator.markup import plain, table


def results(folder: Path) -> Iterator[dict[str, Any]]:
    """The results of the folder, by file name."""
    for path in sorted(folder.glob("*.json")):
        yield json.loads(path.read_text(encoding="utf-8"))


def measured_page(folder: Path, topic: str, head: str) -> str:
    """The page of a topic: for every result what was measured, how, where and when."""
    text = head
    for result in results(folder):
        rows = [
            [plain(one["quantity"]), plain(one["value"]), plain(one.get("compared_with", "–"))]
            for one in result["metrics"]
            if one["topic"] == topic
        ]
        if not rows:
            continue
        text += f"## {result['title']}\n\n{result['setup']}\n\n"
        text += table(["Quantity", "Measured", "Compared with"], rows)
        text += f"\n`{result['command']}`, {result['date']}, {result['machine']}.\n\n"
    return text
