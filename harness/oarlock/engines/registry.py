"""The engines that there are: programs in a folder, one file each, and what the head of each says of it.

The head is inline metadata (PEP 723): the requirements of the program's environment, and in ``[tool.oarlock]`` what
oarlock wants to know. A new engine is a file in ``programs/``, or any file that is named by its path.
"""

import ast
import re
import tomllib
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from oarlock.base.errors import InputError, choose, one_line
from oarlock.base.hashing import of_document, of_file
from oarlock.base.options import Number

PROGRAMS = Path(__file__).with_name("programs")
SHARED = PROGRAMS / "shared"
LAUNCH = Path(__file__).with_name("launch.py")

QUESTIONS = ("forward", "step", "run")
"""What can be asked: accelerations of states, these and one step of each, a free run from the first state."""

PRECISIONS = ("float64", "float32")

_HEAD = re.compile(r"(?m)^# /// script$\s(?P<content>(^#(| .*)$\s)+)^# ///$")
_REQUIREMENT = re.compile(r"\s*([A-Za-z0-9._-]+)\s*(\[[^\]]*\])?\s*(.*)")


@dataclass(frozen=True)
class Program:
    """A program, as its head describes it.

    Attributes:
        name: name of its file.
        path: the file.
        title: for tables.
        requirements: what its environment holds, as pip takes them.
        package: the engine's own, whose version can be asked for; empty if there is none.
        together: packages that take the same version.
        beside: whether any interpreter that has the rest can run it, with the package in a folder of its own.
        several: whether it answers several questions in one process.
        questions: what it can be asked; empty of one that only says what its reader keeps.
        precisions: of its answers; the first unless another is asked for.
        equalities: kinds of equalities that it has; None where it does not say.
        settings: its own, by name; what others are asked for is refused.
        closed: whether states have to be closed, for its rows have no law of their own where they are not.
    """

    name: str
    path: Path
    title: str
    requirements: tuple[str, ...]
    package: str = ""
    together: tuple[str, ...] = ()
    beside: bool = False
    several: bool = False
    questions: tuple[str, ...] = QUESTIONS
    precisions: tuple[str, ...] = PRECISIONS[:1]
    equalities: tuple[str, ...] | None = None
    settings: tuple[str, ...] = ()
    closed: bool = False

    @property
    def digest(self) -> str:
        """Of everything that its answers depend on, besides its environment: the file, and what it takes of others."""
        return of_document([of_file(path) for path in (self.path, LAUNCH, *_taken(self.path))])


def _taken(path: Path) -> list[Path]:
    """The files in ``shared/`` and beside it that a program imports, and those that these do."""
    found: dict[Path, None] = {}
    waiting = [path]
    while waiting:
        importer = waiting.pop()
        try:
            tree = ast.parse(importer.read_bytes())
        except (OSError, SyntaxError, ValueError):
            continue
        for node in ast.walk(tree):
            new = [one for one in _imported(node, importer.parent) if one.is_file() and one not in found]
            waiting += new
            found |= dict.fromkeys(new)
    return sorted(found)


def _imported(node: ast.AST, folder: Path) -> list[Path]:
    """The files that a statement imports if they are in ``shared/`` or in a folder."""
    if isinstance(node, ast.Import):
        modules = [one.name for one in node.names]
    elif isinstance(node, ast.ImportFrom):
        module = node.module or ""
        modules = [module, *(f"{module}.{one.name}".lstrip(".") for one in node.names)]
    else:
        return []
    parts = [module.split(".") for module in modules if module]
    shared = [SHARED.joinpath(*part[1:]).with_suffix(".py") for part in parts if part[0] == SHARED.name and part[1:]]
    return shared + [folder.joinpath(*part).with_suffix(".py") for part in parts]


@cache
def read_program(path: Path) -> Program:
    """Reads the head of a program.

    Raises:
        InputError: the file cannot be read, or its head is missing or not as expected.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"program '{path}' cannot be read: {one_line(error)[:120]}") from None
    found = _HEAD.search(text.replace("\r\n", "\n"))
    if found is None:
        raise InputError(f"program '{path}' has no head, expected '# /// script' with its dependencies (PEP 723)")
    lines = [line[2:] if line.startswith("# ") else line[1:] for line in found["content"].splitlines()]
    try:
        head = tomllib.loads("\n".join(lines))
        return _program(path, head)
    except (tomllib.TOMLDecodeError, TypeError, AttributeError) as error:
        raise InputError(f"program '{path}': its head is not as expected: {one_line(error)[:120]}") from None


def _program(path: Path, head: dict[str, Any]) -> Program:
    own: dict[str, Any] = head.get("tool", {}).get("oarlock", {})
    for name, known in (("questions", QUESTIONS), ("precisions", PRECISIONS)):
        for one in own.get(name, ()):
            choose(f"{name} in the head of '{path.name}'", one, known)
    equalities = own.get("equalities")
    return Program(
        path.stem,
        path,
        str(own.get("title", path.stem)),
        tuple(map(str, head.get("dependencies", ()))),
        str(own.get("package", "")),
        tuple(own.get("together", ())),
        bool(own.get("beside", False)),
        bool(own.get("several", False)),
        tuple(own.get("questions", QUESTIONS)),
        tuple(own.get("precisions", PRECISIONS[:1])),
        None if equalities is None else tuple(equalities),
        tuple(own.get("settings", ())),
        bool(own.get("closed", False)),
    )


def programs() -> dict[str, Program]:
    """The programs that come with oarlock, by name."""
    found = (path for path in sorted(PROGRAMS.glob("*.py")) if path.name != "__init__.py")
    return {path.stem: read_program(path) for path in found}


def expressions() -> list[dict[str, Any]]:
    """Returns what each of them can express, a row a program.

    A row has ``engine``, ``title``, ``questions``, ``precisions``, ``package``, and kinds of ``equalities``, None where
    the program does not say.
    """
    return [
        {
            "engine": name,
            "title": one.title,
            "questions": list(one.questions),
            "precisions": list(one.precisions),
            "equalities": None if one.equalities is None else list(one.equalities),
            "package": one.package,
        }
        for name, one in programs().items()
    ]


@dataclass(frozen=True)
class Engine:
    """An engine as it is asked for.

    Attributes:
        asked: how it was written; it names the engine in tables.
        program: who answers.
        version: of its package; empty: any that its requirements admit.
        precision: of its answers.
        python: an interpreter that has what it needs; empty for an environment that oarlock makes.
        settings: the engine's own, by name.
    """

    asked: str
    program: Program
    version: str = ""
    precision: str = "float64"
    python: str = ""
    settings: dict[str, Number | str] = field(default_factory=dict, hash=False)

    @property
    def name(self) -> str:
        """Names it in tables and folders: without its interpreter, and of a file without its folder."""
        name = self.program.name + (f"@{self.version}" if self.version else "")
        told = dict(self.settings)
        if len(self.program.precisions) > 1 and self.precision != self.program.precisions[0]:
            told = {"precision": self.precision, **told}
        return name + ("" if not told else ":" + ",".join(f"{key}={value}" for key, value in told.items()))

    @property
    def requirements(self) -> tuple[str, ...]:
        """What its environment holds, with the version that was asked for."""
        if not self.version:
            return self.program.requirements
        pinned = {self.program.package, *self.program.together}
        exact = []
        for one in self.program.requirements:
            package, extras, _ = split_requirement(one)
            exact.append(f"{package}{extras}=={self.version}.*" if package in pinned else one)
        return tuple(exact)

    def asks(self, question: str) -> bool:
        """Whether it can be asked such a question."""
        return question in self.program.questions


def split_requirement(text: str) -> tuple[str, str, str]:
    """Splits a requirement into package, extras with their brackets, and versions."""
    found = _REQUIREMENT.fullmatch(text.partition(";")[0])
    if found is None:
        raise InputError(f"requirement '{text}', expected a package and its versions")
    return found[1], found[2] or "", found[3].strip()


def parse_engine(text: str) -> Engine:
    """Parses ``NAME[@VERSION][:key=value,…][=PYTHON]``; NAME is a program's, or the path of one.

    Keys are ``precision``, or settings of the engine's own.

    Raises:
        InputError: there is no such program, or it has no such version or precision.
    """
    name, version, options, python = _split(text)
    if name.endswith(".py"):
        program = read_program(Path(name).absolute())
    else:
        known = programs()
        program = known[choose("engine", name, list(known))]
    if version and not program.package:
        raise InputError(f"engine '{text}': '{program.name}' has no package of its own, expected no version")
    precision = str(options.pop("precision", program.precisions[0]))
    choose(f"precision of engine '{program.name}'", precision, program.precisions)
    for name in options:
        if not program.settings:
            raise InputError(f"engine '{text}': '{name}', but '{program.name}' has no settings (head of its file)")
        choose(f"setting of engine '{program.name}'", name, program.settings)
    return Engine(text, program, version, precision, python, options)


def _split(text: str) -> tuple[str, str, dict[str, Number | str], str]:
    # Where options end and an interpreter begins: keys have no slash, interpreters no comma.
    head, colon, tail = text.partition(":")
    options: dict[str, Number | str] = {}
    python = ""
    if colon and "=" not in head:
        name = head
        for part in tail.split(","):
            key, sign, value = part.partition("=")
            if not sign or not key.strip() or not value:
                raise InputError(f"engine '{text}': '{part}', expected key=value after the colon")
            value, again, python_here = value.partition("=")
            python = python_here if again else python
            options[key.strip()] = _number(value)
    else:
        name, _, python = text.partition("=")
    name, sign, version = name.partition("@")
    if not name or (sign and not re.fullmatch(r"\d+(\.\w+)*", version)):
        raise InputError(f"engine '{text}', expected NAME, NAME@VERSION or NAME=PYTHON, such as mujoco@3.7")
    return name, version, options, python


def _number(text: str) -> Number | str:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
