//! Round 0 of every job: a worker settles the robot. All tasks of later rounds share its result.

use super::{BadState, Hooks, NotRun, Procedure, ProcedureKind, Progress, Refused, Rejected, Round, RoundEnd, Step};
use crate::base::encoding::{self, Bytes, encoded};
use crate::base::error::Invalid;
use crate::base::limits::MAX_REFUSAL;
use crate::problem::{Checked, Preparation, Unprepared};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// First byte of an encoded outcome.
const OUTCOME: u8 = 0xA2;
/// First byte of a saved state.
const SAVED: u8 = 0xA3;
/// Name of the phase.
pub const PHASE: &str = "preparing";
/// Description of the task for people.
const TASK: &str = "the preparation of the robot";

/// Result of the only task of round 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum PreparationOutcome {
    /// The robot has settled.
    Prepared(Preparation),
    /// The robot can't stand, or its start is blocked, for this reason.
    Refused(String),
}

encoded!(PreparationOutcome = OUTCOME);

/// A job's procedure with its preparation. Rounds of the procedure itself follow as rounds 1, 2 and so on.
pub(super) struct Preparing {
    problem: Checked,
    inner: Box<dyn Procedure>,
    /// The encoded preparation, once round 0 is complete.
    preparation: Option<Arc<[u8]>>,
}

#[derive(Serialize, Deserialize)]
struct Saved {
    /// The preparation, and the state of the procedure itself; `None` in round 0.
    prepared: Option<(Preparation, Bytes)>,
}

impl Preparing {
    /// Creates a job before round 0.
    pub fn start(kind: &dyn ProcedureKind, problem: &Checked) -> Result<Self, Invalid> {
        Ok(Self { problem: problem.clone(), inner: kind.start(problem)?, preparation: None })
    }

    /// Restores a job from a saved state.
    pub fn load(kind: &dyn ProcedureKind, problem: &Checked, saved: &[u8]) -> Result<Self, BadState> {
        let Saved { prepared } = encoding::decode(SAVED, saved).map_err(|e| BadState(e.to_string()))?;
        match prepared {
            None => Self::start(kind, problem).map_err(|e| BadState(e.to_string())),
            Some((preparation, state)) => {
                problem.takes(&preparation).map_err(|e| BadState(e.to_string()))?;
                Ok(Self {
                    problem: problem.clone(),
                    inner: kind.load(problem, &state.0)?,
                    preparation: Some(preparation.encode().into()),
                })
            }
        }
    }
}

impl Procedure for Preparing {
    fn round(&self) -> Round {
        match &self.preparation {
            None => Round {
                number: 0,
                tasks: 1,
                at_most: 1,
                lanes: 1,
                phase: PHASE,
                shared: Arc::from([].as_slice()),
                kept: true,
            },
            Some(shared) => {
                let round = self.inner.round();
                Round { number: round.number + 1, shared: shared.clone(), ..round }
            }
        }
    }

    fn task(&self, index: u32) -> Vec<u8> {
        match self.preparation {
            None => {
                assert_eq!(index, 0, "round 0 has one task");
                Vec::new()
            }
            Some(_) => self.inner.task(index),
        }
    }

    fn describe(&self, index: u32) -> String {
        if self.preparation.is_none() { TASK.to_owned() } else { self.inner.describe(index) }
    }

    fn check(&self, index: u32, result: &[u8]) -> Result<(), Rejected> {
        if self.preparation.is_some() {
            return self.inner.check(index, result);
        }
        let reject = |reason: String| Err(Rejected { task: TASK.to_owned(), reason });
        match PreparationOutcome::decode(result) {
            Err(unreadable) => reject(unreadable.to_string()),
            Ok(PreparationOutcome::Prepared(preparation)) => {
                self.problem.takes(&preparation).or_else(|e| reject(e.to_string()))
            }
            Ok(PreparationOutcome::Refused(reason)) if (1..=MAX_REFUSAL).contains(&reason.len()) => Ok(()),
            Ok(PreparationOutcome::Refused(reason)) => {
                reject(format!("its reason has {} bytes: 1 to {MAX_REFUSAL} are allowed", reason.len()))
            }
        }
    }

    fn show(&self, result: &[u8]) -> String {
        match PreparationOutcome::decode(result) {
            Ok(PreparationOutcome::Prepared(preparation)) => preparation.to_string(),
            Ok(PreparationOutcome::Refused(reason)) => format!("refused: {reason}"),
            Err(unreadable) if self.preparation.is_none() => format!("an unreadable result: {unreadable}"),
            Err(_) => self.inner.show(result),
        }
    }

    fn decided(&self, so_far: &[Option<Arc<[u8]>>]) -> Option<u32> {
        self.preparation.as_ref().and_then(|_| self.inner.decided(so_far))
    }

    fn tell(&mut self, results: &[Arc<[u8]>]) -> RoundEnd {
        if self.preparation.is_some() {
            return self.inner.tell(results);
        }
        let step = match results.first().map(|result| PreparationOutcome::decode(result)) {
            Some(Ok(PreparationOutcome::Prepared(preparation))) => {
                self.preparation = Some(preparation.encode().into());
                Step::Next
            }
            Some(Ok(PreparationOutcome::Refused(reason))) => Step::Failed(reason),
            Some(Err(unreadable)) => Step::Failed(format!("the result of {TASK} is unusable: {unreadable}")),
            None => Step::Failed(format!("{TASK} has no result")),
        };
        RoundEnd { row: None, step }
    }

    fn offer(&mut self, batch: &[u8]) -> Result<(), Refused> {
        match self.preparation {
            None => Err(Refused("the robot is not prepared yet: wait for round 1".to_owned())),
            Some(_) => self.inner.offer(batch),
        }
    }

    fn save(&self) -> Vec<u8> {
        let preparation = self.preparation.as_ref().and_then(|bytes| Preparation::decode(bytes).ok());
        encoding::encode(SAVED, &Saved { prepared: preparation.map(|p| (p, Bytes(self.inner.save()))) })
    }

    fn progress(&self) -> Progress {
        let progress = self.inner.progress();
        if self.preparation.is_none() { Progress { phase: PHASE.into(), ..progress } } else { progress }
    }
}

/// Carries out the task of round 0.
pub(super) fn run(problem: &Checked, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
    let prepare = |(index, bytes): &(u32, Vec<u8>)| {
        if *index != 0 || !bytes.is_empty() {
            return Err(NotRun::Task(format!("round 0 has one task without content, but this is task {index}")));
        }
        match problem.prepare(&|| hooks.stop()) {
            Ok(preparation) => Ok(PreparationOutcome::Prepared(preparation).encode()),
            Err(Unprepared::Refused(fault)) => Ok(PreparationOutcome::Refused(shortened(fault.to_string())).encode()),
            Err(Unprepared::Stopped) => Err(NotRun::Stopped),
        }
    };
    tasks.iter().map(prepare).collect()
}

/// Shortens a reason to at most [`MAX_REFUSAL`] bytes.
fn shortened(mut reason: String) -> String {
    reason.truncate(reason.floor_char_boundary(MAX_REFUSAL));
    reason
}
