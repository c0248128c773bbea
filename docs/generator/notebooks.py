"""Tutorials: notebooks without outputs, run when the documentation is built."""

from __future__ import annotations

import base64
import os
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
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

ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def run_notebook(path: Path) -> nbformat.NotebookNode:
    """A notebook with the outputs of its cells, run in an empty folder.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell failed.
    """
    begin, notebook = time.perf_counter(), nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(
            notebook,
            timeout=TIMEOUT,
            startup_timeout=TIMEOUT,
            kernel_name="python3",
            extra_arguments=["--log-level=ERROR"],
            resources={"metadata": {"path": folder}},
        ).execute()
    print(f"{path.name}: {time.perf_counter() - begin:.0f} s", flush=True)
    return notebook


@contextmanager
def environment(*, full: bool) -> Iterator[None]:
    """Meanwhile kernels find the commands of this Python first, and the settings asked for."""
    before = dict(os.environ)
    os.environ["PATH"] = os.pathsep.join([os.path.dirname(sys.executable), before["PATH"]])
    os.environ |= {SETTINGS: "full"} if full else {SETTINGS: "small", **QUICK_TO_COMPILE}
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def notebook_page(notebook: nbformat.NotebookNode, name: str, folder: Path) -> str:
    """The Markdown of a notebook that has been run; its pictures are written into ``folder``."""
    text = ""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            text += cell.source + "\n\n"
            continue
        text += f"```python\n{cell.source}\n```\n\n"
        streams = [one for one in cell.outputs if one.output_type == "stream"]
        text += _shown("".join(one.text for one in streams if one.name == "stdout"))
        for output in cell.outputs:
            if output.output_type != "stream":
                text += _output(output, f"{name}-{text.count('![')}", folder)
    return f"{text}\n[Download this notebook]({name}.ipynb){{ download }}\n"


def _output(output: Any, picture: str, folder: Path) -> str:
    data = output.get("data", {})
    if "image/svg+xml" in data:
        (folder / f"{picture}.svg").write_text(data["image/svg+xml"], encoding="utf-8")
        return f"![Result of the cell above]({picture}.svg)\n\n"
    if "image/png" in data:
        (folder / f"{picture}.png").write_bytes(base64.b64decode(data["image/png"]))
        return f"![Result of the cell above]({picture}.png)\n\n"
    return _shown(data["text/plain"]) if "text/plain" in data else ""


def _shown(text: str) -> str:
    # What a terminal would show in the end: of a line that was written anew, the last state.
    lines = [line.rstrip("\r").rpartition("\r")[2] for line in ESCAPES.sub("", text).split("\n")]
    shown = "\n".join(line for line in lines if line.strip())
    return f"```text\n{shown}\n```\n\n" if shown else ""


def write_tutorials(source: Path, target: Path, *, full: bool, run: bool) -> None:
    """Write a page for every notebook, with its outputs where it is ``run``, two at a time."""
    target.mkdir(parents=True, exist_ok=True)
    paths = sorted(source.glob("*.ipynb"))

    def read(path: Path) -> nbformat.NotebookNode:
        return run_notebook(path) if run else nbformat.read(path, as_version=4)

    with environment(full=full), ThreadPoolExecutor(2) as pool:
        notebooks = list(pool.map(read, paths))
    for path, notebook in zip(paths, notebooks, strict=True):
        page = notebook_page(notebook, path.stem, target)
        (target / f"{path.stem}.md").write_text(page, encoding="utf-8")
        (target / path.name).write_bytes(path.read_bytes())
