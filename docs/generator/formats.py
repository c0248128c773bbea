"""Reference of the files that people write, from their pydantic models."""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.resources import files
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from designopt.io.spec import Spec
from designopt.io.spec_files import LARGEST, SMALLEST
from docs.generator.markup import docstring_text, table


@dataclass(frozen=True)
class FileFormat:
    """A kind of file.

    Attributes:
        page: name of its page.
        title: of the page.
        model: module and class of the whole file.
        words: what such a file is, what makes and what reads it.
        example: a file in ``studies``; empty if there is none.
    """

    page: str
    title: str
    model: str
    words: str
    example: str = ""

    def load(self) -> type[Spec]:
        """Its model."""
        module, _, name = self.model.partition(":")
        return getattr(import_module(module), name)


FORMATS = (
    FileFormat(
        "linkage",
        "Linkage files",
        "kinematics.io.sketch:Sketch",
        "A planar linkage as a sketch: joints roughly where they are, which also chooses the "
        "assembly; bodies that join them; exact lengths where they matter; what is driven. "
        "`designopt new four-bar` writes one; `solve`, `explore`, `export` and `optimise` read it; "
        "in Python `kinematics.read_linkage` and `write_linkage`.",
        "gallery/linkages/four-bar.toml",
    ),
    FileFormat(
        "scene",
        "Scene files",
        "optics.scene.file:SceneFile",
        "A camera, mirrors, pads and what stands in the way, in the section of the finger, and "
        "frames that move. All coordinates are those of the pose in which every joint angle is 0. "
        "`designopt new scene` writes one; `trace`, `render`, `explore`, `export` and `optimise` "
        "read it; in Python `optics.read_scene` and `write_scene`.",
        "gallery/scenes/finger.toml",
    ),
    FileFormat(
        "chamber",
        "Chamber files",
        "optics.chamber.file:ChamberFile",
        "The wall of a soft finger's colored chamber, and the pinhole camera that images its "
        "rings (paper A). `designopt new chamber` writes one; `explore`, `export` and `optimise` "
        "read it; in Python `optics.read_chamber` and `write_chamber`. The equations are in "
        "[Imaging a chamber](../theory/chamber.md).",
        "gallery/chambers/chamber.toml",
    ),
    FileFormat(
        "finger",
        "Finger files",
        "studies.models.finger_file:FingerFile",
        "A finger that has been designed: phalanges, pins, spring, links, motor, camera, layers "
        "and mirrors. No number in it follows from another. `designopt run finger` writes it to "
        "`specs/finger.toml` of its result; `render`, `calibrate finger`, `explore`, `export` and "
        "`optimise` read it; in Python `studies.models.read_finger` and `write_finger`. The "
        "*requirements* from which a finger is designed are settings of the study `finger`: see "
        "[Settings of studies](settings.md#finger). The linkage of a *coupled* finger is one bar: "
        "its `[pins]` are `P` at the proximal and `Q` at the distal phalanx, and `K` as below.",
        "models/finger.toml",
    ),
    FileFormat(
        "lens",
        "Lens files",
        "optics.calibration.calibrated:LensFile",
        "A lens that pictures of a board have determined, with the covariance of its numbers. "
        "`designopt calibrate lens` writes it and `calibrate finger` reads it; in Python "
        "`optics.calibration.read_lens` and `write_lens`. The equations are in "
        "[Lenses](../theory/lenses.md).",
    ),
    FileFormat(
        "board",
        "Board files",
        "perception.boards.board:BoardFile",
        "A printed target for calibration. `designopt new board` writes it beside the PDF and SVG "
        "to print, and `calibrate lens` reads it.",
    ),
    FileFormat(
        "sensor",
        "Sensor folders",
        "studies.models.sensor.sensor_folder:SensorFile",
        "A calibrated finger: `sensor.toml`, described here, and `arrays.npz` with the finger's "
        "errors, their covariance and the calibration frames. Beside these tables the file holds "
        "those of a [scene](scene.md). `designopt calibrate finger` writes the folder and "
        "`designopt see` reads it.",
    ),
)

UNITS = (
    "mm per rad² and per rad⁴",
    "mm per squared radian",
    "N mm/rad",
    "N/mm²",
    "px/rad",
    "px/mm",
    "px",
    "mm",
    "rad",
    "degrees",
    "N mm",
    "N",
    "s",
)


def words_of(model: type[Spec]) -> str:
    """A model's docstring as Markdown, without the name of its table, which heads its section."""
    text = docstring_text(inspect.cleandoc(model.__doc__ or ""))
    text = re.sub(r"^`\[[^`]*`(: |; |\.$)", "", text)
    return text[:1].upper() + text[1:]


@cache
def meanings(model: type[Spec]) -> dict[str, str]:
    """What every field is: its description, or the string below it in the class or its bases."""
    found: dict[str, str] = {}
    for base in reversed(model.__mro__):
        if not (issubclass(base, Spec) and base is not Spec):
            continue
        body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, below in zip(body.body, body.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr):
                assert isinstance(field.target, ast.Name)
                found[field.target.id] = inspect.cleandoc(ast.literal_eval(below.value))
    given = {name: info.description for name, info in model.model_fields.items()}
    return found | {name: text for name, text in given.items() if text}


def unit_of(meaning: str) -> tuple[str, str]:
    """A meaning without its unit, and the unit; empty if there is none."""
    for unit in UNITS:
        named = re.compile(rf"(?:^|,? \(|, ){re.escape(unit)}\)?(?=[.;:,)]|$)")
        if named.search(meaning):
            rest = named.sub("", meaning, count=1).strip(" .;:,")
            return (rest[:1].upper() + rest[1:], unit)
    rest = meaning.strip(" .")
    return (rest[:1].upper() + rest[1:], "")


def tables_of(kind: Any) -> Iterator[type[Spec]]:
    """The tables that an annotation holds."""
    if isinstance(kind, type) and issubclass(kind, Spec):
        yield kind
    for part in get_args(kind):
        yield from tables_of(part)


def kind_words(kind: Any, limits: list[Any]) -> str:
    """What is written for a key, such as "list of numbers"; ``limits`` collects its bounds."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        limits.extend(parts[1:])
        return kind_words(parts[0], limits)
    if origin in (Union, UnionType):
        return " or ".join(kind_words(part, limits) for part in parts if part is not NoneType)
    if origin is Literal:
        return " or ".join(f"`{json.dumps(part)}`" for part in parts)
    if origin is tuple and parts[-1] is not Ellipsis:
        return f"[{', '.join(kind_words(part, limits) for part in parts)}]"
    if origin in (list, tuple):
        return f"list of {kind_words(parts[0], limits)}"
    if origin is dict:
        return f"table of {kind_words(parts[1], limits)} by name"
    if isinstance(kind, type) and issubclass(kind, Spec):
        return "table"
    return {float: "number", int: "whole number", bool: "true or false", str: "text"}[kind]


def bounds_words(limits: list[Any]) -> str:
    """Bounds in signs."""
    flat = [one for limit in limits for one in getattr(limit, "metadata", [limit])]
    words = []
    for limit in flat:
        match limit:
            case Ge(ge=least) if least == SMALLEST:
                words.append("> 0")
            case Ge(ge=least) if least != -LARGEST:
                words.append(f"≥ {least:g}")
            case Gt(gt=least):
                words.append(f"> {least:g}")
            case Le(le=most) if most != LARGEST:
                words.append(f"≤ {most:g}")
            case Lt(lt=most):
                words.append(f"< {most:g}")
            case MinLen(min_length=least):
                words.append(f"at least {least} of them")
            case MaxLen(max_length=most):
                words.append(f"at most {most} of them")
    return ", ".join(dict.fromkeys(words))


def default_words(field: FieldInfo) -> str:
    """A key's default as it is written in a file."""
    if field.is_required():
        return "**required**"
    value = field.get_default(call_default_factory=True)
    if value in (None, PydanticUndefined, [], {}, ()) or isinstance(value, Spec):
        return "–"
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def key_rows(model: type[Spec], place: str) -> list[list[str]]:
    """A row for every key of a table: key, type, unit, default, bounds, meaning."""
    rows = []
    for name, field in model.model_fields.items():
        limits = list(field.metadata)
        kind = kind_words(field.annotation, limits)
        if next(tables_of(field.annotation), None) is not None:
            key = field.alias or name
            kind = f"[{kind}](#{anchor(f'{place}.{key}' if place else key)})"
        meaning, unit = unit_of(docstring_text(meanings(model)[name]))
        rows.append(
            [
                f"`{field.alias or name}`",
                kind,
                unit,
                default_words(field),
                bounds_words(limits),
                meaning,
            ]
        )
    return rows


def anchor(place: str) -> str:
    """The name by which a table's section is linked."""
    return place.replace(".", "-").lower()


HEAD = ["Key", "Type", "Unit", "Default", "Bounds", "Meaning"]


def sections(model: type[Spec], place: str, head: str) -> Iterator[str]:
    """The section of a table and those of the tables in it."""
    yield f"## {head} {{#{anchor(place)}}}\n\n{words_of(model)}\n\n"
    yield table(HEAD, key_rows(model, place)) + "\n"
    for name, field in model.model_fields.items():
        key = field.alias or name
        inner = f"{place}.{key}"
        for part in tables_of(field.annotation):
            yield from sections(part, inner, heading(field.annotation, inner))


def heading(annotation: Any, place: str) -> str:
    """How a file begins the table of a place."""
    bare = annotation
    while get_origin(bare) in (Annotated, Union, UnionType):
        bare = next(part for part in get_args(bare) if part is not NoneType)
    if get_origin(bare) in (list, tuple):
        return f"`[[{place}]]`"
    return f"`[{place}.NAME]`" if get_origin(bare) is dict else f"`[{place}]`"


def format_page(file: FileFormat) -> str:
    """The page of a kind of file."""
    model = file.load()
    text = f"# {file.title}\n\n{file.words}\n\n"
    if file.example:
        lines = (files("studies") / file.example).read_text(encoding="utf-8")
        text += f'??? example "{file.example.rpartition("/")[2]}"\n\n'
        text += textwrap.indent(f"```toml\n{lines.strip()}\n```\n", "    ") + "\n"
    text += table(HEAD, key_rows(model, "")) + "\n"
    for name, field in model.model_fields.items():
        key, parts = field.alias or name, list(tables_of(field.annotation))
        for part in parts:
            text += "".join(sections(part, key, heading(field.annotation, key)))
    return text
