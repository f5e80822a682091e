"""Whether the layout that the compiled core has of MuJoCo's structs is that of the MuJoCo in this process.

A small model is made, and every place that the core would read is compared with what MuJoCo's own bindings show there.
Pointers are compared and never followed, so that a layout that is wrong reads wrong numbers and nothing worse.
"""

import ctypes
from dataclasses import dataclass
from typing import Any

import mujoco

from oarlock.base import core

_MODEL = """<mujoco>
  <option cone="elliptic" jacobian="sparse"><flag energy="enable"/></option>
  <worldbody>
    <geom type="plane" size="2 2 .1"/><geom size=".05" pos="0 0 5"/>
    <site name="hook" pos="0 0 2"/><site/><site/><site/><site/><site/><site/>
    <body name="block" pos="0 0 .04">
      <freejoint/><geom size=".05" condim="6"/><site name="top" pos="0 0 .05"/>
    </body>
    <body name="crank" pos="0 0 1">
      <joint name="a" axis="0 1 0" frictionloss=".3" limited="true" range="-1 -.5"/><geom size=".05" pos=".3 0 0"/>
      <body name="rod" pos=".3 0 0">
        <joint name="b" axis="0 1 0"/><geom size=".05" pos=".3 0 0"/><site name="end" pos=".3 0 0"/>
      </body>
    </body>
    <body name="slider" pos="1 0 1"><joint name="c" type="slide" axis="1 0 0"/><geom size=".05"/></body>
    <body name="swing" pos="2 0 1"><joint name="d" axis="0 1 0"/><geom size=".05" pos=".1 0 0"/></body>
  </worldbody>
  <tendon>
    <spatial><site site="hook"/><site site="end"/></spatial>
    <spatial><site site="hook"/><site site="top"/></spatial>
    <fixed name="gear"><joint joint="c" coef="1"/><joint joint="d" coef="2"/><joint joint="a" coef="3"/>
      <joint joint="b" coef="4"/></fixed>
  </tendon>
  <actuator><motor joint="b"/><general joint="c" dyntype="integrator"/></actuator>
  <equality>
    <connect body1="rod" body2="world" anchor=".3 0 0"/><tendon tendon1="gear"/><joint joint1="c" joint2="d"/>
    <joint joint1="b" active="false"/>
  </equality>
</mujoco>"""
"""Every array that the core reads has entries in it, and no two of its sizes are the same."""

_NUMBERS = {"int64_t": ctypes.c_int64, "int": ctypes.c_int, "double": ctypes.c_double}
"""Types of fields that are no arrays."""

_MARKS: dict[str, float] = {"timestep": 0.001234, "integrator": 7001, "jacobian": 7002, "disableflags": 7003}
"""Numbers that nothing else in a model has, for what is written into ``opt``; no step is taken with them."""


@dataclass(frozen=True)
class Layout:
    """Where a version of MuJoCo keeps what the core reads.

    Attributes:
        places: struct, field, type in C, and offset in the struct (bytes) of each.
        contact_size: bytes of an mjContact.
        eq_data_width: numbers that an equality has in ``eq_data``.
    """

    places: list[tuple[str, str, str, int]]
    contact_size: int
    eq_data_width: int


def known_layout() -> Layout | None:
    """What the core knows of the MuJoCo in this process; None if nothing."""
    known = core.mujoco_layout(mujoco.mj_version())
    return Layout(*known) if known else None


def disagreement(layout: Layout) -> str:
    """The first field that MuJoCo's bindings show elsewhere than a layout says; empty if there is none."""
    model, data = _sample()
    if model.eq_data.shape[1] != layout.eq_data_width:
        return "eq_data"
    if data.contact.mu.strides[0] != layout.contact_size:
        return "contact"
    owners = {"mjModel": model, "mjData": data, "mjContact": data.contact}
    starts = {"mjModel": model._address, "mjData": data._address, "mjContact": _address(data.contact)}
    for whole, field, kind, offset in layout.places:
        shown: Any = owners[whole]
        for name in field.split("."):
            shown = getattr(shown, name)
        place = starts[whole] + offset
        if kind not in _NUMBERS:
            found = ctypes.c_void_p.from_address(place).value if kind.endswith("*") else place
            agrees = found == _address(shown)
        elif whole == "mjContact":
            agrees = place == _address(shown)
        else:
            agrees = _NUMBERS[kind].from_address(place).value == shown
        if not agrees:
            return f"{whole}.{field}"
    return ""


def _address(shown: Any) -> int:
    """Where an array of MuJoCo's bindings lies; of contacts, where the first one does."""
    return (shown.dist if hasattr(shown, "dist") else shown).ctypes.data


def _sample() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model and a state of it in which the numbers to be compared are there and differ."""
    model = mujoco.MjModel.from_xml_string(_MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for name, mark in _MARKS.items():
        setattr(model.opt, name, mark)
    model.stat.extent = 0.004321
    data.time = 0.056789
    return model, data
