"""Templates, figures and pages, whatever they are of."""

import contextlib
import functools
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import altair as alt
import jinja2
import vl_convert
from markdown_it import MarkdownIt

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("oarlock.render"),
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    undefined=jinja2.StrictUndefined,
)


_EMBED = "window.vegaEmbed = vegaEmbed;"


_ESCAPING = _TEMPLATES.overlay(autoescape=True)


@dataclass(frozen=True)
class Figure:
    """A chart with its file name and its caption."""

    name: str
    caption: str
    chart: alt.TopLevelMixin

    @functools.cached_property
    def spec(self) -> str:
        """The chart as JSON, which takes long to make: drawing and page have the same one."""
        return json.dumps(self.chart.to_dict(), sort_keys=True)

    def svg(self) -> str:
        """The chart as a drawing."""
        return vl_convert.vegalite_to_svg(self.spec)


def number(value: Any, unit: str = "") -> str:
    """A figure for reading: three significant digits, a dash for what does not apply."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        text = f"{value:,}".replace(",", " ")
    elif value == int(value) and abs(value) < 1000:
        text = f"{value:.0f}"
    else:
        text = f"{value:.3f}" if 0.01 <= abs(value) < 1000 else f"{value:.2e}"
    return f"{text} {unit}".rstrip()


_TEMPLATES.filters["number"] = number


def _cell(value: Any) -> str:
    """Text that stays inside its cell of a Markdown table."""
    return re.sub(r"([\\`*{}\[\]<>#|!])", r"\\\1", str(value))


_TEMPLATES.filters["cell"] = _cell


def page(
    title: str, text: str, drawn: list[Figure], occasion: dict[str, Any], timed: Sequence[dict[str, Any]] = ()
) -> str:
    """Renders a Markdown page as one HTML file; its links to other pages lead to theirs.

    Args:
        title: of the page.
        text: its Markdown; an image named as one of ``drawn`` becomes an interactive chart.
        drawn: the charts.
        occasion: what is told of the occasion that it was made on, such as commit and date.
        timed: rows of a table of timings.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")

    def figure(self: Any, tokens: Any, index: int, options: Any, env: Any) -> str:
        name = Path(str(tokens[index].attrs["src"])).stem
        return f'<span class="chart" id="chart-{name}"></span>'

    def link(self: Any, tokens: Any, index: int, options: Any, env: Any) -> str:
        target = str(tokens[index].attrs["href"])
        tokens[index].attrs["href"] = re.sub(r"(?<=/)README\.md$", "index.html", target)
        return self.renderToken(tokens, index, options, env)

    parser.add_render_rule("image", figure)
    parser.add_render_rule("link_open", link)
    specs = {figure.name: json.loads(figure.spec) for figure in drawn}
    return _ESCAPING.get_template("page.html.j2").render(
        title=title,
        body=parser.render(text),
        specs=script_json(specs),
        library=script_library(),
        timings=timed,
        occasion=occasion,
    )


def script_json(value: Any) -> str:
    """JSON that cannot end the script that it stands in."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def script_library() -> str:
    """The chart library as it stands in a script."""
    return _library().replace("</script", "<\\/script")


@functools.cache
def _library() -> str:
    """The chart library, which takes a second to bundle: once for every version, where the user's caches are."""
    home = os.environ.get("XDG_CACHE_HOME")
    folder = (Path(home) if home else Path.home() / ".cache") / "oarlock"
    kept = folder / f"charts-{vl_convert.__version__}-{hashlib.sha256(_EMBED.encode()).hexdigest()[:16]}.js"
    try:
        return kept.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        bundle = vl_convert.javascript_bundle(_EMBED)
    with contextlib.suppress(OSError):  # a cache that cannot be written is none
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=folder, delete=False) as file:
            file.write(bundle)
        os.replace(file.name, kept)
    return bundle


def render(template: str, *, escaping: bool = False, **values: Any) -> str:
    """A template of the package with the filters of the reports; with ``escaping`` for HTML."""
    return (_ESCAPING if escaping else _TEMPLATES).get_template(template).render(**values)
