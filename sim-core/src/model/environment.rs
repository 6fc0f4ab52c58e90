//! Environments: map, terrain that may be touched, obstacles that must not be touched, start and goal.
//!
//! Coordinates are measured from the map's centre, mu: x along the map's width, y along its height, z up. The ground is
//! flat at z = 0.

use crate::base::error::{Faults, Invalid, in_range, name, whole_in_range};
use crate::base::limits;
use serde::{Deserialize, Serialize};

/// Environment as in its TOML file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// Name in messages, tables and file names.
    pub name: String,
    /// Description, with the assumptions made where the source gives no value.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Width (x) and height (y) of the map, mu. The robot's pivot must not leave the map.
    pub size: [f64; 2],
    /// Start of the robot.
    pub start: Start,
    /// Goal of the robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal: Option<Goal>,
    /// Boxes that must not be touched.
    #[serde(default, rename = "obstacle", skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<Block>,
    /// Boxes that may be touched and stood on.
    #[serde(default, rename = "terrain", skip_serializing_if = "Vec::is_empty")]
    pub terrain: Vec<Block>,
}

/// Planar pose of the pivot at the start. Its height and tilt follow from settling on the ground.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// x of the pivot, mu.
    pub x: f64,
    /// y of the pivot, mu.
    pub y: f64,
    /// Heading, rad.
    #[serde(default)]
    pub yaw: f64,
}

/// Place that the robot should reach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Goal {
    /// x of the pivot, mu.
    pub x: f64,
    /// y of the pivot, mu.
    pub y: f64,
    /// Height of the pivot at the goal, mu. Only for a distance that weighs height.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub z: Option<f64>,
    /// Heading at the goal, rad. Only for a distance that weighs heading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw: Option<f64>,
    /// Greatest distance between pivot and goal at which a planning job ends, mu.
    #[serde(default = "Goal::default_radius")]
    pub radius: f64,
}

impl Goal {
    /// Creates a goal without height and heading.
    pub fn at(x: f64, y: f64, radius: f64) -> Self {
        Self { x, y, z: None, yaw: None, radius }
    }

    fn default_radius() -> f64 {
        1.0
    }
}

/// Upright box, turned about z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Centre (x, y), mu.
    pub center: [f64; 2],
    /// Full side lengths along its own x and y, mu.
    pub size: [f64; 2],
    /// Height of the lower face, mu.
    #[serde(default)]
    pub base: f64,
    /// Height of the upper face, mu.
    pub top: f64,
    /// Turn about z, rad.
    #[serde(default)]
    pub yaw: f64,
}

impl Block {
    /// Returns true if a disc of radius `margin` mu around a point of the plane overlaps the box.
    pub fn covers(&self, x: f64, y: f64, margin: f64) -> bool {
        let (dx, dy) = (x - self.center[0], y - self.center[1]);
        // The point is too far away at any turn of the box. The factor allows for rounding.
        let reach = (self.size[0] + self.size[1]) / 2.0 + margin;
        if dx * dx + dy * dy > reach * reach * (1.0 + 1e-6) {
            return false;
        }
        let (s, c) = (libm::sin(self.yaw), libm::cos(self.yaw));
        let (u, v) = (c * dx + s * dy, c * dy - s * dx);
        let outside_u = (u.abs() - self.size[0] / 2.0).max(0.0);
        let outside_v = (v.abs() - self.size[1] / 2.0).max(0.0);
        outside_u * outside_u + outside_v * outside_v <= margin * margin
    }
}

impl Environment {
    /// Reads and validates an environment file's text.
    pub fn from_toml(text: &str) -> Result<Self, Invalid> {
        let environment: Self = crate::base::toml_file::read(text)?;
        environment.validate()?;
        Ok(environment)
    }

    /// Returns true if the environment has no terrain, so that all ground is flat.
    pub fn is_flat(&self) -> bool {
        self.terrain.is_empty()
    }

    /// Returns true if a point of the plane lies on the map.
    pub fn contains(&self, x: f64, y: f64) -> bool {
        x.abs() <= self.size[0] / 2.0 && y.abs() <= self.size[1] / 2.0
    }

    /// Refuses values that can't be simulated or make no sense. `validate` in [`crate::problem::Job`] adds the checks
    /// that need the robot.
    pub fn validate(&self) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        faults.take(name("environment.name", &self.name));
        let most = limits::MAX_DESCRIPTION_LENGTH as u64;
        faults.take(whole_in_range(
            "environment.description length",
            self.description.len() as u64,
            (0, most),
            "bytes",
        ));
        for (axis, &side) in self.size.iter().enumerate() {
            faults.take(in_range(format!("environment.size[{axis}]"), side, (1.0, limits::MAX_MAP_SIZE), "mu"));
        }
        let far = (-limits::MAX_MAP_SIZE, limits::MAX_MAP_SIZE);
        let turn = (-7.0, 7.0);
        faults.take(in_range("environment.start.x", self.start.x, far, "mu"));
        faults.take(in_range("environment.start.y", self.start.y, far, "mu"));
        faults.take(in_range("environment.start.yaw", self.start.yaw, turn, "rad"));
        for (list, blocks) in [("obstacle", &self.obstacles), ("terrain", &self.terrain)] {
            let most = limits::MAX_BOXES as u64;
            faults.take(whole_in_range(format!("number of environment.{list}"), blocks.len() as u64, (0, most), ""));
            for (i, b) in blocks.iter().enumerate() {
                let at = |what: &str| format!("environment.{list}[{i}].{what}");
                for axis in 0..2 {
                    faults.take(in_range(at(&format!("center[{axis}]")), b.center[axis], far, "mu"));
                    let side = (1e-3, limits::MAX_MAP_SIZE);
                    faults.take(in_range(at(&format!("size[{axis}]")), b.size[axis], side, "mu"));
                }
                faults.take(in_range(at("base"), b.base, (0.0, 1000.0), "mu"));
                faults.take(in_range(at("top"), b.top, (b.base + 1e-3, 1000.0), "mu"));
                faults.take(in_range(at("yaw"), b.yaw, turn, "rad"));
            }
        }
        if let Some(goal) = &self.goal {
            faults.take(in_range("environment.goal.x", goal.x, far, "mu"));
            faults.take(in_range("environment.goal.y", goal.y, far, "mu"));
            faults.take(goal.z.map_or(Ok(()), |z| in_range("environment.goal.z", z, far, "mu")));
            faults.take(goal.yaw.map_or(Ok(()), |yaw| in_range("environment.goal.yaw", yaw, turn, "rad")));
            faults.take(in_range("environment.goal.radius", goal.radius, (1e-3, limits::MAX_MAP_SIZE), "mu"));
        }
        // Places are checked only if all numbers are valid.
        if faults.is_empty() {
            faults.take(self.place("the start", self.start.x, self.start.y));
            if let Some(goal) = &self.goal {
                faults.take(self.place("the goal", goal.x, goal.y));
            }
        }
        faults.end()
    }

    fn place(&self, what: &'static str, x: f64, y: f64) -> Result<(), Invalid> {
        let [w, h] = self.size;
        if !self.contains(x, y) {
            let wrong = format!(
                "outside the map: x from {} to {} mu, y from {} to {} mu",
                -w / 2.0,
                w / 2.0,
                -h / 2.0,
                h / 2.0
            );
            return Err(Invalid::Misplaced { what, x, y, wrong });
        }
        if let Some(i) = self.obstacles.iter().position(|o| o.covers(x, y, 0.0)) {
            return Err(Invalid::Misplaced { what, x, y, wrong: format!("inside environment.obstacle[{i}]") });
        }
        Ok(())
    }
}
