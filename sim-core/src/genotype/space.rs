//! Space of the genotypes that a search varies: names, units and values of genes, and length of genotypes.

use super::Genotype;
use crate::base::random::Stream;

/// Values that a gene can take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gene {
    /// A number from `low` to `high`, with `low` ≤ `high`. Both and their difference are finite. If they are equal, the
    /// gene is fixed.
    Real {
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
    },
    /// One of several options, written as a whole number from 0.
    Choice {
        /// Number of options, at least 1.
        options: u32,
    },
}

/// Gene with its name.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedGene {
    /// Name in tables and results, such as `gait1.hip-front.omega1`. The part after the last dot is the parameter.
    pub name: String,
    /// Unit; empty for a pure number.
    pub unit: &'static str,
    /// Values that the gene can take.
    pub gene: Gene,
}

/// Length of the genotypes of a space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// One number per gene.
    Fixed,
    /// A sequence of segments, each with one number per gene.
    Sequence {
        /// Least number of segments.
        least: u32,
        /// Greatest number of segments, at least `least`.
        most: u32,
    },
}

/// Set of genotypes that a search may try.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// Genes of a genotype, or of one segment of a sequence.
    pub genes: Vec<NamedGene>,
    /// Length of genotypes.
    pub length: Length,
}

/// Error for a genotype that is not in a space.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Misfit {
    /// The genotype has too many or too few numbers.
    #[error("it has {found} numbers; {wanted} are needed")]
    Length {
        /// Number of numbers found.
        found: usize,
        /// Allowed lengths, as text.
        wanted: String,
    },
    /// A number is NaN or infinite.
    #[error("its number {index} ({name}) is not finite")]
    NotFinite {
        /// Index of the number, from 0.
        index: usize,
        /// Name of the gene.
        name: String,
    },
    /// A number is out of its bounds.
    #[error("its number {index} ({name}) is {value}: allowed is {low} to {high}")]
    OutOfBounds {
        /// Index of the number, from 0.
        index: usize,
        /// Name of the gene.
        name: String,
        /// The number.
        value: f64,
        /// Least allowed value.
        low: f64,
        /// Greatest allowed value.
        high: f64,
    },
    /// A choice is not a whole number.
    #[error("its number {index} ({name}) is {value}: a choice is a whole number")]
    NotWhole {
        /// Index of the number, from 0.
        index: usize,
        /// Name of the gene.
        name: String,
        /// The number.
        value: f64,
    },
}

impl Gene {
    /// Returns the least and the greatest value.
    pub fn bounds(self) -> (f64, f64) {
        match self {
            Self::Real { low, high } => (low, high),
            Self::Choice { options } => (0.0, f64::from(options) - 1.0),
        }
    }

    /// Returns a value drawn uniformly.
    fn draw(self, random: &mut Stream) -> f64 {
        match self {
            // Rounding may lead slightly out of very uneven bounds.
            Self::Real { low, high } => random.uniform(low, high).clamp(low, high),
            Self::Choice { options } => random.below(options).into(),
        }
    }
}

impl NamedGene {
    /// Returns the parameter that the gene gives a value to, such as `omega1`. Several genes can have the same
    /// parameter.
    pub fn parameter(&self) -> &str {
        self.name.rsplit('.').next().unwrap_or_default()
    }
}

impl Space {
    /// Creates a space of real vectors within the bounds (low, high). The genes are named `x1`, `x2` and so on.
    pub fn of_reals(bounds: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let named = |(i, (low, high))| NamedGene { name: format!("x{i}"), unit: "", gene: Gene::Real { low, high } };
        Self { genes: (1..).zip(bounds).map(named).collect(), length: Length::Fixed }
    }

    /// Returns the names of the genes, in order.
    pub fn names(&self) -> Vec<String> {
        self.genes.iter().map(|named| named.name.clone()).collect()
    }

    /// Returns the names of the first `count` numbers of a genotype. In a sequence the number of the segment comes before
    /// the name of the gene, as in `gait1.segment3.turn1.module`.
    pub fn names_of(&self, count: usize) -> Vec<String> {
        let of_sequence = |i: usize| {
            let (segment, gene) = (i / self.genes.len() + 1, &self.genes[i % self.genes.len()].name);
            match gene.split_once('.').filter(|(gait, _)| gait.starts_with("gait")) {
                Some((gait, rest)) => format!("{gait}.segment{segment}.{rest}"),
                None => format!("segment{segment}.{gene}"),
            }
        };
        match self.length {
            Length::Sequence { .. } if !self.genes.is_empty() => (0..count).map(of_sequence).collect(),
            Length::Fixed | Length::Sequence { .. } => self.names().into_iter().take(count).collect(),
        }
    }

    /// Returns the least and the greatest value of each gene, in order.
    pub fn bounds(&self) -> impl Iterator<Item = (f64, f64)> {
        self.genes.iter().map(|named| named.gene.bounds())
    }

    /// Returns the greatest number of numbers that a genotype can have.
    pub fn longest(&self) -> usize {
        let segments = match self.length {
            Length::Fixed => 1,
            Length::Sequence { most, .. } => most as usize,
        };
        self.genes.len().saturating_mul(segments)
    }

    /// Refuses a genotype that is not in the space.
    ///
    /// # Errors
    /// The first misfit: a wrong length, or a number that is not finite, out of its bounds, or a fraction where a whole
    /// number is needed.
    pub fn check(&self, genotype: &Genotype) -> Result<(), Misfit> {
        self.check_length(genotype.numbers().len())?;
        for (index, (&value, named)) in genotype.numbers().iter().zip(self.genes.iter().cycle()).enumerate() {
            let name = || named.name.clone();
            let (low, high) = named.gene.bounds();
            if !value.is_finite() {
                return Err(Misfit::NotFinite { index, name: name() });
            }
            if value < low || value > high {
                return Err(Misfit::OutOfBounds { index, name: name(), value, low, high });
            }
            if matches!(named.gene, Gene::Choice { .. }) && value != libm::floor(value) {
                return Err(Misfit::NotWhole { index, name: name(), value });
            }
        }
        Ok(())
    }

    /// Refuses a length that no genotype of the space has.
    ///
    /// # Errors
    /// [`Misfit::Length`] for such a length.
    pub fn check_length(&self, found: usize) -> Result<(), Misfit> {
        let each = self.genes.len();
        let (fits, wanted) = match self.length {
            Length::Fixed => (found == each, each.to_string()),
            Length::Sequence { least, .. } => {
                let (least, most) = ((least as usize).saturating_mul(each), self.longest());
                let whole = found.checked_rem(each).is_none_or(|rest| rest == 0);
                (whole && (least..=most).contains(&found), format!("{least} to {most} in steps of {each}"))
            }
        };
        if fits { Ok(()) } else { Err(Misfit::Length { found, wanted }) }
    }

    /// Returns a genotype drawn uniformly: first the number of segments, if it varies, then gene after gene.
    pub fn draw(&self, random: &mut Stream) -> Genotype {
        let segments = self.draw_length(random);
        Genotype((0..segments).flat_map(|_| self.draw_segment(random)).collect())
    }

    /// Returns a number of segments drawn uniformly; 1 for a genotype that is not a sequence.
    pub fn draw_length(&self, random: &mut Stream) -> u32 {
        match self.length {
            Length::Fixed => 1,
            Length::Sequence { least, most } => least + random.below(most - least + 1),
        }
    }

    /// Returns the numbers of one segment, drawn uniformly gene after gene.
    pub fn draw_segment(&self, random: &mut Stream) -> Vec<f64> {
        self.genes.iter().map(|named| named.gene.draw(random)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Purpose;
    use proptest::prelude::*;

    fn spaces() -> impl Strategy<Value = Space> {
        let real =
            (-100.0..100.0, 0.0..50.0).prop_map(|(low, range): (f64, f64)| Gene::Real { low, high: low + range });
        let choice = (1u32..9).prop_map(|options| Gene::Choice { options });
        let genes = prop::collection::vec(prop_oneof![real, choice], 1..6);
        let length = prop_oneof![
            Just(Length::Fixed),
            (0u32..4, 0u32..4).prop_map(|(least, more)| Length::Sequence { least, most: least + more })
        ];
        (genes, length).prop_map(|(genes, length)| {
            let named = |(i, gene)| NamedGene { name: format!("gene{i}"), unit: "", gene };
            Space { genes: genes.into_iter().enumerate().map(named).collect(), length }
        })
    }

    proptest! {
        #[test]
        fn drawn_genotype_is_in_the_space(space in spaces(), seed: u64) {
            let genotype = space.draw(&mut Stream::new(seed, Purpose::Sample, 0, 0, 0));
            prop_assert_eq!(space.check(&genotype), Ok(()));
        }

        #[test]
        fn number_out_of_bounds_is_refused_by_name(space in spaces(), seed: u64, at: prop::sample::Index) {
            let mut genotype = space.draw(&mut Stream::new(seed, Purpose::Sample, 0, 0, 0));
            prop_assume!(!genotype.0.is_empty());
            let at = at.index(genotype.0.len());
            let (low, high) = space.genes[at % space.genes.len()].gene.bounds();
            for value in [low - 1.0, high + 1.0] {
                genotype.0[at] = value;
                let name = format!("gene{}", at % space.genes.len());
                prop_assert_eq!(
                    space.check(&genotype), Err(Misfit::OutOfBounds { index: at, name, value, low, high })
                );
            }
        }
    }

    #[test]
    fn names_in_sequence_have_the_number_of_their_segment() {
        let named = |name: &str| NamedGene { name: name.to_owned(), unit: "", gene: Gene::Choice { options: 2 } };
        let genes = vec![named("gait1.turn1.module"), named("face")];
        let fixed = Space { genes, length: Length::Fixed };
        let sequence = Space { length: Length::Sequence { least: 1, most: 9 }, ..fixed.clone() };
        assert_eq!(fixed.names_of(2), fixed.names());
        let names = sequence.names_of(4);
        assert_eq!(names[..2], ["gait1.segment1.turn1.module", "segment1.face"]);
        assert_eq!(names[2..], ["gait1.segment2.turn1.module", "segment2.face"]);
    }

    #[test]
    fn every_kind_of_misfit_is_refused() {
        let named = |name: &str, gene| NamedGene { name: name.to_owned(), unit: "", gene };
        let genes = vec![named("mu", Gene::Real { low: 0.0, high: 1.0 }), named("leg", Gene::Choice { options: 3 })];
        let fixed = Space { genes, length: Length::Fixed };
        let sequence = Space { length: Length::Sequence { least: 1, most: 2 }, ..fixed.clone() };
        let said = |space: &Space, numbers: &[f64]| match space.check(&numbers.to_vec().into()) {
            Ok(()) => "fits".to_owned(),
            Err(misfit) => misfit.to_string(),
        };
        assert_eq!(said(&fixed, &[0.5, 2.0]), "fits");
        assert_eq!(said(&fixed, &[0.5]), "it has 1 numbers; 2 are needed");
        assert_eq!(said(&fixed, &[0.5, 2.0, 0.5, 1.0]), "it has 4 numbers; 2 are needed");
        assert_eq!(said(&fixed, &[f64::NAN, 2.0]), "its number 0 (mu) is not finite");
        assert_eq!(said(&fixed, &[1.5, 2.0]), "its number 0 (mu) is 1.5: allowed is 0 to 1");
        assert_eq!(said(&fixed, &[0.5, 3.0]), "its number 1 (leg) is 3: allowed is 0 to 2");
        assert_eq!(said(&fixed, &[0.5, 1.5]), "its number 1 (leg) is 1.5: a choice is a whole number");
        assert_eq!(said(&sequence, &[0.5, 2.0, 0.0, 0.0]), "fits");
        assert_eq!(said(&sequence, &[]), "it has 0 numbers; 2 to 4 in steps of 2 are needed");
        assert_eq!(said(&sequence, &[0.5, 2.0, 0.5]), "it has 3 numbers; 2 to 4 in steps of 2 are needed");
    }
}
