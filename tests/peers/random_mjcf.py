"""Random MJCF files of what can be imported.

Each setting stands in a default class, in that of `childclass`, or on the element itself."""

import random
from xml.sax.saxutils import quoteattr

import numpy as np

SPELLINGS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
NAMES = ("left leg", "left/leg", "left.leg", "left_leg", "Bein ä", "脚", "body1", "body2", "joint1", "pivot", "a:b",
         "x+y", "-", "..", "foot #1", "1", "knee (left)", "robot/leg/knee", "Ω")
VISUAL_SHAPES = (("sphere", 1), ("cylinder", 2), ("ellipsoid", 3))


class Writer:
    def __init__(self, rng: random.Random):
        self.rng, self.lines, self.depth = rng, [], 0

    def _tag(self, name, attributes):
        order = list(attributes.items())
        self.rng.shuffle(order)
        if self.rng.random() < 0.03:
            self.lines.append("  " * self.depth + "<!-- a <comment> -->")
        return "  " * self.depth + "<" + name + "".join(f" {key}={quoteattr(str(v))}" for key, v in order)

    def leaf(self, name, attributes):
        self.lines.append(self._tag(name, attributes) + "/>")

    def open(self, name, attributes=None):
        self.lines.append(self._tag(name, attributes or {}) + ">")
        self.depth += 1

    def close(self, name):
        self.depth -= 1
        self.lines.append("  " * self.depth + f"</{name}>")


# Each file has some of these: frames, names that are not plain, ground inside a body, sizes of which the class has the
# rest, sections in any order.
FEATURES = ("frames", "names", "floor", "sizes", "order")
# The outermost class; MuJoCo lets it have no other name.
MAIN = "main"


class Classes:
    """Default classes by name: the class around each, and attributes by element."""

    def __init__(self):
        self.around, self.own = {MAIN: None}, {MAIN: {}}

    def get(self, element, name, attributes, key):
        """An element's attribute, its class's where it has none itself."""
        if key in attributes:
            return attributes[key]
        while name is not None:
            if key in self.own[name].get(element, {}):
                return self.own[name][element][key]
            name = self.around[name]
        return None


class Generator:
    def __init__(self, seed: int, bodies: int, scale: float, without=()):
        self.rng = random.Random(seed)
        rng = self.rng
        self.scale, self.bodies = scale, bodies
        self.degrees = rng.random() < 0.6
        self.autolimits = rng.random() < 0.75
        self.inertia = rng.choice([None, None, "auto", "auto", "true", "false"])
        self.classes = Classes()
        self.names, self.joints, self.excludes, self.sites = set(), [], [], 0
        self.all_named = rng.random() < 0.5
        self.hinges, self.made = 0, 0
        self.xml = Writer(rng)
        self.features = {f for f in FEATURES if rng.random() < 0.6 and f not in without}

    # Numbers and places.

    def chance(self, share):
        return self.rng.random() < share

    def number(self, value):
        text = self.rng.choice(["{:.6g}", "{:.6g}", "{:.17g}", "{:.4e}"]).format(value)
        if self.chance(0.05) and value > 0:
            text = "+" + text
        if self.chance(0.05) and text.startswith("0."):
            text = text[1:]
        return text

    def vector(self, values):
        gap = self.rng.choice([" ", " ", " ", "  ", "\t"])
        text = gap.join(self.number(v) for v in values)
        return f" {text} " if self.chance(0.05) else text

    def random_vector(self, reach):
        return [self.rng.uniform(-reach, reach) for _ in range(3)]

    def angle(self, degrees):
        return degrees if self.degrees else np.radians(degrees)

    def orientation(self):
        """In one of the five spellings, to no special length; sometimes along the axes."""
        rng, spelling = self.rng, self.rng.choice(SPELLINGS)
        plain = self.chance(0.25)
        turns = lambda: rng.choice([0, 90, -90, 180, 45]) if plain else rng.uniform(-180, 180)
        if spelling == "quat":
            values = rng.choice([[1, 1, 0, 0], [0, 1, 0, 0], [2, 0, 0, 0], [-1, 0, 0, 1]]) if plain else \
                [rng.uniform(-2, 2) for _ in range(4)]
        elif spelling == "euler":
            values = [self.angle(turns()) for _ in range(3)]
        elif spelling == "axisangle":
            axis = rng.choice([[1, 0, 0], [0, -2, 0], [0, 0, 1]]) if plain else self.random_vector(2)
            values = [*axis, self.angle(turns())]
        elif spelling == "xyaxes":
            values = rng.choice([[0, 1, 0, -1, 0, 0], [0, 0, 2, 1, 0, 1]]) if plain else \
                self.random_vector(2) + self.random_vector(2)
        else:
            values = rng.choice([[0, 0, -1], [0, 0, 3], [1e-3, 0, -1], [0, -1, 0]]) if plain else self.random_vector(2)
        return {spelling: self.vector(values)}

    def pose(self, reach, pos=0.7, turned=0.6):
        place = {"pos": self.vector(self.random_vector(reach))} if self.chance(pos) else {}
        return place | (self.orientation() if self.chance(turned) else {})

    def name(self, share):
        """A name that MuJoCo sees for the first time among elements of a kind; rarely of plain letters only."""
        if not self.chance(share):
            return {}
        name = self.rng.choice(NAMES) if "names" in self.features and self.chance(0.5) else f"part{len(self.names)}"
        if name in self.names:
            name += f" {len(self.names)}"  # a space: only where names are not plain
        self.names.add(name)
        return {"name": name}

    # Classes.

    def class_defaults(self, root):
        rng, own = self.rng, {}
        if self.chance(0.7):
            geom = {}
            if self.chance(0.4):
                geom["type"] = rng.choice(["box", "capsule"])
            if self.chance(0.4):
                geom["size"] = self.vector([rng.uniform(0.05, 0.2) for _ in range(3)])
            if self.chance(0.2):
                geom |= self.pose(0.2)
            if self.chance(0.3):
                geom["density"] = self.number(rng.uniform(100, 2000))
            if self.chance(0.15):
                geom["mass"] = self.number(rng.uniform(0.1, 3))
            if not root and self.chance(0.25):
                geom |= {"contype": "0", "conaffinity": "0"}
            if self.chance(0.3):
                geom |= rng.choice([{"rgba": "1 0 0 1"}, {"friction": "0.9"}, {"group": "2"}, {"condim": "4"}])
            own["geom"] = geom
        if self.chance(0.7):
            joint = {}
            if self.chance(0.5):
                joint["range"] = self.range()
                if self.chance(0.4):
                    joint["limited"] = rng.choice(["true", "auto"])
            if self.chance(0.4):
                joint["axis"] = self.vector(self.random_vector(2))
            if self.chance(0.3):
                joint["pos"] = self.vector(self.random_vector(0.3))
            if self.chance(0.3):
                zeros = [{"damping": "0", "armature": "0.0"}, {"stiffness": "0", "ref": "0"}]
                joint |= rng.choice([*zeros, {"type": "hinge"}])
            own["joint"] = joint
        motors = {"motor": {"forcerange": "-50 50"}, "position": {"kp": "100"}, "general": {"gainprm": "2"}}
        return own | {motor: attributes for motor, attributes in motors.items() if self.chance(0.2)}

    def range(self):
        near = self.rng.choice([90.0, 90.0, 90.01, 89.99])
        return self.vector([-self.angle(90.0), self.angle(near)])

    def defaults(self, name, depth):
        classes = self.classes
        self.xml.open("default", {"class": name} if depth or self.chance(0.3) else {})
        classes.own[name] = self.class_defaults(depth == 0)
        for element, attributes in classes.own[name].items():
            if attributes or self.chance(0.2):
                self.xml.leaf(element, attributes)
        for _ in range(self.rng.choice([0, 1, 2, 3]) if depth < 3 else 0):
            inner = f"c{len(classes.own)}"
            inner = f"class {inner}" if "names" in self.features and self.chance(0.2) else inner
            classes.around[inner] = name
            self.defaults(inner, depth + 1)
        self.xml.close("default")

    def of_class(self, inherited, share=0.3):
        """The class attribute of an element, and the class that counts for it."""
        if self.chance(share):
            name = self.rng.choice(list(self.classes.own))
            return {"class": name}, name
        return {}, inherited

    # Elements.

    def geom(self, inherited, first, inertial):
        rng, own = self.rng, {}
        given, name = self.of_class(inherited)
        get = lambda key: self.classes.get("geom", name, own, key)
        own |= given
        # What is only seen; or, where its class is seen only, what collides all the same.
        if self.chance(0.2):
            own |= {"contype": "0", "conaffinity": "0"}
        elif get("contype") == "0" and self.chance(0.3):
            own |= {"contype": "1", "conaffinity": "1"}
        seen = get("contype") == "0"
        if get("type") not in ("box", "capsule") or self.chance(0.4):
            own["type"] = rng.choice(["box", "capsule"])
        if seen and (not first or inertial) and self.chance(0.4):
            own["type"], count = rng.choice(VISUAL_SHAPES)
            own["size"] = self.vector([rng.uniform(0.05, 0.2) for _ in range(count)])
            own |= self.pose(0.3)
            # Such a shape must not have any mass, unless the body's mass is written out.
            if self.inertia == "true" or not inertial or self.chance(0.5):
                own[rng.choice(["mass"] if get("mass") else ["mass", "density"])] = "0"
            self.xml.leaf("geom", own)
            return
        line = get("type") == "capsule" and not any(get(key) for key in ("pos", *SPELLINGS)) and self.chance(0.5)
        if get("size") is None or self.chance(0.5):
            size = [rng.uniform(0.05, 0.2) for _ in range(3)]
            count = 3 if get("type") == "box" else 1 if line else rng.choice([2, 2, 3])
            # MuJoCo takes the numbers that are not given from the class.
            count = 1 if get("size") is not None and "sizes" in self.features and self.chance(0.2) else count
            own["size"] = self.vector(size[:count])
        if line:
            start = np.array(self.random_vector(0.3))
            own["fromto"] = self.vector([*start, *(start + self.random_vector(0.2) + [0.05, 0.0, 0.0])])
        else:
            own |= self.pose(0.3)
        if self.chance(0.25):
            own["mass"] = self.number(rng.uniform(0.1, 3))
        if self.chance(0.25):
            own["density"] = self.number(rng.uniform(100, 2000))
        if (not first or inertial) and self.chance(0.15):
            own["mass"] = "0"
        own |= self.name(0.2)
        self.xml.leaf("geom", own)

    def inertial(self):
        rng = self.rng
        x, y, z = (rng.uniform(0.1, 0.5) for _ in range(3))
        mass = rng.uniform(0.1, 5)
        moments = np.array([y * y + z * z, x * x + z * z, x * x + y * y]) * mass / 3
        own = {"pos": self.vector(self.random_vector(0.3)), "mass": repr(mass)}
        if self.chance(0.5):
            turn, _ = np.linalg.qr(np.array([self.random_vector(1) for _ in range(3)]))
            full = turn @ np.diag(moments) @ turn.T
            places = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)
            own["fullinertia"] = " ".join(repr(float(full[place])) for place in places)
        else:
            own["diaginertia"] = " ".join(repr(float(m)) for m in moments)
            if self.chance(0.7):
                own |= self.orientation()
        self.xml.leaf("inertial", own)

    def hinge(self, inherited):
        own, name = self.of_class(inherited)
        get = lambda key: self.classes.get("joint", name, own, key)
        if get("range") is None or self.chance(0.3):
            own["range"] = self.range()
        limited = get("limited")
        if not self.autolimits and limited != "true" or self.chance(0.2):
            own["limited"] = "true"
        if self.chance(0.7):
            own["axis"] = self.rng.choice([self.vector(self.random_vector(2)), "1 0 0", "0 -1 0"])
        if self.chance(0.4):
            own["pos"] = self.vector(self.random_vector(0.3))
        if self.chance(0.2):
            own["type"] = "hinge"
        own |= self.name(1.0 if self.all_named else 0.6)
        self.joints.append(own.get("name"))
        self.xml.leaf("joint", own)

    def frames(self, inherited, content, depth=0):
        """Content, inside none, one or several frames; a frame is a pose, and may name a class for what it holds."""
        if "frames" not in self.features or not self.chance(0.2 / (1 + depth)):
            return content(inherited)
        own = self.pose(0.3)
        if self.chance(0.3):
            own["childclass"] = inherited = self.rng.choice(list(self.classes.own))
        own |= self.name(0.2)
        self.xml.open("frame", own)
        self.frames(inherited, content, depth + 1)
        self.xml.close("frame")

    def body(self, inherited, root=False, carrier=None):
        rng = self.rng
        self.made += 1
        hinge = not root and (self.hinges == 0 or self.chance(0.75))
        own = self.name(0.7)
        # Far enough from what carries it that bodies do not overlap, which is refused.
        direction = np.array([rng.gauss(0, 1) for _ in range(3)])
        reach = rng.uniform(0.5, 1.0) * self.scale
        if not root or self.chance(0.7):
            own["pos"] = self.vector(reach * direction / np.linalg.norm(direction))
        if self.chance(0.6):
            own |= self.orientation()
        if self.chance(0.3):
            own["childclass"] = inherited = rng.choice(list(self.classes.own))
        own |= rng.choice([{"gravcomp": "0"}, {"mocap": "false"}]) if self.chance(0.05) else {}
        self.xml.open("body", own)
        if carrier and own.get("name") and self.chance(0.3):
            self.excludes.append((carrier, own["name"]))

        parts = []
        if root:
            free = [("freejoint", self.name(0.3)), ("joint", {"type": "free"} | self.name(0.3))]
            parts.append(lambda _: self.xml.leaf(*rng.choice(free)))
        elif hinge:
            self.hinges += 1
            parts.append(lambda c: self.frames(c, self.hinge))
        inertial = self.inertia == "false" and (root or hinge) or self.chance(0.3)
        if inertial:
            parts.append(lambda _: self.inertial())
        for i in range(rng.choice([1, 1, 2, 3])):
            parts.append(lambda c, first=i == 0: self.frames(c, lambda d: self.geom(d, first, inertial)))
        for _ in range(rng.choice([0, 1, 1, 2, 3]) if self.made < self.bodies else 0):
            parts.append(lambda c: self.frames(c, lambda d: self.body(d, carrier=own.get("name")))
                         if self.made < self.bodies else None)
        if self.chance(0.2):
            self.sites += 1
            site = {"name": f"site{self.sites}"} | self.pose(0.3)
            parts.append(lambda _: self.xml.leaf("site", site))
        if self.chance(0.1):
            parts.append(lambda _: self.xml.leaf("camera", {"mode": "fixed"}))
        rng.shuffle(parts)
        for part in parts:
            part(inherited)
        # A robot has a joint that moves, and as many bodies as were wished for.
        while root and (self.made < self.bodies or self.hinges == 0):
            self.body(inherited, carrier=own.get("name"))
        self.xml.close("body")

    # Sections.

    def compiler(self):
        own = {}
        if not self.degrees or self.chance(0.5):
            own["angle"] = "degree" if self.degrees else "radian"
        if not self.autolimits or self.chance(0.3):
            own["autolimits"] = "true" if self.autolimits else "false"
        if self.inertia:
            own["inertiafromgeom"] = self.inertia
        if self.chance(0.2):
            own["eulerseq"] = "xyz"
        if self.chance(0.2):
            more = [("balanceinertia", "false"), ("boundmass", "0"), ("fusestatic", "false"), ("settotalmass", "-1")]
            own |= [self.rng.choice(more)]
        items = list(own.items())
        cut = self.rng.randint(0, len(items)) if self.chance(0.2) else len(items)
        for part in (items[:cut], items[cut:]):
            if part:
                self.xml.leaf("compiler", dict(part))

    def world(self):
        xml = self.xml
        # Its place and turn are its own: a class may have others.
        plane = {"type": "plane", "pos": "0 0 0", "quat": "1 0 0 0", "size": self.rng.choice(["0 0 1", "5 5 .1"])}
        plane |= {"contype": "1", "conaffinity": "1"} if self.chance(0.5) else {}
        floor = self.rng.choice(["none", "geom", "body" if "floor" in self.features else "geom"])
        xml.open("worldbody")
        if self.chance(0.3):
            xml.leaf("light", {"pos": "0 0 10", "dir": "0 0 -1"})
        def ground():
            if floor == "geom":
                xml.leaf("geom", plane | self.name(0.5))
            elif floor == "body":
                xml.open("body", {"name": "floor"} if self.chance(0.8) else {})
                xml.leaf("geom", plane)
                xml.close("body")
        first = self.chance(0.7)
        if first:
            ground()
        self.body(MAIN, root=True)
        if not first:
            if self.chance(0.3):
                xml.close("worldbody")
                xml.open("worldbody")
            ground()
        xml.close("worldbody")

    def actuators(self):
        if None in self.joints or not self.chance(0.7):
            return
        self.xml.open("actuator")
        kinds = ["motor", "position", "velocity", "general"]
        chosen = self.rng.sample(kinds, self.rng.choice([1, 1, 2]))
        for joint in self.rng.sample(self.joints, len(self.joints)):
            kind = self.rng.choice(chosen)
            own = {"joint": joint} | self.of_class(None, 0.3)[0]
            own |= {"name": joint} if self.chance(0.5) else {}
            if self.chance(0.5):
                position = {"kp": "40", "ctrlrange": self.range(), "ctrllimited": "true"}
                general = {"biastype": "affine", "gainprm": "40", "biasprm": "0 -40 -2"}
                velocity, motor = {"kv": "3"}, {"gear": "30"}
                own |= {"motor": motor, "position": position, "velocity": velocity, "general": general}[kind]
            self.xml.leaf(kind, own)
        self.xml.close("actuator")

    def contact(self):
        if self.excludes:
            self.xml.open("contact")
            for first, second in self.excludes:
                pair = [first, second] if self.chance(0.5) else [second, first]
                self.xml.leaf("exclude", {"body1": pair[0], "body2": pair[1]})
            self.xml.close("contact")

    def rest(self):
        if self.chance(0.3):
            self.xml.leaf("option", {"timestep": "0.002", "gravity": "0 0 -9.81"})
        if self.chance(0.1):
            self.xml.leaf("statistic", {"extent": "2"})
        if self.chance(0.1):
            self.xml.open("visual")
            self.xml.leaf("headlight", {"ambient": "0.4 0.4 0.4"})
            self.xml.close("visual")
        if self.chance(0.1):
            self.xml.open("asset")
            self.xml.leaf("material", {"name": "metal", "rgba": "1 1 1 1"})
            self.xml.close("asset")
        if self.sites and self.chance(0.3):
            self.xml.open("sensor")
            self.xml.leaf("gyro", {"site": "site1"})
            self.xml.close("sensor")

    def text(self):
        rng, xml = self.rng, self.xml
        sections = []
        # Written in this order, since elements name classes and joints; MuJoCo takes sections in any order.
        defaults = lambda: self.defaults(MAIN, 0)
        for section in (defaults, self.compiler, self.world, self.contact, self.actuators, self.rest):
            xml.lines = []
            section()
            sections.append(xml.lines)
        if "order" in self.features:
            rng.shuffle(sections)
        models = ["robot", "my robot", "α/2"] if "names" in self.features else ["robot"]
        model = {"model": rng.choice(models)} if self.chance(0.7) else {}
        xml.lines = ['<?xml version="1.0" encoding="utf-8"?>'] if self.chance(0.2) else []
        xml.open("mujoco", model)
        xml.lines += [line for section in sections for line in section]
        xml.close("mujoco")
        return "\n".join(xml.lines) + "\n"
