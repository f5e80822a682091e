"""Changes of an MJCF file that leave every byte as it is but those that have to change."""

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass

from oarlock.diagnosis.edit.document import Document, Place, SourceFile
from oarlock.diagnosis.edit.markup import Element, escaped

_INDENT = b"  "
"""A level of indentation where the author shows none."""


@dataclass(frozen=True)
class Span:
    """Bytes of a file from ``start`` to ``end``, and what stands there afterwards."""

    start: int
    end: int
    text: bytes


@dataclass(frozen=True)
class _Addition:
    section: str
    tag: str
    attributes: Mapping[str, str]


class Editor:
    """Collects changes of a document, and gives the text of its files with them.

    What is added goes into the main file: into its last section of that name, or into a new one at its end, indented
    as the author does.
    """

    def __init__(self, document: Document):
        self.document = document
        self._attributes: dict[SourceFile, dict[Element, dict[str, str]]] = {}
        self._additions: list[_Addition] = []
        self._insertions: dict[SourceFile, dict[Element, list[_Addition]]] = {}

    def set(self, place: Place, attributes: Mapping[str, str]) -> None:
        """Sets attributes of an element, as values and not as they are escaped; those that it has keep their quotes."""
        changed = {name: value for name, value in attributes.items() if not _has(place.element, name, value)}
        if changed:
            self._attributes.setdefault(place.file, {}).setdefault(place.element, {}).update(changed)

    def add(self, section: str, tag: str, attributes: Mapping[str, str]) -> None:
        """Adds an element to a section, or to the root where that is empty."""
        self._additions.append(_Addition(section, tag, dict(attributes)))

    def insert(self, place: Place, tag: str, attributes: Mapping[str, str]) -> None:
        """Adds an element at the end of another one, in the file that this stands in."""
        within = self._insertions.setdefault(place.file, {}).setdefault(place.element, [])
        within.append(_Addition("", tag, dict(attributes)))

    @property
    def additions(self) -> list[tuple[str, str, Mapping[str, str]]]:
        """Section, tag and attributes of what is added so far; no section where it goes into another element."""
        inserted = [one for elements in self._insertions.values() for added in elements.values() for one in added]
        return [(one.section, one.tag, one.attributes) for one in (*self._additions, *inserted)]

    @property
    def changed(self) -> list[SourceFile]:
        """The files that have changes."""
        touched = {*self._attributes, *self._insertions}
        own = [file for file in self.document.files if file in touched]
        return [self.document.main, *own] if self._additions and self.document.main not in own else own

    def text(self, file: SourceFile) -> bytes:
        """The text of a file with its changes."""
        parts, at = [], 0
        for span in self.spans(file):
            parts += [file.text[at : span.start], span.text]
            at = span.end
        return b"".join([*parts, file.text[at:]])

    def spans(self, file: SourceFile) -> list[Span]:
        """What changes in a file, in its order."""
        spans = [
            span
            for element, attributes in self._attributes.get(file, {}).items()
            for span in _attribute_spans(element, attributes)
        ]
        if file in self._insertions:
            layout = _Layout(file)
            for element, added in self._insertions[file].items():
                spans.append(layout.into(element, [_written(one, layout.quote) for one in added]))
        if file is self.document.main:
            spans += self._added()
        return sorted(spans, key=lambda span: (span.start, span.end))

    def _added(self) -> list[Span]:
        main, spans, new = self.document.main, list[Span](), list[tuple[bytes, list[bytes]]]()
        layout = _Layout(main)
        for section, group in itertools.groupby(
            sorted(self._additions, key=lambda one: one.section), key=lambda one: one.section
        ):
            written = [_written(one, layout.quote) for one in group]
            existing = [child for child in main.root.children if child.tag == section]
            if existing:
                spans.append(layout.into(existing[-1], written))
            elif section:
                new.append((section.encode(), written))
            else:
                new += [(b"", [one]) for one in written]
        if new:
            spans.append(layout.at_the_end(new))
        return spans


def _has(element: Element, name: str, value: str) -> bool:
    return name in element.attributes and element.attributes[name].text == value


def _attribute_spans(element: Element, attributes: Mapping[str, str]) -> list[Span]:
    present = list(element.attributes.values())
    spans = [
        Span(old.start, old.end, escaped(attributes[old.name], old.quote)) for old in present if old.name in attributes
    ]
    new = {name: value for name, value in attributes.items() if name not in element.attributes}
    if new:
        at, quote = (present[-1].end + 1, present[-1].quote) if present else (element.named, '"')
        spans.append(Span(at, at, _attributes(new, quote)))
    return spans


def _attributes(attributes: Mapping[str, str], quote: str) -> bytes:
    mark = quote.encode()
    return b"".join(
        b" " + name.encode() + b"=" + mark + escaped(value, quote) + mark for name, value in attributes.items()
    )


def _written(addition: _Addition, quote: str) -> bytes:
    return b"<" + addition.tag.encode() + _attributes(addition.attributes, quote) + b"/>"


class _Layout:
    """How an author lays a file out."""

    def __init__(self, file: SourceFile):
        self._text, self._root = file.text, file.root
        first = file.text.find(b"\n")
        self._newline = b"\r\n" if first > 0 and file.text[first - 1 : first] == b"\r" else b"\n"
        top = [indent for child in file.root.children if (indent := self._indent(child.start)) is not None]
        self._top = top[0] if top else _INDENT
        deeper = [
            inner.removeprefix(outer)
            for child in file.root.children
            for grandchild in child.children
            if (outer := self._indent(child.start)) is not None
            and (inner := self._indent(grandchild.start)) is not None
            and inner.startswith(outer)
            and inner != outer
        ]
        self._unit = deeper[0] if deeper else self._top or _INDENT
        quotes = [attribute.quote for one in file.root.within() for attribute in one.attributes.values()]
        self.quote = "'" if quotes.count("'") > len(quotes) / 2 else '"'

    def _indent(self, at: int) -> bytes | None:
        """What stands before a place on its line, if that is white space only."""
        before = self._text[self._text.rfind(b"\n", 0, at) + 1 : at]
        return before if re.fullmatch(rb"[ \t]*", before) and b"\n" in self._text[:at] else None

    def into(self, section: Element, written: list[bytes]) -> Span:
        """Adds elements at the end of a section."""
        outer = self._indent(section.start)
        own = [indent for child in section.children if (indent := self._indent(child.start)) is not None]
        inner = own[-1] if own else (outer or b"") + self._unit
        if section.closing is None:
            ending = section.opened - len(b"/>")
            while self._text[ending - 1 : ending].isspace():
                ending -= 1
            end_tag = b"</" + section.tag.encode() + b">"
            if outer is None:
                return Span(ending, section.opened, b">" + b"".join(written) + end_tag)
            return Span(ending, section.opened, b">" + self._lines(written, inner) + self._newline + outer + end_tag)
        closing = self._indent(section.closing)
        if closing is not None:
            at = section.closing - len(closing)
            return Span(at, at, b"".join(inner + one + self._newline for one in written))
        content = self._text[section.opened : section.closing]
        if outer is not None and not content.strip():
            text = self._lines(written, inner) + self._newline + outer
            return Span(section.opened, section.closing, text)
        return Span(section.closing, section.closing, b"".join(written))

    def _lines(self, written: list[bytes], indent: bytes) -> bytes:
        return b"".join(self._newline + indent + one for one in written)

    def at_the_end(self, sections: list[tuple[bytes, list[bytes]]]) -> Span:
        """Adds sections (name, elements) before the end of the root; elements of no section stand alone."""
        assert self._root.closing is not None  # a model has bodies
        closing = self._indent(self._root.closing)
        at = self._root.closing - len(closing or b"")
        text = b""
        for name, written in sections:
            begin, end = (b"<" + name + b">", b"</" + name + b">") if name else (b"", b"")
            if closing is None:
                text += begin + b"".join(written) + end
            elif name:
                inner = self._lines(written, self._top + self._unit)
                text += self._top + begin + inner + self._newline + self._top + end + self._newline
            else:
                text += b"".join(self._top + one + self._newline for one in written)
        return Span(at, at, text)
