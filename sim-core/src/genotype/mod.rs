//! Genotypes, which a search varies, and their space.

mod rules;
mod space;

pub use rules::{NoRules, Rules};
pub use space::{Gene, Length, Misfit, NamedGene, Space};

use serde::{Deserialize, Serialize};

/// Candidate of a search: its numbers, gene after gene. A choice is a whole number.
///
/// Only searches, controllers, [`Space`] and code that prints numbers read them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Genotype(Vec<f64>);

impl From<Vec<f64>> for Genotype {
    fn from(numbers: Vec<f64>) -> Self {
        Self(numbers)
    }
}

impl FromIterator<f64> for Genotype {
    fn from_iter<I: IntoIterator<Item = f64>>(numbers: I) -> Self {
        Self(numbers.into_iter().collect())
    }
}

impl Genotype {
    /// Returns its numbers, gene after gene.
    pub fn numbers(&self) -> &[f64] {
        &self.0
    }

    /// Returns its numbers, for changes in place.
    pub fn numbers_mut(&mut self) -> &mut [f64] {
        &mut self.0
    }

    /// Returns true if both have the same numbers bit for bit: −0 differs from 0, and a NaN equals itself.
    pub fn same_bits(&self, other: &Self) -> bool {
        self.0.iter().map(|v| v.to_bits()).eq(other.0.iter().map(|v| v.to_bits()))
    }

    /// Returns the numbers of each of `count` gaits, which all have equally many numbers.
    ///
    /// # Panics
    /// If the numbers can't be divided equally, or if `count` is 0.
    pub fn gaits(&self, count: usize) -> impl Iterator<Item = &[f64]> {
        let each = self.0.len() / count;
        assert_eq!(self.0.len(), each * count, "{count} gaits must have equally many numbers each");
        (0..count).map(move |gait| &self.0[gait * each..][..each])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaits_are_consecutive_equal_parts() {
        let parts = |numbers: &[f64], count| {
            Genotype::from(numbers.to_vec()).gaits(count).map(<[f64]>::to_vec).collect::<Vec<_>>()
        };
        assert_eq!(parts(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 3), [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]);
        assert_eq!(parts(&[], 2), [[], []] as [[f64; 0]; 2]);
    }

    #[test]
    fn same_bits_distinguishes_zero_signs_and_lengths() {
        let genotype = |numbers: &[f64]| Genotype::from(numbers.to_vec());
        assert!(!genotype(&[0.0]).same_bits(&genotype(&[-0.0])));
        assert!(genotype(&[f64::NAN]).same_bits(&genotype(&[f64::NAN])));
        assert!(!genotype(&[1.0]).same_bits(&genotype(&[1.0, 1.0])));
    }

    #[test]
    fn genotype_is_serialized_as_list_of_numbers() {
        assert_eq!(serde_json::to_string(&Genotype::from(vec![1.5, -2.0])).unwrap(), "[1.5,-2.0]");
    }
}
