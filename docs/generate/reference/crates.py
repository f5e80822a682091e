"""The crates: what each is, and its parts, from the documentation that stands in its sources."""

import re
import tomllib

from text import REPOSITORY, plain, table
from text import page as written

HEAD = """\
The numerics are in Rust. `make rustdoc` writes the documentation of all of it, private items too, to
`build/site/rustdoc`, where it belongs to this site; `cargo doc --open -p oarlock-core` shows that of one crate. A
solver of your own needs `oarlock-core` alone: [how](../how-to/own-solver.md)."""


def page() -> str:
    """A section a crate."""
    members = tomllib.loads((REPOSITORY / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["members"]
    return written("Rust crates", HEAD, *(_crate(member) for member in members))


def _crate(member: str) -> str:
    folder = REPOSITORY / member
    name = tomllib.loads((folder / "Cargo.toml").read_text(encoding="utf-8"))["package"]["name"]
    lines = re.findall(r"^//! ?(.*)$", (folder / "src" / "lib.rs").read_text(encoding="utf-8"), re.MULTILINE)
    first = " ".join(lines[: lines.index("")] if "" in lines else lines)
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines if re.match(r"\| \[?`\w+`", line)]
    parts = [f"## {name}", f"{plain(_unlinked(first))} Its sources are in `{member}`."]
    modules = [row for row in rows if len(row) == 2]
    if modules:
        parts.append(
            table(["module", "what is in it"], [[_unlinked(head), plain(_unlinked(text))] for head, text in modules])
        )
    return "\n\n".join(parts)


def _unlinked(text: str) -> str:
    """Without rustdoc's links, which lead nowhere here."""
    return re.sub(r"\[(`[^`]+`)\](?:\([^)]*\))?", r"\1", text)
