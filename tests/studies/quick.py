"""Short runs of studies as commands, with the settings of ``tests/data/quick_runs.toml``."""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

from designopt.cli import run
from tests.golden import table_of
from tests.helpers import DATA, load_toml


class QuickRun(NamedTuple):
    """What a study has written."""

    folder: Path
    document: dict[str, Any]
    measured: dict[str, Any]

    def table(self, name: str) -> dict[str, list[Any]]:
        """The columns of a table."""
        text = (self.folder / "tables" / f"{name}.csv").read_text(encoding="utf-8")
        return table_of(text)

    def rows(self, name: str) -> list[tuple]:
        """The rows of a table."""
        return list(zip(*self.table(name).values(), strict=True))


def quick_run(
    study: str, folder: Path, *more: str, judged: Collection[str] = frozenset()
) -> QuickRun:
    """Run a study, to which hardly any target applies: it has so few cases.

    Args:
        study: its name.
        folder: an empty one.
        more: further settings.
        judged: metrics whose targets apply to all settings.
    """
    settings = [*load_toml("quick_runs.toml")[study], *more]
    sets = [word for setting in settings for word in ("--set", setting)]
    assert run(["run", study, *sets, "--out", str(folder / "out")]) == 0
    document = json.loads((folder / "out" / "results.json").read_text(encoding="utf-8"))
    metrics = document["metrics"]
    assert {name for name, metric in metrics.items() if metric["target"]} == set(judged)
    measured = {name: metric["value"] for name, metric in metrics.items()}
    return QuickRun(folder / "out", document, measured)


def half_as_high(folder: Path) -> list[str]:
    """Settings by which the images of the packaged finger are 540 px high, not 1080.

    Args:
        folder: where its scene is written.
    """
    path, text = folder / "scene.toml", (DATA / "old_specs" / "scene.toml").read_text("utf-8")
    assert text.count("pixels = 1080") == 1
    path.write_text(text.replace("pixels = 1080", "pixels = 540"), encoding="utf-8")
    return [f"scene={path}"]
