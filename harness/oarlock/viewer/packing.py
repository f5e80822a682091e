"""Arrays as text in a page."""

import base64
from typing import Any

import numpy as np


def packed(values: np.ndarray, kind: str = "<f4") -> dict[str, Any]:
    """An array as the page's script unpacks it: ``kind`` is little-endian ``<f4`` or ``<u4``, ``data`` base64."""
    own = np.ascontiguousarray(values, dtype=kind)
    return {"kind": kind, "shape": list(own.shape), "data": base64.b64encode(own.tobytes()).decode("ascii")}


def unpacked(document: dict[str, Any]) -> np.ndarray:
    """The array of such a document."""
    return np.frombuffer(base64.b64decode(document["data"]), document["kind"]).reshape(document["shape"])
