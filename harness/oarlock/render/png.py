"""Pictures of pixels as PNG, written and read: eight bits a channel, nothing between the lines."""

import struct
import zlib

import numpy as np

_MARK = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {2: 3, 6: 4}


def encoded(pixels: np.ndarray) -> bytes:
    """Pixels (height, width, 3), red, green and blue, as a file."""
    height, width, _ = pixels.shape
    lines = np.zeros((height, 1 + 3 * width), np.uint8)
    lines[:, 1:] = pixels.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(lines.tobytes(), 1)), (b"IEND", b""))
    return _MARK + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    )


def decoded(content: bytes) -> np.ndarray:
    """Pixels (height, width, 3 or 4) of a file of such pictures."""
    at, packed, shape = len(_MARK), [], (0, 0, 0)
    while at < len(content):
        (size,) = struct.unpack_from(">I", content, at)
        kind, body = content[at + 4 : at + 8], content[at + 8 : at + 8 + size]
        if kind == b"IHDR":
            width, height, _, colours, *_ = struct.unpack(">IIBBBBB", body)
            shape = (height, width, _CHANNELS[colours])
        elif kind == b"IDAT":
            packed.append(body)
        at += 12 + size
    height, width, channels = shape
    lines = np.frombuffer(zlib.decompress(b"".join(packed)), np.uint8).reshape(height, 1 + width * channels)
    found = np.zeros(shape, np.uint8)
    above = np.zeros((width, channels), np.uint8)
    for row, line in enumerate(lines):
        above = found[row] = _unfiltered(int(line[0]), line[1:].reshape(width, channels), above)
    return found


def _unfiltered(kind: int, line: np.ndarray, above: np.ndarray) -> np.ndarray:
    """A line (width, channels) from its differences: to its left, above, their mean, or Paeth's choice."""
    if kind in (0, 2):
        return line + above if kind == 2 else line
    if kind == 1:
        return np.cumsum(line, axis=0, dtype=np.uint8)
    found, left, corner = np.zeros_like(line), np.zeros(line.shape[1], int), np.zeros(line.shape[1], int)
    for at, (delta, up) in enumerate(zip(line.astype(int), above.astype(int), strict=True)):
        if kind == 3:
            guess = (left + up) // 2
        else:
            far = left + up - corner
            to_left, to_up, to_corner = abs(far - left), abs(far - up), abs(far - corner)
            guess = np.where(to_up <= to_corner, up, corner)
            guess = np.where((to_left <= to_up) & (to_left <= to_corner), left, guess)
        left, corner = (delta + guess) % 256, up
        found[at] = left
    return found
