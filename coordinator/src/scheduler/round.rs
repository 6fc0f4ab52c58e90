//! The current round of a job: the states of its tasks, and their results.

use super::lease::{AssignmentId, Range, TaskState};
use crate::record::{Charge, Claimant};
use sim_core::base::digest::Digest;
use sim_core::procedure::{self, Procedure, result_digest};
use std::sync::Arc;

/// The outcome of recording a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Recorded {
    /// It is the task's first result. Contains the lease that held the task, if any.
    New(Option<AssignmentId>),
    /// A result with the same bits was recorded before.
    Same,
    /// A result with other bits was recorded before.
    Other,
}

#[derive(Clone, Debug, Default)]
struct Entry {
    state: TaskState,
    /// Crashes and failures while it ran alone.
    attempts: u32,
    /// True for a suspect: it was leased to a worker that crashed or failed. It runs alone from now on, to find out if
    /// it is the cause.
    alone: bool,
}

/// The current round.
#[derive(Clone, Debug)]
pub(super) struct Round {
    plan: procedure::Round,
    pub shared_digest: Digest,
    tasks: Vec<Entry>,
    results: Vec<Option<Arc<[u8]>>>,
    pending: u32,
    done: u32,
    /// No task with a smaller index is pending, except suspects.
    cursor: usize,
    /// True if any task is a suspect.
    suspected: bool,
}

impl Round {
    /// Creates a round with all tasks pending.
    pub fn new(plan: procedure::Round) -> Self {
        let n = plan.tasks as usize;
        Self {
            shared_digest: Digest::of("evogait shared 1", &&*plan.shared),
            tasks: vec![Entry::default(); n],
            results: vec![None; n],
            pending: plan.tasks,
            done: 0,
            cursor: 0,
            suspected: false,
            plan,
        }
    }

    /// Creates a round without tasks, for a procedure that waits for a batch.
    pub fn none(number: u32) -> Self {
        Self::new(procedure::Round {
            number,
            tasks: 0,
            at_most: 1,
            lanes: 1,
            phase: "waiting",
            shared: Arc::new([]),
            kept: false,
        })
    }

    pub fn number(&self) -> u32 {
        self.plan.number
    }

    pub fn phase(&self) -> &'static str {
        self.plan.phase
    }

    pub fn is_kept(&self) -> bool {
        self.plan.kept
    }

    pub fn shared(&self) -> &Arc<[u8]> {
        &self.plan.shared
    }

    /// Largest number of tasks in one lease.
    pub fn at_most(&self) -> u32 {
        self.plan.at_most.max(1)
    }

    /// Number of tasks that take as long together as one alone.
    pub fn lanes(&self) -> u32 {
        self.plan.lanes.max(1)
    }

    pub fn pending(&self) -> u32 {
        self.pending
    }

    pub fn done(&self) -> u32 {
        self.done
    }

    pub fn size(&self) -> u32 {
        self.plan.tasks
    }

    pub fn contains(&self, range: &Range) -> bool {
        range.round == self.number() && range.is_within(self.size())
    }

    fn is_pending(task: &Entry) -> bool {
        matches!(task.state, TaskState::Pending)
    }

    /// Number of pending tasks that are no suspects.
    pub fn pending_unsuspected(&self) -> u32 {
        if !self.suspected {
            return self.pending;
        }
        self.tasks.iter().filter(|t| Self::is_pending(t) && !t.alone).count() as u32
    }

    /// Returns true if a suspect is pending.
    pub fn has_pending_suspect(&self) -> bool {
        self.suspected && self.tasks.iter().any(|t| Self::is_pending(t) && t.alone)
    }

    /// Leases the first pending suspect.
    pub fn cut_suspect(&mut self, assignment: AssignmentId) -> Option<Range> {
        let first = self.tasks.iter().position(|t| Self::is_pending(t) && t.alone)?;
        self.tasks[first].state = TaskState::Leased(assignment);
        self.pending -= 1;
        Some(Range { round: self.number(), first: first as u32, count: 1 })
    }

    /// Leases the first pending task that is no suspect, and up to `size - 1` that follow it without a break.
    pub fn cut(&mut self, size: u32, assignment: AssignmentId) -> Option<Range> {
        let ordinary = |t: &Entry| Self::is_pending(t) && !t.alone;
        let first = self.cursor + self.tasks[self.cursor..].iter().position(ordinary)?;
        let count = self.tasks[first..].iter().take(size.max(1) as usize).take_while(|t| ordinary(t)).count();
        for task in &mut self.tasks[first..first + count] {
            task.state = TaskState::Leased(assignment);
        }
        self.pending -= count as u32;
        self.cursor = first + count;
        Some(Range { round: self.number(), first: first as u32, count: count as u32 })
    }

    /// Leases exactly this range, if all of it is pending.
    pub fn take(&mut self, range: &Range, assignment: AssignmentId) -> bool {
        if !self.contains(range) {
            return false;
        }
        let span = range.first as usize..(range.first + range.count) as usize;
        if !self.tasks[span.clone()].iter().all(Self::is_pending) {
            return false;
        }
        for task in &mut self.tasks[span] {
            task.state = TaskState::Leased(assignment);
        }
        self.pending -= range.count;
        true
    }

    /// Sets the unfinished tasks of a lease back to pending.
    pub fn set_pending(&mut self, range: &Range, assignment: AssignmentId) {
        for i in range.indexes().map(|i| i as usize) {
            if matches!(self.tasks[i].state, TaskState::Leased(a) if a == assignment) {
                self.tasks[i].state = TaskState::Pending;
                self.pending += 1;
                self.cursor = self.cursor.min(i);
            }
        }
    }

    /// Moves the unfinished tasks of a lease to another lease.
    pub fn move_lease(&mut self, range: &Range, from: AssignmentId, to: AssignmentId) {
        for i in range.indexes().map(|i| i as usize) {
            if let TaskState::Leased(holder) = &mut self.tasks[i].state
                && *holder == from
            {
                *holder = to;
            }
        }
    }

    /// Records a task's result if it is the first one.
    pub fn record(&mut self, index: u32, result: &Arc<[u8]>, finder: &Claimant) -> Recorded {
        let (digest, index) = (result_digest(result), index as usize);
        let holder = match &self.tasks[index].state {
            TaskState::Done { digest: there, .. } if *there == digest => return Recorded::Same,
            TaskState::Done { .. } => return Recorded::Other,
            TaskState::Pending => {
                self.pending -= 1;
                None
            }
            TaskState::Leased(holder) => Some(*holder),
        };
        self.tasks[index].state = TaskState::Done { digest, finder: finder.clone() };
        self.results[index] = Some(result.clone());
        self.done += 1;
        Recorded::New(holder)
    }

    /// Replaces a recorded result by the one that arbitration confirmed.
    pub fn correct(&mut self, index: u32, result: Arc<[u8]>, finder: Claimant) {
        let index = index as usize;
        if let Some(task) = self.tasks.get_mut(index).filter(|task| matches!(task.state, TaskState::Done { .. })) {
            task.state = TaskState::Done { digest: result_digest(&result), finder };
            self.results[index] = Some(result);
        }
    }

    /// Returns tasks that are not done and have crashed or failed while they ran alone, with the number of attempts.
    pub fn attempts(&self) -> impl Iterator<Item = (u32, u32)> {
        let open = |t: &Entry| t.attempts > 0 && !matches!(t.state, TaskState::Done { .. });
        (0..).zip(&self.tasks).filter(move |(_, t)| open(t)).map(|(index, task)| (index, task.attempts))
    }

    /// Returns the digest of a task's result and the worker that delivered it, if the task is done.
    pub fn found(&self, index: u32) -> Option<(Digest, &Claimant)> {
        match &self.tasks.get(index as usize)?.state {
            TaskState::Done { digest, finder } => Some((*digest, finder)),
            _ => None,
        }
    }

    /// Returns a task's result, if it is done.
    pub fn result(&self, index: u32) -> Option<&Arc<[u8]>> {
        self.results.get(index as usize)?.as_ref()
    }

    /// Returns the results that settle the round, by index, once they are complete.
    pub fn settled(&self, procedure: &dyn Procedure) -> Option<Vec<Arc<[u8]>>> {
        let count = procedure.decided(&self.results).map_or(self.results.len(), |count| count as usize);
        let results = self.results.get(..count).filter(|results| !results.is_empty())?;
        results.iter().cloned().collect()
    }

    /// Returns the suspects, with the number of attempts of each.
    #[cfg(test)]
    pub fn suspects(&self) -> std::collections::BTreeMap<u32, u32> {
        let suspect = |(i, t): (usize, &Entry)| t.alone.then_some((i as u32, t.attempts));
        self.tasks.iter().enumerate().filter_map(suspect).collect()
    }

    /// Sets the suspects and attempts to those of these charges.
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
        // Tasks below the cursor may no longer be suspects, and must be found again.
        self.cursor = 0;
    }

    /// Returns the number of attempts of a task.
    pub fn attempts_of(&self, index: u32) -> u32 {
        self.tasks.get(index as usize).map_or(0, |task| task.attempts)
    }

    /// Returns true if all tasks of a range are done.
    pub fn is_done(&self, range: &Range) -> bool {
        range.indexes().all(|i| self.found(i).is_some())
    }
}
