"""A badge: how many engines and models agree, as a small SVG."""

import html
from typing import Any

_WIDTH_OF = 6.6
"""Width of a character at 11 px, roughly, px."""

_GOOD, _FAIR, _BAD = "#2e7d32", "#b26a00", "#b71c1c"


def badge(document: dict[str, Any]) -> str:
    """Draws a badge of a matrix."""
    total = len(document["rows"]) + len(document["failures"])
    passed = sum(row["passed"] for row in document["rows"])
    explained = sum(row["cause"] != "unexplained" for row in document["rows"])
    if document["tolerance"] is not None:
        value = f"{passed} of {total} within {document['tolerance']:g}"
    else:
        value = f"{explained} of {total} explained"
        passed = explained
    shade = _GOOD if total and passed == total else _FAIR if passed else _BAD
    return _drawn("closed loops", value, shade)


def _drawn(label: str, value: str, shade: str) -> str:
    left, right = (round(_WIDTH_OF * len(text) + 12) for text in (label, value))
    whole, said = left + right, html.escape(f"{label}: {value}")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{whole}" height="20" role="img" aria-label="{said}">'
        f"<title>{said}</title>"
        f'<rect width="{left}" height="20" rx="3" fill="#444"/>'
        f'<rect x="{left}" width="{right}" height="20" rx="3" fill="{shade}"/>'
        f'<g fill="#fff" text-anchor="middle" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11">'
        f'<text x="{left / 2:g}" y="14">{html.escape(label)}</text>'
        f'<text x="{left + right / 2:g}" y="14">{html.escape(value)}</text></g></svg>\n'
    )
