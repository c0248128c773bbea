"""Reference of the public names in each package's ``__init__.pyi``, read and not imported."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import griffe

from docs.generator.markup import docstring_text, plain, table

ROOT = Path(__file__).parents[2]
PACKAGES = ("designopt", "kinematics", "optics", "perception", "studies")
SPECIAL = ("__call__",)


def stubs() -> Iterator[tuple[str, Path]]:
    """Every package with public names, by its import path."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("__init__.pyi")):
            yield ".".join(path.parent.relative_to(ROOT).parts), path


def public_names(stub: Path) -> list[str]:
    """What a stub lists in ``__all__``."""
    for node in ast.parse(stub.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return ast.literal_eval(node.value)
    raise ValueError(f"{stub}: it has no __all__")


class Reference:
    """All packages, parsed once."""

    def __init__(self) -> None:
        """Parse the sources."""
        self._loader = griffe.GriffeLoader(search_paths=[ROOT])
        for package in PACKAGES:
            self._loader.load(package)
        self._loader.resolve_aliases()

    def object(self, path: str) -> Any:
        """What a public path names, where it is defined."""
        found: Any = self._loader.modules_collection[path]
        return found.final_target if found.is_alias else found

    def page(self, package: str, names: list[str]) -> str:
        """The page of a package."""
        module = self.object(package)
        text = f"# `{package}`\n\n{_prose(module.docstring)}\n\n"
        objects = {name: self.object(f"{package}.{name}") for name in names}
        rows = [[f"[`{name}`](#{name})", _summary(one)] for name, one in objects.items()]
        text += table(["Name", "What it is"], rows) + "\n"
        return text + "".join(_section(name, one) for name, one in objects.items())


def _section(name: str, one: Any) -> str:
    text = f"## `{name}` {{#{name}}}\n\n"
    if one.kind is griffe.Kind.FUNCTION:
        return text + _signature(name, one) + _described(one)
    if one.kind is griffe.Kind.CLASS:
        constructor = one.all_members.get("__init__")
        if constructor is not None and not _is_field_class(one):
            text += _signature(name, constructor)
        text += _described(one)
        for member in _methods(one):
            text += f"### `{name}.{member.name}` {{#{name}.{member.name}}}\n\n"
            if member.kind is griffe.Kind.FUNCTION:
                text += _signature(member.name, member, "property" in member.labels)
            text += _described(member)
        return text
    return text + f"```python\n{name} = {one.value}\n```\n\n" + _described(one)


def _is_field_class(one: Any) -> bool:
    return "dataclass" in one.labels or "__init__" not in one.members


def _methods(one: Any) -> Iterator[Any]:
    for name, member in one.members.items():
        public = name in SPECIAL or not name.startswith("_")
        if member.is_alias or not public or member.docstring is None:
            continue
        if member.kind is griffe.Kind.FUNCTION or "property" in member.labels:
            yield member


def _signature(name: str, one: Any, is_property: bool = False) -> str:
    returns = "" if one.returns is None else f" -> {one.returns}"
    if is_property:
        return f"```python\n{name}{returns.replace(' ->', ':')}\n```\n\n"
    parts, kinds, star = [], griffe.ParameterKind, False
    for parameter in one.parameters:
        if parameter.name in ("self", "cls"):
            continue
        if parameter.kind is kinds.keyword_only and not star:
            parts.append("*")
            star = True
        star = star or parameter.kind is kinds.var_positional
        mark = {kinds.var_positional: "*", kinds.var_keyword: "**"}.get(parameter.kind, "")
        part = mark + parameter.name
        if parameter.annotation is not None:
            part += f": {parameter.annotation}"
        if parameter.default is not None and not mark:
            part += f" = {parameter.default}"
        parts.append(part)
    line = f"{name}({', '.join(parts)}){returns}"
    if len(line) > 90:
        line = f"{name}(\n" + "".join(f"    {part},\n" for part in parts) + f"){returns}"
    return f"```python\n{line}\n```\n\n"


def _parsed(docstring: Any) -> list[Any]:
    return docstring.parse("google", returns_multiple_items=False, warnings=False)


def _prose(docstring: Any) -> str:
    if docstring is None:
        return ""
    return "\n\n".join(
        docstring_text(one.value) for one in _parsed(docstring) if one.kind == "text"
    )


def _summary(one: Any) -> str:
    text = "" if one.docstring is None else one.docstring.value
    return docstring_text(text.partition("\n\n")[0])


def _described(one: Any) -> str:
    if one.docstring is None:
        return ""
    text = ""
    for section in _parsed(one.docstring):
        value: Any = section.value
        match section.kind.value:
            case "text":
                text += docstring_text(value) + "\n\n"
            case "parameters" | "attributes" as kind:
                rows = [
                    [f"`{part.name}`", _type(part.annotation), docstring_text(part.description)]
                    for part in value
                ]
                head = {"parameters": "Argument", "attributes": "Attribute"}[kind]
                text += table([head, "Type", "Meaning"], rows) + "\n"
            case "returns" | "raises" as kind:
                for part in value:
                    word = "Returns" if kind == "returns" else f"Raises `{part.annotation}`"
                    text += f"**{word}**: {docstring_text(part.description)}\n\n"
            case "examples":
                text += "".join(_example(part) for _, part in value)
            case "admonition":
                if value.kind == "example":
                    text += _example(value.contents)
                else:
                    text += f"**{section.title}**: {docstring_text(value.contents)}\n\n"
    return text


def _type(annotation: Any) -> str:
    return "" if annotation is None else f"`{annotation}`".replace("\n", " ")


def _example(text: str) -> str:
    return f"```pycon\n{text.strip()}\n```\n\n"


def index_page(pages: list[tuple[str, str, int]]) -> str:
    """The page that lists the packages."""
    rows = [[f"[`{name}`]({name}.md)", plain(words), str(count)] for name, words, count in pages]
    return (
        "# Python\n\nLengths are in mm and angles in radians. A design is a JAX pytree, so that "
        "`jax.grad`, `jax.vmap` and `jax.jit` apply to it. An answer that can fail is a "
        "[`Solution`](designopt.md#Solution): a value, its signed distance to the edge of "
        "feasibility, the residual, and a code whose text names what to change. Shapes stand in "
        'the signatures: `Float[Array, "*batch joints"]` is an array of floats with any number of '
        "leading axes and one of joints. The tests run every example and check every shape.\n\n"
        + table(["Package", "What it does", "Names"], rows)
    )


def write_api(folder: Path) -> None:
    """Write the pages of all packages."""
    folder.mkdir(parents=True, exist_ok=True)
    reference, listed = Reference(), []
    for package, stub in stubs():
        names = public_names(stub)
        (folder / f"{package}.md").write_text(reference.page(package, names), encoding="utf-8")
        listed.append((package, _summary(reference.object(package)), len(names)))
    (folder / "index.md").write_text(index_page(listed), encoding="utf-8")
