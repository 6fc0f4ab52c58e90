//! Encoding of an optimiser's state: a tag, then numbers of eight bytes each, floating-point numbers by their bits.
//!
//! The layout of a kind has a fixed length for a given population and genotype. So a state of another job is rejected
//! before its numbers are read.

use super::BadState;
use crate::genotype::{Genotype, Misfit, Space};

/// First bytes of every state; the digit is the layout's version.
const MAGIC: &[u8; 7] = b"evgopt1";
/// Length of magic, kind, seed, generation, population and genotype length.
const HEADER: usize = MAGIC.len() + 1 + 4 * 8;

/// Identity of the optimiser that a state belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Owner {
    /// `b'p'` for swarms, `b'g'` for the genetic algorithm.
    pub kind: u8,
    pub seed: u64,
    pub population: usize,
    pub genotype: usize,
}

pub(super) struct Writer(Vec<u8>);

impl Writer {
    /// Writes the header. `numbers` is the count of numbers that follow it.
    pub fn new(owner: Owner, generation: u32, numbers: usize) -> Self {
        let mut bytes = Vec::with_capacity(HEADER + 8 * numbers);
        bytes.extend_from_slice(MAGIC);
        bytes.push(owner.kind);
        for word in [owner.seed, u64::from(generation), owner.population as u64, owner.genotype as u64] {
            bytes.extend_from_slice(&word.to_le_bytes());
        }
        Self(bytes)
    }

    pub fn number(&mut self, value: f64) {
        self.0.extend_from_slice(&value.to_bits().to_le_bytes());
    }

    pub fn numbers(&mut self, values: &[f64]) {
        values.iter().for_each(|&v| self.number(v));
    }

    pub fn finish(self) -> Vec<u8> {
        self.0
    }
}

pub(super) struct Reader<'a> {
    rest: &'a [u8],
    genotype: usize,
}

impl<'a> Reader<'a> {
    /// Checks the header and the length of the rest. Returns the reader and the generation.
    pub fn new(bytes: &'a [u8], owner: Owner, numbers: usize) -> Result<(Self, u32), BadState> {
        let refuse = |why: String| Err(BadState(why));
        let Some(after_magic) = bytes.strip_prefix(MAGIC) else {
            return refuse("its first bytes are not those of a state of this version".into());
        };
        let mut words = after_magic.get(1..).unwrap_or(&[]).chunks_exact(8).map(word);
        let (Some(seed), Some(generation), Some(population), Some(genotype)) =
            (words.next(), words.next(), words.next(), words.next())
        else {
            return refuse(format!("it ends after {} bytes, before the end of its header", bytes.len()));
        };
        if after_magic[0] != owner.kind {
            return refuse("it belongs to another kind of optimiser".into());
        }
        if seed != owner.seed {
            return refuse(format!("its seed is {seed}, but this job's is {}", owner.seed));
        }
        if (population, genotype) != (owner.population as u64, owner.genotype as u64) {
            return refuse(format!(
                "it holds {population} candidates of {genotype} parameters, but this job has {} of {}",
                owner.population, owner.genotype
            ));
        }
        let Ok(generation) = u32::try_from(generation) else {
            return refuse(format!("its generation {generation} is out of range"));
        };
        if bytes.len() != HEADER + 8 * numbers {
            return refuse(format!("it has {} bytes instead of {}", bytes.len(), HEADER + 8 * numbers));
        }
        Ok((Self { rest: &bytes[HEADER..], genotype: owner.genotype }, generation))
    }

    /// Reads the next number, which must not be NaN.
    pub fn number(&mut self) -> Result<f64, BadState> {
        let Some((first, rest)) = self.rest.split_at_checked(8) else {
            return Err(BadState("it is cut off".into()));
        };
        self.rest = rest;
        let value = f64::from_bits(word(first));
        if value.is_nan() { Err(BadState("it holds a NaN".into())) } else { Ok(value) }
    }

    /// Reads a vector of finite numbers, as long as a genotype.
    pub fn vector(&mut self) -> Result<Vec<f64>, BadState> {
        let values = (0..self.genotype).map(|_| self.number()).collect::<Result<Vec<_>, _>>()?;
        if values.iter().all(|v| v.is_finite()) { Ok(values) } else { Err(BadState("it holds an infinity".into())) }
    }

    /// Reads a genotype of the space.
    pub fn genotype(&mut self, space: &Space) -> Result<Genotype, BadState> {
        let genotype = Genotype::from(self.vector()?);
        match space.check(&genotype) {
            Ok(()) => Ok(genotype),
            Err(Misfit::OutOfBounds { index, value, .. }) => {
                Err(BadState(format!("parameter {index} = {value} of a candidate is out of its bounds")))
            }
            Err(misfit) => Err(BadState(format!("a candidate is not in the job's space: {misfit}"))),
        }
    }
}

fn word(eight: &[u8]) -> u64 {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(eight);
    u64::from_le_bytes(bytes)
}
