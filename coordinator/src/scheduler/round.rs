//! A round of tasks, each pending, leased or done: a generation's candidates, or the examinations that follow the search.

use super::lease::AssignmentId;
use proto::limits::MAX_ASSIGNMENT_GENOMES;
use sim_core::finish::{Done, Examination};
use sim_core::score::{Counts, Genome};
use std::sync::Arc;

/// Tasks `first .. first + count` of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// The round: a generation, or a number from the number of generations on.
    pub round: u32,
    /// Index of the first.
    pub first: u32,
    /// How many; at least 1.
    pub count: u32,
}

impl Range {
    /// The tasks' indexes.
    pub fn indexes(&self) -> std::ops::Range<u32> {
        self.first..self.first + self.count
    }
}

/// What a task found. Equal when the bits are.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// An evaluation has one, an examination one a tree; `None` where it failed.
    pub scores: Vec<Option<f64>>,
    /// What it took.
    pub counts: Counts,
    /// sim-core's `Traces` as JSON, of the examination that is asked for them.
    pub traces: Vec<u8>,
}

impl Outcome {
    /// That of an evaluation.
    pub fn evaluation(score: Option<f64>, counts: Counts) -> Self {
        Self { scores: vec![score], counts, traces: Vec::new() }
    }

    /// The score of an evaluation.
    pub fn score(&self) -> Option<f64> {
        self.scores.first().copied().flatten()
    }
}

impl PartialEq for Outcome {
    fn eq(&self, other: &Self) -> bool {
        let same_scores = self.scores.len() == other.scores.len()
            && self.scores.iter().zip(&other.scores).all(|(a, b)| same_bits(*a, *b));
        same_scores && self.counts == other.counts && self.traces == other.traces
    }
}

/// What the tasks of a round are.
#[derive(Clone, Debug)]
pub(super) enum Work {
    /// To be evaluated, by index.
    Candidates(Arc<[Genome]>),
    /// To be answered, by index.
    Examinations(Arc<[Examination]>),
}

impl Work {
    fn len(&self) -> usize {
        match self {
            Self::Candidates(genomes) => genomes.len(),
            Self::Examinations(examinations) => examinations.len(),
        }
    }

    /// Most tasks in one assignment.
    pub fn most_at_once(&self) -> u32 {
        match self {
            Self::Candidates(genomes) => {
                let bytes = genomes.first().map_or(1, |g| 8 * g.len().max(1));
                (MAX_ASSIGNMENT_GENOMES / bytes) as u32
            }
            // Each is long, and no two kinds take the same time.
            Self::Examinations(_) => 1,
        }
    }

    /// A task, for people.
    pub fn describe(&self, round: u32, index: u32) -> String {
        match self {
            Self::Candidates(_) => format!("the evaluation of candidate {index} of generation {round}"),
            Self::Examinations(all) => all
                .get(index as usize)
                .map_or_else(|| "an examination".to_owned(), |e| format!("the examination of {e}")),
        }
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

/// What became of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Recorded {
    /// It is the first.
    New,
    /// The same bits were there.
    Same,
    /// Other bits were there.
    Other,
}

#[derive(Clone, Debug, Default)]
struct Entry {
    state: State,
    /// Crashes and failures while it was worked on alone.
    attempts: u32,
    /// It was part of a range that crashed or failed: from now on it is worked on alone, to find the culprit.
    alone: bool,
}

/// The round that is being worked on.
#[derive(Clone, Debug)]
pub(super) struct Round {
    pub number: u32,
    pub work: Work,
    tasks: Vec<Entry>,
    pending: u32,
    done: u32,
    /// No task below this one is pending.
    cursor: usize,
}

impl Round {
    pub fn generation(number: u32, genomes: Vec<Genome>) -> Self {
        Self::new(number, Work::Candidates(genomes.into()))
    }

    pub fn examinations(number: u32, examinations: Vec<Examination>) -> Self {
        Self::new(number, Work::Examinations(examinations.into()))
    }

    fn new(number: u32, work: Work) -> Self {
        let n = work.len();
        Self { number, work, tasks: vec![Entry::default(); n], pending: n as u32, done: 0, cursor: 0 }
    }

    pub fn pending(&self) -> u32 {
        self.pending
    }

    pub fn done(&self) -> u32 {
        self.done
    }

    pub fn size(&self) -> u32 {
        self.tasks.len() as u32
    }

    /// Whether its tasks are evaluations of the search.
    pub fn is_generation(&self) -> bool {
        matches!(self.work, Work::Candidates(_))
    }

    pub fn contains(&self, range: &Range) -> bool {
        range.round == self.number
            && range.count > 0
            && range.first.checked_add(range.count).is_some_and(|end| end <= self.size())
    }

    /// Leases the first pending task and up to `size - 1` that follow it without a break.
    pub fn cut(&mut self, size: u32, assignment: AssignmentId) -> Option<Range> {
        let is_pending = |t: &Entry| matches!(t.state, State::Pending);
        let first = self.cursor + self.tasks[self.cursor..].iter().position(is_pending)?;
        let rest = &self.tasks[first..];
        let count = if rest[0].alone {
            1
        } else {
            rest.iter().take(size.max(1) as usize).take_while(|t| is_pending(t) && !t.alone).count()
        };
        for task in &mut self.tasks[first..first + count] {
            task.state = State::Leased(assignment);
        }
        self.pending -= count as u32;
        self.cursor = first + count;
        Some(Range { round: self.number, first: first as u32, count: count as u32 })
    }

    /// Leases exactly this range, if all of it is pending.
    pub fn take(&mut self, range: &Range, assignment: AssignmentId) -> bool {
        if !self.contains(range) {
            return false;
        }
        let span = range.first as usize..(range.first + range.count) as usize;
        if !self.tasks[span.clone()].iter().all(|t| matches!(t.state, State::Pending)) {
            return false;
        }
        for task in &mut self.tasks[span] {
            task.state = State::Leased(assignment);
        }
        self.pending -= range.count;
        true
    }

    /// What a lease still held becomes pending again.
    pub fn release(&mut self, range: &Range, assignment: AssignmentId) {
        for i in range.indexes().map(|i| i as usize) {
            if matches!(self.tasks[i].state, State::Leased(a) if a == assignment) {
                self.tasks[i].state = State::Pending;
                self.pending += 1;
                self.cursor = self.cursor.min(i);
            }
        }
    }

    /// Takes a result in unless there is one: the first one wins.
    pub fn record(&mut self, index: u32, outcome: &Outcome) -> Recorded {
        let state = &mut self.tasks[index as usize].state;
        match state {
            State::Done(there) if there == outcome => return Recorded::Same,
            State::Done(_) => return Recorded::Other,
            State::Pending => self.pending -= 1,
            State::Leased(_) => {}
        }
        *state = State::Done(outcome.clone());
        self.done += 1;
        Recorded::New
    }

    /// Tasks that are not done and have crashed or failed while they were worked on alone, and how often.
    pub fn attempts(&self) -> impl Iterator<Item = (u32, u32)> {
        let open = self.tasks.iter().enumerate().filter(|(_, t)| t.attempts > 0 && !matches!(t.state, State::Done(..)));
        open.map(|(index, task)| (index as u32, task.attempts))
    }

    /// What a task found, if it is done.
    pub fn outcome(&self, index: u32) -> Option<&Outcome> {
        match &self.tasks.get(index as usize)?.state {
            State::Done(outcome) => Some(outcome),
            _ => None,
        }
    }

    /// Whether all of a range is done.
    pub fn is_done(&self, range: &Range) -> bool {
        range.indexes().all(|i| matches!(self.tasks[i as usize].state, State::Done(_)))
    }

    /// All outcomes by index, once every task is done.
    pub fn outcomes(&self) -> Option<Vec<&Outcome>> {
        (0..self.size()).map(|i| self.outcome(i)).collect()
    }

    /// The examinations with their scores, once every one is done. None in a generation.
    pub fn answers(&self) -> Option<Vec<Done>> {
        let Work::Examinations(examinations) = &self.work else { return None };
        let outcomes = self.outcomes()?;
        Some(examinations.iter().cloned().zip(outcomes.into_iter().map(|o| o.scores.clone())).collect())
    }

    /// A crash or failure while this range was worked on: a range of several is split, a single one is blamed. Returns
    /// how many attempts the single one has had.
    pub fn blame(&mut self, range: &Range) -> u32 {
        for i in range.indexes() {
            self.tasks[i as usize].alone = true;
        }
        if range.count > 1 {
            return 0;
        }
        let attempts = &mut self.tasks[range.first as usize].attempts;
        *attempts += 1;
        *attempts
    }
}
