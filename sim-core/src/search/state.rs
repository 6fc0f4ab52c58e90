//! How an optimiser's state is written: a tag, then numbers of eight bytes each, floating-point ones by their bits.
//!
//! The layout of a kind has a fixed length for a given population and genome, so a state of another job is refused
//! before anything is read from it.

use super::BadState;
use crate::genotype::{Bounds, Genome};

/// First bytes of every state; the digit is the layout's version.
const MAGIC: &[u8; 7] = b"evgopt1";
/// Magic, kind, then seed, generation, population and genome length.
const HEADER: usize = MAGIC.len() + 1 + 4 * 8;

/// What a state belongs to; it fits only an optimiser with the same answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Owner {
    /// `b'p'` for swarms, `b'g'` for the genetic algorithm.
    pub kind: u8,
    pub seed: u64,
    pub population: usize,
    pub genome: usize,
}

pub(super) struct Writer(Vec<u8>);

impl Writer {
    /// `numbers`: how many will follow the header.
    pub fn new(owner: Owner, generation: u32, numbers: usize) -> Self {
        let mut bytes = Vec::with_capacity(HEADER + 8 * numbers);
        bytes.extend_from_slice(MAGIC);
        bytes.push(owner.kind);
        for word in [owner.seed, u64::from(generation), owner.population as u64, owner.genome as u64] {
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
    genome: usize,
}

impl<'a> Reader<'a> {
    /// Checks the header and the length of all that follows; returns the generation with the reader.
    pub fn new(bytes: &'a [u8], owner: Owner, numbers: usize) -> Result<(Self, u32), BadState> {
        let refuse = |why: String| Err(BadState(why));
        let Some(after_magic) = bytes.strip_prefix(MAGIC) else {
            return refuse("it does not begin like one of this version".into());
        };
        let mut words = after_magic.get(1..).unwrap_or(&[]).chunks_exact(8).map(word);
        let (Some(seed), Some(generation), Some(population), Some(genome)) =
            (words.next(), words.next(), words.next(), words.next())
        else {
            return refuse(format!("it is cut off after {} bytes", bytes.len()));
        };
        if after_magic[0] != owner.kind {
            return refuse("it belongs to another kind of optimiser".into());
        }
        if seed != owner.seed {
            return refuse(format!("its seed is {seed}, this job's is {}", owner.seed));
        }
        if (population, genome) != (owner.population as u64, owner.genome as u64) {
            return refuse(format!(
                "it holds {population} candidates of {genome} parameters, this job has {} of {}",
                owner.population, owner.genome
            ));
        }
        let Ok(generation) = u32::try_from(generation) else {
            return refuse(format!("its generation, {generation}, is impossible"));
        };
        if bytes.len() != HEADER + 8 * numbers {
            return refuse(format!("it has {} bytes instead of {}", bytes.len(), HEADER + 8 * numbers));
        }
        Ok((Self { rest: &bytes[HEADER..], genome: owner.genome }, generation))
    }

    /// The next number, which must not be NaN.
    pub fn number(&mut self) -> Result<f64, BadState> {
        let Some((first, rest)) = self.rest.split_at_checked(8) else {
            return Err(BadState("it is cut off".into()));
        };
        self.rest = rest;
        let value = f64::from_bits(word(first));
        if value.is_nan() { Err(BadState("it holds a NaN".into())) } else { Ok(value) }
    }

    /// A vector as long as a genome, of finite numbers.
    pub fn vector(&mut self) -> Result<Vec<f64>, BadState> {
        let values = (0..self.genome).map(|_| self.number()).collect::<Result<Vec<_>, _>>()?;
        if values.iter().all(|v| v.is_finite()) { Ok(values) } else { Err(BadState("it holds an infinity".into())) }
    }

    /// A genome within the bounds.
    pub fn genome(&mut self, bounds: &Bounds) -> Result<Genome, BadState> {
        let genome = self.vector()?;
        match genome.iter().zip(&bounds.0).position(|(v, (low, high))| v < low || v > high) {
            None => Ok(genome),
            Some(i) => Err(BadState(format!("parameter {i} = {} of a candidate is out of its bounds", genome[i]))),
        }
    }
}

fn word(eight: &[u8]) -> u64 {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(eight);
    u64::from_le_bytes(bytes)
}
