"""L15: a fixed tendon that nothing uses, over joints that couplings hold: a differential that is a solid axle.

A sum of joints that is kept leaves them all but one freedom. Couplings of each to one of them leave one in all, so that
they turn as one shaft. The tendon that says what was meant stands in the file, and holds nothing by itself.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from oarlock.base.errors import few
from oarlock.base.text import quoted
from oarlock.diagnosis.lint.view import JOINT, TENDON, Remark, View
from oarlock.mechanics.coupled import coupled_ids
from oarlock.mechanics.names import element_name

JOINTS = 3
"""A sum of fewer holds as much as a coupling of two does."""

_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)


def look(view: View) -> Iterator[Remark]:
    """A remark a tendon."""
    model = view.model
    couplings = {one.name: set(coupled_ids(model, one.index)) for one in view.equalities if one.kind.holds == "joints"}
    for tendon in range(model.ntendon):
        first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
        wraps = range(first, first + count)
        if count < JOINTS or any(model.wrap_type[wrap] != _JOINT for wrap in wraps) or _used(view, tendon):
            continue
        terms = {int(model.wrap_objid[wrap]): float(model.wrap_prm[wrap]) for wrap in wraps}
        holding = [name for name, joints in couplings.items() if len(joints) == 2 and joints <= set(terms)]
        if len(holding) < count - 1:  # they leave more than one freedom
            continue
        said = " ".join(
            f"{'+' if value > 0 else '-'} {abs(value):g} {element_name(model, JOINT, joint)}"
            for joint, value in terms.items()
        )
        name = element_name(model, TENDON, tendon)
        line = (
            f"{few([quoted(one) for one in holding], last='and')} hold its joints together, as a solid axle does, and "
            f"nothing uses this tendon: {said.removeprefix('+ ')}, kept by one tendon equality in place of those "
            f'couplings, is a differential: <tendon tendon1="{name}"/>'
        )
        yield Remark(
            "L15", line, name, figures={"also": holding, "joints": [element_name(model, JOINT, one) for one in terms]}
        )


def _used(view: View, tendon: int) -> bool:
    """Whether a tendon holds, pulls or limits something, or drives an actuator."""
    model = view.model
    own = [
        bool(model.tendon_limited[tendon]),
        *(
            bool(np.any(getattr(model, f"tendon_{what}")[tendon]))
            for what in ("stiffness", "damping", "frictionloss", "armature")
        ),
    ]
    driven = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (model.actuator_trnid[:, 0] == tendon)
    kind = mujoco.mjtEq.mjEQ_TENDON
    kept = [index for index in range(model.neq) if model.eq_type[index] == kind and tendon in coupled_ids(model, index)]
    return any(own) or bool(driven.any()) or bool(kept)
