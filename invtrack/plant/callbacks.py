"""MuJoCo's process-wide callbacks, confined to one model and one block of code."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco

Callback = Callable[[mujoco.MjModel, mujoco.MjData], None]


@contextmanager
def mujoco_callbacks(model: mujoco.MjModel, *, control: Callback | None = None, passive: Callback | None = None) -> Iterator[None]:
    """Run `control(model, data)` and `passive(model, data)` inside MuJoCo's pipeline for `model`, and for `model` only.

    control writes data.ctrl, passive adds to data.qfrc_passive; MuJoCo calls both in every mj_forward and in each stage of RK4. The
    callbacks of MuJoCo are global to the process. Here other models (also copies of `model`) do not see these; blocks may be
    nested, and within a nested block the callbacks of the outer one still serve the outer model. What was installed before is
    back in place when the block ends, also after an exception.
    """
    previous_control, previous_passive = mujoco.get_mjcb_control(), mujoco.get_mjcb_passive()
    try:
        if control is not None:
            mujoco.set_mjcb_control(_only_for(model, control, previous_control))
        if passive is not None:
            mujoco.set_mjcb_passive(_only_for(model, passive, previous_passive))
        yield
    finally:
        mujoco.set_mjcb_control(previous_control)
        mujoco.set_mjcb_passive(previous_passive)


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect the texts of MuJoCo's warnings in a list, in place of its log file MUJOCO_LOG.TXT and its lines on stderr.

    MuJoCo warns of each kind once per MjData. The handler is global to the process; what was installed before is put back at the
    end.
    """
    texts: list[str] = []
    previous = mujoco.get_mju_user_warning()
    try:
        mujoco.set_mju_user_warning(texts.append)
        yield texts
    finally:
        mujoco.set_mju_user_warning(previous)


@contextmanager
def callbacks_suspended() -> Iterator[None]:
    """Run a block without control and passive callbacks, then put them back.

    MuJoCo tries out what it compiles, and a callback in Python cannot be given a model that is not finished.
    """
    control, passive = mujoco.get_mjcb_control(), mujoco.get_mjcb_passive()
    mujoco.set_mjcb_control(None)
    mujoco.set_mjcb_passive(None)
    try:
        yield
    finally:
        mujoco.set_mjcb_control(control)
        mujoco.set_mjcb_passive(passive)


def _only_for(model: mujoco.MjModel, callback: Callback, otherwise: Callback | None) -> Callback:
    def dispatch(called_model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if called_model is model:
            callback(called_model, data)
        elif otherwise is not None:
            otherwise(called_model, data)

    return dispatch
