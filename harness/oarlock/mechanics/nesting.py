"""Models within models: what ``<model>`` and ``<attach>`` make of a few files, counted before MuJoCo does it.

MuJoCo reads a ``<model>`` wherever one is named, also within itself, until its stack ends; and a file that attaches
another one twice, which attaches another one twice, becomes a thousand copies in ten files.
"""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from oarlock.base.errors import InputError

DEPTH = 100
"""Models within one another: 0.3 s, and MuJoCo's time grows with the third power."""

COPIES = 5000
"""Models that are read or attached, all together."""


@dataclass
class Part:
    """What a file says of other MJCF files.

    Attributes:
        includes: files that it includes.
        models: pairs of name (empty: none given) and file of a ``<model>``.
        attached: name of a model → how often it is attached.
    """

    includes: list[Path] = field(default_factory=list)
    models: list[tuple[str, Path]] = field(default_factory=list)
    attached: Counter[str] = field(default_factory=Counter)


def require_few_copies(path: Path, parts: dict[Path, Part]) -> None:
    """Checks how models lie within models.

    Args:
        path: the file that is loaded, for messages.
        parts: file → what it says of others; of all that it leads to.

    Raises:
        InputError: a model is within itself, too deep, or there too often.
    """
    _Count(path, parts).copies(path, ())


class _Count:
    """Counts copies, of every file once."""

    def __init__(self, path: Path, parts: dict[Path, Part]):
        self._path, self._parts = path, parts
        self._known: dict[Path, int] = {}

    def copies(self, file: Path, above: tuple[Path, ...]) -> int:
        """How many models a file becomes, itself among them."""
        if file in above:
            raise InputError(
                f"{self._path}: <model> names '{file.name}', which is within itself, expected another file"
            )
        if len(above) > DEPTH:
            raise InputError(f"{self._path}: models within models, more than {DEPTH} deep, expected fewer")
        if file not in self._known:
            total = 1
            own = self._with_includes(file)
            attached: Counter[str] = sum((part.attached for part in own), Counter())
            named = {name for part in own for name, _ in part.models}
            unnamed = sum(count for name, count in attached.items() if name not in named)
            for name, model in (one for part in own for one in part.models):
                total += max(1, attached[name] if name else unnamed) * self.copies(model, (*above, file))
                if total > COPIES:
                    raise InputError(f"{self._path}: attaches models more than {COPIES} times, expected fewer")
            self._known[file] = total
        return self._known[file]

    def _with_includes(self, file: Path) -> list[Part]:
        found, left = dict[Path, Part](), [file]
        while left:
            one = left.pop()
            if one in self._parts and one not in found:
                found[one] = self._parts[one]
                left += found[one].includes
        return list(found.values())
