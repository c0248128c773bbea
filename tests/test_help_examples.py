"""Every command's --help has an example, and it does what it says."""

import re
import shlex
import shutil
import signal
import subprocess
import sys
import urllib.request
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path

import pytest

from designopt import cli
from designopt.cli import app

COMMANDS = {point.name: point for point in entry_points(group=app.COMMAND_GROUP)}
WRITES = {
    "export": ["cad/finger.dxf", "cad/finger-parts.csv"],
    "new": ["my-finger.toml"],
    "optimise": ["better/report.html"],
    "render": ["trial/001.png", "trial/frames.csv", "trial/truth.json"],
    "run": ["quick/report.html"],
    "solve": ["four-bar.csv"],
    "sweep": ["out/sweep-table1/result/report.html"],
    "trace": ["finger.json"],
}
"""What the examples leave behind."""
ONE_WORKER = {"sweep": ["--workers", "1"]}
"""It compiles once; `tests/designopt/sweep` has several."""


def examples_of(command: str, capsys: pytest.CaptureFixture[str]) -> list[list[str]]:
    """The examples in a command's --help as words, each from the lines that it stands in."""
    assert cli.run([command, "--help"]) == 0
    paragraphs = capsys.readouterr().out.split("\n\n")
    found = [text.split("Example:\n")[1] for text in paragraphs if "Example:\n" in text]
    assert found
    for text in found:
        assert text.split() == shlex.split(text)
        assert shlex.split(text)[:2] == ["designopt", command]
    return [shlex.split(text)[1:] for text in found]


@pytest.fixture
def gallery(tmp_path, monkeypatch):
    """A folder with the files that the examples are about, to run them in."""
    for folder, name in (("gallery/linkages", "four-bar.toml"), ("gallery/scenes", "finger.toml")):
        shutil.copy(str(files("studies") / folder / name), tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "command", sorted(set(COMMANDS) - {"calibrate", "explore", "front", "see"})
)
def test_the_example_of_a_command_runs(command, gallery, capsys):
    before = {path.name for path in gallery.iterdir()}
    for words in examples_of(command, capsys):
        assert cli.run([*words, *ONE_WORKER.get(command, ())]) == 0
        assert capsys.readouterr().out or command in WRITES
    for name in WRITES.get(command, ()):
        assert (gallery / name).stat().st_size > 0
    assert command in WRITES or {path.name for path in gallery.iterdir()} == before


def test_the_example_of_explore_serves_its_page(gallery, capsys):
    (words,) = examples_of("explore", capsys)
    script = Path(sys.executable).parent / "designopt"
    command = [script, *words, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = re.search(r"http://\S+", process.stdout.readline())
        assert address
        cookies = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        cookies.open(address[0]).close()
        with cookies.open(address[0].partition("?")[0]) as page:
            assert "designopt explore" in page.read().decode()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0
