//! A round of tasks, each pending, leased or done: a generation's candidates, or the examinations that follow the search.

use super::lease::{AssignmentId, Task};
use crate::record::Charge;
use proto::limits::MAX_ASSIGNMENT_GENOMES;
use proto::v1;
use sim_core::base::score::Counts;
use sim_core::genotype::Genome;
use sim_core::procedure::evolve::finish::{Done, Examination};
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

/// Who found something.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Finder {
    /// Id of the worker; empty if it is not known.
    pub worker: Arc<str>,
    /// The machine it called from; empty if it is not known.
    pub host: Arc<str>,
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
            Self::Candidates(genomes) => genomes.first().map_or(1, most_at_once),
            // Each is long, and no two kinds take the same time.
            Self::Examinations(_) => 1,
        }
    }

    /// What a worker is asked to do for a range.
    pub fn task(&self, range: Range) -> Task {
        match self {
            Self::Candidates(genomes) => Task::Evaluate { range, genomes: genomes.clone(), base: 0 },
            Self::Examinations(all) => Task::Examine { range, examination: all[range.first as usize].clone() },
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

/// Most candidates with such a genome in one assignment, at least 1.
pub(super) fn most_at_once(genome: &Genome) -> u32 {
    (MAX_ASSIGNMENT_GENOMES / (8 * genome.len().max(1))).max(1) as u32
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
    /// What was found, and by whom.
    Done(Outcome, Finder),
}

/// What became of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Recorded {
    /// It is the first; who had the task, if anybody.
    New(Option<AssignmentId>),
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
    /// A suspect: it was worked on when a worker crashed or failed. From now on it is worked on alone, to find the culprit.
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
    /// No task below this one is pending, suspects aside.
    cursor: usize,
    /// Whether any task is suspected.
    suspected: bool,
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
        Self { number, work, tasks: vec![Entry::default(); n], pending: n as u32, done: 0, cursor: 0, suspected: false }
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

    /// Tasks that are pending and no suspects.
    pub fn pending_unsuspected(&self) -> u32 {
        if !self.suspected {
            return self.pending;
        }
        self.tasks.iter().filter(|t| matches!(t.state, State::Pending) && !t.alone).count() as u32
    }

    /// Whether a suspect is pending.
    pub fn has_pending_suspect(&self) -> bool {
        self.suspected && self.tasks.iter().any(|t| matches!(t.state, State::Pending) && t.alone)
    }

    /// Leases the first pending suspect.
    pub fn cut_suspect(&mut self, assignment: AssignmentId) -> Option<Range> {
        let suspect = |t: &Entry| matches!(t.state, State::Pending) && t.alone;
        let first = self.tasks.iter().position(suspect)?;
        self.tasks[first].state = State::Leased(assignment);
        self.pending -= 1;
        Some(Range { round: self.number, first: first as u32, count: 1 })
    }

    /// Leases the first pending task that is no suspect, and up to `size - 1` that follow it without a break.
    pub fn cut(&mut self, size: u32, assignment: AssignmentId) -> Option<Range> {
        let is_pending = |t: &Entry| matches!(t.state, State::Pending) && !t.alone;
        let first = self.cursor + self.tasks[self.cursor..].iter().position(is_pending)?;
        let count = self.tasks[first..].iter().take(size.max(1) as usize).take_while(|t| is_pending(t)).count();
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

    /// A task that failed too often, for those who want to see it happen.
    pub fn poisoned(&self, index: u32, attempts: u32) -> v1::Poisoned {
        match &self.work {
            Work::Candidates(genomes) => v1::Poisoned {
                generation: self.number,
                candidate: index,
                genome: genomes.get(index as usize).cloned().unwrap_or_default(),
                attempts,
                ..v1::Poisoned::default()
            },
            Work::Examinations(all) => {
                all.get(index as usize).map_or_else(v1::Poisoned::default, |examination| v1::Poisoned {
                    generation: examination.candidate.generation,
                    candidate: examination.candidate.candidate,
                    genome: examination.candidate.genome.clone(),
                    question: v1::Question::from(examination.question).into(),
                    attempts,
                    score: Some(examination.candidate.score),
                })
            }
        }
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
    pub fn record(&mut self, index: u32, outcome: &Outcome, finder: &Finder) -> Recorded {
        let state = &mut self.tasks[index as usize].state;
        let holder = match state {
            State::Done(there, _) if there == outcome => return Recorded::Same,
            State::Done(..) => return Recorded::Other,
            State::Pending => {
                self.pending -= 1;
                None
            }
            State::Leased(holder) => Some(*holder),
        };
        *state = State::Done(outcome.clone(), finder.clone());
        self.done += 1;
        Recorded::New(holder)
    }

    /// Tasks that are not done and have crashed or failed while they were worked on alone, and how often.
    pub fn attempts(&self) -> impl Iterator<Item = (u32, u32)> {
        let open = self.tasks.iter().enumerate().filter(|(_, t)| t.attempts > 0 && !matches!(t.state, State::Done(..)));
        open.map(|(index, task)| (index as u32, task.attempts))
    }

    /// What a task found, if it is done.
    pub fn outcome(&self, index: u32) -> Option<&Outcome> {
        match &self.tasks.get(index as usize)?.state {
            State::Done(outcome, _) => Some(outcome),
            _ => None,
        }
    }

    /// Who found it, if it is done and that is known.
    pub fn finder(&self, index: u32) -> Finder {
        match self.tasks.get(index as usize).map(|t| &t.state) {
            Some(State::Done(_, finder)) => finder.clone(),
            _ => Finder::default(),
        }
    }

    /// Replaces what was found by what was decided.
    pub fn correct(&mut self, index: u32, outcome: &Outcome, finder: Finder) {
        if let Some(task) = self.tasks.get_mut(index as usize)
            && let State::Done(..) = task.state
        {
            task.state = State::Done(outcome.clone(), finder);
        }
    }

    /// Hands what a lease still holds on to another one.
    pub fn pass_on(&mut self, range: &Range, from: AssignmentId, to: AssignmentId) {
        for i in range.indexes().map(|i| i as usize) {
            if let State::Leased(holder) = &mut self.tasks[i].state
                && *holder == from
            {
                *holder = to;
            }
        }
    }

    /// Tasks that are worked on alone, and how often each failed so.
    #[cfg(test)]
    pub fn suspects(&self) -> std::collections::BTreeMap<u32, u32> {
        let suspect = |(i, t): (usize, &Entry)| t.alone.then_some((i as u32, t.attempts));
        self.tasks.iter().enumerate().filter_map(suspect).collect()
    }

    /// Holds this against its tasks, and nothing else.
    pub fn suspect(&mut self, charges: &[Charge]) {
        for task in &mut self.tasks {
            (task.alone, task.attempts) = (false, 0);
        }
        for charge in charges {
            let span = charge.first as usize..charge.first.saturating_add(charge.count) as usize;
            for task in self.tasks.get_mut(span).unwrap_or_default() {
                task.alone = true;
                task.attempts += u32::from(charge.attempt);
            }
        }
        self.suspected = !charges.is_empty();
        // Who is no suspect any more may lie below it.
        self.cursor = 0;
    }

    /// How often a task crashed or failed alone.
    pub fn attempts_of(&self, index: u32) -> u32 {
        self.tasks.get(index as usize).map_or(0, |task| task.attempts)
    }

    /// Whether all of a range is done.
    pub fn is_done(&self, range: &Range) -> bool {
        range.indexes().all(|i| matches!(self.tasks[i as usize].state, State::Done(..)))
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
}
