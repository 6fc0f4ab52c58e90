//! Terrain in the engine: stairs, which are blocks on the ground with sides along x and y.

use crate::model::environment::Block;

/// A block from the ground up to its top, mu.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layer {
    /// Least x, y.
    pub low: [f32; 2],
    /// Greatest x, y.
    pub high: [f32; 2],
    pub top: f32,
}

impl Layer {
    /// Returns the coordinate of the side that a motion along an axis meets, in positive (1) or negative (−1)
    /// direction.
    #[inline(always)]
    pub fn side(&self, axis: usize, sign: f32) -> f32 {
        if sign > 0.0 { self.low[axis] } else { self.high[axis] }
    }
}

/// Least width of stairs, mu; no box of a robot is as long.
const LEAST_WIDTH: f64 = 10.0;

/// Returns true if the engine can simulate the blocks: on the ground, with sides along x and y, all between the same
/// two lines, which are far apart. Then robots meet only faces and edges of a block, never a corner of its top.
pub(super) fn known(terrain: &[Block]) -> bool {
    let straight = terrain.iter().all(|block| block.yaw == 0.0 && block.base == 0.0);
    let between_two_lines = |axis: usize| {
        let lines = |block: &Block| (block.center[axis], block.size[axis]);
        terrain.iter().all(|block| lines(block) == lines(&terrain[0]) && block.size[axis] >= LEAST_WIDTH)
    };
    straight && [0, 1].into_iter().any(between_two_lines)
}

/// Returns the blocks, each extended beneath the higher ones that hide one of its sides. Together they fill the same
/// space. A stair's tread then continues beneath the next stair, and no side is left that can't be touched.
pub(super) fn layers(terrain: &[Block]) -> Vec<Layer> {
    let mut layers: Vec<Layer> = terrain.iter().map(layer).collect();
    layers.sort_by(|a, b| a.top.total_cmp(&b.top));
    for i in 0..layers.len() {
        let (lower, higher) = layers.split_at_mut(i + 1);
        while higher.iter().any(|other| grow(&mut lower[i], other)) {}
    }
    layers
}

fn layer(block: &Block) -> Layer {
    let side = |axis: usize, sign: f64| (block.center[axis] + sign * block.size[axis] / 2.0) as f32;
    Layer { low: [0, 1].map(|a| side(a, -1.0)), high: [0, 1].map(|a| side(a, 1.0)), top: block.top as f32 }
}

/// Extends a block beneath another that hides one of its sides. Returns true if it did.
fn grow(block: &mut Layer, over: &Layer) -> bool {
    for (axis, other) in [(0, 1), (1, 0)] {
        let covers = over.low[other] <= block.low[other] && over.high[other] >= block.high[other];
        if !covers {
            continue;
        }
        let hides = |side: f32| over.low[axis] <= side && side <= over.high[axis];
        if hides(block.high[axis]) && over.high[axis] > block.high[axis] {
            block.high[axis] = over.high[axis];
            return true;
        }
        if hides(block.low[axis]) && over.low[axis] < block.low[axis] {
            block.low[axis] = over.low[axis];
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block(x: (f64, f64), y: (f64, f64), top: f64) -> Block {
        let middle = |(a, b): (f64, f64)| (a + b) / 2.0;
        let center = [middle(x), middle(y)];
        Block { center, size: [x.1 - x.0, y.1 - y.0], base: 0.0, top, yaw: 0.0 }
    }

    #[test]
    fn stairs_extend_beneath_higher_stairs() {
        let stair = |i: u32, top| block((3.0 * f64::from(i), 3.0 * f64::from(i) + 3.0), (-5.0, 5.0), top);
        let found = layers(&[stair(2, 1.8), stair(0, 0.6), stair(1, 1.2)]);
        let x: Vec<(f32, f32, f32)> = found.iter().map(|l| (l.low[0], l.high[0], l.top)).collect();
        assert_eq!(x, [(0.0, 9.0, 0.6), (3.0, 9.0, 1.2), (6.0, 9.0, 1.8)]);
        assert!(found.iter().all(|l| (l.low[1], l.high[1]) == (-5.0, 5.0)));
    }

    #[test]
    fn only_wide_straight_stairs_are_supported() {
        let stair = |from: f64, top| block((from, from + 3.0), (-5.0, 5.0), top);
        let stairs = [stair(0.0, 0.6), stair(3.0, 1.2)];
        assert!(known(&[]) && known(&stairs) && known(&stairs[..1]));
        let with = |change: &dyn Fn(&mut Block)| {
            let mut stairs = stairs;
            change(&mut stairs[1]);
            known(&stairs)
        };
        assert!(with(&|b| b.size[0] = 1.0) && with(&|b| b.top = 0.1));
        assert!(!with(&|b| b.yaw = 0.1) && !with(&|b| b.base = 0.1));
        assert!(!with(&|b| b.size[1] = 11.0) && !with(&|b| b.center[1] = 1.0));
        assert!(!known(&[block((0.0, 3.0), (0.0, 3.0), 1.0)]));
    }

    #[test]
    fn block_that_hides_part_of_side_changes_nothing() {
        let blocks = [block((0.0, 2.0), (0.0, 2.0), 1.0), block((2.0, 3.0), (0.0, 1.0), 2.0)];
        assert_eq!(layers(&blocks), blocks.each_ref().map(layer));
    }
}
