"""Do all engines have the same robot? What must hold before speeds and outcomes are worth a comparison."""

import mujoco
import numpy as np

from measure import rank_agreement
from ours import Ours
from theirs import Theirs

# Random gaits of a few seconds, each engine at its default, ours against MuJoCo. What was measured is far above; a wrong
# axis, gain or friction lies far below.
LEAST_AGREEMENT = 0.6


class Checks:
    def __init__(self):
        self.passed = self.failed = 0

    def that(self, holds, what):
        self.passed, self.failed = self.passed + bool(holds), self.failed + (not holds)
        print(f"{'ok    ' if holds else 'FAILED'}  {what}", flush=True)

    def near(self, own, other, tolerance, what):
        off = float(np.abs(np.asarray(own, float) - np.asarray(other, float)).max())
        self.that(off <= tolerance, f"{what}: within {tolerance:g} ({off:.2g})")


def inertia(model, body):
    """About the centre of mass, in the body's axes."""
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    turn = turn.reshape(3, 3)
    return turn @ np.diag(model.body_inertia[body]) @ turn.T


def mjcf(checks, robot, theirs, facts):
    model, bodies = theirs.model, facts["bodies"]
    checks.that(model.nbody == len(bodies) + 1, f"{robot}: {len(bodies)} bodies and the world")
    checks.that(model.njnt - 1 == model.nu == len(facts["joints"]), f"{robot}: {model.nu} hinges, each with a motor")
    checks.that(model.ngeom == sum(b["boxes"] for b in bodies) + 1, f"{robot}: {model.ngeom - 1} boxes and the ground")
    ids = [model.body(b["name"]).id for b in bodies]
    checks.near(model.body_mass[ids], [b["mass"] for b in bodies], 1e-6, f"{robot}: masses, kg")
    checks.near(model.body_ipos[ids], [b["center_of_mass"] for b in bodies], 1e-6, f"{robot}: centres of mass, mu")
    checks.near([inertia(model, i) for i in ids], [b["inertia"] for b in bodies], 1e-6, f"{robot}: inertias, kg·mu²")
    limits = [model.joint(name).range for name in facts["joints"]]
    checks.near(limits, [[-np.pi / 2, np.pi / 2]] * len(limits), 1e-6, f"{robot}: limits, rad")


def urdf(checks, robot, text, facts):
    model = mujoco.MjModel.from_xml_string(text)
    bodies = facts["bodies"]
    checks.that(model.njnt == len(facts["joints"]), f"{robot}: MuJoCo reads the URDF too, {model.njnt} hinges")
    ids = [model.body(b["name"]).id for b in bodies[1:]]  # the first is part of MuJoCo's world
    checks.near(model.body_mass[ids], [b["mass"] for b in bodies[1:]], 1e-6, f"{robot}: its masses, kg")
    checks.near([inertia(model, i) for i in ids], [b["inertia"] for b in bodies[1:]], 1e-6, f"{robot}: its inertias")


def motion(checks, given, robot, ours, theirs, facts):
    fall, limp = facts["free_fall"], facts["limp"]
    fallen = facts["start"]["position"][2] + fall["lift"] - fall["height"]
    checks.near(theirs.let_go(fall["lift"], fall["seconds"]), fall["height"], 2e-3 * fallen,
                f"{robot}: a free fall, mu")
    checks.near(theirs.let_go(limp["lift"], limp["seconds"], limp=True), limp["height"], 0.02,
                f"{robot}: where it comes to rest, dropped and limp, mu")
    checks.near(theirs.let_go(0.0, 4.0), facts["start"]["position"][2], 0.01, f"{robot}: where it stands, mu")
    b = theirs.run(theirs.default, given.gaits)
    for engine, setting in facts["default_settings"].items():
        agreement = rank_agreement(ours.run(setting, given.gaits), b)
        checks.that(not agreement["broken"],
                    f"{robot}, {engine}: {given.gaits} gaits of {given.duration:g} s end soundly in both")
        checks.that(agreement["spearman"] >= LEAST_AGREEMENT,
                    f"{robot}, {engine}: rank correlation of the distances {agreement['spearman']:.2f}, "
                    f"at least {LEAST_AGREEMENT}")


def run(given):
    checks = Checks()
    for robot in given.robots:
        ours = Ours(given, robot)
        facts = ours.facts()
        theirs = Theirs(ours.export("mjcf"), facts)
        mjcf(checks, robot, theirs, facts)
        urdf(checks, robot, ours.export("urdf"), facts)
        motion(checks, given, robot, ours, theirs, facts)
    print(f"{checks.passed} passed, {checks.failed} failed")
    return 1 if checks.failed else 0
