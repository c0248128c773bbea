"""Tutorials: notebooks without outputs, run when the documentation is built."""

from __future__ import annotations

import base64
import os
import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

SETTINGS = "DESIGNOPT_TUTORIALS"
"""Variable that the notebooks read: ``full`` for the settings a reader would use."""

TIMEOUT = 3600
"""Seconds for one cell of a tutorial with full settings."""

QUICK_TO_COMPILE = {
    "XLA_FLAGS": "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1",
    "JAX_DISABLE_MOST_OPTIMIZATIONS": "true",
}
"""What small settings are compiled with: in two thirds of the time, as the tests are."""

ESCAPES = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


def run_notebook(path: Path, *, full: bool) -> nbformat.NotebookNode:
    """A notebook with the outputs of its cells, run in an empty folder.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell failed.
    """
    notebook: Any = nbformat.read(path, as_version=4)
    # A kernel inherits this process's environment, in which the commands of this Python come first.
    before = dict(os.environ)
    os.environ["PATH"] = os.pathsep.join([os.path.dirname(sys.executable), before["PATH"]])
    os.environ |= {SETTINGS: "full"} if full else {SETTINGS: "small", **QUICK_TO_COMPILE}
    try:
        with tempfile.TemporaryDirectory() as folder:
            client = NotebookClient(
                notebook,
                timeout=TIMEOUT,
                startup_timeout=TIMEOUT,
                kernel_name="python3",
                extra_arguments=["--log-level=ERROR"],
                resources={"metadata": {"path": folder}},
            )
            client.execute()
    finally:
        os.environ.clear()
        os.environ.update(before)
    return notebook


def notebook_page(notebook: nbformat.NotebookNode, name: str, folder: Path) -> str:
    """The Markdown of a notebook that has been run; its pictures are written into ``folder``."""
    text = ""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            text += cell.source + "\n\n"
            continue
        text += f"```python\n{cell.source}\n```\n\n"
        for output in cell.outputs:
            text += _output(output, f"{name}-{text.count('![')}", folder)
    return f"{text}\n[Download this notebook]({name}.ipynb){{ download }}\n"


def _output(output: Any, picture: str, folder: Path) -> str:
    if output.output_type == "stream":
        if output.name == "stderr":
            return ""
        return _shown(output.text)
    data = output.get("data", {})
    if "image/svg+xml" in data:
        (folder / f"{picture}.svg").write_text(data["image/svg+xml"], encoding="utf-8")
        return f"![Result of the cell above]({picture}.svg)\n\n"
    if "image/png" in data:
        (folder / f"{picture}.png").write_bytes(base64.b64decode(data["image/png"]))
        return f"![Result of the cell above]({picture}.png)\n\n"
    return _shown(data["text/plain"]) if "text/plain" in data else ""


def _shown(text: str) -> str:
    return f"```text\n{ESCAPES.sub('', text).rstrip()}\n```\n\n"


def write_tutorials(source: Path, target: Path, *, full: bool, run: bool) -> None:
    """Write a page for every notebook, with its outputs where it is ``run``."""
    target.mkdir(parents=True, exist_ok=True)
    for path in sorted(source.glob("*.ipynb")):
        begin = time.perf_counter()
        notebook = run_notebook(path, full=full) if run else nbformat.read(path, as_version=4)
        page = notebook_page(notebook, path.stem, target)
        (target / f"{path.stem}.md").write_text(page, encoding="utf-8")
        (target / path.name).write_bytes(path.read_bytes())
        print(f"{path.name}: {time.perf_counter() - begin:.0f} s")
