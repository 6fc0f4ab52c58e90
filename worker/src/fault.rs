//! Injected faults for tests across processes. Release builds contain them only with the feature `faults`.
//!
//! The environment variable `EVOGAIT_FAULT` holds faults separated by `;`. Each is `KIND`, which applies to all tasks,
//! or `KIND@round=R,index=I`, which applies to that task of that round. Round 0 is a job's preparation; round G + 1 is
//! generation G of its search.
//!
//! Kinds: `panic`; `abort` (ends the process); `stall` (never continues); `wrong` (inverts the lowest bit of the first
//! score); `slow@ms=N` (delays each task by N ms).

use crate::assignments::Work;
use sim_core::procedure::evolve::TaskResult;
use sim_core::procedure::{Hooks, NotRun};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

/// Name of the environment variable.
const VARIABLE: &str = "EVOGAIT_FAULT";
/// Time between two checks of a slowed or stalled slot.
const NAP: Duration = Duration::from_millis(5);

static FAULTS: LazyLock<Result<Vec<Fault>, String>> = LazyLock::new(|| match std::env::var(VARIABLE) {
    Ok(text) => text.split(';').filter(|one| !one.is_empty()).map(Fault::read).collect(),
    Err(_) => Ok(Vec::new()),
});

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FaultKind {
    Panic,
    Abort,
    Stall,
    Wrong,
    Slow,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Fault {
    kind: FaultKind,
    round: Option<u32>,
    index: Option<u32>,
    ms: u64,
}

impl Fault {
    fn read(text: &str) -> Result<Self, String> {
        let (kind, places) = text.split_once('@').unwrap_or((text, ""));
        let kind = match kind {
            "panic" => FaultKind::Panic,
            "abort" => FaultKind::Abort,
            "stall" => FaultKind::Stall,
            "wrong" => FaultKind::Wrong,
            "slow" => FaultKind::Slow,
            _ => return Err(format!("{VARIABLE}: unknown fault '{kind}': use panic, abort, stall, wrong or slow")),
        };
        let mut fault = Self { kind, round: None, index: None, ms: 0 };
        for place in places.split(',').filter(|place| !place.is_empty()) {
            let wrong = || format!("{VARIABLE}: invalid '{place}': use round=N, index=N or ms=N");
            let (key, value) = place.split_once('=').ok_or_else(wrong)?;
            let number: u32 = value.parse().map_err(|_| wrong())?;
            match key {
                "round" => fault.round = Some(number),
                "index" => fault.index = Some(number),
                "ms" => fault.ms = number.into(),
                _ => return Err(wrong()),
            }
        }
        Ok(fault)
    }

    fn is_at(&self, round: u32, index: u32) -> bool {
        self.round.is_none_or(|r| r == round) && self.index.is_none_or(|i| i == index)
    }
}

/// Checks the syntax of the variable.
pub(crate) fn check() -> Result<(), String> {
    FAULTS.clone().map(|_| ())
}

/// Applies the faults other than `wrong`, before the tasks are computed.
pub(crate) fn strike(work: &Work, hooks: &dyn Hooks) -> Result<(), NotRun> {
    for fault in FAULTS.iter().flatten() {
        for (index, _) in work.tasks.iter().filter(|(index, _)| fault.is_at(work.round, *index)) {
            match fault.kind {
                FaultKind::Panic => panic!("{VARIABLE} at task {index} of round {}", work.round),
                FaultKind::Abort => std::process::abort(),
                FaultKind::Stall => loop {
                    std::thread::sleep(NAP);
                },
                FaultKind::Wrong => {}
                FaultKind::Slow => wait(Duration::from_millis(fault.ms), hooks)?,
            }
        }
    }
    Ok(())
}

/// Applies `wrong` to the results. A preparation has no score, so it stays as it is.
pub(crate) fn falsified(work: &Work, mut results: Vec<Vec<u8>>) -> Vec<Vec<u8>> {
    for fault in FAULTS.iter().flatten().filter(|fault| fault.kind == FaultKind::Wrong && work.round > 0) {
        for ((index, _), result) in work.tasks.iter().zip(&mut results) {
            if fault.is_at(work.round, *index) {
                *result = turned(result);
            }
        }
    }
    results
}

/// Returns the result with the lowest bit of its first score inverted.
fn turned(result: &[u8]) -> Vec<u8> {
    let Ok(mut content) = TaskResult::decode(result) else { return result.to_owned() };
    let score = match &mut content {
        TaskResult::Evaluated { score, .. } => score.as_mut(),
        TaskResult::Examined { scores, .. } => scores.iter_mut().flatten().next(),
    };
    if let Some(score) = score {
        *score = f64::from_bits(score.to_bits() ^ 1);
    }
    content.encode()
}

fn wait(time: Duration, hooks: &dyn Hooks) -> Result<(), NotRun> {
    let start = Instant::now();
    while start.elapsed() < time {
        if hooks.stop() {
            return Err(NotRun::Stopped);
        }
        std::thread::sleep(NAP);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_matches_task_and_invalid_text_is_refused() {
        let fault = Fault::read("panic@round=1,index=3").unwrap();
        assert!(fault.is_at(1, 3) && !fault.is_at(1, 2) && !fault.is_at(0, 3));
        assert!(Fault::read("abort").unwrap().is_at(7, 7));
        assert_eq!(Fault::read("slow@ms=20").unwrap().ms, 20);
        for nonsense in ["", "explode", "panic@round", "panic@index=x", "slow@s=1", "wrong@generation=1"] {
            assert!(Fault::read(nonsense).is_err(), "{nonsense}");
        }
    }

    #[test]
    fn wrong_inverts_lowest_bit_of_first_score() {
        let evaluated = |score| TaskResult::Evaluated {
            genotype: None,
            score,
            descriptors: Vec::new(),
            counts: Default::default(),
        };
        let examined = |scores| TaskResult::Examined { scores, counts: Default::default(), traces: None };
        let next = f64::from_bits(2.0f64.to_bits() ^ 1);
        for (right, wrong) in [
            (evaluated(Some(2.0)), evaluated(Some(next))),
            (evaluated(None), evaluated(None)),
            (examined(vec![None, Some(2.0), Some(2.0)]), examined(vec![None, Some(next), Some(2.0)])),
        ] {
            assert_eq!(turned(&right.encode()), wrong.encode());
        }
        assert_eq!(turned(&[255; 3]), [255; 3]);
    }
}
