//! How far two places are apart.

use crate::base::math::wrap;
use crate::model::Place;

/// ϱ(p, q) = √(Δx² + Δy² (+ Δz²) + (w·Δyaw)²), mu. The paper gives no metric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metric {
    /// w, mu/rad.
    pub yaw_weight: f64,
    /// Whether height counts: in environments with terrain.
    pub height: bool,
}

impl Metric {
    /// ϱ². Symmetric, 0 for equal places; the order of squares is that of distances.
    pub fn squared(&self, p: &Place, q: &Place) -> f64 {
        let (dx, dy) = (p.x - q.x, p.y - q.y);
        let dz = if self.height { p.z - q.z } else { 0.0 };
        let turn = self.yaw_weight * wrap(p.yaw - q.yaw);
        dx * dx + dy * dy + dz * dz + turn * turn
    }
}
