"""Our side: the exported robot, and gaits run by our engines."""

import json
import subprocess
import sys
from dataclasses import dataclass

import numpy as np


@dataclass
class Ends:
    """Where gaits end, one a row: x, y (mu), yaw (rad); NaN where a simulation broke."""

    pose: np.ndarray
    wall: float
    simulated: float

    @property
    def distance(self):
        return np.hypot(self.pose[:, 0], self.pose[:, 1])


def told(command):
    """What a command of ours prints; its own words end the comparison if it fails."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"tests/peers: {done.stderr.strip()}")
    return done.stdout


class Ours:
    def __init__(self, arguments, robot):
        self.arguments, self.robot = arguments, robot

    def export(self, format):
        name, _, variant = self.robot.partition(":")
        if name == "random" and format == "mjcf":
            return told([self.arguments.rollouts, self.robot, "--mjcf", *(["--real"] if self.arguments.real else [])])
        scale = "real" if self.arguments.real else "paper"
        command = [self.arguments.evogait, "robot", name, "--format", format, "--scale", scale]
        return told([*command, *(["--variant", variant] if variant else [])])

    def _ask(self, gaits, settings, more=()):
        command = [self.arguments.rollouts, self.robot, "--gaits", str(gaits), "--seed", str(self.arguments.seed)]
        command += ["--duration", str(self.arguments.duration), *more]
        command += ["--real"] if self.arguments.real else []
        for setting in settings:
            command += ["--setting", setting]
        return json.loads(told(command))

    def facts(self):
        """Robot, settled start and tables of joint targets (gait, tick, joint)."""
        facts = self._ask(self.arguments.gaits, [], ["--tables"])
        facts["tables"] = np.array(facts["tables"])
        return facts

    def run(self, setting, gaits):
        run = self._ask(gaits, [setting])["runs"][0]
        broken = (np.nan,) * 3
        pose = [(*end["position"][:2], end["yaw"]) if end else broken for end in run["ends"]]
        return Ends(np.array(pose), run["wall"], run["simulated"])
