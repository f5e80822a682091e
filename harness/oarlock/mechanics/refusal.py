"""What MuJoCo says of a model that it refuses, in words of a user."""

import re

from oarlock.base.text import one_line
from oarlock.mechanics.engine_version import too_old

_PARSER = re.compile(
    r"XML parse error \d+: Error=XML_(?:ERROR_)?(?P<what>\w+) ErrorID=\d+ \(0x[0-9a-f]+\) Line number=(?P<line>\d+)"
    r"(?:: XMLElement name=(?P<name>\S+))?"
)
"""How its parser, tinyxml2, puts where a file is no XML."""

_ROOT = "Unrecognized XML model type"


def refusal(error: BaseException) -> str:
    """Says why MuJoCo refused a model, in one line, and what was expected where it does not say that itself."""
    said = one_line(error)
    if parsed := _PARSER.search(said):
        what, line, name = parsed["what"].lower().replace("_", " "), parsed["line"], parsed["name"]
        element = f" <{name}>" if name else ""
        return f"XML that cannot be read: {what}{element} at line {line}, expected MJCF or URDF"
    expected = ", expected <mujoco> or <robot>" if _ROOT in said else ""
    return f"MuJoCo refuses it: {said}{expected}{too_old(said)}"
