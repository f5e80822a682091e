"""The templates of the package, with the filters that they know."""

import re
from typing import Any

import jinja2

from oarlock.base.numbers import figure
from oarlock.base.text import markdown as cell
from oarlock.base.text import markdown_code, one_line, toml_string

__all__ = ["cell", "render", "toml", "toml_key"]


def toml(value: Any) -> str:
    """Writes a value as TOML: numbers with all their digits, strings, and lists of them."""
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return toml_string(value) if isinstance(value, str) else repr(value)


def toml_key(name: str) -> str:
    """Writes a name as a key of TOML, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml(name)


_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("oarlock.render"),
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    undefined=jinja2.StrictUndefined,
)
_TEMPLATES.filters |= {"number": figure, "cell": cell, "code": markdown_code, "line": one_line}
_TEMPLATES.filters |= {"toml": toml, "key": toml_key}
_ESCAPING = _TEMPLATES.overlay(autoescape=True)


def render(template: str, *, escaping: bool = False, **values: Any) -> str:
    """Fills in a template of the package.

    Args:
        template: name of its file.
        escaping: whether text is escaped for HTML.
        values: what the template names.
    """
    return (_ESCAPING if escaping else _TEMPLATES).get_template(template).render(**values)
