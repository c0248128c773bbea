"""Files to begin with, which ``designopt new`` writes: every study's settings, and further ones."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import entry_points
from typing import Any

from designopt.errors import UserError, load_plug_in
from designopt.io.spec import Spec
from designopt.study.settings import spec_with
from designopt.study.settings_file import format_settings
from designopt.study.study import installed_studies

TEMPLATE_GROUP = "designopt.templates"
"""Entry points of this group are sequences of `FileTemplate`s."""


@dataclass(frozen=True)
class FileTemplate:
    """A commented file that a person copies and changes.

    Attributes:
        name: what it is called after ``designopt new``; no study is called so.
        purpose: one line.
        command: what takes it, without the file at its end.
        content: its text; with the settings it is called with, where it has any.
        spec: its settings, which ``--set`` changes; ``None`` if it has none.
        prints: further files that are written beside it, from the settings, by their ending.
    """

    name: str
    purpose: str
    command: str
    content: Callable[..., str]
    spec: type[Spec] | None = None
    prints: Mapping[str, Callable[[Any], bytes]] = field(default_factory=dict)

    def given(self, assignments: Sequence[str]) -> list[Spec]:
        """What `content` and `prints` are called with: the settings, where any are asked for.

        Args:
            assignments: ``key=value`` texts.

        Raises:
            UserError: it has no settings, or these are wrong.
        """
        if not assignments and not self.prints:
            return []
        if self.spec is None:
            raise UserError(
                f"--set {assignments[0]}: '{self.name}' has no settings; change the file itself"
            )
        shown_by = "designopt new {} -"
        return [spec_with(self.spec, assignments, study=self.name, shown_by=shown_by)]


def installed_templates() -> Iterator[tuple[str, FileTemplate | UserError]]:
    """Every template by name, settings first; what cannot be loaded comes as its error."""
    for name, study in installed_studies():
        if isinstance(study, UserError):
            yield name, study
            continue
        purpose, command = f"settings: {study.purpose}", f"designopt run {name} --config"
        content = partial(format_settings, study)
        yield name, FileTemplate(name, purpose, command, content, study.spec)
    for point in sorted(entry_points(group=TEMPLATE_GROUP), key=lambda point: point.name):
        try:
            templates = load_plug_in(point, "the templates")
        except UserError as error:
            yield point.name, error
            continue
        for template in templates:
            yield template.name, template


def load_template(name: str) -> FileTemplate:
    """The installed template of that name.

    Raises:
        UserError: there is none of that name, or its package cannot be imported.
    """
    found = dict(installed_templates())
    if name not in found:
        close = difflib.get_close_matches(name, found, n=1)
        hint = f"did you mean '{close[0]}'?" if close else "'designopt new --list' shows all names"
        raise UserError(f"NAME: no template is named '{name}'; {hint}")
    template = found[name]
    if isinstance(template, UserError):
        raise template
    return template
