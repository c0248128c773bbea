"""The settings of a study in a file: written with comments, and read for ``--config``."""

from __future__ import annotations

import itertools
import json
import os
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic_core import PydanticUndefined

from designopt.design_kind import kind_of_tables
from designopt.errors import UserError
from designopt.io.files import read_toml
from designopt.io.spec import Spec
from designopt.io.toml_writing import format_toml
from designopt.study.result_folders import DOCUMENT, recorded_spec
from designopt.study.settings import NO_CONFIG, Config, fields
from designopt.study.study import Study

WIDTH = 96
"""Columns of a comment, without its mark."""

BOUNDS = {
    "minimum": ">= {}",
    "exclusiveMinimum": "> {}",
    "maximum": "<= {}",
    "exclusiveMaximum": "< {}",
    "multipleOf": "a multiple of {}",
    "minItems": "at least {} of them",
    "maxItems": "at most {} of them",
}
"""Words for the bounds in a JSON schema."""

HEAD = """\
{purpose}

The settings of the study with their defaults. Change what is to differ; what is left out, or is
behind a #, has its default. Then

    designopt run {name} --config FILE

with --set KEY=VALUE for single settings, which lie over the file."""


def read_config(paths: Sequence[Path], study: Study) -> Config:
    """The settings in the file that ``--config`` names; none where it names no file.

    Args:
        paths: a TOML file such as `format_settings` writes; or the ``results.json`` of a run, whose
            ``spec`` is taken, or its folder.
        study: whose settings they are.

    Raises:
        UserError: there are two files, or it cannot be read or holds something else. Whether its
            keys and values are valid is found by `settings.spec_with`.
    """
    if not paths:
        return NO_CONFIG
    path, *others = paths
    if others:
        raise UserError(f"--config {others[0]}: {path} is named, too; name one file")
    if os.path.isdir(path):
        path = path / DOCUMENT
    if path.suffix == ".json":
        name, tables = recorded_spec(path)
        if name not in (study.name, study.front_of):
            raise UserError(
                f"{path}: it has settings of the study '{name}' and not of '{study.name}'; name a "
                "result of this one"
            )
        return Config(tables, str(path))
    tables = read_toml(path, "study")
    kind = kind_of_tables(tables)
    if kind is not None and kind.table not in study.spec.model_fields:
        raise UserError(
            f"{path}: it describes a {kind.name} and no settings of the study '{study.name}'; "
            f"{kind.command} takes it"
        )
    return Config(tables, str(path))


def format_settings(study: Study, given: Spec | None = None) -> str:
    """The text of a file with every setting of a study: its value, meaning and bounds.

    Args:
        study: whose settings they are.
        given: the values; the defaults, where there are any, by default.

    Example:
        >>> from designopt.study.study import load_study
        >>> lines = format_settings(load_study("linkage-stability")).splitlines()
        >>> lines[lines.index("decades = 2.0") - 1]
        '# decades over which the lengths of random linkages spread; >= 0.1, <= 6'
    """
    return format_spec(HEAD.format(purpose=study.purpose, name=study.name), study.spec, given)


def format_spec(head: str, model: type[Spec], given: Spec | None = None) -> str:
    """The text of a file with every key of a spec: its value, meaning and bounds.

    Keys without a value, or for which it is ``None``, are written as comments.

    Args:
        head: what stands first, as a comment.
        model: of the whole file.
        given: the values; the defaults, where there are any, by default.
    """
    schema = model.model_json_schema()
    tables: dict[str, list[str]] = {"": []}
    for key, default, meaning in fields(model, default=given):
        table, _, name = key.rpartition(".")
        for outer in itertools.accumulate(table.split("."), "{}.{}".format):
            tables.setdefault(outer, [])
        bounds = _bounds(_schema_of(key, schema))
        words = "; ".join([meaning, ", ".join(bounds)] if bounds else [meaning])
        comment = textwrap.fill(words, WIDTH, break_on_hyphens=False)
        if default is PydanticUndefined:
            comment += "; must be given"
        if default in (None, PydanticUndefined):
            line = format_toml({}, f"{comment}\n{name} =")
        else:
            line = format_toml({name: default}, comment)
        tables[table].append(line)
    text = format_toml({}, head)
    for table, lines in tables.items():
        if table and lines:
            meaning = _schema_of(table, schema).get("description")
            lines = [format_toml({}, meaning) if meaning else "", f"[{table}]\n", *lines]
        text += "\n" * bool(lines) + "".join(lines)
    return text


def _schema_of(key: str, schema: dict[str, Any]) -> dict[str, Any]:
    """The part of a spec's JSON schema that is of one key."""
    part = schema
    for name in key.split("."):
        table = part.get("$ref", "").removeprefix("#/$defs/")
        part = schema.get("$defs", {}).get(table, part)["properties"][name]
    return part


def _bounds(schema: dict[str, Any]) -> list[str]:
    """What the JSON schema of a key allows, in words."""
    for choice in schema.get("anyOf", ()):  # of a key that may be none
        schema = schema | choice if choice.get("type") != "null" else schema
    words = [sign.format(f"{schema[key]:.12g}") for key, sign in BOUNDS.items() if key in schema]
    if "enum" in schema:
        words.append(" or ".join(json.dumps(value) for value in schema["enum"]))
    if isinstance(items := schema.get("items"), dict) and (each := _bounds(items)):
        words.append(f"each {', '.join(each)}")
    return words
