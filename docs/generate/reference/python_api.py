"""The public names of ``oarlock``, from their docstrings."""

import oarlock
from text import page as written

HEAD = """\
All public names are those of `oarlock` itself; modules are no part of the interface. `oarlock.__version__` is the
version. `check`, `run`, `conform`, `diff`, `sample`, `suite`, `sweep`, `versions` and `view` each give an
[`Answer`](#oarlock.Answer): its tables are polars frames, `report` writes its page, and a notebook shows it."""


def page() -> str:
    """Functions first, then what they take and give."""
    names = [name for name in oarlock.__all__ if not name.startswith("__")]
    functions = [name for name in names if not isinstance(getattr(oarlock, name), type)]
    classes = [name for name in names if name not in functions]
    return written(
        "Python",
        HEAD,
        "## Functions",
        *(f"::: oarlock.{name}" for name in functions),
        "## Classes",
        *(f"::: oarlock.{name}" for name in classes),
    )
