"""``--set key=value`` on the command line, turned into a checked spec."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Iterator
from typing import Any

import pydantic

from designopt.errors import UserError
from designopt.study import Spec


def spec_with(model: type[Spec], assignments: Iterable[str], *, study: str) -> Spec:
    """The spec of ``model`` with ``assignments`` in place of its defaults.

    Args:
        model: the study's spec.
        assignments: ``a.b=value`` texts; a value is read as TOML, and as plain text where it is
            not TOML, so ``lens.name=wide`` needs no quotes.
        study: the study's name, for the messages.

    Raises:
        UserError: every fault at once, in one line.
    """
    overrides: dict[str, Any] = {}
    for text in assignments:
        _assign(overrides, text, study)
    try:
        return model.model_validate(overrides)
    except pydantic.ValidationError as error:
        faults = "; ".join(_fault(model, details) for details in error.errors())
        raise UserError(
            f"{faults} ('designopt list {study}' shows every key with its default)"
        ) from error


def spec_of(model: type[Spec], tables: Any, *, source: str) -> Spec:
    """The spec that an earlier result was made with.

    Args:
        model: the study's spec.
        tables: as they stand in ``results.json``.
        source: where they come from, for messages.

    Raises:
        UserError: this version of the study has other settings.
    """
    try:
        return model.model_validate(tables)
    except pydantic.ValidationError as error:
        raise UserError(
            f"{source}: made by another version of the study, whose settings differ; run it again"
        ) from error


def fields(model: type[Spec], prefix: str = "") -> Iterator[tuple[str, Any, str]]:
    """Every key of a spec as ``(key, default, description)``, nested keys joined by dots.

    The default of a key that has none is ``pydantic_core.PydanticUndefined``.
    """
    for name, info in model.model_fields.items():
        kind = info.annotation
        if isinstance(kind, type) and issubclass(kind, Spec):
            yield from fields(kind, f"{prefix}{name}.")
        else:
            yield prefix + name, info.get_default(call_default_factory=True), info.description or ""


def _assign(overrides: dict[str, Any], text: str, study: str) -> None:
    key, equals, value = text.partition("=")
    path = key.strip().split(".")
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise UserError(f"--set {text!a}: not UTF-8; write it in UTF-8") from error
    if not equals or not all(path):
        raise UserError(
            f"--set {text}: a key is missing; write --set key=value "
            f"('designopt list {study}' shows the keys)"
        )
    try:
        document = tomllib.loads(f"value = {value}")
    except (tomllib.TOMLDecodeError, RecursionError):
        document = {}
    parsed = document["value"] if set(document) == {"value"} else value
    place = overrides
    for part in path[:-1]:
        place = place.setdefault(part, {})
        if not isinstance(place, dict):
            raise UserError(
                f"--set {text}: '{part}' was already given a value; set its parts or the whole"
            )
    place[path[-1]] = parsed


def _fault(model: type[Spec], details: Any) -> str:
    key = ".".join(str(part) for part in details["loc"])
    if details["type"] == "extra_forbidden":
        known = [name for name, _, _ in fields(model)]
        close = difflib.get_close_matches(key, known, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"the keys are {', '.join(known)}"
        return f"--set {key}: unknown key; {hint}"
    if details["type"] == "missing":
        return f"--set {key}=…: this key is missing and has no default; give it a value"
    wanted = details["msg"].removeprefix("Value error, ")
    wanted = wanted[0].lower() + wanted[1:]
    return f"--set {key}={details['input']}: {wanted}" if key else wanted
