"""Pictures of pixels: what is written is read back by a reader of the tests' own, and the other way round."""

import struct
import zlib

import numpy as np
import pytest
from oarlock.render.gif import CLEAR, Gif
from oarlock.render.png import decoded, encoded

GENERATOR = np.random.default_rng(5)

CELL = 8
"""Of 256: colours that are nearer than this to one another in every channel may become one."""

WIDEST = 256 / 6 + CELL
"""Of 256: how far a colour may be from the nearest of 216 that are spread evenly, and of its own cell."""


def smooth(height=40, width=50):
    y, x = np.mgrid[:height, :width]
    return np.stack([3 * x, 4 * y, x * y % 256], axis=2).astype(np.uint8)


def noise(height=40, width=50):
    return GENERATOR.integers(0, 256, (height, width, 3), dtype=np.uint8)


# PNG.


@pytest.mark.parametrize("pixels", [smooth(), noise(), noise(1, 1)], ids=["smooth", "noise", "one"])
def test_png_comes_back(pixels):
    assert np.array_equal(decoded(encoded(pixels)), pixels)


def paeth(left, up, corner):
    far = int(left) + int(up) - int(corner)
    return min((left, up, corner), key=lambda one: abs(far - int(one)))


def filtered(pixels, kind):
    """A file of pixels (height, width, channels) with one filter, byte by byte as the standard has it."""
    height, width, channels = pixels.shape
    lines = bytearray()
    for y in range(height):
        lines.append(kind)
        for x in range(width):
            for c in range(channels):
                left = int(pixels[y, x - 1, c]) if x else 0
                up = int(pixels[y - 1, x, c]) if y else 0
                corner = int(pixels[y - 1, x - 1, c]) if x and y else 0
                guess = (0, left, up, (left + up) // 2, int(paeth(left, up, corner)))[kind]
                lines.append((int(pixels[y, x, c]) - guess) % 256)
    packed = zlib.compress(bytes(lines))
    head = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", packed[:7]), (b"IDAT", packed[7:]), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in chunks
    )


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("kind", range(5))
def test_every_filter_of_png_is_read(kind, channels):
    pixels = GENERATOR.integers(0, 256, (9, 11, channels), dtype=np.uint8)
    assert np.array_equal(decoded(filtered(pixels, kind)), pixels)


# GIF.


def unpacked(packed, count):
    """Values of the codes of a GIF, by its standard."""
    bits, held, place, size = 0, 0, 0, 9
    table: list[bytes] = []
    found, before = bytearray(), b""

    def start():
        return [bytes([value]) for value in range(256)] + [b"", b""]

    while True:
        while bits < size:
            held |= packed[place] << bits
            place, bits = place + 1, bits + 8
        code, held, bits = held & ((1 << size) - 1), held >> size, bits - size
        if code == 256:
            table, size, before = start(), 9, b""
            continue
        if code == 257:
            assert len(found) == count
            return bytes(found)
        word = table[code] if code < len(table) else before + before[:1]
        assert code <= len(table)
        found += word
        if before and len(table) < 4096:
            table.append(before + word[:1])
        if len(table) == 1 << size and size < 12:
            size += 1
        before = word


def frames(content):
    """Frames (height, width, 3) of a GIF and how long each is shown, s."""
    assert content[:6] == b"GIF89a"
    width, height = struct.unpack_from("<HH", content, 6)
    palette = np.frombuffer(content, np.uint8, 768, 13).reshape(256, 3)
    screen, at, found, times = np.zeros((height, width, 3), np.uint8), 13 + 768, [], []

    def blocks(at):
        parts = []
        while size := content[at]:
            parts.append(content[at + 1 : at + 1 + size])
            at += 1 + size
        return b"".join(parts), at + 1

    while content[at] != 0x3B:
        if content[at] == 0x21:
            label = content[at + 1]
            body, at = blocks(at + 2)
            if label == 0xF9:
                times.append(struct.unpack("<H", body[1:3])[0] / 100)
                assert body[0] & 1
                assert body[3] == CLEAR
            continue
        assert content[at] == 0x2C
        left, top, wide, high = struct.unpack_from("<HHHH", content, at + 1)
        assert content[at + 10] == 8
        packed, at = blocks(at + 11)
        values = np.frombuffer(unpacked(packed, wide * high), np.uint8).reshape(high, wide)
        window = screen[top : top + high, left : left + wide]
        window[values != CLEAR] = palette[values[values != CLEAR]]
        found.append(screen.copy())
    return found, times


def made(pictures, seconds=0.04):
    gif = Gif(pictures, seconds)
    for picture in pictures:
        gif.add(picture)
    return frames(gif.content())


def test_few_colours_come_back_as_they_were():
    first = np.full((30, 40, 3), 255, np.uint8)
    second = first.copy()
    second[5:9, 10:20] = (200, 30, 16)
    third = second.copy()
    third[29, 39] = (0, 0, 120)
    found, times = made([first, second, second, third])
    assert all(np.array_equal(a, b) for a, b in zip(found, [first, second, second, third], strict=True))
    assert times == [0.04] * 4


def test_more_words_than_a_table_holds():
    """Noise fills the table of 4096 words many times over."""
    values = GENERATOR.integers(0, 6, (150, 160, 3)) * 40 + 20
    picture = values.astype(np.uint8)
    (found,), _ = made([picture])
    assert np.array_equal(found, picture)


def test_many_colours_become_their_neighbours():
    picture = smooth(200, 80)
    (found,), _ = made([picture])
    assert len(np.unique(picture.reshape(-1, 3) // CELL, axis=0)) > CLEAR
    off = np.abs(found.astype(int) - picture)
    assert off.max() <= WIDEST
    assert off.mean() < WIDEST / 3


def test_a_frame_is_shown_at_least_as_long_as_readers_allow():
    assert made([smooth()], 0.001)[1] == [0.02]
