"""Text from models, files and results, made harmless where it is shown: whatever is in it, it stays one line of text.

Terminals, Markdown, HTML, TOML, charts and drawings show only what comes out of here. Control characters (those that a
terminal obeys among them), line breaks, and characters that are not seen or turn the direction of writing are shown by
their numbers.
"""

import hashlib
import re

LONGEST = 2000
"""Characters of a text that is shown, at most; of a longer one its beginning, and how long it is."""

LONGEST_NAME = 120
"""The same in a chart, where nobody could read more."""

_MARKUP = re.compile(r"([\\`*{}\[\]<>#|!&~$^]|(?<![^\W_])_|_(?![^\W_])|:(?=//)|(?<=www)\.)")


def visible(text: object, most: int = LONGEST) -> str:
    r"""A text as one line of characters that print; others by their numbers, such as ``\n`` or ``\x1b``."""
    line = str(text)
    if len(line) > most:
        line = f"{line[:most]}… ({len(line)} characters)"
    return line if line.isprintable() else "".join(c if c.isprintable() else _numbered(c) for c in line)


def _numbered(character: str) -> str:
    # A space of another width, as between the digits of a number, is seen and harmless.
    return " " if character in "\u00a0\u2009\u202f" else ascii(character)[1:-1]


def short_name(text: object) -> str:
    """A name for a chart: a long one is cut, and told from others with the same beginning by a digest."""
    name = str(text)
    if len(name) <= LONGEST_NAME:
        return visible(name)
    digest = hashlib.blake2b(name.encode(errors="replace"), digest_size=4).hexdigest()
    return f"{visible(name[: LONGEST_NAME - 9])}…{digest}"


def one_line(text: object) -> str:
    """Joins the lines of a message, so that it takes one line on a terminal and in a log."""
    return visible(" ".join(str(text).split()))


def quoted(name: str) -> str:
    """A name in quotes; one that quotes others, such as ``connect of 'a' and 'b'``, stands as it is."""
    return name if "'" in name else f"'{name}'"


def called(kind: str, name: str) -> str:
    """An element in a sentence, ``joint 'elbow'``; a description, ``joint of 'crank'``, stands as it is."""
    return name if name.startswith(f"{kind} of ") else f"{kind} {quoted(name)}"


def markdown(text: object) -> str:
    """Text that stays text in Markdown, in a sentence and in a cell of a table."""
    return _MARKUP.sub(r"\\\1", one_line(text))


def markdown_code(text: object) -> str:
    """Text as code in Markdown, in a sentence or a cell of a table."""
    line = one_line(text).replace("|", "\\|")
    fence = "`" * (1 + max(map(len, re.findall("`+", line)), default=0))
    space = " " if "`" in line or not line.strip() else ""
    return f"{fence}{space}{line}{space}{fence}"


def toml_string(text: str) -> str:
    """Text as a basic string of TOML, on one line whatever is in it."""
    return '"' + "".join(_escaped(character) for character in text) + '"'


def json_visible(text: str) -> str:
    """JSON with what does not print written by numbers; such characters stand in its strings only."""
    if text.replace("\n", "").isprintable():
        return text
    return "".join(c if c.isprintable() or c == "\n" else _json_numbered(c) for c in text)


def _json_numbered(character: str) -> str:
    units = character.encode("utf-16-be", errors="surrogatepass")
    return "".join(f"\\u{units[at : at + 2].hex()}" for at in range(0, len(units), 2))


def _escaped(character: str) -> str:
    if character in '"\\':
        return "\\" + character
    if character.isprintable():
        return character
    number = ord(character)
    if 0xD800 <= number < 0xE000:  # half a character, which TOML cannot hold
        return "\\uFFFD"
    return f"\\u{number:04X}" if number < 0x10000 else f"\\U{number:08X}"


def version_numbers(version: str) -> tuple[int, ...]:
    """The numbers of a version, "3.17.0" as (3, 17, 0)."""
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])
