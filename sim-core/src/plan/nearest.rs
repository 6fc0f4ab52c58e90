//! Nearest-neighbour search under the planner's metric: a k-d tree that grows with the planner's tree.
//!
//! The result equals that of a linear scan, to the bit: distances are [`Metric::squared`] of the stored places, and
//! ties go to the lowest index. A subtree is skipped only if its box cannot hold a better result. The bound needs no
//! slack: it uses the metric's own operations in the metric's own order, and rounding preserves order. Heading is an
//! interval like the other coordinates; [`Cell::bound`] accounts for its wrap at ±π.
//!
//! No crate fits: crates of k-d trees and R-trees offer Euclidean distances without a circular coordinate, leave the
//! order of ties open, or build the tree only once. The planner needs a query after every few places it adds.

use super::Metric;
use crate::base::math::wrap;
use crate::model::Place;
use std::f64::consts::PI;

/// Most places in a leaf.
const LEAF: usize = 16;
/// Share of a subtree's places that one side may hold (plus one leaf); above it the subtree is rebuilt. So depth stays
/// logarithmic for any order of places, also along a line or all at one point.
const BALANCE: f64 = 0.7;

/// Set of places with queries for the nearest; ties go to the lowest index.
#[derive(Clone, Debug)]
pub struct Nearest {
    metric: Metric,
    places: Vec<Place>,
    cells: Vec<Cell>,
    /// Root of the tree: the cell around all of its places.
    top: Option<u32>,
    /// Unused cells, left over when a subtree was rebuilt.
    free: Vec<u32>,
    /// Places outside the tree, because the bounds do not hold for headings beyond ±π.
    loose: Vec<u32>,
    /// True if a place or a weight is not finite. Then every query scans all places.
    scan_only: bool,
}

/// A box around places.
#[derive(Clone, Debug)]
struct Cell {
    low: Place,
    high: Place,
    /// Lowest index of the cell's places.
    least: u32,
    count: u32,
    content: Content,
}

#[derive(Clone, Debug)]
enum Content {
    Leaf(Vec<u32>),
    /// Two child cells. A new place with a coordinate below `at` goes to the first.
    Split {
        axis: Axis,
        at: f64,
        sides: [u32; 2],
    },
}

#[derive(Clone, Copy, Debug)]
enum Axis {
    X,
    Y,
    Z,
    Yaw,
}

impl Axis {
    fn of(self, place: &Place) -> f64 {
        match self {
            Self::X => place.x,
            Self::Y => place.y,
            Self::Z => place.z,
            Self::Yaw => place.yaw,
        }
    }
}

impl Nearest {
    /// Creates an empty set.
    pub fn new(metric: Metric) -> Self {
        Self {
            metric,
            places: Vec::new(),
            cells: Vec::new(),
            top: None,
            free: Vec::new(),
            loose: Vec::new(),
            scan_only: !metric.yaw_weight.is_finite() || !metric.z.is_finite(),
        }
    }

    /// Adds a place. Its index is the number of places added before.
    pub fn add(&mut self, place: Place) {
        let index = self.places.len() as u32;
        self.places.push(place);
        self.scan_only |= !is_finite(&place);
        if self.scan_only || place.yaw.abs() > PI {
            self.loose.push(index);
        } else if let Some(top) = self.top {
            self.insert(top, index);
        } else {
            self.top = Some(self.build(&mut [index]));
        }
    }

    /// Returns the index and squared distance of the place nearest to `q`, without the place of index `but`. `None` if
    /// there is no other place.
    pub fn nearest(&self, q: &Place, but: Option<usize>) -> Option<(usize, f64)> {
        let but = but.and_then(|i| u32::try_from(i).ok());
        let mut search = Search { set: self, q, but, best: None };
        if self.scan_only || !is_finite(q) || q.yaw.abs() > PI {
            (0..self.places.len() as u32).for_each(|i| search.try_place(i));
        } else {
            self.loose.iter().for_each(|&i| search.try_place(i));
            if let Some(top) = self.top {
                search.descend(top);
            }
        }
        search.best.map(|(i, distance)| (i as usize, distance))
    }

    /// Adds a place to the tree. Rebuilds the highest cell that becomes too full or too uneven.
    fn insert(&mut self, top: u32, index: u32) {
        let place = self.places[index as usize];
        // Parent and side of the current cell.
        let mut link: Option<(u32, usize)> = None;
        let mut uneven: Option<(Option<(u32, usize)>, u32)> = None;
        let mut at = top;
        loop {
            let cell = &mut self.cells[at as usize];
            cell.count += 1;
            cell.low = least_of(&cell.low, &place);
            cell.high = most_of(&cell.high, &place);
            match &mut cell.content {
                Content::Leaf(members) => {
                    members.push(index);
                    if members.len() > LEAF && uneven.is_none() {
                        uneven = Some((link, at));
                    }
                    break;
                }
                &mut Content::Split { axis, at: border, sides } => {
                    let count = cell.count;
                    let side = usize::from(axis.of(&place) >= border);
                    let then = self.cells[sides[side] as usize].count + 1;
                    if uneven.is_none() && f64::from(then) > BALANCE * f64::from(count) + LEAF as f64 {
                        uneven = Some((link, at));
                    }
                    link = Some((at, side));
                    at = sides[side];
                }
            }
        }
        if let Some((link, cell)) = uneven {
            let mut members = Vec::with_capacity(self.cells[cell as usize].count as usize);
            self.take_apart(cell, &mut members);
            let built = self.build(&mut members);
            match link.map(|(parent, side)| (&mut self.cells[parent as usize].content, side)) {
                Some((Content::Split { sides, .. }, side)) => sides[side] = built,
                _ => self.top = Some(built),
            }
        }
    }

    /// Frees a cell and all cells below it, and moves their places to `members`.
    fn take_apart(&mut self, cell: u32, members: &mut Vec<u32>) {
        self.free.push(cell);
        match std::mem::replace(&mut self.cells[cell as usize].content, Content::Leaf(Vec::new())) {
            Content::Leaf(leaf) => members.extend(leaf),
            Content::Split { sides, .. } => sides.into_iter().for_each(|side| self.take_apart(side, members)),
        }
    }

    /// Builds a balanced cell of these places (at least one) and returns its index.
    fn build(&mut self, members: &mut [u32]) -> u32 {
        let first = self.places[members[0] as usize];
        let (mut low, mut high, mut least) = (first, first, members[0]);
        for &i in members.iter() {
            low = least_of(&low, &self.places[i as usize]);
            high = most_of(&high, &self.places[i as usize]);
            least = least.min(i);
        }
        let count = members.len() as u32;
        let content = if members.len() <= LEAF {
            let mut leaf = Vec::with_capacity(LEAF + 1);
            leaf.extend_from_slice(members);
            Content::Leaf(leaf)
        } else {
            let axis = self.widest(&low, &high);
            let places = &self.places;
            let along = |i: &u32| axis.of(&places[*i as usize]);
            let middle = members.len() / 2;
            // The index breaks ties, so that any set of places can be halved.
            members.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
            let at = along(&members[middle]);
            let (first, second) = members.split_at_mut(middle);
            Content::Split { axis, at, sides: [self.build(first), self.build(second)] }
        };
        let cell = Cell { low, high, least, count, content };
        match self.free.pop() {
            Some(free) => {
                self.cells[free as usize] = cell;
                free
            }
            None => {
                self.cells.push(cell);
                (self.cells.len() - 1) as u32
            }
        }
    }

    /// Returns the axis along which a box is longest under the metric.
    fn widest(&self, low: &Place, high: &Place) -> Axis {
        let mut widest = (high.x - low.x, Axis::X);
        let height = if self.metric.z == 0.0 { 0.0 } else { self.metric.z.abs() * (high.z - low.z) };
        let turn = self.metric.yaw_weight.abs() * (high.yaw - low.yaw);
        for (side, axis) in [(high.y - low.y, Axis::Y), (height, Axis::Z), (turn, Axis::Yaw)] {
            if side > widest.0 {
                widest = (side, axis);
            }
        }
        widest.1
    }
}

/// One query and its best result so far.
struct Search<'a> {
    set: &'a Nearest,
    q: &'a Place,
    but: Option<u32>,
    best: Option<(u32, f64)>,
}

impl<'a> Search<'a> {
    fn try_place(&mut self, i: u32) {
        if Some(i) == self.but {
            return;
        }
        let distance = self.set.metric.squared(&self.set.places[i as usize], self.q);
        if self.best.is_none_or(|(index, best)| distance < best || (distance == best && i < index)) {
            self.best = Some((i, distance));
        }
    }

    fn descend(&mut self, cell: u32) {
        let set: &'a Nearest = self.set;
        match &set.cells[cell as usize].content {
            Content::Leaf(members) => members.iter().for_each(|&i| self.try_place(i)),
            Content::Split { sides, .. } => {
                let [a, b] = sides.map(|side| (self.bound(side), side));
                // The nearer side first. If both are equally near, the side with the lower index first: it wins ties.
                let swap = b.0 < a.0 || (b.0 == a.0 && self.least(b.1) < self.least(a.1));
                for (bound, side) in if swap { [b, a] } else { [a, b] } {
                    if self.may_hold_better(bound, side) {
                        self.descend(side);
                    }
                }
            }
        }
    }

    fn may_hold_better(&self, bound: f64, cell: u32) -> bool {
        self.best.is_none_or(|(index, best)| bound < best || (bound == best && self.least(cell) < index))
    }

    fn least(&self, cell: u32) -> u32 {
        self.set.cells[cell as usize].least
    }

    fn bound(&self, cell: u32) -> f64 {
        self.set.cells[cell as usize].bound(&self.set.metric, self.q)
    }
}

impl Cell {
    /// Returns a lower bound, in floating point, of [`Metric::squared`] from `q` to any place in the box.
    ///
    /// Rounded differences, products and sums of non-negative numbers keep the order of the exact ones. So it is enough
    /// to apply the metric's operations to the least difference along each axis. The turn between two headings within
    /// ±π is t for t = |Δyaw| ≤ π and 2π − t beyond, both exact in floating point. It rises, then falls, so over an
    /// interval of t its minimum is at one of the ends.
    fn bound(&self, metric: &Metric, q: &Place) -> f64 {
        let outside = |low: f64, high: f64, q: f64| (low - q).max(q - high).max(0.0);
        let dx = outside(self.low.x, self.high.x, q.x);
        let dy = outside(self.low.y, self.high.y, q.y);
        let dz = if metric.z == 0.0 { 0.0 } else { metric.z * outside(self.low.z, self.high.z, q.z) };
        let nearest = outside(self.low.yaw, self.high.yaw, q.yaw);
        let farthest = (self.high.yaw - q.yaw).max(q.yaw - self.low.yaw);
        let turn = metric.yaw_weight * wrap(nearest).abs().min(wrap(farthest).abs());
        dx * dx + dy * dy + dz * dz + turn * turn
    }
}

fn is_finite(place: &Place) -> bool {
    [place.x, place.y, place.z, place.yaw].iter().all(|v| v.is_finite())
}

fn least_of(a: &Place, b: &Place) -> Place {
    Place { x: a.x.min(b.x), y: a.y.min(b.y), z: a.z.min(b.z), yaw: a.yaw.min(b.yaw) }
}

fn most_of(a: &Place, b: &Place) -> Place {
    Place { x: a.x.max(b.x), y: a.y.max(b.y), z: a.z.max(b.z), yaw: a.yaw.max(b.yaw) }
}
