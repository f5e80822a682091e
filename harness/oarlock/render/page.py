"""Figures and pages, independent of what they show."""

import contextlib
import functools
import hashlib
import html
import json
import os
import re
import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import altair as alt
import vl_convert
from markdown_it import MarkdownIt

from oarlock.base.errors import InputError
from oarlock.base.files import write_text
from oarlock.base.text import one_line, short_name
from oarlock.render.template import render

_EMBED = "window.vegaEmbed = vegaEmbed;"


@dataclass(frozen=True)
class Figure:
    """A chart with the name of its file and its caption."""

    name: str
    caption: str
    chart: alt.TopLevelMixin

    @functools.cached_property
    def spec(self) -> str:
        """The chart as JSON, its text harmless. It takes long to make, so the drawing and the page share it."""
        return json.dumps(_harmless(self.chart.to_dict()), sort_keys=True)

    def svg(self) -> str:
        """The chart as SVG."""
        return self._drawing

    @functools.cached_property
    def _drawing(self) -> str:
        return vl_convert.vegalite_to_svg(self.spec)


def _harmless(value: Any) -> Any:
    """A chart's document with its text made visible, and long names short: one of these stops the chart library."""
    if isinstance(value, dict):
        return {key: _harmless(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_harmless(entry) for entry in value]
    return short_name(value) if isinstance(value, str) else value


def drawable(figures: Sequence[Figure]) -> list[Figure]:
    """The figures that the chart library draws. One that it cannot draw costs its figure only, and a warning."""
    found = []
    for figure in figures:
        try:
            figure.svg()
        except BaseException as error:
            # A panic of the chart library is no Exception.
            if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
                raise
            warnings.warn(f"figure '{figure.name}' is not drawn: {one_line(error)[:200]}", stacklevel=2)
        else:
            found.append(figure)
    return found


def page(
    title: str,
    text: str,
    drawn: list[Figure],
    occasion: dict[str, Any],
    timed: Sequence[dict[str, Any]] = (),
    *,
    folded: Collection[str] = (),
) -> str:
    """Renders Markdown as one HTML file without outside references. Links to other pages lead to their HTML.

    Args:
        title: title of the page.
        text: its Markdown; an image named like one of ``drawn`` becomes an interactive chart.
        drawn: the charts.
        occasion: when and where it was made, such as commit and date.
        timed: rows of a table of timings.
        folded: headings of sections that are closed until somebody opens them.
    """
    parser = MarkdownIt("commonmark", {"html": False}).enable("table")

    def figure(self: Any, tokens: Any, index: int, options: Any, env: Any) -> str:
        name = Path(str(tokens[index].attrs["src"])).stem
        return f'<span class="chart" id="chart-{html.escape(name)}"></span>'

    def link(self: Any, tokens: Any, index: int, options: Any, env: Any) -> str:
        target = str(tokens[index].attrs["href"])
        tokens[index].attrs["href"] = re.sub(r"(?<=/)README\.md$", "index.html", target)
        return self.renderToken(tokens, index, options, env)

    parser.add_render_rule("image", figure)
    parser.add_render_rule("link_open", link)
    specs = {figure.name: json.loads(figure.spec) for figure in drawn}
    return render(
        "page.html.j2",
        escaping=True,
        title=title,
        body=_folded(parser.render(text), folded),
        specs=script_json(specs),
        library=script_library(),
        timings=timed,
        occasion=occasion,
    )


def _folded(body: str, headings: Collection[str]) -> str:
    """Puts sections of HTML, each from its heading to the next, into boxes that open."""
    first, *sections = re.split(r"(?=<h2>)", body)
    for number, section in enumerate(sections):
        heading, mark, rest = section.partition("</h2>")
        if html.unescape(heading.removeprefix("<h2>")) in headings:
            sections[number] = f"<details><summary>{heading}{mark}</summary>{rest}</details>\n"
    return "".join([first, *sections])


def script_json(value: Any) -> str:
    """Renders a value as JSON that cannot end the script element that it stands in."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def script_library() -> str:
    """Returns the chart library as text for a script element."""
    return _library().replace("</script", "<\\/script")


@functools.cache
def _library() -> str:
    """Bundles the chart library. That takes a second, so every version is kept in the user's cache."""
    home = os.environ.get("XDG_CACHE_HOME")
    folder = (Path(home) if home else Path.home() / ".cache") / "oarlock"
    kept = folder / f"charts-{vl_convert.__version__}-{hashlib.sha256(_EMBED.encode()).hexdigest()[:16]}.js"
    try:
        return kept.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        bundle = vl_convert.javascript_bundle(_EMBED)
    with contextlib.suppress(InputError):  # a cache that cannot be written is none
        write_text(kept, bundle)
    return bundle
