//! Nearest neighbours under the planner's metric.

use super::{Metric, Place};

/// Places that can be asked for the nearest; ties go to the lowest index.
#[derive(Clone, Debug)]
pub struct Nearest {
    metric: Metric,
    places: Vec<Place>,
}

impl Nearest {
    /// An empty set.
    pub fn new(metric: Metric) -> Self {
        Self { metric, places: Vec::new() }
    }

    /// Adds a place; its index is how many there were before.
    pub fn add(&mut self, place: Place) {
        self.places.push(place);
    }

    /// Index and squared distance of the place nearest to `q`, leaving out the index `but`. `None` if there is no other.
    pub fn nearest(&self, q: &Place, but: Option<usize>) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        for (i, p) in self.places.iter().enumerate() {
            if Some(i) == but {
                continue;
            }
            let distance = self.metric.squared(p, q);
            if best.is_none_or(|b| distance < b.1) {
                best = Some((i, distance));
            }
        }
        best
    }
}
