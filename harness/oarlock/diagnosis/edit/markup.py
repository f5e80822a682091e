"""The elements of an MJCF file with the bytes that each stands on, by the rules of the reader that MuJoCo has.

That reader (tinyxml2) takes more than XML allows, such as ``--`` in comments or entities that nobody defined, and files
have it: a stricter one would refuse what MuJoCo runs.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from oarlock.base.errors import InputError

BYTE_ORDER_MARK = b"\xef\xbb\xbf"

_NAME = rb"[A-Za-z_:\x80-\xff][\w.:\-\x80-\xff]*"
_OPENING = re.compile(rb"<\s*(" + _NAME + rb")")
_CLOSING = re.compile(rb"<\s*/(" + _NAME + rb")[^>]*>")
_ATTRIBUTE = re.compile(rb"\s*(" + _NAME + rb")\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_ENDING = re.compile(rb"\s*(/?)>")
_ENTITY = re.compile(r"&(?:#x([0-9A-Fa-f]+)|#([0-9]+)|(quot|amp|apos|lt|gt));")
_NAMED = {"quot": '"', "amp": "&", "apos": "'", "lt": "<", "gt": ">"}
_SKIPPED = ((b"<!--", b"-->"), (b"<![CDATA[", b"]]>"), (b"<?", b"?>"), (b"<!", b">"))
"""What is no element → how it ends."""


@dataclass(frozen=True)
class Attribute:
    """An attribute: ``text`` is its value, which is written on the bytes ``start`` to ``end``, in quotes."""

    name: str
    text: str
    start: int
    end: int
    quote: str


@dataclass(eq=False)
class Element:
    """An element and where it stands.

    Attributes:
        tag: its name.
        attributes: by name, in their order.
        start: first byte; end: the one after its last.
        named: byte after the name of the start tag.
        opened: byte after the start tag.
        closing: first byte of the end tag; None where the start tag closes itself.
        parent: None: the root.
    """

    tag: str
    attributes: dict[str, Attribute]
    start: int
    named: int
    opened: int
    parent: "Element | None" = None
    children: list["Element"] = field(default_factory=list)
    closing: int | None = None
    end: int = 0

    def get(self, name: str, otherwise: str = "") -> str:
        """Value of an attribute."""
        return self.attributes[name].text if name in self.attributes else otherwise

    def within(self) -> Iterator["Element"]:
        """Itself and all in it, in the order of the file."""
        left: list[Element] = [self]
        while left:
            one = left.pop()
            yield one
            left += reversed(one.children)


def parse(text: bytes, file: object) -> Element:
    """Gives the root of a file; what follows it is not read, as in MuJoCo.

    Args:
        text: of the file.
        file: its name, for messages.

    Raises:
        InputError: it is not well-formed.
    """
    at, open_ones = 0, list[Element]()
    while (at := text.find(b"<", at)) >= 0:
        skipped = next((end for begin, end in _SKIPPED if text.startswith(begin, at)), None)
        if skipped is not None:
            past = text.find(skipped, at)
            if past < 0:
                break
            at = past + len(skipped)
        elif closing := _CLOSING.match(text, at):
            if not open_ones or open_ones[-1].tag != _decoded(closing[1]):
                break
            last = open_ones.pop()
            last.closing, last.end, at = at, closing.end(), closing.end()
            if not open_ones:
                return last
        else:
            element, empty = _opened(text, at, file)
            at = element.opened
            if open_ones:
                element.parent = open_ones[-1]
                open_ones[-1].children.append(element)
            if not empty:
                open_ones.append(element)
            elif not open_ones:
                return element
    raise InputError(f"{file}: not well-formed XML: no element ends where it should")


def _opened(text: bytes, at: int, file: object) -> tuple[Element, bool]:
    opening = _OPENING.match(text, at)
    found, past = dict[str, Attribute](), opening.end() if opening else at
    while opening and (one := _ATTRIBUTE.match(text, past)):
        place, past = (2 if one[2] is not None else 3), one.end()
        name, quote = _decoded(one[1]), text[past - 1 : past].decode()
        found[name] = Attribute(name, _unescaped(_decoded(one[place])), one.start(place), one.end(place), quote)
    ending = _ENDING.match(text, past)
    if opening is None or ending is None:
        line = text.count(b"\n", 0, at) + 1
        raise InputError(f"{file}: not well-formed XML: line {line}, expected a tag with attributes in quotes")
    element = Element(_decoded(opening[1]), found, at, opening.end(), ending.end())
    element.end = ending.end()
    return element, bool(ending[1])


def _decoded(text: bytes) -> str:
    return text.decode("utf-8", "surrogateescape")


def _unescaped(text: str) -> str:
    def character(entity: re.Match[str]) -> str:
        if entity[3]:
            return _NAMED[entity[3]]
        code = int(entity[1], 16) if entity[1] else int(entity[2])
        return chr(code) if 0 < code < 0x110000 else entity[0]

    return _ENTITY.sub(character, text.replace("\r\n", "\n").replace("\r", "\n"))


def escaped(text: str, quote: str) -> bytes:
    """A value as it stands between quotes."""
    entities = {"&": "&amp;", "<": "&lt;", "\n": "&#10;", "\r": "&#13;", quote: "&quot;" if quote == '"' else "&apos;"}
    return "".join(entities.get(one, one) for one in text).encode("utf-8", "surrogateescape")
