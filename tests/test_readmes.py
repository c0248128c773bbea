"""The commands in the READMEs can be pasted as they are, one after the other."""

import itertools
import json
import re
import shlex
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import typer

from designopt import cli
from designopt.cli import app
from designopt.study.settings import fields, spec_with
from designopt.study.study import load_study
from studies.models import packaged_finger
from studies.models.spec_files import finger_files

ROOT = Path(__file__).parents[1]
READMES = [ROOT / "README.md", *sorted(ROOT.glob("studies/**/README.md"))]
COMMANDS = {point.name: point for point in entry_points(group=app.COMMAND_GROUP)}
MAIN_JOB = "out/finger"
"""What the first set-up command of the README leaves behind."""
OTHERS = ("python3", ".", "pip")
CHEAP = ("list", "new", "solve", "trace", "export")


def pasted(readme: Path) -> Iterator[list[str]]:
    """The commands in a README's blocks, as words."""
    text = readme.read_text(encoding="utf-8")
    for kind, block in re.findall(r"^```(\w*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        assert kind in ("sh", "toml", "pycon")  # whatever else stands in a block is no command
        lines = block.replace("\\\n", "").splitlines() if kind == "sh" else []
        yield from (shlex.split(line) for line in lines if not line.startswith("#"))


def mentioned(readme: Path) -> Iterator[list[str]]:
    """The commands with arguments in its sentences."""
    text = readme.read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    spans = re.findall(r"`(designopt [^`]+)`", prose)
    yield from (words for words in map(str.split, spans) if len(words) > 2)


def written(readme: Path) -> set[str]:
    """The files that its commands ``designopt new`` and ``calibrate lens`` write."""
    made = [parsed(words) for words in pasted(readme) if words[:2] == ["designopt", "new"]]
    lenses = [parsed(words) for words in pasted(readme) if words[1:3] == ["calibrate", "lens"]]
    files = {given["file"] or f"{given['name']}.toml" for given in made if given["name"]}
    return files | {str(given["out"]) for given in lenses}


def parsed(words: list[str]) -> dict:
    """The parameters of a designopt command, as the command line reads them."""
    command, app = COMMANDS[words[1]].load(), typer.Typer()
    if isinstance(command, typer.Typer):
        group = typer.main.get_group(command)
        return group.commands[words[2]].make_context(words[2], words[3:]).params
    app.command()(command)
    return typer.main.get_command(app).make_context(words[1], words[2:]).params


@pytest.mark.parametrize("readme", READMES, ids=lambda path: path.parent.name)
def test_commands_are_read_and_name_what_there_is(readme):
    for words in (*pasted(readme), *mentioned(readme)):
        if words[0] != "designopt":
            assert words[0] in OTHERS, words
            continue
        given = parsed(words)
        if study := given.get("study"):
            settings = list(given.get("settings") or [])
            if objectives := given.get("objectives"):
                study = f"{study}-front"
                settings.append(f"objectives={json.dumps(objectives.split(','))}")
            spec = load_study(study).spec
            spec_with(spec, settings, study=study)
            keys = {key for key, _, _ in fields(spec)}
            assert {one.partition("=")[0] for one in given.get("vary") or []} <= keys
        for name in (word.rpartition("=")[2] for word in words[2:] if word.endswith(".toml")):
            made = name.startswith(f"{MAIN_JOB}/specs/") or name in written(readme)
            assert (ROOT / name).is_file() or made, words


def test_no_command_finds_the_folder_of_another():
    """A result is never overwritten, so each has a folder of its own, in all READMEs together."""
    made = [MAIN_JOB]
    for words in itertools.chain.from_iterable(map(pasted, READMES)):
        if words[0] == "designopt" and words[1] in ("run", "export", "front"):
            given, end = parsed(words), "-front" if words[1] == "front" else ""
            made.append(str(given["out"] or Path("out") / f"{given['study']}{end}"))
    assert len(made) == len(set(made))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The root folder after the main job, as far as commands that read need it."""
    (tmp_path / "studies").symlink_to(ROOT / "studies")
    specs = tmp_path / MAIN_JOB / "specs"
    specs.mkdir(parents=True)
    for file in finger_files(packaged_finger()):
        (specs / file.name).write_text(str(file.content), encoding="utf-8")
    document = {"study": "finger", "spec": load_study("finger").spec().model_dump(mode="json")}
    (specs.parent / "results.json").write_text(json.dumps(document))
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_cheap_commands_run():
    """Each once; of a sweep a few places only. Results of other commands are not there."""
    few = re.compile(r"(?<=:)\d+$")
    commands = {tuple(words) for readme in READMES for words in pasted(readme)}
    for words in sorted(words for words in commands if words[0] == "designopt"):
        made = [word for word in words[2:3] if word.startswith("out/")]
        if words[1] in CHEAP and all(word.startswith(MAIN_JOB) for word in made):
            assert cli.run([few.sub("4", word) for word in words[1:]]) == 0, words


@pytest.mark.parametrize("readme", READMES, ids=lambda path: path.parent.name)
def test_links_lead_to_files(readme):
    links = re.findall(r"\]\(([^):#]+)\)", readme.read_text(encoding="utf-8"))
    assert [link for link in links if not (readme.parent / link).exists()] == []
