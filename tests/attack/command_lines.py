"""Mutated arguments of every command: values, options and places of others, hostile ones, left out, doubled, exchanged.

cd tests && ../.venv/bin/python -m attack --only arguments
"""

import os
import random
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from mechanisms import four_bar, write_model
from suites import TINY

from attack.trials import Attempt, command, forked

BASES: list[tuple[str, ...]] = [
    ("run", "tiny", "--out", "out", "--duration", "0.02", "--json", "-"),
    ("run", "tiny", "--out", "out", "--solver", "sr1:eps_abs=1e-6", "--mode", "free", "--form", "hard"),
    ("run", "model.xml", "--out", "out", "--timestep", "0.001", "--duration", "0.01", "--rtol", "1e-6"),
    ("run", "four_bar", "--out", "out", "--duration", "0.01", "--mode", "lockstep", "--walker", "pinv"),
    ("run", "ring:bodies=3", "--out", "out", "--duration", "0.01", "--mode", "free", "--solver", "pinv"),
    ("run", "tiny", "--out", "out", "--integrator", "euler", "--stabilisation", "both", "--stepping", "python"),
    ("run", "tiny", "--out", "out", "--report", "page", "--replace", "--ignore-inequalities", "--no-code"),
    ("suite", "tiny", "--out", "out", "--jobs", "1", "--json", "-"),
    ("suite", "tiny", "--out", "out", "--sweep", "seed=1:2:2", "--sweep", "timestep=1e-3:2e-3:2"),
    ("suite", "tiny", "model.xml", "--out", "out", "--report", "page", "--fresh", "--unit-timeout", "30"),
    ("check", "model.xml", "--budget", "0", "--duration", "0.05", "--json", "-"),
    ("check", "tiny", "--budget", "0", "--duration", "0.05", "--seed", "3", "--controls", "random"),
    ("check", "model.xml", "--budget", "0.1", "--duration", "0.05", "--timestep", "0.001", "--integrator", "euler"),
    ("check", "model.xml", "--budget", "0", "--duration", "0.05", "--control", "m=1", "--keyframe", "home"),
    ("check", "model.xml", "--budget", "0", "--duration", "0.05", "--target", "1e-6", "--fail-above", "1e-3"),
    ("check", "model.xml", "--budget", "0", "--duration", "0.05", "--write-keyframe", "out/k.xml"),
    ("check", "model.xml", "--budget", "0", "--duration", "0.05", "--fix", "out/f.xml"),
    ("check", "model.xml", "tiny", "--lint", "--sarif", "out/s.sarif", "--junit", "out/s.xml", "--quiet"),
    ("close", "model.xml", "--pair", "tip1", "rocker", "--as", "hinge", "-o", "out/c.xml", "--json", "-"),
    ("solvers", "--json"),
    ("new", "x", "model.xml", "--to", "out"),
    ("new", "x", "model.xml", "--to", "out", "--outside"),
    ("diff", "results", "results", "--timings", "2", "--limit", "3", "--json", "-"),
    ("diff", "results", "other", "--allow-missing", "--junit", "out/j.xml", "--report", "page"),
    ("report", "results", "--to", "page"),
    ("bench", "--size", "6", "--rounds", "1", "--json", "-"),
    ("bench", "--model", "four_bar", "--rounds", "1"),
    ("list",),
    ("list", "--json"),
    ("explain", "L1"),
    ("explain", "--json"),
]

VALUES = [
    *(
        "",
        " ",
        "-",
        "--",
        "-1",
        "0",
        "1",
        "2",
        "nan",
        "inf",
        "-inf",
        "1e308",
        "1e-308",
        "1e400",
        "9" * 19,
        "9" * 5000,
        "0x1",
    ),
    *(
        "1e-9",
        "1_0",
        "½",
        "٣",
        "x",
        "X" * 300,
        "x" * 10**5,
        "a b",
        "[red]x[/red]",
        "\x1b[2J",
        "a\nb",
        "\udcff",
        "\u202e",
        "*",
    ),
    *(
        "..",
        "/dev/null/x",
        "/dev/full",
        "pipe",
        "folder",
        "model.xml",
        "tiny",
        "results",
        "gone",
        "gone.xml",
        "[1]",
        "?",
    ),
    *(
        "tiny:N=1",
        "ring:bodies=0",
        "ring:bodies=1e9",
        "ring:bodies=-1",
        "ring:M=1",
        "ring:bodies=",
        "ring:",
        ":",
        "ring:bodies=3,N=4",
        "four_bar:x=1",
    ),
    *(
        "pinv",
        "mujoco",
        "sr1:eps_abs=0",
        "sr1:eps_abs=nan",
        "pinv:x=1",
        "sr1:",
        "rk4",
        "euler",
        "free",
        "hard",
        "random",
    ),
    *("seed=1:2:2", "seed=1:2:10000000", "seed=2:1:2", "timestep=0:1:2", "timestep=1e-300:1e300:3", "solref=nan:1:2"),
    *(
        "x=1:2:3",
        "seed=1:2",
        "seed",
        "=::",
        "m=1",
        "m=nan",
        "m=",
        "=1",
        "m=1=2",
        "keyframe",
        "home",
        "tcp://127.0.0.1:1",
    ),
    *(
        "local",
        "tls://x",
        "tcp://[::1",
        "L1",
        "L9999",
        "loop-open",
        "/proc/version/x",
        "out/../out",
        "./tiny",
        "tiny/",
    ),
]
FLAGS = [
    *(
        "--json",
        "--out",
        "--report",
        "--jobs",
        "--scheduler",
        "--solver",
        "--form",
        "--mode",
        "--walker",
        "--integrator",
    ),
    *(
        "--stabilisation",
        "--timestep",
        "--duration",
        "--rtol",
        "--stepping",
        "--replace",
        "--no-code",
        "--fresh",
        "--help",
    ),
    *(
        "--unit-timeout",
        "--sweep",
        "--keyframe",
        "--controls",
        "--control",
        "--seed",
        "--target",
        "--fail-above",
        "--x",
        "-h",
    ),
    *(
        "--write-keyframe",
        "--write-tuned",
        "--fix",
        "--to",
        "--outside",
        "--timings",
        "--limit",
        "--junit",
        "--size",
        "--rounds",
    ),
]

LARGE = {"bench": ("--growth", "--growth-report", "--size", "--model"), "suite": ("tiny", "model.xml")}
"""Words without which a command does everything that there is, for minutes and rightly."""


def attempts(seed: int, folder: Path, count: int = 200) -> Iterator[Attempt]:
    """Commands with mutated arguments.

    Args:
        seed: of chance.
        folder: gets a folder of results to be read.
        count: of attempts.
    """
    prepare = _prepared(folder)
    number = 0
    for number in range(count):
        chance = random.Random(f"arguments-{seed}-{number}")
        arguments = mutated(BASES[number % len(BASES)], chance)
        while not _moderate(arguments):
            arguments = mutated(BASES[number % len(BASES)], chance)
        given = ("out", "page", *arguments)  # whatever is named may be written to
        yield Attempt(f"arguments {seed}-{number}", arguments, prepare, given)


def _prepared(folder: Path) -> Callable[[Path], None]:
    """What writes the files that arguments name."""
    kept = folder / "kept"
    kept.mkdir()
    write_model(kept / "tiny", four_bar(), TINY)
    text = four_bar(
        rest='<actuator><motor name="m" joint="crank"/></actuator><keyframe><key name="home" qpos="0 0 0"/></keyframe>'
    )
    write_model(kept, text)
    Path(f"{kept}.tmp").mkdir()
    for name, more in (("results", ()), ("other", ("--mode", "free"))):
        forked(partial(command, ["run", "tiny", "--duration", "0.02", "--out", name, *more], kept), folder)
    return partial(_write, kept)


def _write(kept: Path, folder: Path) -> None:
    for path in kept.iterdir():
        os.system(f"cp -r '{path}' '{folder}'") if path.is_dir() else (folder / path.name).write_bytes(
            path.read_bytes()
        )
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "out").mkdir()


def mutated(base: tuple[str, ...], chance: random.Random) -> tuple[str, ...]:
    """Arguments with one to three things changed; the command stays."""
    words = list(base)
    for _ in range(chance.choice([1, 1, 2, 3])):
        at = chance.randrange(1, len(words) + 1)
        match chance.randrange(8):
            case 0 if at < len(words):
                del words[at]
            case 1 if at < len(words):
                words.insert(at, words[at])
            case 2:
                words[at:at] = [chance.choice(FLAGS), chance.choice(VALUES)]
            case 3:
                words.insert(at, chance.choice(FLAGS))
            case 4:
                words[at:at] = [one for one in chance.choice(BASES)[1:] if chance.random() < 0.5]
            case 5 if at < len(words):
                other = chance.randrange(1, len(words))
                words[at], words[other] = words[other], words[at]
            case _ if at < len(words):
                words[at] = chance.choice(VALUES)
            case _:
                words.append(chance.choice(VALUES))
    return tuple(words)


def _moderate(arguments: tuple[str, ...]) -> bool:
    """Whether a command does not do everything that there is, or write where models are."""
    if any("\0" in word for word in arguments):
        return False
    name = arguments[0]
    if name == "new" and "--to" not in arguments:
        return False
    if name == "bench" and any(word.startswith(("--growth", "--family")) for word in arguments):
        return False
    return name not in LARGE or any(word in LARGE[name] for word in arguments)
