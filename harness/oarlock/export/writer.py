"""A compiled model as plain MJCF: bodies with explicit inertias, joints, and equalities of bodies, to the last digit.

Everything is read from the compiled model, so that includes, defaults, replicas and inertias of geoms are resolved, and
written with all digits, where MuJoCo's own writer has six. The pose that bodies are written in is one that closes the
equalities, because readers take the second anchor of a connect from it; hinges and slides keep their numbers there by
``ref``.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass, field

import mujoco
import numpy as np

from oarlock.base.text import called, quoted
from oarlock.export.readers import Reader
from oarlock.mechanics.names import Equality, element_name, equalities
from oarlock.mechanics.prepare import integrator_of

BASE = "base"
"""Name of the body that holds all others, for readers that take one only."""

EARTH = (0.0, 0.0, -9.81)
"""m/s². The gravity of whoever reads none."""

TOGETHER = 1e-9
"""m or rad. Points of a connect further apart, in the pose that is written, are no connect of the reader's."""

_FREE, _BALL, _SLIDE, _HINGE = (
    int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("FREE", "BALL", "SLIDE", "HINGE")
)
_TYPES = {_BALL: "ball", _SLIDE: "slide", _HINGE: "hinge"}
_BODY, _SITE, _JOINT = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_JOINT
_GEOM, _ACTUATOR = mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtObj.mjOBJ_ACTUATOR

_SHAPES = {"PLANE": 3, "SPHERE": 1, "CAPSULE": 2, "ELLIPSOID": 3, "CYLINDER": 2, "BOX": 3}
_SIZES = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")): (name.lower(), size) for name, size in _SHAPES.items()}

_OTHERS = {
    "tendon": "tendon", "sensor": "sensor", "cam": "camera", "light": "light", "key": "keyframe", "flex": "flex",
    "skin": "skin", "plugin": "plugin", "pair": "contact pair", "exclude": "contact exclusion",
}  # fmt: skip
"""Count ``n…`` of a model → what is never written."""


_STILL = ("sensor", "camera", "light", "keyframe", "skin", "site")
"""Those of them that no motion depends on."""


@dataclass(frozen=True)
class Left:
    """An element that is not in the export.

    Attributes:
        element: in words, such as ``joint equality 'mirror'``.
        why: the reason.
        moves: whether a motion may depend on it.
    """

    element: str
    why: str
    moves: bool = True

    def __str__(self) -> str:
        return f"{self.element}: {self.why}"


@dataclass
class Export:
    """A model as it was written.

    Attributes:
        text: the MJCF.
        left: what it lacks.
        equalities: names of the equalities that it has.
        turned: address in qpos of a quaternion → what it was at the pose that is written: there it is 1 0 0 0.
        shifted: address in qpos → the number that is 0 in the export.
        split: names of free joints that became three slides and a ball, with the same velocities.
        reference: the pose that is written (nq).
    """

    text: str = ""
    left: list[Left] = field(default_factory=list)
    equalities: list[str] = field(default_factory=list)
    turned: dict[int, np.ndarray] = field(default_factory=dict)
    shifted: dict[int, float] = field(default_factory=dict)
    split: list[str] = field(default_factory=list)
    reference: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def coordinates(self, qpos: np.ndarray) -> np.ndarray:
        """Positions (nq) of the export at the model's positions (nq); velocities are the same in both."""
        found, turn, back = qpos.copy(), np.zeros(4), np.zeros(4)
        for at, reference in self.turned.items():
            mujoco.mju_negQuat(back, reference)
            mujoco.mju_mulQuat(turn, back, qpos[at : at + 4])
            found[at : at + 4] = turn
        for at, zero in self.shifted.items():
            found[at] -= zero
        return found


class Writer:
    """Writes one model for one reader.

    Args:
        model: the model.
        reader: who will read it.
        reference: a pose that closes the equalities (nq).
    """

    def __init__(self, model: mujoco.MjModel, reader: Reader, reference: np.ndarray):
        self._model, self._reader = model, reader
        self._export = Export()
        self._names: dict[tuple[str, int], str] = {}
        self._base = reader.one_root and not self._floats()
        reference = reference.copy()
        if reader.one_root and not self._base:  # alone in space it is written at the origin, which closes it as well
            reference[:7] = [0, 0, 0, 1, 0, 0, 0]
        self._export.reference = reference
        self._data = mujoco.MjData(model)
        self._data.qpos[:] = reference
        mujoco.mj_fwdPosition(model, self._data)
        self._taken: set[str] = {BASE, "world"} if self._base else {"world"}

    def write(self) -> Export:
        """The export."""
        model, export = self._model, self._export
        root = ET.Element("mujoco", model=element_name(model, mujoco.mjtObj.mjOBJ_MODEL, 0))
        ET.SubElement(root, "compiler", angle="radian", autolimits="false")
        self._option(root)
        world = ET.SubElement(root, "worldbody")
        top = ET.SubElement(world, "body", name=BASE) if self._base else world
        if self._base:
            ET.SubElement(top, "inertial", pos="0 0 0", mass="0", diaginertia="0 0 0")
        self._contents(0, top)
        elements = {0: top}
        for body in range(1, model.nbody):
            elements[body] = self._body(body, elements[int(model.body_parentid[body])])
        written = ET.Element("equality")
        for equality in equalities(model):
            if left := self._equality(equality, written):
                export.left.append(Left(f"{equality.kind} equality {quoted(equality.name)}", left))
            else:
                export.equalities.append(equality.name)
        actuators = ET.Element("actuator")
        for actuator in range(model.nu):
            self._actuator(actuator, actuators)
        root.extend(part for part in (written, actuators) if len(part))
        self._count_others()
        ET.indent(root)
        export.text = ET.tostring(root, encoding="unicode") + "\n"
        return export

    def _leave(self, element: str, why: str, moves: bool = True) -> None:
        self._export.left.append(Left(element, why, moves))

    def _floats(self) -> bool:
        """Whether all bodies are on one free body, and nothing else is."""
        model = self._model
        held = any(not all(one.bodies) for one in equalities(model) if one.kind.joins_points)
        roots = int((model.body_parentid[1:] == 0).sum())
        return roots == 1 and model.jnt_type[0] == _FREE and not held and not (model.geom_bodyid == 0).any()

    def _zero(self, at: int, joints: int) -> float:
        """What is taken from a coordinate, because its body has several joints."""
        zero = float(self._data.qpos[at]) if self._reader.shifts and joints > 1 else 0.0
        if zero:
            self._export.shifted[at] = zero
        return zero

    def _name(self, kind: mujoco.mjtObj, index: int) -> str:
        """A name of its own, in which a reader stumbles over nothing."""
        sort = kind.name.removeprefix("mjOBJ_").lower()
        if (sort, index) not in self._names:
            wanted = mujoco.mj_id2name(self._model, kind, index) or f"{sort}{index}"
            name, count = wanted, 1
            while f"{sort} {name}" in self._taken or (sort == "body" and name in self._taken):
                count += 1
                name = f"{wanted}_{count}"
            self._taken.add(f"{sort} {name}")
            self._names[sort, index] = name
        return self._names[sort, index]

    def _option(self, root: ET.Element) -> None:
        option = self._model.opt
        gravity = option.gravity * (not option.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        name = {"euler": "Euler", "rk4": "RK4"}.get(integrator_of(self._model).name, "implicitfast")
        ET.SubElement(root, "option", timestep=_text([option.timestep]), gravity=_text(gravity), integrator=name)
        if not self._reader.gravity and not np.array_equal(gravity, EARTH):
            why = f"{self._reader.title}'s reader takes {' '.join(f'{one:g}' for one in EARTH)}"
            self._leave(f"gravity {' '.join(f'{one:g}' for one in gravity)}", why)
        if option.density or option.viscosity:
            self._leave("option", "a fluid")

    # Bodies.

    def _body(self, body: int, parent: ET.Element) -> ET.Element:
        model, data = self._model, self._data
        name, above = self._name(_BODY, body), int(model.body_parentid[body])
        turn = data.xmat[above].reshape(3, 3)
        place = turn.T @ (data.xpos[body] - data.xpos[above])
        back, quat = np.zeros(4), np.zeros(4)
        mujoco.mju_negQuat(back, data.xquat[above])
        mujoco.mju_mulQuat(quat, back, data.xquat[body])
        if above == 0:  # as they are, to the last bit
            place, quat = data.xpos[body], data.xquat[body]
        if model.body_jntnum[body] == 0:
            place, quat = model.body_pos[body], model.body_quat[body]
        off = bool(np.abs(place).max() > 0.0 or np.abs(quat[1:]).max() > 0.0)
        if self._reader.seats and len(self._joints(body)) > 1 and off:
            parent = ET.SubElement(parent, "body", name=f"{name}_seat", pos=_text(place), quat=_text(quat))
            place, quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        element = ET.SubElement(parent, "body", name=name, pos=_text(place), quat=_text(quat))
        if model.body_mocapid[body] >= 0:
            self._leave(f"mocap of body {quoted(name)}", "it stands still")
        if model.body_gravcomp[body]:
            self._leave(f"gravcomp of body {quoted(name)}", "no reader takes it")
        if model.body_mass[body]:  # a reader stumbles over one that says 0
            ET.SubElement(
                element,
                "inertial",
                pos=_text(model.body_ipos[body]),
                quat=_text(model.body_iquat[body]),
                mass=_text([model.body_mass[body]]),
                diaginertia=_text(model.body_inertia[body]),
            )
        elif self._reader.weights and model.body_geomnum[body]:
            ET.SubElement(element, "inertial", pos="0 0 0", mass="0", diaginertia="0 0 0")
        for joint in self._joints(body):
            self._joint(joint, body, element)
        self._contents(body, element)
        return element

    def _joint(self, joint: int, body: int, element: ET.Element) -> None:
        model, data = self._model, self._data
        kind, name, at = int(model.jnt_type[joint]), self._name(_JOINT, joint), int(model.jnt_qposadr[joint])
        dof, turn = int(model.jnt_dofadr[joint]), data.xmat[body].reshape(3, 3)
        armature = _text([model.dof_armature[dof]])
        if kind == _FREE and not self._base:
            ET.SubElement(element, "joint", type="free", name=name, armature=armature)
            return
        if kind == _FREE:
            self._export.split.append(name)
            for axis, letter in zip(np.eye(3), "xyz", strict=True):
                own = at + "xyz".index(letter)
                reference = self._data.qpos[own] - self._zero(own, 4)
                ET.SubElement(
                    element,
                    "joint",
                    type="slide",
                    name=f"{name}_{letter}",
                    axis=_text(turn.T @ axis),
                    ref=_text([reference]),
                    armature=armature,
                )
            at, name = at + 3, f"{name}_turn"
        if kind in (_FREE, _BALL):
            reference = np.array(data.qpos[at : at + 4])
            mujoco.mju_normalize4(reference)
            if np.abs(reference[1:]).max() > 0.0:
                self._export.turned[at] = reference
        alone = len(self._joints(body)) == 1  # its own motion leaves axis and place as they are
        place = np.zeros(3) if kind == _FREE else turn.T @ (data.xanchor[joint] - data.xpos[body])
        axis = turn.T @ data.xaxis[joint]
        if kind != _FREE and (alone or kind == _SLIDE):
            place = model.jnt_pos[joint]
        if alone:
            axis = model.jnt_axis[joint]
        written = {"type": _TYPES.get(kind, "ball"), "name": name, "pos": _text(place)}
        if kind in (_SLIDE, _HINGE):
            zero = self._zero(at, len(self._joints(body)))
            written |= {"axis": _text(axis), "ref": _text([data.qpos[at] - zero])}
            if model.jnt_stiffness.reshape(model.njnt, -1)[joint, 0]:
                written["stiffness"] = _text([model.jnt_stiffness.reshape(model.njnt, -1)[joint, 0]])
                written["springref"] = _text([model.qpos_spring[at] - zero])
            if model.jnt_limited[joint]:
                written |= {"limited": "true", "range": _text(model.jnt_range[joint] - zero)}
        elif model.jnt_stiffness.reshape(model.njnt, -1)[joint].any():
            self._leave(f"spring of {called('joint', name)}", "no reader has springs of balls")
        if kind == _BALL and model.jnt_limited[joint]:
            self._leave(f"range of {called('joint', name)}", "no reader has ranges of balls")
        damping = model.dof_damping.reshape(model.nv, -1)[dof, 0]
        written |= {} if not damping else {"damping": _text([damping])}
        if model.dof_frictionloss[dof]:
            written["frictionloss"] = _text([model.dof_frictionloss[dof]])
        ET.SubElement(element, "joint", {**written, "armature": armature})

    def _joints(self, body: int) -> range:
        first = int(self._model.body_jntadr[body])
        return range(first, first + int(self._model.body_jntnum[body]))

    def _contents(self, body: int, element: ET.Element) -> None:
        """Sites and geoms of a body; the geoms weigh nothing, for the inertia is said."""
        model = self._model
        for site in np.flatnonzero(model.site_bodyid == body).tolist() if self._reader.sites else ():
            pose = {"pos": _text(model.site_pos[site]), "quat": _text(model.site_quat[site])}
            ET.SubElement(element, "site", {"name": self._name(_SITE, site), **pose})
        for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
            name = self._name(_GEOM, geom)
            if int(model.geom_type[geom]) not in _SIZES:
                self._leave(f"geom {quoted(name)}", "a mesh, height field or function")
                continue
            shape, size = _SIZES[int(model.geom_type[geom])]
            ET.SubElement(
                element,
                "geom",
                name=name,
                type=shape,
                size=_text(model.geom_size[geom, :size]),
                pos=_text(model.geom_pos[geom]),
                quat=_text(model.geom_quat[geom]),
                mass="0",
                contype=str(model.geom_contype[geom]),
                conaffinity=str(model.geom_conaffinity[geom]),
                friction=_text(model.geom_friction[geom]),
                rgba=_text(model.geom_rgba[geom].astype(float).round(4)),
            )

    # Equalities.

    def _equality(self, equality: Equality, parent: ET.Element) -> str:
        """Writes an equality, or says why not."""
        model, index, kind = self._model, equality.index, equality.kind.name
        if not model.eq_active0[index]:
            return "it is off"
        if kind not in self._reader.equalities:
            return f"{self._reader.title}'s reader has none of its kind"
        common = {
            "name": equality.name,
            "solref": _text(model.eq_solref[index]),
            "solimp": _text(model.eq_solimp[index]),
        }
        if kind == "joint":
            ET.SubElement(parent, "joint", {**common, **self._coupling(index)})
            return ""
        pose = self._points(equality)
        if kind == "connect":
            (first, place1), (second, place2) = pose[:2]
            apart = float(np.linalg.norm(self._world(first, place1) - self._world(second, place2)))
            if apart > TOGETHER:
                return f"its points are {apart:.2g} m apart in the pose that is written"
            ET.SubElement(parent, "connect", {**common, **self._bodies(first, second), "anchor": _text(place1)})
            return ""
        (first, place1), (second, place2), turn = pose
        relative = _text([*place1, *turn])  # with an anchor MuJoCo takes its place in the first body here
        said = {"relpose": relative, "anchor": _text(place2), "torquescale": _text([model.eq_data[index, 10]])}
        ET.SubElement(parent, "weld", {**common, **self._bodies(first, second), **said})
        return ""

    def _bodies(self, first: int, second: int) -> dict[str, str]:
        named = {"body1": self._body_name(first)}
        return {**named, "body2": self._body_name(second)} if second or self._base else named

    def _body_name(self, body: int) -> str:
        return (BASE if self._base else "world") if body == 0 else self._name(_BODY, body)

    def _world(self, body: int, place: np.ndarray) -> np.ndarray:
        return self._data.xpos[body] + self._data.xmat[body].reshape(3, 3) @ place

    def _points(self, equality: Equality) -> tuple:
        """Body and place of the first point, of the second, and the pose of the second body in the first, if welded."""
        model, index = self._model, equality.index
        data, weld = model.eq_data[index], equality.kind.turns
        turn = np.array(data[6:10]) if weld else np.zeros(4)
        if equality.sites is not None:
            one, two = equality.sites
            back = np.zeros(4)
            mujoco.mju_negQuat(back, model.site_quat[two])
            mujoco.mju_mulQuat(turn, model.site_quat[one], back)
            places = model.site_pos[one], model.site_pos[two]
        else:
            places = (data[3:6], data[0:3]) if weld else (data[0:3], data[3:6])
            mujoco.mju_normalize4(turn)
        bodies = equality.bodies
        return (bodies[0], places[0]), (bodies[1], places[1]), turn

    def _coupling(self, index: int) -> dict[str, str]:
        """The polynomial of a joint equality, about the pose that is written."""
        model, reference = self._model, self._export.reference
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])

        def moved(joint: int) -> float:
            at = int(model.jnt_qposadr[joint])
            return float(reference[at] - model.qpos0[at])

        polynomial = np.polynomial.Polynomial(model.eq_data[index, :5])
        named = {"joint1": self._name(_JOINT, first)}
        if second >= 0:
            polynomial = polynomial(np.polynomial.Polynomial([moved(second), 1.0]))
            named["joint2"] = self._name(_JOINT, second)
        coefficients = np.zeros(5)
        coefficients[: len(polynomial.coef)] = polynomial.coef
        coefficients[0] -= moved(first)
        return {**named, "polycoef": _text(coefficients)}

    def _actuator(self, actuator: int, parent: ET.Element) -> None:
        model, name = self._model, self._name(_ACTUATOR, actuator)
        fixed = model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        bare = model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        bare = bare and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
        on_joint = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
        joint = int(model.actuator_trnid[actuator, 0])
        single = on_joint and int(model.jnt_type[joint]) in (_SLIDE, _HINGE)
        if not self._reader.actuators:
            self._leave(f"actuator {quoted(name)}", f"{self._reader.title}'s reader has none")
        elif not (fixed and bare and single):
            self._leave(f"actuator {quoted(name)}", "no motor of a hinge or slide")
        else:
            gear = float(model.actuator_gear[actuator, 0] * model.actuator_gainprm[actuator, 0])
            said = {"joint": self._name(_JOINT, joint), "gear": _text([gear])}
            if model.actuator_ctrllimited[actuator]:
                said |= {"ctrllimited": "true", "ctrlrange": _text(model.actuator_ctrlrange[actuator])}
            ET.SubElement(parent, "motor", {"name": name, **said})

    def _count_others(self) -> None:
        others = _OTHERS if self._reader.sites else {**_OTHERS, "site": "site"}
        for count, what in others.items():
            if number := int(getattr(self._model, f"n{count}", 0)):
                self._leave(
                    f"{number} {what}{'' if number == 1 else 's' if what[-1] != 'x' else 'es'}",
                    "not written",
                    what not in _STILL,
                )


def _text(numbers: Iterable[float]) -> str:
    return " ".join(f"{float(number):.17g}" for number in numbers)
