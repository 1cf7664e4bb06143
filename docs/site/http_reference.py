"""The pages of the HTTP interface, made of its OpenAPI document."""

import functools
import html
import json
from typing import Any

import yaml

Schema = dict[str, Any]
METHODS = ("get", "put", "post", "patch", "delete")
BOUNDS = {"minimum": "≥ {}", "exclusiveMinimum": "> {}", "maximum": "≤ {}", "exclusiveMaximum": "< {}",
          "minLength": "at least {} characters", "maxLength": "at most {} characters", "minItems": "at least {} items",
          "maxItems": "at most {} items", "maxProperties": "at most {} members", "pattern": "as `{}`"}


@functools.cache
def document(text: str) -> dict[str, Any]:
    """The OpenAPI document."""
    loaded: dict[str, Any] = yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    return loaded


def prose(text: str) -> str:
    """A description as Markdown; what looks like an element of HTML is text."""
    pieces = text.split("`")
    return "`".join(piece if i % 2 else html.escape(piece, quote=False) for i, piece in enumerate(pieces))


def cell(text: str) -> str:
    """The same in a cell of a table."""
    return prose(" ".join(text.split())).replace("|", "\\|")


def literal(value: object) -> str:
    """A value as JSON."""
    return f"`{json.dumps(value, ensure_ascii=False)}`"


def type_of(schema: Schema, objects: str) -> str:
    """The type of a value, with links to the objects on the page `objects`."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        return f"[{name}]({objects}#{name.lower()})"
    for key, word in (("oneOf", " or "), ("anyOf", " or "), ("allOf", " and ")):
        if key in schema:
            return word.join(dict.fromkeys(type_of(variant, objects) for variant in schema[key]))
    if "const" in schema:
        return literal(schema["const"])
    if "enum" in schema:
        return ", ".join(literal(value) for value in schema["enum"])
    kinds = schema.get("type", "any value")
    names = []
    for kind in kinds if isinstance(kinds, list) else [kinds]:
        if kind == "array" and "prefixItems" in schema:
            names.append(f"array of ({', '.join(type_of(one, objects) for one in schema['prefixItems'])})")
        elif kind == "array":
            names.append(f"array of {type_of(schema.get('items', {}), objects)}")
        elif kind == "object" and isinstance(schema.get("additionalProperties"), dict):
            names.append(f"object whose values are {type_of(schema['additionalProperties'], objects)}")
        else:
            names.append(kind)
    return " or ".join(names)


def facts(schema: Schema) -> str:
    """The description, the bounds and the default of a value, for a cell."""
    found = [schema["description"].strip().rstrip(".") + "."] if schema.get("description") else []
    for variant in [schema, *schema.get("oneOf", []), *schema.get("anyOf", [])]:
        if variant is not schema and variant.get("description") and not schema.get("description"):
            found.append(variant["description"].strip().rstrip(".") + ".")
    bounds = [words.format(schema[key]) for key, words in BOUNDS.items() if key in schema]
    if bounds:
        found.append(", ".join(bounds) + ".")
    if schema.get("default") is not None:
        found.append(f"Default: {literal(schema['default'])}.")
    if schema.get("deprecated"):
        found.append("**Deprecated.**")
    return cell(" ".join(found))


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + "\n"


def members(schema: Schema, prefix: str = "") -> list[list[str]]:
    """The rows of an object's members; those of objects without a name stand below their parent's."""
    rows = []
    required = set(schema.get("required", []))
    for name, value in schema.get("properties", {}).items():
        optional = "" if name in required else " (optional)"
        rows.append([f"`{prefix}{name}`", cell(type_of(value, "objects.md")) + optional, facts(value)])
        if "properties" in value:
            rows += members(value, f"{prefix}{name}.")
    return rows


def title_of(variant: Schema) -> str:
    """What a variant is called: by the values of its members that are constant."""
    for name, value in variant.get("properties", {}).items():
        constant = value.get("const", value["enum"][0] if len(value.get("enum", [])) == 1 else None)
        if constant is not None:
            return f"With `{name}` {literal(constant)}"
    return f"As {type_of(variant, 'objects.md')}"


def shape(schema: Schema) -> str:
    """An object in Markdown: its members, variants or values."""
    text = ""
    if schema.get("properties"):
        text += table(["member", "type", "meaning"], members(schema))
    for key, words in (("oneOf", "One of:"), ("anyOf", "One of:"), ("allOf", "All of:")):
        variants = schema.get(key, [])
        if variants:
            text += f"{words}\n\n"
        for variant in variants:
            description = prose(variant.get("description", ""))
            text += f"**{title_of(variant)}.** {description}\n\n{shape(variant)}"
    if not text:
        kinds = type_of(schema, "objects.md")
        text = "" if "$ref" in schema else f"{kinds[0].upper()}{kinds[1:]}. {facts({**schema, 'description': ''})}\n\n"
    return text


def object_page(contract: str) -> str:
    """The page of the objects in requests and answers."""
    schemas: dict[str, Schema] = document(contract)["components"]["schemas"]
    parts = ["# Objects of the HTTP interface\n\nWhat requests and answers of the [routes](http.md) have, by name.\n"]
    for name, schema in sorted(schemas.items()):
        parts.append(f"## {name} {{ #{name.lower()} }}\n\n{prose(schema.get('description', ''))}\n\n{shape(schema)}")
    return "\n".join(parts)


def bodies(content: dict[str, Schema]) -> str:
    """The media types of a body, each with its type."""
    return "; ".join(f"`{media}`: {cell(type_of(entry.get('schema', {}), 'objects.md'))}"
                     for media, entry in content.items())


def operation_part(path: str, method: str, operation: dict[str, Any]) -> str:
    """One method of one route."""
    text = f"### {method.upper()} `{path}` {{ #{operation['operationId']} }}\n\n**{prose(operation['summary'])}.** "
    text += f"{prose(operation.get('description', ''))}\n\n"
    if operation.get("parameters"):
        text += table(["parameter", "in", "type", "meaning"], [
            [f"`{one['name']}`", one["in"], cell(type_of(one.get("schema", {}), "objects.md")),
             facts({**one.get("schema", {}), "description": one.get("description", "")})]
            for one in operation["parameters"]])
    if "requestBody" in operation:
        text += f"Body: {bodies(operation['requestBody']['content'])}\n\n"
    return text + table(["status", "meaning", "body"], [
        [status, cell(answer.get("description", "")), bodies(answer.get("content", {}))]
        for status, answer in operation["responses"].items()])


def route_page(contract: str) -> str:
    """The page of the routes."""
    api = document(contract)
    parts = [f"# HTTP interface\n\n{prose(api['info']['description'])}\n\nThis page and [its objects](objects.md) are "
             f"made of `openapi.yaml`, version {api['info']['version']}, which `packstone openapi` prints. A server "
             "with keys wants the header `Authorization: Bearer KEY` in every request.\n"]
    operations = [(path, method, item[method]) for path, item in api["paths"].items() for method in METHODS
                  if method in item]
    for tag in api["tags"]:
        of_tag = [one for one in operations if one[2]["tags"] == [tag["name"]]]
        parts.append(f"## {tag['name'].capitalize()}\n\n{prose(tag['description'])}.\n")
        parts.append(table(["route", "what it does"], [
            [f"[{method.upper()} `{path}`](#{operation['operationId']})", cell(operation["summary"])]
            for path, method, operation in of_tag]))
        parts += [operation_part(*one) for one in of_tag]
    return "\n".join(parts)
