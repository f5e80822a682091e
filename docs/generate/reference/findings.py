"""The findings of ``oarlock check``, from their catalogue."""

import re

from oarlock.diagnosis.verdict.findings import CATALOGUE, Entry, catalogue
from text import page as written
from text import plain, table

HEAD = """\
What `oarlock check` can find. A code is stable: it is never given to anything else. `oarlock explain CODE` prints
the same. In the formulas r, ṙ and r̈ are the deviation of the rows and its rates, J their Jacobian, f MuJoCo's
force on them, R their softness, K, B and d stiffness, damping and impedance (`efc_KBIP`), A = J M⁻¹ Jᵀ, h the
timestep, v the velocities."""


def page() -> str:
    """All of them, in the groups of the catalogue."""
    entries = catalogue()
    rows = [
        [f"[{entry.code}](#{entry.code.lower()})", entry.name, entry.severity, plain(entry.title)]
        for entry in entries.values()
    ]
    parts = [table(["code", "name", "severity", "what is the matter"], rows)]
    for group, codes in _groups():
        parts += [f"## {group}", *(_entry(entries[code]) for code in codes)]
    return written("Findings", HEAD, *parts)


def _groups() -> list[tuple[str, list[str]]]:
    """Heading of a group → its codes, in the order of the file."""
    text = CATALOGUE.read_text(encoding="utf-8")
    parts = re.split(r"^\n# (.+)\.\n(?=\n\[)", text, flags=re.MULTILINE)
    groups = [
        (head, re.findall(r"^\[(\w+)\]$", part, re.MULTILINE))
        for head, part in zip(parts[1::2], parts[2::2], strict=True)
    ]
    listed = [code for _, codes in groups for code in codes]
    if listed != list(catalogue()):
        raise ValueError("findings.toml: a code stands in no group")
    return groups


def _entry(entry: Entry) -> str:
    parts = {"How it is measured": entry.measured, "What to do": entry.remedy}
    lines = [
        f"### {entry.code} {entry.name} {{#{entry.code.lower()}}}",
        f"*{entry.severity}.* **{plain(entry.title)}**",
    ]
    lines.append(_prose(entry.meaning))
    for heading, prose in parts.items():
        lines += [f"**{heading}**", _prose(prose)]
    return "\n\n".join(lines)


def _prose(text: str) -> str:
    """Paragraphs, and formulas as they stand."""
    parts: list[tuple[bool, list[str]]] = []
    for line in text.splitlines():
        formula = line.startswith("    ")
        if not parts or parts[-1][0] != formula:
            parts.append((formula, []))
        parts[-1][1].append(line[4:] if formula else plain(line))
    return "\n\n".join(
        "```text\n" + "\n".join(lines) + "\n```" if formula else "\n".join(lines) for formula, lines in parts
    )
