"""Whether every link of a built site leads to something, and nothing is loaded from elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}
"""What a browser loads by itself, by its tag."""


class _Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[tuple[str, str, bool]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.anchors |= {value for key in ("id", "name") if (value := given.get(key))}
        if tag == "link" and given.get("rel") in ("canonical", "prev", "next"):
            return
        key = LOADED.get(tag, "href")
        if target := given.get(key):
            self.links.append((tag, target, tag in LOADED))


def faults(site: Path) -> Iterator[str]:
    """A line for every link that leads nowhere and every file that is loaded from elsewhere."""
    pages = {path: _Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    anchors = {path: page.anchors for path, page in pages.items()}
    for path, page in sorted(pages.items()):
        where = path.relative_to(site)
        for tag, target, loaded in page.links:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                if loaded and parts.scheme != "data":
                    yield f"{where}: <{tag}> loads {target} from elsewhere"
                continue
            file = path if not parts.path else (path.parent / unquote(parts.path)).resolve()
            file = file / "index.html" if file.is_dir() else file
            if path.name == "404.html" and parts.path.startswith("/"):
                continue
            if not file.exists():
                yield f"{where}: {target} leads nowhere"
            elif (place := unquote(parts.fragment)) and place not in anchors.get(file, {place}):
                yield f"{where}: {target} names a place that is not there"
