//! Space of sequences and its rules: random genotypes, cross points and mutations.

use crate::base::limits::MAX_TRIES;
use crate::base::random::{Purpose, Stream};
use crate::genotype::{Genotype, Rules, Space};
use std::sync::Arc;

/// Space of the genotypes and its rules.
#[derive(Clone, Debug)]
pub(super) struct Domain {
    pub space: Space,
    pub rules: Arc<dyn Rules>,
}

impl Domain {
    /// Draws candidate `i` of generation 0 until it keeps the rules, at most [`MAX_TRIES`] times again. The last
    /// genotype is returned if none keeps them.
    pub fn draw(&self, seed: u64, i: u32) -> Genotype {
        let mut random = Stream::new(seed, Purpose::InitialPosition, 0, i, 0);
        let mut drawn = self.draw_once(&mut random);
        for _ in 0..MAX_TRIES {
            if self.rules.allows(&self.space, &drawn) {
                break;
            }
            drawn = self.draw_once(&mut random);
        }
        drawn
    }

    fn draw_once(&self, random: &mut Stream) -> Genotype {
        let segments = self.space.draw_length(random);
        (0..segments).flat_map(|_| self.rules.draw(&self.space, random)).collect()
    }

    /// Returns the number of numbers in a segment.
    pub fn genes(&self) -> usize {
        self.space.genes.len()
    }

    /// Returns the number of segments of a genotype.
    pub fn segments(&self, genotype: &Genotype) -> u32 {
        genotype.numbers().len().checked_div(self.genes()).unwrap_or(0) as u32
    }

    /// Returns the head of one genotype followed by the tail of another. `cuts` are the numbers of segments before the
    /// cross points.
    pub fn join(&self, [head, tail]: [&Genotype; 2], cuts: [u32; 2]) -> Genotype {
        let [head_end, tail_start] = cuts.map(|cut| cut as usize * self.genes());
        [&head.numbers()[..head_end], &tail.numbers()[tail_start..]].concat().into()
    }

    /// Returns one cut for each of two genotypes with these numbers of segments, such that both children have an
    /// allowed length. Genotypes of equal length have equal cuts.
    pub fn cuts(&self, lengths: [u32; 2], random: &mut Stream) -> [u32; 2] {
        let [a, b] = lengths;
        if a != b {
            let allowed = |length: u32| self.space.check_length(length as usize * self.genes()).is_ok();
            for _ in 0..MAX_TRIES {
                let cuts = lengths.map(|length| cut(length, random));
                if allowed(cuts[0] + (b - cuts[1])) && allowed(cuts[1] + (a - cuts[0])) {
                    return cuts;
                }
            }
        }
        // With equal cuts the children have the lengths of their parents.
        [cut(a.min(b), random); 2]
    }

    /// Replaces `count` segments, or a random number of them, by segments drawn at random. The segments are different
    /// ones. A genotype with fewer segments has all of them replaced.
    pub fn mutate(&self, genotype: &mut Genotype, count: Option<u32>, random: &mut Stream) {
        let length = self.segments(genotype);
        if length == 0 {
            return;
        }
        let count = count.unwrap_or_else(|| 1 + random.below(length)).min(length);
        let mut places: Vec<u32> = (0..length).collect();
        for i in 0..count {
            let chosen = i + random.below(length - i);
            places.swap(i as usize, chosen as usize);
            let start = places[i as usize] as usize * self.genes();
            let segment = self.rules.draw(&self.space, random);
            genotype.numbers_mut()[start..][..self.genes()].copy_from_slice(&segment);
        }
    }
}

/// Returns the number of segments before a cross point, with at least one segment on each side if there are two.
fn cut(length: u32, random: &mut Stream) -> u32 {
    if length < 2 { random.below(length + 1) } else { 1 + random.below(length - 1) }
}
