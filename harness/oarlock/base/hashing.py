"""Digests of texts, files and documents: the first 16 hexadecimal digits of their SHA-256."""

import hashlib
import json
from pathlib import Path
from typing import Any

from oarlock.base.files import read_bytes


def of_text(text: str) -> str:
    """Computes the digest of a text in UTF-8."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def of_file(path: Path) -> str:
    """Computes the digest of a file's contents; an empty text if the file cannot be read."""
    try:
        return hashlib.sha256(read_bytes(path)).hexdigest()[:16]
    except (OSError, ValueError):
        return ""


def of_document(document: Any) -> str:
    """Computes the digest of a document as JSON with sorted keys; what JSON cannot hold counts as its ``str``."""
    return of_text(json.dumps(document, sort_keys=True, ensure_ascii=False, default=str))
