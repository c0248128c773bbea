"""The command ``designopt explore``: its faults, its browser, its end."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.commands import check_command_refused, refused_cases

FOUR_BAR = str(Path(__file__).parents[3] / "studies" / "gallery" / "linkages" / "four-bar.toml")
COMMAND = ["-m", "designopt", "explore", FOUR_BAR]


@pytest.mark.parametrize(("line", "words"), refused_cases("explore"))
def test_faults_are_one_line(capsys, monkeypatch, tmp_path, line, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    check_command_refused(capsys, f"explore {line.format(four_bar=FOUR_BAR)}", words)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@contextmanager
def explored(*options, **variables):
    """The command's first line on a page's address, and the process, which ends without a word."""
    with subprocess.Popen(
        [sys.executable, *COMMAND, "--port", "0", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | variables,
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        try:
            yield process, line
        finally:
            process.send_signal(signal.SIGINT)
            ended = process.communicate(timeout=60)
    assert (process.returncode, *ended) == (0, "", "")


ADDRESS = r"four-bar: (http://127\.0\.0\.1:\d+/\?token=[\w-]{43}) \(Ctrl-C ends it\)\n"


def test_the_address_is_printed_where_there_is_no_browser():
    with explored("--no-browser") as (_, line):
        assert re.fullmatch(ADDRESS, line)
    with explored(BROWSER="no-such-browser") as (_, line):
        assert re.fullmatch(ADDRESS, line)


def test_a_browser_is_given_a_file_that_leads_to_the_page(tmp_path):
    """The command line of a browser is for everyone's eyes; the file is not."""
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\nprintf %s "$1" > {tmp_path}/given\n')
    browser.chmod(0o755)
    with explored(BROWSER=f"{browser} %s") as (_, line):
        assert line == "four-bar: in your browser; close the page or press Ctrl-C to end\n"
        given = (tmp_path / "given").read_text()
        assert given.startswith("file://")
        file = Path(given.removeprefix("file://"))
        assert file.stat().st_mode & 0o777 == 0o600
        assert re.search(r"url=http://127\.0\.0\.1:\d+/\?token=[\w-]{43}\"", file.read_text())
    assert not file.parent.exists()


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [1.0, 2.0, 4.0])
def test_an_interrupt_ends_it_quietly_at_any_moment(tmp_path, seconds):
    """From the first import of its own on, and while it compiles."""
    with subprocess.Popen(
        [sys.executable, *COMMAND, "--no-browser", "--port", "0", "--no-cache"],
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
