//! Places of a robot on the map.

use crate::base::math::{Pose, Vector, about_z, wrap};

/// Place of the pivot: the part of a configuration that a planner uses. Joint angles and tilt belong to the local
/// state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// x, mu.
    pub x: f64,
    /// y, mu.
    pub y: f64,
    /// z, mu.
    pub z: f64,
    /// Heading, rad, in (−π, π].
    pub yaw: f64,
}

impl Place {
    /// The origin, heading along x.
    pub const ORIGIN: Place = Place { x: 0.0, y: 0.0, z: 0.0, yaw: 0.0 };

    /// Returns a point of this place's frame in map coordinates. Heights are the same in both: the frames differ by a
    /// turn about z and a shift in the plane.
    pub fn point(&self, x: f64, y: f64) -> (f64, f64) {
        self.plane().point(x, y)
    }

    /// Returns this place's frame in the plane, for the conversion of many points.
    pub fn plane(&self) -> Plane {
        Plane { x: self.x, y: self.y, sine: libm::sin(self.yaw), cosine: libm::cos(self.yaw) }
    }

    /// Returns a place of this place's frame in map coordinates.
    pub fn then(&self, inner: &Place) -> Place {
        let (x, y) = self.point(inner.x, inner.y);
        Place { x, y, z: inner.z, yaw: wrap(self.yaw + inner.yaw) }
    }

    /// Returns a place of the map in this place's frame. `frame.seen(&frame.then(&p))` is p except for rounding.
    pub fn seen(&self, outer: &Place) -> Place {
        let (dx, dy) = (outer.x - self.x, outer.y - self.y);
        let (s, c) = (libm::sin(self.yaw), libm::cos(self.yaw));
        Place { x: c * dx + s * dy, y: c * dy - s * dx, z: outer.z, yaw: wrap(outer.yaw - self.yaw) }
    }

    /// Returns the frame in which rollouts of the canonical frame are laid out: this place's x, y and heading.
    pub fn frame(&self) -> Pose {
        Pose::from_parts(Vector::new(self.x as f32, self.y as f32, 0.0), about_z(self.yaw))
    }

    /// Returns the planar distance, mu.
    pub fn planar_distance(&self, other: &Place) -> f64 {
        let (dx, dy) = (self.x - other.x, self.y - other.y);
        (dx * dx + dy * dy).sqrt()
    }
}

/// Frame of a place in the plane, with the sine and cosine of its heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    x: f64,
    y: f64,
    sine: f64,
    cosine: f64,
}

impl Plane {
    /// Returns a point of the frame in map coordinates.
    pub fn point(&self, x: f64, y: f64) -> (f64, f64) {
        (self.x + self.cosine * x - self.sine * y, self.y + self.sine * x + self.cosine * y)
    }
}
