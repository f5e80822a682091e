"""The commands, as the terminal knows them."""

import re
from typing import Any

from oarlock.cli.app import app
from text import code, plain, table
from text import page as written
from typer.main import get_command

HEAD = """\
`oarlock COMMAND --help` says the same in the terminal. Exit status of every command: 0 all is well, 1 a gate failed
or something got worse, 2 bad input (one line says what), 130 interrupted, 141
whoever read the output has gone."""


def page() -> str:
    """Every command with its arguments and options."""
    commands = get_command(app).commands  # type: ignore[attr-defined]
    return written("Commands", HEAD, *(_command(name, commands[name]) for name in commands))


def _command(name: str, command: Any) -> str:
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    options = [one for one in command.params if one.param_type_name == "option" and one.name != "help"]
    usage = " ".join(["oarlock", name, *(_named(one) for one in arguments), *(["[OPTIONS]"] if options else [])])
    parts = [f"## oarlock {name} {{#{name}}}", f"```text\n{usage}\n```", _prose(command.help or "")]
    if arguments:
        parts.append(
            table(["argument", "what it is"], [[code(_named(one)), plain(one.help or "")] for one in arguments])
        )
    if options:
        parts.append(table(["option", "what it does", "default"], [_option(one) for one in options]))
    return "\n\n".join(parts)


def _prose(text: str) -> str:
    return "\n\n".join(plain(re.sub(r"\s+", " ", part)).strip() for part in text.split("\n\n"))


def _named(one: Any) -> str:
    metavar = one.metavar or one.name.upper()
    return f"{metavar}{'' if one.nargs == 1 else ' …'}"


def _option(one: Any) -> list[str]:
    flag = "/".join([*one.opts, *one.secondary_opts])
    value = "" if one.is_flag else f" {one.metavar or 'VALUE'}"
    default = "" if one.default in (None, False, (), []) or callable(one.default) else str(one.default)
    return [code(flag + value), plain(one.help or ""), code(default)]
