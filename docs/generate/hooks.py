"""What ``mkdocs build`` does besides: it writes the reference from the sources, and sets formulas as MathML.

A page of the reference is made anew in every build, from what the package itself says of its commands, findings, files
and solvers, so that none can be out of date. Nothing of the package imports this folder.
"""

import html
import os
import re
from pathlib import Path
from typing import Any

import figures
from latex2mathml.converter import convert
from reference import case_file as case_file_page
from reference import columns, commands, crates, documents, findings, python_api, solvers
from text import REPOSITORY

PAGES = {
    "reference/commands.md": commands.page,
    "reference/findings.md": findings.page,
    "reference/case.md": case_file_page.page,
    "reference/columns.md": columns.page,
    "reference/solvers.md": solvers.page,
    "reference/python.md": python_api.page,
    "reference/rust.md": crates.page,
    **documents.PAGES,
}
"""Place on the site → what writes the page."""

PICTURES = {
    "figures/boat.svg": "reports/boat/figures/mechanism.svg",
    "figures/drift.svg": "reports/figures/drift.svg",
}
"""Place on the site → published figure."""

_MARK = re.compile(r"^<!-- generated: (\w+) -->$", re.MULTILINE)
_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def on_config(config: Any) -> Any:
    """Where the package is read from: this checkout, whatever is installed."""
    os.environ.setdefault("NO_COLOR", "1")
    return config


def on_files(files: Any, config: Any) -> Any:
    """Adds the pages that are written here, and the figures of the published reports."""
    from mkdocs.structure.files import File

    for place, write in PAGES.items():
        files.append(File.generated(config, place, content=write()))
    for place, source in PICTURES.items():
        files.append(File.generated(config, place, content=(REPOSITORY / source).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Puts tables of measured figures where a page has a mark for them, and has decisions link to the site."""
    place = page.file.src_uri
    if place.startswith("decisions/"):
        markdown = documents.relinked(markdown, f"docs/{place}", place)
    return _MARK.sub(lambda mark: figures.TABLES[mark[1]](), markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Sets formulas as MathML, which browsers draw without a script."""
    content = _INLINE.sub(lambda found: _mathml(found[1], "inline"), content)
    return _BLOCK.sub(lambda found: f'<div class="formula">{_mathml(found[1], "block")}</div>', content)


def _mathml(latex: str, display: str) -> str:
    return convert(html.unescape(latex).strip(), display=display)


def on_post_build(config: Any) -> None:
    """Leaves out what the theme brings for features that are not used here, and what only a server of its own reads."""
    for name in ("sitemap.xml", "sitemap.xml.gz"):
        (Path(config["site_dir"]) / name).unlink(missing_ok=True)
