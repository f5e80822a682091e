"""The keys of ``case.toml``, from the schema that it is checked with."""

import json
from typing import Any

from oarlock.cases.case_file import CaseFile
from text import attributes, code, plain, table
from text import page as written

HEAD = """\
A case is a folder in `mjcf/` with a model and a `case.toml`: the start, the drive, what the model must turn out to
be, the experiments and the gates. Only `title` is required. Every table refuses keys that it does not know, in one
line that names them. `oarlock new` writes a first one ([tutorial](../tutorials/model.md))."""

RANGES = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
KINDS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false"}


class _Schema:
    def __init__(self, schema: dict[str, Any]):
        self._schema = schema
        self.places = {"CaseFile": "the file itself"}
        self._find(schema)

    def of(self, name: str) -> dict[str, Any]:
        """The schema of a table."""
        return self._schema if name == "CaseFile" else self._schema["$defs"][name]

    def _find(self, part: dict[str, Any]) -> None:
        """What a table is called where it first stands: ``[run]``, ``[[gates]]``, ``[settings.NAME]``."""
        for key, value in part["properties"].items():
            for name, form in self.named(value, "[{}]"):
                if name not in self.places:
                    self.places[name] = form.format(key)
                    self._find(self.of(name))

    def named(self, value: dict[str, Any], form: str = "") -> list[tuple[str, str]]:
        """The tables that may stand there, each with what it is called there."""
        if "$ref" in value:
            return [(value["$ref"].rpartition("/")[2], form)]
        if value.get("type") == "array" and "items" in value:
            return self.named(value["items"], "[[{}]]")
        if value.get("type") == "object" and isinstance(value.get("additionalProperties"), dict):
            return self.named(value["additionalProperties"], "[{}.NAME]")
        return [found for one in value.get("anyOf", ()) for found in self.named(one, form)]

    def kind(self, value: dict[str, Any]) -> str:
        """What may stand there, in words."""
        if "$ref" in value:
            name = value["$ref"].rpartition("/")[2]
            return f"[table](#{name.lower()})"
        if "anyOf" in value:
            return " or ".join(dict.fromkeys(self.kind(one) for one in value["anyOf"] if one.get("type") != "null"))
        if "enum" in value or "const" in value:
            return ", ".join(code(str(one)) for one in value.get("enum", [value.get("const")]))
        if value.get("type") == "array":
            some = [self.kind(one) for one in value.get("prefixItems", ())]
            return f"list of {len(some)} numbers" if some else f"list: {self.kind(value.get('items', {}))}"
        if value.get("type") == "object":
            inner = value.get("additionalProperties")
            return f"name → {self.kind(inner)}" if isinstance(inner, dict) else "table"
        bounds = " and ".join(f"{sign} {value[key]:g}" for key, sign in RANGES.items() if key in value)
        return f"{KINDS[value['type']]} {bounds}".strip()


def page() -> str:
    """A section a table of the file."""
    schema = _Schema(CaseFile.model_json_schema())
    return written("case.toml", HEAD, *(_section(schema, name) for name in schema.places))


def _section(schema: _Schema, name: str) -> str:
    part = schema.of(name)
    lead, meanings = attributes(part.get("description", ""))
    required = set(part.get("required", ()))
    rows = [
        [
            code(key),
            schema.kind(value),
            plain(_meaning(schema, key, value, meanings)),
            "required" if key in required else _default(value),
        ]
        for key, value in part["properties"].items()
    ]
    place = schema.places[name]
    title = f"## {place if name == 'CaseFile' else code(place)} {{#{name.lower()}}}"
    return "\n\n".join([title, plain(lead), table(["key", "what stands there", "what it says", "default"], rows)])


def _meaning(schema: _Schema, key: str, value: dict[str, Any], meanings: dict[str, str]) -> str:
    """What the docstring says of a key; of one that is a table, what that says of itself.

    Raises:
        ValueError: nothing says what the key is.
    """
    inner = next((schema.of(name) for name, _ in schema.named(value)), {})
    said = meanings.get(key) or attributes(inner.get("description", ""))[0].partition(". ")[0]
    if not said:
        raise ValueError(f"case.toml: the docstring of its table does not say what '{key}' is")
    return said


def _default(value: dict[str, Any]) -> str:
    default = value.get("default")
    if default in (None, [], {}, "") or isinstance(default, dict | list):
        return ""
    return code(json.dumps(default))
