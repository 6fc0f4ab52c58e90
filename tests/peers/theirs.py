"""MuJoCo's side: the exported robot, loaded as it is, fed the same joint targets from the same start."""

import time

import mujoco
import mujoco.rollout
import numpy as np

from ours import Ends

CONES = {"elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC, "pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL}


def heading(quaternion):
    """Twist about z of rotations w, x, y, z."""
    return 2 * np.arctan2(quaternion[..., 3], quaternion[..., 0])


class Theirs:
    def __init__(self, mjcf, facts):
        self.model = mujoco.MjModel.from_xml_string(mjcf)
        self.data = mujoco.MjData(self.model)
        self.facts = facts
        self.default = ("elliptic", self.model.opt.timestep)
        self.roll = mujoco.rollout.Rollout(nthread=0)

    def set(self, setting):
        cone, step = setting
        self.model.opt.cone, self.model.opt.timestep = CONES[cone], step

    def start(self, lift=0.0):
        """The full physics state of our settled start; joints are matched by name."""
        mujoco.mj_resetData(self.model, self.data)
        start = self.facts["start"]
        x, y, z, w = start["rotation"]
        self.data.qpos[:7] = [*start["position"], w, x, y, z]
        self.data.qpos[2] += lift
        for name, angle in zip(self.facts["joints"], start["joints"]):
            self.data.qpos[self.model.joint(name).qposadr[0]] = angle
        state = np.empty(mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(self.model, self.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state

    def controls(self, gaits):
        """Targets at the end of each step, as our engine takes them; columns in the order of the actuators."""
        step, tick, duration = self.model.opt.timestep, self.facts["tick"], self.facts["duration"]
        times = step * np.arange(1, round(duration / step) + 1)
        tables = self.facts["tables"][:gaits]
        at = np.clip(times / tick, 0, tables.shape[1] - 1)
        before = np.minimum(at.astype(int), tables.shape[1] - 2)
        share = (at - before)[None, :, None]
        targets = tables[:, before] * (1 - share) + tables[:, before + 1] * share
        columns = np.empty_like(targets)
        for i, name in enumerate(self.facts["joints"]):
            columns[:, :, self.model.actuator(name).id] = targets[:, :, i]
        return columns

    def run(self, setting, gaits):
        self.set(setting)
        start, controls = self.start(), self.controls(gaits)
        pose, wall = [], 0.0
        for control in controls:
            begin = time.perf_counter()
            states, _ = self.roll.rollout(self.model, self.data, start[None], control[None])
            wall += time.perf_counter() - begin
            qpos = states[0, -1, 1 : 1 + self.model.nq]
            sound = np.isfinite(qpos).all() and np.abs(qpos[:3]).max() < 1e3
            pose.append((qpos[0], qpos[1], heading(qpos[3:7])) if sound else (np.nan,) * 3)
        return Ends(np.array(pose), wall, gaits * self.facts["duration"])

    def let_go(self, lift, seconds, limp=False):
        """Height of the pivot some time after its release above its start, joints held at 0, or limp but damped."""
        self.set(("elliptic", 0.0005))
        gains = self.model.actuator_gainprm.copy(), self.model.actuator_biasprm.copy()
        if limp:
            self.model.actuator_gainprm[:, 0] = self.model.actuator_biasprm[:, 1] = 0
        control = np.zeros((1, round(seconds / self.model.opt.timestep), self.model.nu))
        states, _ = self.roll.rollout(self.model, self.data, self.start(lift)[None], control)
        self.model.actuator_gainprm[:], self.model.actuator_biasprm[:] = gains
        return states[0, -1, 3]
