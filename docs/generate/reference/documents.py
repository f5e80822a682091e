"""Documents of the repository that belong on the site, too, and links between the two."""

import posixpath
import re

from text import REPOSITORY

SHOWN = {
    "project/architecture.md": "ARCHITECTURE.md",
    "project/contributing.md": "CONTRIBUTING.md",
    "project/changelog.md": "CHANGELOG.md",
    "project/security.md": "SECURITY.md",
}
"""Place on the site → document."""

_LINK = re.compile(r"\[([^\]]+)\]\(([^)\s:]+)\)")


def relinked(markdown: str, source: str, place: str) -> str:
    """The text of a document, with links that lead to pages of the site; of others only the words stay.

    Args:
        markdown: the text.
        source: path of the document in the repository.
        place: of its page on the site.
    """
    places = {document: shown for shown, document in SHOWN.items()}

    def link(found: re.Match[str]) -> str:
        path, sign, anchor = found[2].partition("#")
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        shown = places.get(target) or (target.removeprefix("docs/") if target.startswith("docs/") else None)
        if not path:
            return found[0]
        return (
            f"[{found[1]}]({posixpath.relpath(shown, posixpath.dirname(place))}{sign}{anchor})" if shown else found[1]
        )

    return _LINK.sub(link, markdown)


def _page(place: str) -> str:
    source = SHOWN[place]
    return relinked((REPOSITORY / source).read_text(encoding="utf-8"), source, place)


PAGES = {place: lambda place=place: _page(place) for place in SHOWN}
