"""Mutated case files: keys left out, doubled and retyped, hostile values, laws and tables, bytes changed.

cd tests && ../.venv/bin/python -m attack --only cases
"""

import os
import random
import re
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from mechanisms import four_bar
from places import REPOSITORY
from suites import TINY

from attack.models import garbled
from attack.trials import Attempt

MOTOR = four_bar(
    rest='<actuator><motor name="m" joint="crank"/></actuator><keyframe><key name="home" qpos="0 0 0"/></keyframe>'
)

RICH = """title = "rich"
summary = "Every table."
source = "made up"
tags = ["a", "b"]
rank_cut = 1e-9
[run]
duration_s = 0.02
timestep_s = 1e-3
integrator = "rk4"
stabilisation = "both"
ignore_inequalities = true
[start]
qpos = { crank = 0.0, coupler = 0.0, rocker = 0.0 }
qvel = { crank = 0.0 }
[drive]
constants = { a = 0.5, b = "2*a" }
ctrl.m = "a*sin(b*t) + PI"
[expect]
nv = 3
rows = "3"
rank = 2
dof = 1
reactions = "unique"
[baumgarte]
beta = 5.0
k = 25.0
[settings.stiff]
solver = "cg"
solref = [0.02, 1.0]
solimp = [0.9, 0.95, 0.001, 0.5, 2.0]
[truth]
file = "t.csv"
joint = "crank"
source = "nobody"
[paper]
source = "somebody"
iterations_mean = 1.5
[[published]]
time_s = 0.01
joint = "crank"
position = 0.0
source = "x"
[sweep]
timesteps_s = [1e-3, 2e-3]
[[experiments]]
mode = "free"
forms = ["hard"]
solvers = ["mujoco", "pinv", "sr1:eps_abs=1e-3"]
integrators = ["euler"]
settings = ["default", "stiff"]
[[experiments]]
mode = "one-step"
[[gates]]
figure = "drift_pos_max"
where = { mode = "free" }
min = 0.0
max = 1e9
cause = "x"
[[endings]]
status = "unconverged"
where = { solver = "sr1" }
cause = "y"
"""

LAWS = [
    *(
        "",
        " ",
        "t",
        "x",
        "1/0",
        "0/0",
        "1/t",
        "t^t^t^t",
        "1e999",
        "-1e308*1e308",
        "sqrt(-1)",
        "ln(0)",
        "sin(",
        ")",
        "()",
    ),
    *(
        "1+",
        "+1",
        "--1",
        "1 2",
        "2t",
        "t(1)",
        "sin",
        "sin cos t",
        "e",
        "PI",
        "π*t",
        "t;t",
        "__import__('os')",
        "1e5000",
    ),
    *("(" * 5000 + "t" + ")" * 5000, "-" * 5000 + "t", "+".join(["t"] * 20_000), "sin(" * 2000 + "t" + ")" * 2000),
    *("9" * 5000, "t" * 10_000, "x" * 10**6, "\\u0000", "\\u001b[2J", "{N}", "{", "t\\nt", "a", "b", "abs(t)^1e9"),
]
VALUES = [
    *("-1", "0", "1", "2", "1e308", "-1e308", "1e-308", "nan", "inf", "-inf", "true", '""', '" "', '"x"', "[]", "[[]]"),
    *(
        "{}",
        "{ a = 1 }",
        "[1, 2]",
        '["a"]',
        "1979-05-27",
        "07:32:00",
        "9" * 19,
        "9" * 5000,
        "2147483648",
        "0x10",
        "1_0",
    ),
    *("[" * 2000 + "]" * 2000, "{a=" * 500 + "1" + "}" * 500, "[" + "1," * 10_000 + "]", '["a", 1, nan]', "[[1], [2]]"),
    *('"/nowhere/x"', '"/dev/zero"', '"pipe"', '"../../x"', '"a\\u0000b"', '"\\u001b[2J"', '"[red]x[/red]"', '"a\\nb"'),
    *('"<script>alert(1)</script>"', '"| x | y |"', '"![](http://127.0.0.1/x)"', '"\\u202e"', '"{N}"', '"{"', '"%s"'),
    f'"{"x" * 10**5}"',
    *(f'"{law}"' for law in LAWS),
    *(
        '"rk4"',
        '"euler"',
        '"free"',
        '"lockstep"',
        '"pinv"',
        '"mujoco"',
        '"sr1:eps_abs=0"',
        '"sr1:eps_abs=nan"',
        '"hard"',
    ),
    *(
        '"pinv:x=1"',
        '":"',
        '"sr1:"',
        '"sr1:eps_abs=1e-3,eps_abs=1"',
        '"done"',
        '"diverged"',
        '"crank"',
        '"m"',
        '"stiff"',
    ),
]
ADDED = [
    "unknown = 1",
    "[unknown]\na = 1",
    "a" + ".a" * 5000 + " = 1",
    "[" + "a." * 3000 + "a]",
    "[[experiments]]\nmode = 'free'\n" * 3000,
    "[[variants]]\nparameters = { N = 1 }",
    "[parameters]\nN = 1\n[[variants]]\nparameters = { N = 2 }\n[[variants]]\nparameters = { N = 3.5 }",
    "[parameters]\nE = 1",
    "[parameters]\n'../x' = 1",
    '[parameters]\n"a\\u001b[2J" = 1',
    "[drive.constants]\nE = 2.7",
    "[drive.constants]\n" + "".join(f"c{i} = '2*c{i - 1}'\n" for i in range(1, 3000)),
    "[drive.constants]\na0 = 1\n" + "".join(f"a{i} = '(a{i - 1}+a{i - 1})'\n" for i in range(1, 1000)),
    "[drive.ctrl]\n" + "".join(f"m{i} = 't'\n" for i in range(3000)),
    "[drive.ctrl]\n\"\\u001b]0;x\\u0007\" = 't'",
    "[settings.'../../x']\nsolver = 'cg'",
    "[settings.\"a\\nb\"]\nsolver = 'cg'\n[[experiments]]\nmode = 'free'\nsettings = [\"a\\nb\"]",
    "[settings.'" + "x" * 5000 + "']\nsolver = 'cg'",
    "[start.qpos]\n'' = 1",
    "[start.qpos]\ncrank = 1e308",
    "[start.qvel]\ncrank = 1e300",
    "[start.qvel]\ncrank = 1e9",
    "[paper]\nsource = 'x'\nclaims = 'pipe'",
    "[paper]\nsource = 'x'\nclaims = '/dev/zero'",
    "[truth]\nfile = 'pipe'\njoint = 'crank'\nsource = 'x'",
    "[truth]\nfile = '/dev/stdin'\njoint = 'crank'\nsource = 'x'",
    "[truth]\nfile = 'model.xml'\nsite = 'tip1'\nsource = 'x'",
    "[[published]]\ntime_s = 1e308\njoint = 'crank'\nposition = 0\nsource = 'x'",
    "[[gates]]\nfigure = 'drift_pos_max'\nwhere = { run = '[' }\nmax = nan\ncause = ''",
    "[[gates]]\nfigure = '" + "x" * 10**5 + "'\nmax = 1\ncause = 'x'",
    "[sweep]\ntimesteps_s = [1e-300, 1e300]",
    "[sweep]\ntimesteps_s = [" + "1e-3," * 100_000 + "]",
    "# " + "x" * 2**22,
    "\0",
    "\ufeff",
    '"""',
    "'''" + "x" * 10**5,
    "a = 1\na = 2",
    "[a]\n[a]",
    "=",
]

_LINE = re.compile(r"^(\s*[\w.\"'-]+\s*=\s*)(.+)$", re.MULTILINE)
_NUMBER = re.compile(r"(?<![\w\"'])-?\d[\d.e+-]*")
_VALUE = re.compile(r"\"[^\"\n]*\"|-?\d[\d.e+-]*|true|false")


def bases() -> dict[str, tuple[str, Path | None]]:
    """Name → text of a case file, and the folder that it is of; None for the four-bar with a motor."""
    real = sorted((REPOSITORY / "mjcf").glob("*/case.toml"))
    found: dict[str, tuple[str, Path | None]] = {"tiny": (TINY, None), "rich": (RICH, None), "rich again": (RICH, None)}
    for path in real:
        if (path.parent / "model.xml").exists():
            # A hundredth of a second shows what the file does, and the motions of weeks are not the question.
            text = re.sub(r"^duration_s = .*$", "duration_s = 0.01", path.read_text(), flags=re.MULTILINE)
            text = re.sub(r"^time_s = .*$", "time_s = 0.005", text, flags=re.MULTILINE)
            found[path.parent.name] = text, path.parent
    return found


def attempts(seed: int, _: Path, count: int = 300) -> Iterator[Attempt]:
    """Commands on mutated cases: every hostile addition and law once, then what chance makes."""
    known = bases()
    singles = [f"title = 'x'\n{one}" for one in ADDED]
    singles += [f'{TINY}[drive]\nctrl.m = "{law}"\n' for law in LAWS]
    for number in range(count):
        chance = random.Random(f"cases-{seed}-{number}")
        if number < len(singles):
            name, content, folder = "made up", singles[number].encode("utf-8", "surrogatepass"), None
        else:
            name = chance.choice(list(known))
            text, folder = known[name]
            content = mutated(text, chance)
        yield Attempt(f"cases {seed}-{number} ({name})", _command(chance), partial(_write, content, folder))


def _command(chance: random.Random) -> tuple[str, ...]:
    return chance.choices(
        [
            ("run", "case", "--out", "out"),
            ("run", "case", "--out", "out", "--stepping", "python"),
            ("run", "case:N=2", "--out", "out", "--report", "page"),
            ("suite", "case", "--out", "out"),
            ("suite", "case", "--out", "out", "--sweep", "timestep=1e-3:2e-3:2"),
            ("check", "case", "--budget", "0", "--duration", "0.05"),
            ("bench", "--model", "case", "--rounds", "1"),
        ],
        [5, 1, 1, 3, 1, 2, 1],
    )[0]


def _write(content: bytes, source: Path | None, folder: Path) -> None:
    case = folder / "case"
    if source:
        shutil.copytree(source, case)
    else:
        case.mkdir()
        (case / "model.xml").write_text(MOTOR)
        rows = "".join(f"{time_s},0,0,0\n" for time_s in (0, 1, 2))
        (case / "t.csv").write_text(f"time,position,velocity,acceleration\n{rows}")
    (case / "case.toml").write_bytes(content)
    os.mkfifo(case / "pipe")


def mutated(text: str, chance: random.Random) -> bytes:
    """A case file with one to three things changed; rarely its bytes."""
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        lines = list(_LINE.finditer(text))
        if not lines:
            break
        one = chance.choice(lines)
        match chance.randrange(9):
            case 0:  # left out
                text = text[: one.start()] + text[one.end() :]
            case 1:  # doubled
                text = text[: one.end()] + "\n" + one[0] + text[one.end() :]
            case 2:  # moved to another table
                at = chance.choice(lines).end()
                text = text[:at] + "\n" + one[0] + text[at:]
            case 3:
                text = f"{text}\n{chance.choice(ADDED)}\n"
            case 4 | 5:  # the whole value
                text = text[: one.start(2)] + chance.choice(VALUES) + text[one.end(2) :]
            case 6:  # one of the numbers in it, which may well be run
                inner = list(_NUMBER.finditer(text, one.start(2), one.end(2)))
                if inner:
                    which = chance.choice(inner)
                    number = f"{chance.uniform(-2, 2) * 10 ** chance.choice([-6, -3, 0, 0, 0, 2]):.4g}"
                    text = text[: which.start()] + number + text[which.end() :]
            case _:  # one of the values in it
                inner = list(_VALUE.finditer(text, one.start(2), one.end(2)))
                if inner:
                    which = chance.choice(inner)
                    text = text[: which.start()] + chance.choice(VALUES) + text[which.end() :]
    content = text.encode("utf-8", "surrogatepass")
    return garbled(content, chance) if chance.random() < 0.15 else content
