"""The command ``designopt explore``: its faults, its window, its end."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from designopt import cli
from designopt.explore import desktop
from tests.commands import check_command_refused, finished, refused_cases
from tests.designopt.explore.hands import served
from tests.designopt.tables import cases

FOUR_BAR = str(Path(__file__).parents[3] / "studies" / "gallery" / "linkages" / "four-bar.toml")
COMMAND = ["-m", "designopt", "explore", FOUR_BAR]


@pytest.mark.parametrize(("line", "words"), refused_cases("explore"))
def test_faults_are_one_line(capsys, monkeypatch, tmp_path, line, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    check_command_refused(capsys, f"explore {line.format(four_bar=FOUR_BAR)}", words)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


NO_WINDOW = r"error: no window can be opened here; use --web and a browser \(.*%s.*\)\n"


@pytest.mark.parametrize(("variables", "reason"), cases("no_window"))
def test_where_no_window_opens_the_page_is_named(capsys, monkeypatch, tmp_path, variables, reason):
    for name, content in cases("toolkits"):
        (tmp_path / f"{name}.py").write_text(content)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert cli.run(["explore", FOUR_BAR]) == 2
    assert re.fullmatch(NO_WINDOW % reason, capsys.readouterr().err)


def test_a_window_system_that_does_not_answer_is_the_same(capsys, monkeypatch):
    monkeypatch.setattr(desktop, "PATIENCE", 0.01)
    assert cli.run(["explore", FOUR_BAR]) == 2
    assert re.fullmatch(NO_WINDOW % "does not answer within 0.01 s", capsys.readouterr().err)


def test_an_interrupt_ends_the_page_quietly(tmp_path):
    with served(FOUR_BAR, tmp_path) as address:
        assert address.endswith("/")


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [1.0, 2.0, 4.0])
def test_an_interrupt_ends_it_quietly_at_any_moment(tmp_path, seconds):
    """From the first import of its own on, and while it compiles."""
    with subprocess.Popen(
        [sys.executable, *COMMAND, "--web", "--port", "0", "--no-cache"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode in (0, 130)
    assert err in ("", "interrupted; no file is half-written\n")


DESKTOP = """
import sys
from matplotlib import pyplot
from designopt import cli
from designopt.explore import desktop

def close_soon(figure, title, show=desktop.show_window):
    canvas = figure.canvas
    timer = canvas.new_timer(interval=300)
    timer.single_shot = True
    timer.add_callback(lambda: (print(title, *canvas.get_width_height()), pyplot.close(figure)))
    timer.start()
    show(figure, title)

desktop.show_window = close_soon
sys.exit(cli.run(["explore", *sys.argv[1:]]))
"""


def test_a_window_opens_on_a_desktop(tmp_path):
    xvfb = shutil.which("xvfb-run")
    if xvfb is None:
        pytest.skip("no xvfb-run here, and so no desktop to open a window on")
    pytest.importorskip("tkinter", reason="Python was built without Tk")
    command = [xvfb, "-a", sys.executable, "-c", DESKTOP, FOUR_BAR]
    variables = os.environ | {"MPLBACKEND": "tkagg"}
    done = finished(command, cwd=tmp_path, env=variables, timeout=200)
    assert (done.returncode, done.stderr) == (0, "")
    title, width, height = done.stdout.split()
    assert title == "four-bar"
    # A desktop may give it less than it asks for, but not of another shape.
    assert int(width) > 1000
    assert int(width) / int(height) == pytest.approx(1280 / 760, rel=0.01)
