"""Moving pictures as GIF: one palette, and of every frame what changed."""

import struct
from collections.abc import Iterable, Iterator

import numpy as np

CLEAR = 255
"""Number of the colour that leaves a pixel as it is."""

LEVELS = 32
"""Steps of red, of green and of blue that are told apart."""

FINENESS = (LEVELS, 16, 8, 6)
"""Such steps when colours are chosen; the last has no more cells than there are colours."""

COVERED = 0.98
"""Part of all pixels that chosen colours have to be near to."""

LEAST = 0.02
"""s: a frame that is shown shorter is slowed down by what shows GIFs."""


class Gif:
    """A moving picture that is made frame by frame.

    Args:
        sample: some of its frames, (height, width, 3) each, from which colours are chosen.
        seconds: that each frame is shown, at least ``LEAST``; the file counts hundredths.
    """

    def __init__(self, sample: Iterable[np.ndarray], seconds: float):
        frames = list(sample)
        self._shape = frames[0].shape[:2]
        palette = _palette(frames)
        self._nearest = _nearest(palette)
        self._hundredths = max(2, round(100 * seconds))
        self._before: np.ndarray | None = None
        height, width = self._shape
        screen = struct.pack("<HHBBB", width, height, 0xF7, 0, 0)
        again = b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"
        self._parts = [b"GIF89a", screen, palette.tobytes(), again]

    def add(self, frame: np.ndarray) -> None:
        """Adds a frame of the same size."""
        numbers = self._nearest[_key(frame)]
        top, left, (height, width) = 0, 0, self._shape
        drawn = numbers
        if self._before is not None:
            differs = numbers != self._before
            rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
            top, bottom = (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 1)
            left, right = (int(columns[0]), int(columns[-1]) + 1) if len(columns) else (0, 1)
            window = slice(top, bottom), slice(left, right)
            drawn = np.where(differs[window], numbers[window], CLEAR)
            height, width = drawn.shape
        self._before = numbers
        self._parts += [
            struct.pack("<BBBBHBB", 0x21, 0xF9, 4, 0x05, self._hundredths, CLEAR, 0),
            struct.pack("<BHHHHB", 0x2C, left, top, width, height, 0),
            b"\x08",
            *_blocks(_lzw(drawn.astype(np.uint8).tobytes())),
            b"\x00",
        ]

    def content(self) -> bytes:
        """The file."""
        return b"".join([*self._parts, b"\x3b"])


def _key(frame: np.ndarray, levels: int = LEVELS) -> np.ndarray:
    """Which of ``levels``³ cells of colours each pixel is in."""
    red, green, blue = np.moveaxis(frame.astype(int) * levels // 256, -1, 0)
    return (red * levels + green) * levels + blue


def _palette(frames: list[np.ndarray]) -> np.ndarray:
    """255 colours, each the mean of a cell, and one more that stands for none.

    The cells are as fine as they can be for the commonest 255 to have nearly all pixels.
    """
    pixels = np.concatenate([frame.reshape(-1, 3) for frame in frames])
    found = np.zeros((256, 3), np.uint8)
    for levels in FINENESS:
        keys = _key(pixels, levels)
        counts = np.bincount(keys, minlength=levels**3)
        chosen = np.argsort(-counts, kind="stable")[:CLEAR]
        if counts[chosen].sum() >= COVERED * len(pixels):
            sums = np.stack([np.bincount(keys, channel, levels**3)[chosen] for channel in pixels.T], axis=1)
            found[: len(chosen)] = np.rint(sums / np.maximum(counts[chosen], 1)[:, None])
            break
    return found


def _nearest(palette: np.ndarray) -> np.ndarray:
    """The number of the nearest colour of every cell."""
    level = (np.arange(LEVELS) + 0.5) * 256 / LEVELS
    cells = np.stack(np.meshgrid(level, level, level, indexing="ij"), axis=-1).reshape(-1, 3)
    colours = palette[:CLEAR].astype(float)
    # |c − p|² less what is the same for all p.
    return (np.square(colours).sum(axis=1) - 2.0 * cells @ colours.T).argmin(axis=1)


def _lzw(values: bytes) -> bytes:
    """Bytes, packed as GIF packs them: Lempel, Ziv and Welch's codes of 9 to 12 bits, the lowest bit first."""
    clear, end, most = 256, 257, 4096
    found, held, bits = bytearray(), 0, 0

    def put(code: int, size: int) -> None:
        nonlocal held, bits
        held |= code << bits
        bits += size
        while bits >= 8:
            found.append(held & 0xFF)
            held >>= 8
            bits -= 8

    table: dict[int, int] = {}
    size, following = 9, end + 1
    put(clear, size)
    prefix = values[0]
    for value in values[1:]:
        key = prefix << 8 | value
        code = table.get(key)
        if code is not None:
            prefix = code
            continue
        put(prefix, size)
        if following < most:
            table[key] = following
            size += following == 1 << size
            following += 1
        else:
            put(clear, size)
            table.clear()
            size, following = 9, end + 1
        prefix = value
    put(prefix, size)
    put(end, size)
    if bits:
        found.append(held & 0xFF)
    return bytes(found)


def _blocks(packed: bytes) -> Iterator[bytes]:
    for at in range(0, len(packed), 255):
        part = packed[at : at + 255]
        yield bytes([len(part)]) + part
