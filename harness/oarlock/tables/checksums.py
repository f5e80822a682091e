"""Checksums of what is kept: of tables, in the documents that name them; of a document, in itself.

They are there for damage: a bad disk, a half copy, an edit by hand. Whoever wants to deceive can compute them anew.
"""

import hashlib
import json
import re
import stat
from pathlib import Path
from typing import Any

KEY = "checksum"
"""Key of a document's own checksum, its last one."""

_BYTES = 16
_BLANK = "0" * (2 * _BYTES)
_SEAL = re.compile(rb'"checksum": "([0-9a-f]{32})"\s*\}\s*\Z')
_TAIL = 128
"""Bytes at the end of a document that hold its checksum."""


def of_bytes(content: bytes) -> str:
    """The checksum of contents: 32 hexadecimal digits of their BLAKE2b."""
    return hashlib.blake2b(content, digest_size=_BYTES).hexdigest()


def of_file(path: Path) -> str | None:
    """The checksum of a file's contents; None if there is no regular file that can be read."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            return None
        with path.open("rb") as file:
            return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=_BYTES)).hexdigest()
    except (OSError, ValueError):
        return None


def sealed(document: dict[str, Any], indent: int | None) -> bytes:
    """A document as JSON, with the checksum of this text (zeros in its own place) as its last key."""
    text = json.dumps({**document, KEY: _BLANK}, indent=indent, ensure_ascii=False, allow_nan=False) + "\n"
    content = text.encode()
    at = content.rindex(_BLANK.encode())
    return content[:at] + of_bytes(content).encode() + content[at + len(_BLANK) :]


def has_seal(content: bytes) -> bool:
    """Whether a document has a checksum of its own."""
    return _SEAL.search(content[-_TAIL:]) is not None


def holds(content: bytes) -> bool:
    """Whether a document has its checksum and it is right."""
    found = _SEAL.search(content[-_TAIL:])
    if found is None:
        return False
    at = max(0, len(content) - _TAIL) + found.start(1)
    return of_bytes(content[:at] + _BLANK.encode() + content[at + len(_BLANK) :]) == found[1].decode()
