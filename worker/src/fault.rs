//! Faults on demand, for tests across processes; not part of release builds (feature `faults` puts them there).
//!
//! The environment variable `EVOGAIT_FAULT` holds any number of them, separated by `;`: `KIND` or
//! `KIND@generation=G,candidate=C`, which strikes only there. Kinds: `panic`; `abort`, the end of the whole process; `stall`,
//! which never gets on; `wrong`, the lowest bit of the score turned over; `slow@ms=N`, so many ms more a candidate.

use crate::assignments::Task;
use sim_core::evaluate::{Evaluation, Stopped};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

/// The variable's name.
const VARIABLE: &str = "EVOGAIT_FAULT";
/// How often a slow or stuck slot looks around.
const NAP: Duration = Duration::from_millis(5);

static FAULTS: LazyLock<Result<Vec<Fault>, String>> = LazyLock::new(|| match std::env::var(VARIABLE) {
    Ok(text) => text.split(';').filter(|one| !one.is_empty()).map(Fault::read).collect(),
    Err(_) => Ok(Vec::new()),
});

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Panic,
    Abort,
    Stall,
    Wrong,
    Slow,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Fault {
    kind: Kind,
    generation: Option<u32>,
    candidate: Option<u32>,
    ms: u64,
}

impl Fault {
    fn read(text: &str) -> Result<Self, String> {
        let (kind, places) = text.split_once('@').unwrap_or((text, ""));
        let kind = match kind {
            "panic" => Kind::Panic,
            "abort" => Kind::Abort,
            "stall" => Kind::Stall,
            "wrong" => Kind::Wrong,
            "slow" => Kind::Slow,
            _ => return Err(format!("{VARIABLE}: there is no fault '{kind}'")),
        };
        let mut fault = Self { kind, generation: None, candidate: None, ms: 0 };
        for place in places.split(',').filter(|place| !place.is_empty()) {
            let wrong = || format!("{VARIABLE}: '{place}' is no generation=N, candidate=N or ms=N");
            let (key, value) = place.split_once('=').ok_or_else(wrong)?;
            let number: u32 = value.parse().map_err(|_| wrong())?;
            match key {
                "generation" => fault.generation = Some(number),
                "candidate" => fault.candidate = Some(number),
                "ms" => fault.ms = number.into(),
                _ => return Err(wrong()),
            }
        }
        Ok(fault)
    }

    fn is_at(&self, generation: u32, candidate: u32) -> bool {
        self.generation.is_none_or(|g| g == generation) && self.candidate.is_none_or(|c| c == candidate)
    }
}

/// Whether the variable can be read.
pub(crate) fn check() -> Result<(), String> {
    FAULTS.clone().map(|_| ())
}

/// Does what the variable asks for, before the work itself. An examination is in its round and has its index.
pub(crate) fn strike(task: &Task, stop: &dyn Fn() -> bool) -> Result<(), Stopped> {
    let places: Vec<(u32, u32)> = match task {
        Task::Evaluate { generation, candidates, .. } => candidates.iter().map(|(c, _)| (*generation, *c)).collect(),
        Task::Examine { round, index, .. } => vec![(*round, *index)],
    };
    for fault in FAULTS.iter().flatten() {
        for (generation, candidate) in places.iter().filter(|(g, c)| fault.is_at(*g, *c)) {
            match fault.kind {
                Kind::Panic => panic!("{VARIABLE} at candidate {candidate} of generation {generation}"),
                Kind::Abort => std::process::abort(),
                Kind::Stall => loop {
                    std::thread::sleep(NAP);
                },
                Kind::Wrong => {}
                Kind::Slow => wait(Duration::from_millis(fault.ms), stop)?,
            }
        }
    }
    Ok(())
}

/// Turns the bits that `wrong` asks for.
pub(crate) fn falsified(generation: u32, mut evaluations: Vec<Evaluation>) -> Vec<Evaluation> {
    for fault in FAULTS.iter().flatten().filter(|fault| fault.kind == Kind::Wrong) {
        for evaluation in evaluations.iter_mut().filter(|e| fault.is_at(generation, e.candidate)) {
            evaluation.score = evaluation.score.map(|score| f64::from_bits(score.to_bits() ^ 1));
        }
    }
    evaluations
}

fn wait(time: Duration, stop: &dyn Fn() -> bool) -> Result<(), Stopped> {
    let start = Instant::now();
    while start.elapsed() < time {
        if stop() {
            return Err(Stopped);
        }
        std::thread::sleep(NAP);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_strikes_where_it_says_and_nonsense_is_refused() {
        let fault = Fault::read("panic@generation=1,candidate=3").unwrap();
        assert!(fault.is_at(1, 3) && !fault.is_at(1, 2) && !fault.is_at(0, 3));
        assert!(Fault::read("abort").unwrap().is_at(7, 7));
        assert_eq!(Fault::read("slow@ms=20").unwrap().ms, 20);
        for nonsense in ["", "explode", "panic@generation", "panic@candidate=x", "slow@s=1"] {
            assert!(Fault::read(nonsense).is_err(), "{nonsense}");
        }
    }
}
