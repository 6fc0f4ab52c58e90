//! One generation's candidates: pending, leased or done.

use super::lease::AssignmentId;
use sim_core::score::{Counts, Genome};
use std::sync::Arc;

/// Candidates `first .. first + count` of a generation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// The generation.
    pub generation: u32,
    /// Index of the first.
    pub first: u32,
    /// How many; at least 1.
    pub count: u32,
}

impl Range {
    /// The candidates' indexes.
    pub fn candidates(&self) -> std::ops::Range<u32> {
        self.first..self.first + self.count
    }
}

/// What an evaluation found. Equal when the bits are.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// The score; `None` where the evaluation failed.
    pub score: Option<f64>,
    /// What it took.
    pub counts: Counts,
}

impl PartialEq for Outcome {
    fn eq(&self, other: &Self) -> bool {
        same_bits(self.score, other.score) && self.counts == other.counts
    }
}

/// Whether two scores are the same bits.
pub(super) fn same_bits(a: Option<f64>, b: Option<f64>) -> bool {
    a.map(f64::to_bits) == b.map(f64::to_bits)
}

#[derive(Clone, Debug, Default)]
enum State {
    #[default]
    Pending,
    Leased(AssignmentId),
    Done(Outcome),
}

#[derive(Clone, Debug, Default)]
struct Candidate {
    state: State,
    /// Crashes and failures while it was evaluated alone.
    attempts: u32,
    /// It was part of a range that crashed or failed: from now on it is evaluated alone, to find the culprit.
    alone: bool,
}

/// The generation that is being evaluated.
#[derive(Clone, Debug)]
pub(super) struct Generation {
    pub number: u32,
    pub genomes: Arc<[Genome]>,
    candidates: Vec<Candidate>,
    pending: u32,
    done: u32,
    /// No candidate below this one is pending.
    cursor: usize,
}

impl Generation {
    pub fn new(number: u32, genomes: Vec<Genome>) -> Self {
        let n = genomes.len();
        Self {
            number,
            genomes: genomes.into(),
            candidates: vec![Candidate::default(); n],
            pending: n as u32,
            done: 0,
            cursor: 0,
        }
    }

    pub fn pending(&self) -> u32 {
        self.pending
    }

    pub fn done(&self) -> u32 {
        self.done
    }

    pub fn population(&self) -> u32 {
        self.candidates.len() as u32
    }

    pub fn contains(&self, range: &Range) -> bool {
        range.generation == self.number
            && range.count > 0
            && range.first.checked_add(range.count).is_some_and(|end| end <= self.population())
    }

    /// Leases the first pending candidate and up to `size - 1` that follow it without a break.
    pub fn cut(&mut self, size: u32, assignment: AssignmentId) -> Option<Range> {
        let is_pending = |c: &Candidate| matches!(c.state, State::Pending);
        let first = self.cursor + self.candidates[self.cursor..].iter().position(is_pending)?;
        let rest = &self.candidates[first..];
        let count = if rest[0].alone {
            1
        } else {
            rest.iter().take(size.max(1) as usize).take_while(|c| is_pending(c) && !c.alone).count()
        };
        for candidate in &mut self.candidates[first..first + count] {
            candidate.state = State::Leased(assignment);
        }
        self.pending -= count as u32;
        self.cursor = first + count;
        Some(Range { generation: self.number, first: first as u32, count: count as u32 })
    }

    /// Leases exactly this range, if all of it is pending.
    pub fn take(&mut self, range: &Range, assignment: AssignmentId) -> bool {
        if !self.contains(range) {
            return false;
        }
        let span = range.first as usize..(range.first + range.count) as usize;
        if !self.candidates[span.clone()].iter().all(|c| matches!(c.state, State::Pending)) {
            return false;
        }
        for candidate in &mut self.candidates[span] {
            candidate.state = State::Leased(assignment);
        }
        self.pending -= range.count;
        true
    }

    /// What a lease still held becomes pending again.
    pub fn release(&mut self, range: &Range, assignment: AssignmentId) {
        for i in range.candidates().map(|i| i as usize) {
            if matches!(self.candidates[i].state, State::Leased(a) if a == assignment) {
                self.candidates[i].state = State::Pending;
                self.pending += 1;
                self.cursor = self.cursor.min(i);
            }
        }
    }

    /// Takes a result in unless there is one: the first one wins. Returns the one there was.
    pub fn record(&mut self, candidate: u32, outcome: Outcome) -> Option<Outcome> {
        let state = &mut self.candidates[candidate as usize].state;
        match state {
            State::Done(there) => return Some(*there),
            State::Pending => self.pending -= 1,
            State::Leased(_) => {}
        }
        *state = State::Done(outcome);
        self.done += 1;
        None
    }

    /// Whether all of a range is done.
    pub fn is_done(&self, range: &Range) -> bool {
        range.candidates().all(|i| matches!(self.candidates[i as usize].state, State::Done(_)))
    }

    /// All outcomes by index, once every candidate is done.
    pub fn outcomes(&self) -> Option<Vec<Outcome>> {
        self.candidates.iter().map(|c| if let State::Done(o) = c.state { Some(o) } else { None }).collect()
    }

    /// A crash or failure while this range was evaluated: a range of several is split, a single one is blamed. Returns
    /// how many attempts the single one has had.
    pub fn blame(&mut self, range: &Range) -> u32 {
        for i in range.candidates() {
            self.candidates[i as usize].alone = true;
        }
        if range.count > 1 {
            return 0;
        }
        let attempts = &mut self.candidates[range.first as usize].attempts;
        *attempts += 1;
        *attempts
    }
}
