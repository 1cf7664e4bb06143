"""Writes the types of documents, which are schemas of ``openapi.yaml``, as `TypedDict` classes.

    python tests/typed_documents.py     # writes them again into the package
"""

from __future__ import annotations

import keyword
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from live_server import REPOSITORY

PACKAGE = REPOSITORY / "python/packstone"
HEAD = '''"""{title}

Written by ``tests/typed_documents.py`` of the schemas of the same names in ``openapi.yaml``, which describes each
field. Lengths are in mm. A field that may be missing is `NotRequired`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypedDict

if TYPE_CHECKING:
    from typing_extensions import NotRequired
'''
# The documents of each module.
MODULES = {
    "results.py": (
        "What is known about packings, plans and studies.",
        ["Report", "EngineInfo", "JobPlan", "StudyTable"],
    ),
    "reports.py": ("The figures of exports.", ["ExportReport"]),
    "services.py": ("What a service says of itself and of an API key.", ["Capabilities", "KeyInfo"]),
}
# Requests are plain dictionaries, in any form that a request may have.
REQUESTS = {"AxisRatiosInput", "ExportRequest", "Specimen", "PackingModel", "Materials", "Material"}
Schema = dict[str, Any]


def modules() -> Iterator[tuple[Path, str]]:
    """The path and the text of each module."""
    contract = yaml.safe_load((REPOSITORY / "openapi.yaml").read_text())
    schemas: dict[str, Schema] = contract["components"]["schemas"]
    for name, (title, roots) in MODULES.items():
        texts = [HEAD.format(title=title)]
        for schema in sorted(reached(schemas, roots)):
            if is_class(schemas[schema]) and schema not in roots_of_choice(schemas, roots):
                texts.append(of_class(schemas, schema))
        yield PACKAGE / name, "\n\n".join(texts)


def reached(schemas: dict[str, Schema], roots: list[str]) -> set[str]:
    """The schemas that others refer to."""
    found: set[str] = set()
    waiting = list(roots)
    while waiting:
        name = waiting.pop()
        if name not in found and name not in REQUESTS:
            found.add(name)
            waiting += re.findall(r"#/components/schemas/(\w+)", str(schemas[name]))
    return found


def roots_of_choice(schemas: dict[str, Schema], roots: list[str]) -> set[str]:
    """The documents that are one of several, each of which is a class."""
    return {root for root in roots if is_choice(schemas[root])}


def is_class(schema: Schema) -> bool:
    """Whether a schema is an object with fields."""
    return "allOf" in schema or bool(schema.get("properties")) or is_choice(schema)


def is_choice(schema: Schema) -> bool:
    """Whether a schema is one of several objects, whose fields are those of one class here."""
    return all("$ref" in one or "allOf" in one for one in schema.get("oneOf", [])) and len(schema.get("oneOf", [])) > 1


def of_class(schemas: dict[str, Schema], name: str) -> str:
    """The class of a schema."""
    fields: dict[str, str] = {}
    required: set[str] = set()
    for part in parts(schemas, schemas[name]):
        required |= set(part.get("required", []))
        for field, schema in part.get("properties", {}).items():
            fields[field] = union([fields[field], of(schemas, schema)] if field in fields else [of(schemas, schema)])
    if is_choice(schemas[name]):
        one_each = [list(parts(schemas, one)) for one in schemas[name]["oneOf"]]
        required = set.intersection(*(set().union(*(part.get("required", []) for part in one)) for one in one_each))
    description = re.sub(r"\s+", " ", schemas[name].get("description", f"A document {name}."))
    doc = textwrap.fill(f'"""{description}"""', 112).replace("\n", "\n    ")
    if "\n" in doc:
        doc = doc.removesuffix('"""') + '\n    """'
    lines = [f"class {name}(TypedDict):", f"    {doc}", ""]
    for field, type in fields.items():
        # A class of TypedDict cannot name such a field.
        if not keyword.iskeyword(field):
            line = f"    {field}: {type if field in required else f'NotRequired[{type}]'}"
            if len(line) > 120:
                line = line.replace("[", "[\n        ", 1).replace(", ", ",\n        ").replace("]", ",\n    ]")
            lines.append(line)
    return "\n".join(lines) + "\n"


def parts(schemas: dict[str, Schema], schema: Schema) -> Iterator[Schema]:
    """A schema, or those that it has the fields of all of."""
    if "$ref" in schema:
        yield from parts(schemas, schemas[schema["$ref"].rsplit("/", 1)[-1]])
    elif "allOf" in schema or is_choice(schema):
        for part in schema.get("allOf") or schema["oneOf"]:
            yield from parts(schemas, part)
    else:
        yield schema


def of(schemas: dict[str, Schema], schema: Schema) -> str:
    """The type of a value."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[-1]
        if name in REQUESTS:
            return "dict[str, Any]"
        return name if is_class(schemas[name]) else of(schemas, schemas[name])
    if "oneOf" in schema or "anyOf" in schema:
        return union([of(schemas, one) for one in schema.get("oneOf") or schema["anyOf"]])
    if "enum" in schema:
        return f"Literal[{', '.join(repr(value) for value in schema['enum'])}]".replace("'", '"')
    types = schema.get("type", [])
    return union([plain(schemas, schema, type) for type in ([types] if isinstance(types, str) else types)] or ["Any"])


def plain(schemas: dict[str, Schema], schema: Schema, type: str) -> str:
    """The type of a value of one type of JSON."""
    if type == "array":
        return f"list[{of(schemas, schema['items']) if 'items' in schema else 'Any'}]"
    if type == "object":
        values = schema.get("additionalProperties")
        return f"dict[str, {of(schemas, values) if isinstance(values, dict) else 'Any'}]"
    return {"integer": "int", "number": "float", "string": "str", "boolean": "bool", "null": "None"}[type]


def union(types: list[str]) -> str:
    """One of several types."""
    return " | ".join(dict.fromkeys(types))


if __name__ == "__main__":
    for path, text in modules():
        path.write_text(text)
