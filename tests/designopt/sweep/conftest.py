"""The plug-in's studies, as if their package were installed."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]

ENTRY_POINTS = """
[designopt.studies]
swept = tests.designopt.sweep.plugin:SWEPT
batched = tests.designopt.sweep.plugin:BATCHED
"""


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    """The studies, installed for this process and for those that it starts."""
    package = tmp_path_factory.mktemp("installed") / "swept-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: swept\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text(ENTRY_POINTS)
    with pytest.MonkeyPatch.context() as patch:
        for folder in (ROOT, package.parent):
            patch.syspath_prepend(folder)
        patch.setenv("PYTHONPATH", f"{ROOT}:{package.parent}")
        yield


@pytest.fixture
def installed(plugin, monkeypatch, tmp_path):
    """A working folder, with the studies installed."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    return work
