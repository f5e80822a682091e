"""Runs a program of an engine: ``PYTHON launch.py PROGRAM ASK ANSWER [ASK ANSWER ...]``.

Standard library only, any Python from 3.9 on. The folders in ``OARLOCK_ENGINE_PATH`` come first on ``sys.path``; the
program's own and that of the programs here, with what they share, come last, because a program is named as the package
that it imports. The process ends when whoever started it is gone: their end of its standard input closes then.
"""

import os
import runpy
import sys
import threading


def _watch() -> None:
    # Of the bare file: a buffered reader that waits holds up the end of the interpreter.
    while os.read(0, 1):
        pass
    os._exit(1)  # nobody is left to hear of it


def main() -> None:
    """Runs the program that the first argument names; the others are its arguments."""
    if os.environ.pop("OARLOCK_ENGINE_WATCH", ""):
        threading.Thread(target=_watch, daemon=True).start()
    sys.argv = sys.argv[1:]
    first = [folder for folder in os.environ.pop("OARLOCK_ENGINE_PATH", "").split(os.pathsep) if folder]
    sys.path[:1] = first  # in place of the folder of this file
    own = os.path.dirname(os.path.abspath(sys.argv[0]))
    shared = os.path.join(os.path.dirname(os.path.abspath(__file__)), "programs")
    sys.path += [own] if own == shared else [own, shared]
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
