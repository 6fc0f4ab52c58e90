//! Rules between the numbers of a genotype, which bounds can't express.

use super::{Genotype, Space};
use crate::base::random::Stream;

/// Static rules that genotypes of a space keep. Searches check them where candidates are bred.
pub trait Rules: Send + Sync + std::fmt::Debug {
    /// Draws one segment that keeps the rules: one number per gene.
    fn draw(&self, space: &Space, random: &mut Stream) -> Vec<f64>;

    /// Returns true if all segments of a genotype keep the rules.
    fn allows(&self, space: &Space, genotype: &Genotype) -> bool;
}

/// Rules that allow all genotypes of a space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoRules;

impl Rules for NoRules {
    fn draw(&self, space: &Space, random: &mut Stream) -> Vec<f64> {
        space.draw_segment(random)
    }

    fn allows(&self, _: &Space, _: &Genotype) -> bool {
        true
    }
}
