"""The page: one HTML file that asks for nothing outside of it."""

from functools import cache
from importlib.resources import files
from pathlib import Path

from oarlock.base.errors import InputError
from oarlock.base.files import write_text
from oarlock.render.page import script_json
from oarlock.render.template import render
from oarlock.viewer.show import Show


def html(shown: Show) -> str:
    """The page as text."""
    return render(
        "view.page.html.j2",
        escaping=True,
        title=shown.title,
        head=shown.head,
        notes=shown.notes,
        alone=len(shown.film.sides) == 1,
        document=script_json(shown.document()),
        library=_script("oarlock.render", "vendor/three.min.js"),
        script=_script("oarlock.viewer", "viewer.js"),
    )


def write(shown: Show, path: Path) -> int:
    """Writes the page; gives its size in bytes.

    Raises:
        InputError: its name is not that of a page, or it cannot be written.
    """
    require_page(path)
    text = html(shown)
    write_text(path, text, named=True)
    return len(text.encode())


def require_page(path: Path) -> None:
    """Refuses a name that no browser takes for that of a page.

    Raises:
        InputError: it does not end in .html or .htm.
    """
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"'{path}', expected the name of a page, OUT.html")


@cache
def _script(package: str, name: str) -> str:
    """A script of the package as text for a script element."""
    try:
        text = (files(package) / name).read_text(encoding="utf-8")
    except OSError:
        raise InputError(f"'{name}' of {package} is not there, expected a whole installation of oarlock") from None
    return text.replace("</script", "<\\/script")
