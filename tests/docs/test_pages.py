"""Mark-up, commands, names, links and versions of the documentation."""

import json
import re
from importlib.metadata import entry_points
from pathlib import Path

import nbformat
import pytest

import docs.generator.__main__ as generator
from designopt.cli.app import COMMAND_GROUP
from docs.generator.api import Reference, public_names, stubs
from docs.generator.commands import commands, commands_page
from docs.generator.links import faults
from docs.generator.markup import math_to_mathml, plain, table
from docs.generator.measured import measured_page, results
from docs.generator.notebooks import notebook_page

ROOT = Path(__file__).parents[2]
TUTORIALS = sorted((ROOT / "docs/pages/tutorials").glob("*.ipynb"))


def test_equations_become_mathml_outside_of_code():
    page = math_to_mathml("so $a_1^2$ and `$b$`:\n\n$$x * y$$\n\n```sh\necho $HOME $PATH\n```\n")
    assert page.count("<math") == 2
    assert "<msubsup>" in page
    assert "`$b$`" in page
    assert "echo $HOME $PATH" in page
    assert "*" not in page  # Markdown would read it as emphasis


@pytest.mark.parametrize("path", sorted((ROOT / "docs/pages/theory").glob("*.md")), ids=str)
def test_no_equation_of_the_theory_is_left_as_tex(path):
    page = math_to_mathml(path.read_text(encoding="utf-8"))
    assert not re.findall(r"\$|\\[a-z]{3,}", re.sub(r"`[^`]*`", "", page))
    assert (
        'mathvariant="bold' not in page
    )  # browsers do not draw it: letters are written \\mathbf{n}


def test_an_equation_at_the_start_of_a_line_stays_in_it():
    # Python-Markdown takes a line that begins with <math> for a block.
    assert "\n<span><math" in math_to_mathml("a vector\n$\\mathbf{n}$ and")


def test_tables_and_text_keep_what_markdown_would_read():
    assert table(["a"], [["x | y"]]).splitlines()[-1] == "| x \\| y |"
    assert plain("<b> *c* _d_") == "\\<b\\> \\*c\\* \\_d\\_"


def test_every_command_is_on_its_page_with_its_options():
    page = commands_page()
    listed = {name.split()[0] for name, _, _ in commands()}
    assert listed == set(entry_points(group=COMMAND_GROUP).names)
    section = page.partition("## `designopt solve`")[2].partition("\n## ")[0]
    for option in ("--sweep", "--csv", "--figure", "--rate", "--plan"):
        assert f"`{option}" in section
    assert "designopt solve" in section.partition("Example:")[2]


def test_every_public_name_is_on_the_page_of_its_package():
    reference = Reference()
    for package, stub in stubs():
        names = public_names(stub)
        page = reference.page(package, names)
        for name in names:
            assert f"{{#{name}}}" in page
    page = reference.page("optics", ["find_coverage", "Chamber"])
    assert "angles: Float[Array, '*batch joints']" in page
    assert "**Raises `ValueError`**" in page
    assert ">>> found = find_coverage(scene, jnp.zeros(0))" in page
    assert "`Chamber.imaging_ratio`" in page


def test_links_that_lead_nowhere_are_found(tmp_path):
    (tmp_path / "a.html").write_text(
        '<h1 id="top"></h1><a href="b.html#there"></a><a href="b.html#not"></a>'
        '<a href="c.html"></a><a href="https://example.org/"></a><script src="https://example.org/x.js"></script>'
    )
    (tmp_path / "b.html").write_text('<p id="there"><a href="a.html#top"></a></p>')
    found = list(faults(tmp_path))
    assert [line.partition(": ")[2] for line in found] == [
        "b.html#not names a place that is not there",
        "c.html leads nowhere",
        "<script> loads https://example.org/x.js from elsewhere",
    ]


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorials_are_kept_without_outputs_and_end_with_a_check(path):
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
    assert any("assert " in cell.source for cell in code[-2:])


def test_outputs_stand_below_their_cells(tmp_path):
    cell = nbformat.v4.new_code_cell("1 + 1")
    cell.outputs = [
        nbformat.v4.new_output("stream", name="stdout", text="\x1b[1mtwo\x1b[0m\n"),
        nbformat.v4.new_output("stream", name="stderr", text="noise"),
        nbformat.v4.new_output("execute_result", data={"text/plain": "2"}),
        nbformat.v4.new_output("display_data", data={"image/png": "iVBORw0KGgo="}),
    ]
    page = notebook_page(nbformat.v4.new_notebook(cells=[cell]), "sum", tmp_path)
    assert page.startswith("```python\n1 + 1\n```\n\n```text\ntwo\n```\n\n```text\n2\n```")
    assert "noise" not in page
    assert (tmp_path / "sum-0.png").read_bytes() == b"\x89PNG\r\n\x1a\n"


def test_measured_figures_are_those_of_the_readmes():
    for result in results(ROOT / "docs/measured"):
        if "source" not in result:
            continue  # figures of a run that no README repeats
        readme = (ROOT / result["source"]).read_text(encoding="utf-8")
        for metric in result["metrics"]:
            for number in re.findall(r"\d+\.\d+", metric["value"]):
                assert number in readme, (result["source"], metric)


def test_measured_pages_have_their_topic_only(tmp_path):
    rows = [
        {"topic": "speed", "quantity": "a turn", "value": "2 s"},
        {"topic": "accuracy", "quantity": "a length", "value": "3 mm", "compared_with": "4 mm"},
    ]
    made = {"title": "Bars", "setup": "One.", "command": "x", "date": "d", "machine": "m"}
    (tmp_path / "bars.json").write_text(json.dumps(made | {"metrics": rows}))
    page = measured_page(tmp_path, "accuracy", "# Accuracy\n")
    assert "| a length | 3 mm | 4 mm |" in page
    assert "a turn" not in page


def test_the_newest_version_is_opened(tmp_path):
    for name in ("0.9.0", "0.10.0", "0.2.0"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "index.html").write_text("")
    generator.write_versions(tmp_path)
    page = (tmp_path / "index.html").read_text()
    assert re.findall(r'href="([^"]*)"', page)[0] == "0.10.0/index.html"
    assert 'content="0; url=0.10.0/index.html"' in page
    assert list(faults(tmp_path)) == []


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path, capsys):
    given = ["--unrun", "--out", str(tmp_path / "site"), "--work", str(tmp_path / "work")]
    assert generator.main(given) == 0
    assert "built without a warning" in capsys.readouterr().out
    assert list(faults(tmp_path / "site")) == []
