"""Reference of every study's settings, from its spec."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from pydantic_core import PydanticUndefined

from designopt.errors import UserError
from designopt.io.spec import Spec
from designopt.study.study import installed_studies
from docs.generator.formats import HEAD, bounds_words, kind_words, meanings, unit_of
from docs.generator.markup import docstring_text, table

INTRO = """\
# Settings of studies

`designopt new NAME` writes the settings of the study `NAME` as a file with comments; `designopt run
NAME --config FILE` reads it, and `--set KEY=VALUE` sets single ones over the file. Keys of nested
tables are joined by dots: `body.thickness` is `thickness` in the table `[body]`. What is left out
has its default.

"""


def setting_rows(model: type[Spec], prefix: str, given: Spec | None) -> Iterator[list[str]]:
    """A row for every key; nested keys are joined by dots, with the defaults of their table."""
    for name, field in model.model_fields.items():
        kind: Any = field.annotation
        value = field.get_default(call_default_factory=True)
        value = value if given is None else getattr(given, name)
        if isinstance(kind, type) and issubclass(kind, Spec):
            own = value if isinstance(value, Spec) else None
            yield from setting_rows(kind, f"{prefix}{name}.", own)
            continue
        limits = list(field.metadata)
        words = kind_words(kind, limits)
        meaning, unit = unit_of(docstring_text(meanings(model)[name]))
        default = "–" if value in (None, PydanticUndefined) else f"`{_written(value)}`"
        yield [f"`{prefix}{name}`", words, unit, default, bounds_words(limits), meaning]


def _written(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        value = [one.model_dump(mode="json") if isinstance(one, Spec) else one for one in value]
    return json.dumps(value, ensure_ascii=False, default=str)


def settings_page() -> str:
    """The settings of all installed studies."""
    text = INTRO
    for name, study in installed_studies():
        assert not isinstance(study, UserError), study
        rows = list(setting_rows(study.spec, "", None))
        text += f"## `{name}` {{#{name}}}\n\n{study.purpose}.\n\n{table(HEAD, rows)}\n"
    return text
