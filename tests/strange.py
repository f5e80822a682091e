"""MJCF files in the manner of other authors: includes, defaults, meshes and textures in folders of their own."""

import shutil
import struct
import zlib
from pathlib import Path

from places import FIXTURES

FILES = {
    "gripper": "gripper/gripper.xml",
    "hopper": "hopper.xml",
    "crane": "crane.xml",
    "pair": "attached/pair.xml",
}
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def _write_png(path: Path) -> None:
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", 4, 4, 8, 2, 0, 0, 0)
    pixels = b"".join(b"\0" + bytes([200, 200, 210] * 4) for _ in range(4))
    image = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(pixels)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + image)


def write_files(folder: Path) -> Path:
    """Copies the fixtures to a new folder and makes their meshes and textures."""
    shutil.copytree(FIXTURES, folder)
    for meshes in ("gripper/meshes", "hanger/shapes"):
        (folder / meshes).mkdir()
        (folder / meshes / "link.obj").write_text(TETRAHEDRON)
    _write_png(folder / "gripper" / "meshes" / "plate.png")
    return folder
