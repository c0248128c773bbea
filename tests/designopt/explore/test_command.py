"""The command ``designopt explore``: its faults, its window, its end."""

import os
import random
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
from designopt.explore.server import listen
from tests.designopt.explore.hands import environment

FOUR_BAR = str(Path(__file__).parents[3] / "studies" / "gallery" / "linkages" / "four-bar.toml")
COMMAND = [sys.executable, "-m", "designopt", "explore", FOUR_BAR]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([FOUR_BAR, "--port", "0"], ["--port 0", "add --web"]),
        ([FOUR_BAR, "--web", "--port", "70000"], ["--port", "65535"]),
        (
            [FOUR_BAR, "--out", "file/new"],
            ["--out file/new", "file is no folder", "name a folder that can"],
        ),
        ([FOUR_BAR, "--web", "--port", "0", "--set", "a=1"], ["--set a=1", "only a study"]),
        (["no.toml", "--web", "--port", "0"], ["no.toml", "cannot be read"]),
        (["sqare", "--web", "--port", "0"], ["STUDY", "'sqare'"]),
        ([], ["STUDY|FILE"]),
    ],
)
def test_faults_are_one_line(capsys, monkeypatch, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert cli.run(["explore", *arguments]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("error: ")
    assert shown.err.count("\n") == 1
    for word in words:
        assert word in shown.err


def test_a_port_in_use_is_said(capsys):
    with listen(0) as listener:
        port = str(listener.getsockname()[1])
        assert cli.run(["explore", FOUR_BAR, "--web", "--port", port]) == 2
    assert f"--port {port}: " in capsys.readouterr().err


NO_WINDOW = r"error: no window can be opened here; use --web and a browser \(.*%s.*\)\n"
TOOLKITS = {
    "aborts": "import os; os.write(2, b'Could not load it.'); os.abort()",
    "dies": "import os; os._exit(3)",
    "exits": "raise SystemExit('Unable to access the X Display')",
    "fails": "raise AttributeError('no display')",
    "without_canvas": "",
}


@pytest.mark.parametrize(
    ("backend", "reason"),
    [
        ("agg", "no window system"),
        ("webagg", "no window system"),
        ("module://nosuch", "No module named 'nosuch'"),
        ("module://aborts", "Could not load it"),
        ("module://dies", "with code 3"),
        ("module://exits", "X Display"),
        ("module://fails", "no display"),
        ("module://without_canvas", "FigureCanvas"),
    ],
)
def test_where_no_window_opens_the_page_is_named(capsys, monkeypatch, tmp_path, backend, reason):
    for name, content in TOOLKITS.items():
        (tmp_path / f"{name}.py").write_text(content)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setenv("MPLBACKEND", backend)
    assert cli.run(["explore", FOUR_BAR]) == 2
    assert re.fullmatch(NO_WINDOW % reason, capsys.readouterr().err)


def test_a_window_system_that_does_not_answer_is_the_same(capsys, monkeypatch):
    monkeypatch.setattr(desktop, "PATIENCE", 0.01)
    assert cli.run(["explore", FOUR_BAR]) == 2
    assert re.fullmatch(NO_WINDOW % "does not answer within 0.01 s", capsys.readouterr().err)


@pytest.mark.parametrize("display", [None, ":99999"])
def test_a_toolkit_that_finds_no_display_is_the_same(display):
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    bare = {name: value for name, value in os.environ.items() if name not in displays}
    bare |= {"MPLBACKEND": "tkagg"} | ({} if display is None else {"DISPLAY": display})
    done = subprocess.run(COMMAND, env=bare, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(NO_WINDOW % "", done.stderr)


def test_an_interrupt_ends_the_page_quietly(tmp_path):
    with subprocess.Popen(
        [*COMMAND, "--web", "--port", "0"],
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert re.search(r"http://127\.0\.0\.1:\d+/", process.stdout.readline())
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")


@pytest.mark.slow
def test_an_interrupt_ends_it_quietly_at_any_moment(tmp_path):
    """From the first import of its own to the page that is served."""
    chances, served = random.Random(0), 0
    while served < 3:
        with subprocess.Popen(
            [*COMMAND, "--web", "--port", "0", "--no-cache"],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            time.sleep(chances.uniform(1.0, 4.0 + 4.0 * served))
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=60)
        assert process.returncode in (0, 130)
        assert err in ("", "interrupted; no file is half-written\n")
        served += bool(out)


DESKTOP = """
import sys
from matplotlib import pyplot
from designopt import cli
from designopt.exploring import desktop

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
    done = subprocess.run(
        [xvfb, "-a", sys.executable, "-c", DESKTOP, FOUR_BAR],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
        env=environment() | {"MPLBACKEND": "tkagg"},
    )
    assert (done.returncode, done.stderr) == (0, "")
    title, width, height = done.stdout.split()
    assert title == "four-bar"
    # A desktop may give it less than it asks for, but not of another shape.
    assert int(width) > 1000
    assert int(width) / int(height) == pytest.approx(1280 / 760, rel=0.01)
