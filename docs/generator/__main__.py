"""``python -m docs.generator``: the whole site, strictly checked, into ``build/site``."""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from designopt import __version__
from docs.generator.api import write_api
from docs.generator.commands import commands_page
from docs.generator.formats import FORMATS, format_page
from docs.generator.links import faults
from docs.generator.markup import math_to_mathml
from docs.generator.measured import measured_page
from docs.generator.notebooks import write_tutorials
from docs.generator.pictures import write_pictures
from docs.generator.screenshots import write_screenshots
from docs.generator.settings import settings_page

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
SHIM = "assets/offline-search.js"
"""Search runs in a worker, which browsers do not start from files; this page's own script does."""


def write_sources(source: Path, *, run: bool, full: bool) -> None:
    """Write all pages and pictures of the site as Markdown into a folder."""
    shutil.copytree(DOCS / "pages", source, ignore=shutil.ignore_patterns("*.ipynb"))
    reference = source / "reference"
    reference.mkdir(exist_ok=True)
    for file in FORMATS:
        (reference / f"{file.page}.md").write_text(format_page(file), encoding="utf-8")
    (reference / "settings.md").write_text(settings_page(), encoding="utf-8")
    (reference / "commands.md").write_text(commands_page(), encoding="utf-8")
    write_api(source / "api")
    write_pictures(source / "pictures")
    write_screenshots(source / "pictures")
    for topic in ("accuracy", "speed"):
        path = source / "measured" / f"{topic}.md"
        head = path.read_text(encoding="utf-8")
        path.write_text(measured_page(DOCS / "measured", topic, head), encoding="utf-8")
    write_tutorials(DOCS / "pages" / "tutorials", source / "tutorials", full=full, run=run)
    for path in source.rglob("*.md"):
        if path.parent.name not in ("api", "reference"):
            path.write_text(math_to_mathml(path.read_text(encoding="utf-8")), encoding="utf-8")


def build_site(source: Path, site: Path) -> list[str]:
    """Build the site from its Markdown; what is wrong with it, a line each.

    A site that was there before is replaced by one with which nothing is wrong.
    """
    config: Any = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    # Zensical builds only below the folder of its configuration.
    config |= {"docs_dir": source.name, "site_dir": "site"}
    config["site_name"] = f"{config['site_name']} {__version__}"
    file = source.parent / "mkdocs.yml"
    file.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--clean", "-f", str(file)]
    done = subprocess.run(command, cwd=file.parent, capture_output=True, text=True, check=False)
    if done.returncode:
        return [done.stdout + done.stderr]
    built = source.parent / "site"
    for page in built.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        depth = "../" * (len(page.relative_to(built).parts) - 1)
        page.write_text(
            text.replace("https://unpkg.com/iframe-worker/shim", depth + SHIM), encoding="utf-8"
        )
    if wrong := list(faults(built)):
        return wrong
    shutil.rmtree(site, ignore_errors=True)
    shutil.copytree(built, site)
    return []


def write_versions(folder: Path) -> None:
    """Write the page over the versions that lie in a folder, the newest of which it opens."""
    names = sorted(
        (path.parent.name for path in folder.glob("*/index.html")),
        key=lambda name: [int(part) if part.isdigit() else -1 for part in name.split(".")],
        reverse=True,
    )
    items = "".join(f'<li><a href="{name}/index.html">{name}</a></li>' for name in names)
    text = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>designopt</title>\n'
        f'<meta http-equiv="refresh" content="0; url={names[0]}/index.html"></head>\n'
        f"<body><p>Documentation of designopt, by version:</p><ul>{items}</ul></body></html>\n"
    )
    (folder / "index.html").write_text(text, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Build; 1 if anything is wrong."""
    parser = argparse.ArgumentParser(prog="python -m docs.generator", description=__doc__)
    parser.add_argument(
        "--out", type=Path, default=ROOT / "build" / "site", help="folder of versions"
    )
    parser.add_argument(
        "--work", type=Path, default=ROOT / "build" / "docs", help="for the sources"
    )
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--full", action="store_true", help="tutorials with a reader's settings")
    how.add_argument("--unrun", action="store_true", help="tutorials without outputs")
    given = parser.parse_args(arguments)
    if given.work.exists() and any(given.work.iterdir()) and not (given.work / "source").is_dir():
        parser.error(f"--work {given.work}: it holds something else; name a new folder")
    shutil.rmtree(given.work, ignore_errors=True)
    given.work.mkdir(parents=True)
    source = given.work.resolve() / "source"
    write_sources(source, run=not given.unrun, full=given.full)
    site = given.out.resolve() / __version__
    wrong = build_site(source, site)
    for line in wrong:
        print(line, file=sys.stderr)
    if not wrong:
        write_versions(given.out)
        print(f"{site / 'index.html'}: built without a warning")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
