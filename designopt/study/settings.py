"""Settings of a study: declared, set by ``--set key=value``, and whether targets apply to them."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import pydantic
from pydantic_core import PydanticUndefined

from designopt.errors import UserError, shortened
from designopt.io.files import DEEPEST, is_too_deep
from designopt.io.spec import Spec


class Config(NamedTuple):
    """Settings from a file, which lie over the defaults; see `settings_file.read_config`.

    Attributes:
        tables: nested, as in ``results.json``.
        source: the file, for messages; empty if there is none.
    """

    tables: Mapping[str, Any]
    source: str


NO_CONFIG = Config({}, "")


def setting(
    default: Any, meaning: str, *, scales: bool = False, free: bool = False, **bounds: Any
) -> Any:
    """A field of a study's spec.

    Targets apply to a run with the default settings (`targets_waived`), but for two kinds.

    Args:
        default: its value where none is given.
        meaning: what it is, with its unit in brackets.
        scales: a number that makes a result surer the larger it is: targets apply from the default
            on upwards.
        free: no target depends on it.
        bounds: as `pydantic.Field` takes them, such as ``ge=1, le=1000``.

    Example:
        >>> class Spec_(Spec):
        ...     fingers: int = setting(40, "fingers with errors", scales=True, ge=1)
        >>> targets_waived(Spec_(fingers=2)), targets_waived(Spec_(fingers=80))
        ('fingers = 2 is less than 40', '')
    """
    marks: Any = {"scales": scales, "free": free}
    return pydantic.Field(default=default, description=meaning, json_schema_extra=marks, **bounds)  # type: ignore[call-overload]


def distinct(values: list[Any]) -> list[Any]:
    """The values of a setting, if they differ from each other; for pydantic's `AfterValidator`.

    Raises:
        ValueError: two are the same.
    """
    if len(set(values)) < len(values):
        raise ValueError("values must differ from each other")
    return values


def targets_waived(spec: Spec, default: Spec | None = None, prefix: str = "") -> str:
    """Why the targets of a study do not apply to a run with these settings; empty if they do.

    Args:
        spec: the settings.
        default: what they are compared with, in place of the model's defaults.
        prefix: of their keys.
    """
    for name, info in type(spec).model_fields.items():
        value, key = getattr(spec, name), prefix + name
        wanted = (
            info.get_default(call_default_factory=True)
            if default is None
            else getattr(default, name)
        )
        extra = info.json_schema_extra
        marks = extra if isinstance(extra, dict) else {}
        if marks.get("free") or value == wanted or wanted is PydanticUndefined:
            continue
        if isinstance(value, Spec):
            if why := targets_waived(value, wanted, f"{key}."):
                return why
        elif not marks.get("scales"):
            return f"{key} is not the default"
        elif value < wanted:
            return f"{key} = {value} is less than {wanted}"
    return ""


def spec_with(
    model: type[Spec],
    assignments: Iterable[str],
    *,
    study: str,
    config: Config = NO_CONFIG,
    shown_by: str = "designopt list {}",
) -> Spec:
    """The spec of ``model`` with ``assignments`` in place of its defaults.

    Args:
        model: the study's spec.
        assignments: ``a.b=value`` texts; a value is read as TOML, and as plain text where it is
            not TOML, so ``lens.name=wide`` needs no quotes.
        study: the study's name, for the messages.
        config: settings between the defaults and the assignments.
        shown_by: the command that shows the keys, with braces for the name.

    Raises:
        UserError: every fault at once, in one line.
    """
    overrides: dict[str, Any] = {}
    for text in assignments:
        _assign(overrides, text, shown_by.format(study))
    return spec_of_tables(model, overrides, study=study, config=config, shown_by=shown_by)


def spec_of_tables(
    model: type[Spec],
    tables: Mapping[str, Any],
    *,
    study: str = "STUDY",
    config: Config = NO_CONFIG,
    shown_by: str = "designopt list {}",
) -> Spec:
    """The spec of ``model`` with nested ``tables`` of settings in place of its defaults.

    Args:
        model: the study's spec.
        tables: nested settings.
        study: the study's name, for the messages.
        config: settings between the defaults and the tables.
        shown_by: the command that shows the keys, with braces for the name.

    Raises:
        UserError: every fault at once, in one line.
    """
    spec, faults = _validated(model, _merge(config.tables, tables))
    if spec is not None:
        return spec
    # What is wrong without the tables, too, is a fault of the file.
    _, before = _validated(model, config.tables) if config.source else (None, {})
    in_file = "; ".join(text for text in faults if text in before)
    words = [f"{config.source}: {in_file}"] if in_file else []
    for text, key in faults.items():
        if text not in before:
            words.append(f"--set {text}" if key else text)
    raise UserError(
        f"{'; '.join(words)} ('{shown_by.format(study)}' shows every key with its default)"
    )


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


def fields(
    model: type[Spec], prefix: str = "", default: Spec | None = None
) -> Iterator[tuple[str, Any, str]]:
    """Every key of a spec as ``(key, default, description)``, nested keys joined by dots.

    The default of a key that has none is ``pydantic_core.PydanticUndefined``. Of a nested spec, the
    defaults are those of the field that holds it.
    """
    for name, info in model.model_fields.items():
        kind, own = info.annotation, info.get_default(call_default_factory=True)
        own = own if default is None else getattr(default, name)
        if isinstance(kind, type) and issubclass(kind, Spec):
            yield from fields(kind, f"{prefix}{name}.", own if isinstance(own, Spec) else None)
        else:
            yield prefix + name, own, info.description or ""


def _validated(
    model: type[Spec], tables: Mapping[str, Any]
) -> tuple[Spec | None, dict[str, tuple[int | str, ...]]]:
    """The spec with these tables over its defaults, or what is wrong, with the keys."""
    try:
        return model.model_validate(_over_defaults(model, tables)), {}
    except pydantic.ValidationError as error:
        return None, {_fault(model, details): details["loc"] for details in error.errors()}


def _over_defaults(model: type[Spec], tables: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables laid over what the defaults of their fields set in them."""
    laid = dict(tables)
    for name, info in model.model_fields.items():
        if isinstance(info.default, Spec) and isinstance(laid.get(name), Mapping):
            table = _merge(info.default.model_dump(exclude_unset=True), laid[name])
            laid[name] = _over_defaults(type(info.default), table)
    return laid


def _merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    both = {
        key: _merge(base[key], over[key])
        for key in base.keys() & over.keys()
        if isinstance(base[key], Mapping) and isinstance(over[key], Mapping)
    }
    return {**base, **over, **both}


def _assign(overrides: dict[str, Any], text: str, shown_by: str) -> None:
    key, equals, value = text.partition("=")
    path = key.strip().split(".")
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise UserError(f"--set {text!a}: not UTF-8; write it in UTF-8") from error
    if not all(path):
        raise UserError(
            f"--set {text}: a key is missing; write --set key=value ('{shown_by}' shows the keys)"
        )
    if not equals:
        raise UserError(
            f"--set {text}: a value is missing; write --set {text}=VALUE "
            f"('{shown_by}' shows the defaults)"
        )
    try:
        document = tomllib.loads(f"value = {value}")
    except (tomllib.TOMLDecodeError, RecursionError):
        document = {}
    parsed = document["value"] if set(document) == {"value"} else value
    if len(path) > DEEPEST or is_too_deep(parsed):
        raise UserError(
            f"--set {shortened(text)}: nested too deeply for a setting "
            f"('{shown_by}' shows the keys)"
        )
    place = overrides
    for part in path[:-1]:
        place = place.setdefault(part, {})
        if not isinstance(place, dict):
            raise UserError(
                f"--set {text}: '{part}' was already given a value; set its parts or the whole"
            )
    place[path[-1]] = parsed


def _fault(model: type[Spec], details: Any) -> str:
    path = [str(part) for part in details["loc"]]
    key, given = ".".join(path), details["input"]
    if details["type"] == "extra_forbidden":
        return f"{key}: unknown key; {_known_keys(model, path)}"
    if details["type"] == "missing":
        return f"{key}=…: this key is missing and has no default; give it a value"
    if details["type"] == "model_type":
        return f"{key}=…: it has keys of its own; {_known_keys(model, [*path, ''])}"
    wanted = details["msg"].removeprefix("Value error, ")
    wanted = wanted[0].lower() + wanted[1:]
    # Of a table whose keys contradict each other the message has those that do.
    value = "" if isinstance(given, Mapping) else f"={shortened(str(given))}"
    return f"{key}{value}: {wanted}" if key else wanted


def _known_keys(model: type[Spec], path: Sequence[str]) -> str:
    """What an unknown key may have been meant for, or else what there is in its table."""
    known = [name for name, _, _ in fields(model)]
    table = "".join(f"{part}." for part in path[:-1])
    inside = [key.removeprefix(table) for key in known if key.startswith(table)]
    names = list(dict.fromkeys(key.split(".")[0] for key in inside))
    close = [table + name for name in difflib.get_close_matches(path[-1], names, n=1)]
    # Perhaps the name is right and its table was forgotten, or mistaken.
    close = close or [key for key in known if key.split(".")[-1] == path[-1]]
    if close:
        return f"did you mean {' or '.join(repr(key) for key in close)}?"
    there = (name if name in inside else f"{name}.*" for name in names)
    return f"the keys{f' of {table[:-1]}' if table else ''} are {', '.join(there)}"
