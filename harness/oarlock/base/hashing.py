"""Digests of texts, files and documents."""

import hashlib
import json
from pathlib import Path
from typing import Any


def of_text(text: str) -> str:
    """Sixteen hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def of_file(path: Path) -> str:
    """Sixteen hexadecimal digits of the contents; of nothing if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError:
        return ""


def of_document(document: Any) -> str:
    """The digest of what JSON can hold."""
    return of_text(json.dumps(document, sort_keys=True, ensure_ascii=False, default=str))
