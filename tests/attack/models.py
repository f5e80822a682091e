"""Mutated models: MJCF files with bytes, attributes and elements changed, and hostile elements put in.

cd tests && ../.venv/bin/python -m attack --only models
"""

import os
import random
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from mechanisms import TANGLE, four_bar, parallelogram
from places import REPOSITORY

from attack.trials import Attempt

SMALL = {
    "four_bar": four_bar(),
    "parallelogram": parallelogram(),
    "tangle": TANGLE,
    "motor": four_bar(
        rest='<actuator><position name="servo" joint="crank" kp="1"/></actuator>'
        '<sensor><jointpos joint="crank"/></sensor>'
        '<keyframe><key name="home" qpos="0 0 0" ctrl="0.1"/></keyframe><size memory="1M"/>'
    ),
    "wall": four_bar(
        body='<geom name="hand" type="sphere" size="0.1" contype="1" conaffinity="1"/>',
        rest='<worldbody><geom name="wall" type="plane" size="1 1 1" pos="0 0 -1" contype="1"/></worldbody>',
    ),
    "assets": four_bar(
        rest='<asset><texture name="t" type="2d" builtin="checker" width="8" height="8"/><material name="m" '
        'texture="t"/><mesh name="s" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>'
    ),
}

NUMBERS = [
    *("nan", "inf", "-inf", "1e308", "-1e308", "1e-308", "0", "-1", "1e9", "1e-12", "2147483648", "-2147483648"),
    *("99999999999999999999", "9" * 5000, "0x10", "1,5", "", " ", "1 2", "0 0 0", "1 0 0 0", "0 0 0 0 0 0", "1e400"),
    "1 " * 2000,
]
NAMES = [
    *("", " ", "a b", "[red]x[/red]", "[/]", "**x**", "a|b", "`x`", "&#10;", "&#27;[31m", "&#27;[2J", "&#7;", "&#13;x"),
    *("&lt;script&gt;alert(1)&lt;/script&gt;", '&quot;]&#10;evil = "1', "../../x", "/nowhere/x", "/dev/zero", "pipe"),
    *(
        "\u202egnp.exe",
        "\u200b",
        "ä",
        "😀",
        "x" * 1000,
        "x" * 1001,
        "x" * 10**6,
        "&#x0;",
        "&amp;#27;",
        "{{7*7}}",
        "${x}",
    ),
    *("%s%n", "#0", "world", "crank", "true", "false", "auto", "RK4", "euler", "ball", "free", "plane", "mesh", "cg"),
]


def _pendulums(count: int) -> str:
    return "".join(
        f'<body name="p{i}" pos="{i} 0 0"><joint axis="0 1 0"/><geom fromto="0 0 0 0 0 0.5"/></body>'
        for i in range(count)
    )


def _connects(count: int) -> str:
    connects = "".join(f'<connect body1="p{i}" body2="world" anchor="0 0 0"/>' for i in range(count))
    return f"<worldbody>{_pendulums(count)}</worldbody><equality>{connects}</equality>"


SNIPPETS = [
    '<include file="pipe"/>',
    '<include file="/dev/zero"/>',
    '<include file="/dev/stdin"/>',
    '<include file="model.xml"/>',
    '<include file="/proc/version"/>',
    '<include file="folder"/>',
    '<include file="gone.xml"/>',
    '<include file="link"/>',
    f'<include file="{"x" * 5000}"/>',
    '<asset><texture name="x" type="2d" file="/proc/version"/></asset>',
    '<asset><texture name="x" type="2d" file="pipe"/></asset>',
    '<asset><texture name="x" type="2d" builtin="flat" width="100000" height="100000"/></asset>',
    '<asset><hfield name="x" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>',
    '<asset><hfield name="x" file="/dev/zero" size="1 1 1 1"/></asset>',
    '<asset><mesh name="x" file="/dev/full"/></asset>',
    '<asset><mesh name="x" file="model.xml"/></asset>',
    f'<asset><mesh name="x" vertex="{"nan " * 12}"/></asset>',
    f'<asset><mesh name="x" vertex="{"0 " * 12}"/></asset>',
    '<asset><model name="x" file="model.xml"/></asset><worldbody><attach model="x" body="crank"/></worldbody>',
    '<worldbody><replicate count="1000000000"><geom size="1"/></replicate></worldbody>',
    '<worldbody><replicate count="70"><replicate count="70"><replicate count="70"><geom size="1"/></replicate>'
    "</replicate></replicate></worldbody>",
    '<worldbody><replicate count="4999"><geom size="0.1" contype="0"/></replicate></worldbody>',
    '<worldbody><replicate count="-5"><geom size="1"/></replicate></worldbody>',
    '<worldbody><replicate count="300"><body><freejoint/><geom size="0.1"/></body></replicate></worldbody>',
    '<worldbody><replicate count="1.9e1"><replicate count="0x100"><geom size="1"/></replicate></replicate></worldbody>',
    '<worldbody><flexcomp name="x" type="grid" count="999 999 999" spacing="1 1 1"/></worldbody>',
    '<worldbody><flexcomp name="x" type="grid" count="9 9 9" spacing="1 1 1" dim="3" mass="1"/></worldbody>',
    '<worldbody><composite type="cable" count="10000 1 1" curve="s" size="1"><geom type="capsule" size="0.005"/>'
    "</composite></worldbody>",
    '<worldbody><composite type="cable" count="50 1 1" curve="s" size="1"><joint kind="main"/><geom type="capsule" '
    'size="0.005" density="1000"/></composite></worldbody>',
    *(f'<size n{what}="2000000000"/>' for what in ("key", "userdata", "user_body", "conmax", "jmax", "stack")),
    *(f'<size memory="{value}"/>' for value in ("1", "100", "1K", "-1", "1E", "999999999P", "nan", "4G", "64G")),
    *(f'<option {kind}="2000000000"/>' for kind in ("iterations", "ls_iterations", "ccd_iterations")),
    '<option iterations="2000000000" tolerance="0"/>',
    '<option iterations="0"/>',
    *(f'<option timestep="{value}"/>' for value in ("1e308", "1e-308", "1e-12", "1e-9", "1e9", "10", "-1", "0", "nan")),
    *(f'<option gravity="0 0 {value}"/>' for value in ("1e308", "-1e300", "nan", "inf", "1e10")),
    '<option density="1e300" viscosity="1e300" wind="1e300 0 0"/>',
    '<option><flag energy="enable" equality="disable" sleep="enable" multiccd="enable" nativeccd="disable"/></option>',
    '<option impratio="1e308" cone="elliptic" jacobian="sparse" solver="PGS"/>',
    '<option o_solref="0 0" o_solimp="1 1 1 1 1"><flag override="enable"/></option>',
    *(
        f'<default><equality solref="{value}"/></default>'
        for value in ("0 0", "-1 -1", "1e308 1", "nan 1", "-1e308 -1")
    ),
    *(
        f'<default><equality solimp="{value}"/></default>'
        for value in ("1 1 0 0 0", "0 0 0 0.5 2", "nan 1 1 1 1", "2 2")
    ),
    '<equality><joint joint1="crank" joint2="rocker" polycoef="1e308 1e308 1e308 1e308 1e308"/></equality>',
    '<equality><joint joint1="crank" polycoef="1e30 0 0 0 0"/></equality>',
    '<equality><connect name="a" body1="crank" anchor="1e308 0 0"/></equality>',
    '<equality><weld body1="crank" relpose="0 0 0 0 0 0 0"/></equality>',
    '<equality><weld body1="crank" torquescale="-1e300"/></equality>',
    '<worldbody><body quat="0 0 0 0"><joint/><geom size="1"/></body></worldbody>',
    '<worldbody><body><joint armature="1e308" damping="1e308" stiffness="1e308" frictionloss="1e308"/><geom size="1"/>'
    "</body></worldbody>",
    '<worldbody><body><joint axis="0 0 0"/><geom size="1"/></body></worldbody>',
    '<worldbody><body><joint range="1 -1" limited="true"/><geom size="1"/></body></worldbody>',
    '<worldbody><body><freejoint/><inertial pos="0 0 0" mass="1" fullinertia="1 1 1 5 5 5"/></body></worldbody>',
    '<worldbody><body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 100"/></body></worldbody>',
    '<worldbody><body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1e-14 1e-14 1e-14"/></body></worldbody>',
    '<worldbody><body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="1e300 1e300 1e300"/></body></worldbody>',
    '<worldbody><body><joint type="slide" armature="-2"/><geom size="0.1"/></body></worldbody>',
    f"<worldbody>{'<body>' * 5000}{'</body>' * 5000}</worldbody>",
    "<worldbody>" + '<body><joint/><geom size="0.1"/>' * 90 + "</body>" * 90 + "</worldbody>",
    f"<worldbody>{'<frame>' * 3000}{'</frame>' * 3000}</worldbody>",
    f"<worldbody>{_pendulums(200)}</worldbody>",
    _connects(100),
    _connects(1000),
    *(f'<keyframe><key qpos="{value}"/></keyframe>' for value in ("nan 0 0", "1 2", "1e308 0 0", "inf inf inf", "")),
    '<keyframe><key time="1e308" qvel="1e200 1e200 1e200"/></keyframe>',
    '<keyframe><key name="[b]" time="nan"/></keyframe>',
    *(
        f'<actuator><motor joint="crank" {value}/></actuator>'
        for value in ('gear="1e308"', 'ctrlrange="2 1"', 'gear="0"')
    ),
    '<actuator><general joint="crank" dyntype="muscle" gaintype="muscle" biastype="muscle"/></actuator>',
    '<actuator><general joint="crank" dyntype="integrator" actdim="100000"/></actuator>',
    '<actuator><plugin plugin="mujoco.pid" joint="crank"/></actuator>',
    '<extension><plugin plugin="../../evil.so"/></extension>',
    '<custom><numeric name="x" size="2000000000"/></custom>',
    '<custom><text name="x" data="&#27;[31m"/></custom>',
    '<compiler meshdir="/" texturedir="/dev" autolimits="false" inertiafromgeom="false"/>',
    '<compiler angle="degree" eulerseq="qqq" coordinate="global" boundmass="nan"/>',
    '<compiler balanceinertia="true" settotalmass="1e308" fusestatic="true" discardvisual="true"/>',
    '<statistic extent="nan" meansize="0"/><visual><global offwidth="2000000000"/></visual>',
    '<tendon><spatial name="x" springlength="nan"><site site="tip1"/><site site="tip2"/></spatial></tendon>',
    '<tendon><fixed name="x" range="1 0" frictionloss="1"><joint joint="crank" coef="1e308"/></fixed></tendon>'
    '<equality><tendon tendon1="x" polycoef="1e308 1 1 1 1"/></equality>',
    '<tendon><spatial name="x"><site site="tip1"/><pulley divisor="0"/><site site="tip2"/></spatial></tendon>',
    '<contact><pair geom1="hand" geom2="wall" condim="7"/></contact>',
    '<sensor><user dim="2000000000" objtype="body" objname="crank"/></sensor>',
    '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>&b;',
    "<!-- " + "-" * 10**5,
    "<![CDATA[ <x> ]]>",
    "\0",
    "<" * 1000,
]

_ATTRIBUTE = re.compile(r'([\w.-]+)\s*=\s*"([^"]*)"')
_EMPTY = re.compile(r"<(\w+)[^<>]*/>")
_SECTION = re.compile(r"</(?:worldbody|equality|mujoco|body)>")


def bases() -> dict[str, str]:
    """Name → text of the models that are mutated."""
    real = sorted((REPOSITORY / "mjcf").glob("*/model.xml"))
    return {**SMALL, **{path.parent.name: path.read_text() for path in real}}


def attempts(seed: int, _: Path, count: int = 500) -> Iterator[Attempt]:
    """Commands on mutated models: every hostile element once, then what chance makes of real ones."""
    known = bases()
    for number in range(count):
        chance = random.Random(f"models-{seed}-{number}")
        if number < len(SNIPPETS):
            name, text = "four_bar", _put_in(SMALL["four_bar"], SNIPPETS[number])
        else:
            name = chance.choice(list(known))
            text = mutated(known[name], chance, known)
        yield Attempt(f"models {seed}-{number} ({name})", _command(chance), partial(_write, text))


def _command(chance: random.Random) -> tuple[str, ...]:
    short = ("--duration", "0.02")
    return chance.choice(
        [
            ("run", "model.xml", *short, "--out", "out"),
            ("run", "model.xml", *short, "--out", "out", "--stepping", "python", "--solver", "pinv"),
            ("run", "model.xml", *short, "--out", "out", "--ignore-inequalities", "--report", "out/page"),
            ("check", "model.xml", "--budget", "0", "--duration", "0.1"),
            ("check", "model.xml", "--budget", "0", "--duration", "0.1", "--report", "out", "--ignore-inequalities"),
            ("check", "model.xml", "--budget", "0.1", "--duration", "0.1", "--write-keyframe", "out/key.xml"),
            ("new", "x", "model.xml", "--to", "out"),
            ("new", "x", "model.xml", "--to", "out", "--outside"),
        ]
    )


def _write(content: bytes, folder: Path) -> None:
    (folder / "model.xml").write_bytes(content)
    os.mkfifo(folder / "pipe")
    (folder / "folder").mkdir()
    (folder / "out").mkdir()
    (folder / "link").symlink_to("pipe")


def _put_in(text: str, snippet: str) -> bytes:
    return text.replace("</mujoco>", f"{snippet}</mujoco>").encode(errors="surrogatepass")


def mutated(text: str, chance: random.Random, known: dict[str, str]) -> bytes:
    """A model with one to four things changed."""
    content = text.encode()
    for _ in range(chance.choice([1, 1, 2, 4])):
        content = chance.choices(list(_CHANGES), list(_CHANGES.values()))[0](content, chance)
    if chance.random() < 0.03:
        other = known[chance.choice(list(known))].encode()
        content = content[: chance.randrange(len(content) + 1)] + other[chance.randrange(len(other)) :]
    return content


def garbled(content: bytes, chance: random.Random) -> bytes:
    """Bytes changed, cut out, doubled, put in, or cut off."""
    at = chance.randrange(len(content) + 1)
    to = min(len(content), at + chance.choice([1, 3, 20, 200]))
    return chance.choice(
        [
            content[:at] + bytes([chance.randrange(256)]) + content[at + 1 :],
            content[:at] + content[to:],
            content[:at] + content[at:to] * 2 + content[to:],
            content[:at] + chance.randbytes(to - at) + content[at:],
            content[:at],
        ]
    )


def _revalued(content: bytes, chance: random.Random) -> bytes:
    """Another value of an attribute, in the same words or from the list."""
    text = content.decode("latin-1")
    found = list(_ATTRIBUTE.finditer(text))
    if not found:
        return content
    one = chance.choice(found)
    words = one[2].split() or [""]
    value = chance.choice(NUMBERS + NAMES)
    if chance.random() < 0.4:  # what may well be run
        value = f"{chance.uniform(-2, 2) * 10 ** chance.choice([-6, -3, 0, 0, 0, 2]):.4g}"
    if chance.random() < 0.6:
        words[chance.randrange(len(words))] = value
        value = " ".join(words)
    return _replaced(content, one.start(2), one.end(2), value)


def _renamed(content: bytes, chance: random.Random) -> bytes:
    """A name, everywhere."""
    text = content.decode("latin-1")
    names = [one for one in _ATTRIBUTE.finditer(text) if one[1] == "name" and one[2]]
    if not names:
        return content
    old, new = chance.choice(names)[2], chance.choice(NAMES).encode("utf-8", "surrogatepass")
    return content.replace(b'"' + old.encode("latin-1") + b'"', b'"' + new + b'"')


def _exchanged(content: bytes, chance: random.Random) -> bytes:
    """The value of another attribute."""
    found = list(_ATTRIBUTE.finditer(content.decode("latin-1")))
    if not found:
        return content
    one = chance.choice(found)
    return _replaced(content, one.start(2), one.end(2), chance.choice(found)[2])


def _unattributed(content: bytes, chance: random.Random) -> bytes:
    found = list(_ATTRIBUTE.finditer(content.decode("latin-1")))
    if not found:
        return content
    one = chance.choice(found)
    return _replaced(content, one.start(), one.end(), "")


def _element(content: bytes, chance: random.Random) -> bytes:
    """An element without contents left out, doubled, or copied ten times."""
    found = list(_EMPTY.finditer(content.decode("latin-1")))
    if not found:
        return content
    one = chance.choice(found)
    return _replaced(content, one.start(), one.end(), one[0] * chance.choice([0, 0, 2, 10]))


def _inserted(content: bytes, chance: random.Random) -> bytes:
    """A hostile element, before the end of another one."""
    found = list(_SECTION.finditer(content.decode("latin-1")))
    at = chance.choice(found).start() if found else len(content)
    return content[:at] + chance.choice(SNIPPETS).encode() + content[at:]


def _replaced(content: bytes, start: int, end: int, text: str) -> bytes:
    return content[:start] + text.encode("utf-8", "surrogatepass") + content[end:]


_CHANGES: dict[Callable[[bytes, random.Random], bytes], int] = {
    garbled: 2,
    _revalued: 6,
    _renamed: 3,
    _exchanged: 2,
    _unattributed: 2,
    _element: 2,
    _inserted: 1,
}
