"""A fence around what is attacked: the kernel lets it write below one folder only, whatever it is tricked into.

An attack looks for ways to write where nothing should be written. When it finds one, the machine of whoever attacks
must not pay for it: a damaged folder with a link in it, followed by root, once replaced a file of the system.
"""

import ctypes
import os
import stat
import sys
from pathlib import Path

_CREATE, _ADD, _RESTRICT = 444, 445, 446
"""System calls of Landlock, the same on every architecture."""
_BENEATH = 1
_NO_NEW_PRIVILEGES = 38
_WRITE_FILE, _TRUNCATE = 1 << 1, 1 << 14
_WRITING = _WRITE_FILE | _TRUNCATE | sum(1 << bit for bit in range(4, 14))
"""Opening to write, truncating, removing, making anything, moving from folder to folder."""
_OLDEST = 3
"""Version that knows truncating."""
_DEVICES = ("/dev/null", "/dev/full")
"""May be written to as ever, and not removed or replaced."""


class _Beneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("folder", ctypes.c_int32))


def available() -> bool:
    """Whether this kernel has what a fence needs."""
    return sys.platform == "linux" and ctypes.CDLL(None).syscall(_CREATE, None, 0, 1) >= _OLDEST


def fence(folder: Path) -> None:
    """Keeps this process and those that it starts from writing elsewhere, for good.

    Raises:
        OSError: the kernel refuses.
    """
    handled = ctypes.c_uint64(_WRITING)
    rules = _called(_CREATE, ctypes.byref(handled), ctypes.sizeof(handled), 0)
    for path in (str(folder), *_DEVICES):
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
        allowed = _WRITING if stat.S_ISDIR(os.stat(path).st_mode) else _WRITE_FILE | _TRUNCATE
        _called(_ADD, rules, _BENEATH, ctypes.byref(_Beneath(allowed, opened)), 0)
        os.close(opened)
    if ctypes.CDLL(None).prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0):
        raise OSError("no fence: prctl")
    _called(_RESTRICT, rules, 0)
    os.close(rules)


def _called(number: int, *arguments: object) -> int:
    library = ctypes.CDLL(None, use_errno=True)
    given = library.syscall(number, *arguments)
    if given < 0:
        raise OSError(ctypes.get_errno(), "no fence: " + os.strerror(ctypes.get_errno()))
    return given
