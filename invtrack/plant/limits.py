"""What actuators pass on of their controls: the tightest of ctrlrange, forcerange and a joint's actuatorfrcrange."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.plant.elements import element_name
from invtrack.plant.units import constant_gain

_ON_A_JOINT = tuple(map(int, (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)))
_ON_A_TENDON = int(mujoco.mjtTrn.mjTRN_TENDON)
_SCALAR_JOINTS = tuple(map(int, (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)))


@dataclass(frozen=True)
class ControlLimit:
    """Lowest and highest value that is passed on of one control; infinite where there is none.

    Args:
        low, high: the bounds, in the unit of the control.
        sources: the attributes of the file that they come from, such as "forcerange", the lower one's first.
        forcerange: whether the actuator's forcerange is in the bounds; where the force depends on the state it is not.
        joint: the joint whose actuatorfrcrange is in the bounds, or None.
    """

    low: float
    high: float
    sources: tuple[str, ...] = ()
    forcerange: bool = False
    joint: int | None = None


def control_limits(model: mujoco.MjModel, addresses: Indices) -> Array:
    """Lowest and highest value (p, 2) that the actuators pass on of the controls at these addresses; infinite where unlimited."""
    limits = [control_limit(model, int(address)) for address in addresses]
    return np.array([[limit.low, limit.high] for limit in limits]).reshape(len(limits), 2)


def control_limit(model: mujoco.MjModel, address: int) -> ControlLimit:
    """The limit of the control at this address of data.ctrl.

    The ctrlrange, and, where the force of the actuator is a constant times its control plus a constant, the controls whose forces
    are the ends of its forcerange; also those of the actuatorfrcrange of its joint, where no other actuator acts on that joint.
    Forces that depend on the state (servos, muscles) or follow an activation are not limits of the control: a run notes when they
    are clamped.
    """
    bounds, sources = [-np.inf, np.inf], ["", ""]
    if model.actuator_ctrllimited[address] and not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL:
        bounds, sources = model.actuator_ctrlrange[address].tolist(), ["ctrlrange", "ctrlrange"]
    actuator = actuator_of(model, address)
    line = _force_of_control(model, actuator)
    forcerange, joint = False, None
    if line is not None:
        gain, bias = line
        if model.actuator_forcelimited[actuator]:
            forcerange = True
            _tighten(bounds, sources, (model.actuator_forcerange[actuator] - bias) / gain, "forcerange")
        joint = _joint_alone(model, actuator)
        if joint is not None:
            gear = model.actuator_gear[model.actuator_outadr[actuator], 0]
            _tighten(bounds, sources, (model.jnt_actfrcrange[joint] / gear - bias) / gain, "actuatorfrcrange")
    named = tuple(dict.fromkeys(source for source in sources if source))
    return ControlLimit(bounds[0], bounds[1], named, forcerange, joint)


def actuator_of(model: mujoco.MjModel, address: int) -> int:
    """The actuator whose control stands at this address of data.ctrl."""
    return int(np.searchsorted(model.actuator_ctrladr, address, side="right")) - 1


def limit_text(model: mujoco.MjModel, name: str, address: int) -> str:
    """What messages call the limit of an input of this name: "forcerange of u", "actuatorfrcrange of joint x at u"."""
    limit = control_limit(model, address)
    sources = list(limit.sources)
    if limit.joint is not None and "actuatorfrcrange" in sources:
        sources[sources.index("actuatorfrcrange")] += f" of joint {element_name(model, 'joint', limit.joint)}"
    return f"{' and '.join(sources) or 'limit'} {'at' if sources and ' ' in sources[-1] else 'of'} {name}"


def _tighten(bounds: list[float], sources: list[str], ends: Array, source: str) -> None:
    """Clamp both bounds to a range: MuJoCo clamps the control first and the force after it, so the later has the last word."""
    low, high = sorted(ends.tolist())
    for side, bound in enumerate(bounds):
        clamped = min(max(bound, low), high)
        if clamped != bound:
            bounds[side], sources[side] = clamped, source


def _force_of_control(model: mujoco.MjModel, actuator: int) -> tuple[float, float] | None:
    """(gain, bias) of an actuator whose force before its range is gain * control + bias in every state; None of any other."""
    if model.actuator_trntype[actuator] == _ON_A_TENDON and model.tendon_actfrclimited[model.actuator_trnid[actuator, 0]]:
        return None  # it is scaled with the others at its tendon, before its own range clamps it
    gain = constant_gain(model, actuator)
    if gain is None or gain == 0 or model.actuator_actnum[actuator] or model.actuator_ctrlnum[actuator] != 1:
        return None
    kind = model.actuator_biastype[actuator]
    if kind == mujoco.mjtBias.mjBIAS_NONE:
        return gain, 0.0
    constant, *slopes = model.actuator_biasprm[actuator, :3]
    return (gain, float(constant)) if kind == mujoco.mjtBias.mjBIAS_AFFINE and not np.any(slopes) else None


def _joint_alone(model: mujoco.MjModel, actuator: int) -> int | None:
    """The scalar joint with an actuatorfrcrange on which this actuator acts and nothing else does; None where there is none."""
    joint = scalar_joint(model, actuator)
    if joint is None or not model.jnt_actfrclimited[joint] or model.jnt_actgravcomp[joint]:
        return None
    others = [other for other in range(model.nactuator) if other != actuator]
    return None if any(_may_act_on(model, other, joint) for other in others) else joint


def scalar_joint(model: mujoco.MjModel, actuator: int) -> int | None:
    """The slide or hinge on which the actuator acts, with a gear that is not zero; None where it acts in another way."""
    if model.actuator_trntype[actuator] not in _ON_A_JOINT or model.actuator_outnum[actuator] != 1:
        return None
    joint = int(model.actuator_trnid[actuator, 0])
    moved = model.jnt_type[joint] in _SCALAR_JOINTS and model.actuator_gear[model.actuator_outadr[actuator], 0]
    return joint if moved else None


def _may_act_on(model: mujoco.MjModel, actuator: int, joint: int) -> bool:
    kind, target = model.actuator_trntype[actuator], int(model.actuator_trnid[actuator, 0])
    if kind in _ON_A_JOINT:
        return target == joint
    if kind != _ON_A_TENDON:
        return True  # a site, a body or a crank can act on any joint above it
    first = int(model.tendon_adr[target])
    wraps = slice(first, first + int(model.tendon_num[target]))
    on_joints = model.wrap_type[wraps] == mujoco.mjtWrap.mjWRAP_JOINT
    return not np.all(on_joints) or joint in model.wrap_objid[wraps]
