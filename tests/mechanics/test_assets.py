"""A copy takes along what MuJoCo reads for an element, from where the model lies, and nothing else."""

import os
import struct

import pytest
from mechanisms import four_bar, write_model
from oarlock import InputError
from oarlock.mechanics.mjcf import copy_model

PICTURE = bytes.fromhex(  # one grey pixel
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b550000000a49444154789c6360000000020001"
    "48afa4710000000049454e44ae426082"
)
TETRAHEDRON = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
SECRET = b"root:x:0:0:root:/root:/bin/bash\n"


def model(tmp_path, asset, files):
    for name, content in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return write_model(tmp_path / "model", four_bar(rest=f"<asset>{asset}</asset>"))


def copied(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_what_mujoco_reads_is_copied(tmp_path):
    field = struct.pack("<ii4f", 2, 2, 0, 1, 0, 1)
    asset = (
        '<mesh name="m" file="sub/m.OBJ"/><texture name="t" type="2d" file="t.png"/>'
        '<hfield name="h" size="1 1 1 1" file="h.bin"/><texture name="u" type="2d" file="u" content_type="image/png"/>'
    )
    files = {"model/sub/m.OBJ": TETRAHEDRON, "model/t.png": PICTURE, "model/h.bin": field, "model/u": PICTURE}
    copy_model(model(tmp_path, asset, files), tmp_path / "out")
    assert copied(tmp_path / "out") == ["assets/h.bin", "assets/m.OBJ", "assets/t.png", "assets/u", "model.xml"]


@pytest.mark.parametrize(
    "asset",
    [
        '<texture name="t" type="cube" builtin="flat" width="8" height="8" fileright="{}"/>',
        '<texture name="t" type="2d" builtin="flat" width="8" height="8" file="{}"/>',
    ],
    ids=["side", "whole"],
)
@pytest.mark.parametrize("where", ["/etc/passwd", "../secret", "secret", "secret.png"])
def test_what_it_skips_is_not(tmp_path, asset, where):
    files = {"secret": SECRET, "model/secret": SECRET, "model/secret.png": SECRET}
    copy_model(model(tmp_path, asset.format(where), files), tmp_path / "out")
    assert copied(tmp_path / "out") == ["model.xml"]


@pytest.mark.parametrize(
    ("file", "said"),
    [("secret", "is not copied, expected .png, .ktx"), ("secret.png", "does not begin as a file .png does")],
)
def test_files_of_another_kind_are_named(tmp_path, file, said):
    """With visuals discarded MuJoCo never looks at a texture, whatever it is."""
    path = model(tmp_path, f'<texture name="t" type="2d" file="{file}"/>', {f"model/{file}": SECRET})
    path.write_text(path.read_text().replace("<compiler ", '<compiler discardvisual="true" '))
    with pytest.raises(InputError, match=said) as caught:
        copy_model(path, tmp_path / "out")
    assert file in str(caught.value)
    assert copied(tmp_path / "out") == []


def test_files_outside_need_the_flag(tmp_path, oarlock_here):
    path = model(tmp_path, '<mesh name="m" file="../far/m.obj"/>', {"far/m.obj": TETRAHEDRON})
    finished = oarlock_here("new", "mine", path, "--to", ".")
    (line,) = finished.stderr.splitlines()
    assert finished.returncode == 2
    assert "m.obj' is outside the folder of the model, expected --outside" in line
    assert not (tmp_path / "mine").exists()
    finished = oarlock_here("new", "mine", path, "--to", ".", "--outside")
    assert finished.returncode == 0, finished.stderr
    assert copied(tmp_path / "mine" / "assets") == ["m.obj"]


def test_links_lead_outside_too(tmp_path):
    path = model(tmp_path, '<mesh name="m" file="m.obj"/>', {"far/m.obj": TETRAHEDRON})
    os.symlink("../far/m.obj", tmp_path / "model" / "m.obj")
    with pytest.raises(InputError, match="expected --outside"):
        copy_model(path, tmp_path / "out")


def test_includes_outside_need_the_flag(tmp_path):
    (tmp_path / "far.xml").write_text("<mujocoinclude><option/></mujocoinclude>")
    path = write_model(tmp_path / "model", four_bar(rest='<include file="../far.xml"/>'))
    with pytest.raises(InputError, match="expected --outside"):
        copy_model(path, tmp_path / "out")
    copy_model(path, tmp_path / "again", outside=True)
