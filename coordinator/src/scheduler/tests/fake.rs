//! A procedure for tests. Each round's tasks follow from the results of the previous round, so a change of one bit
//! changes everything after it.

use sim_core::procedure::{
    Artefact, BadState, Procedure, Progress, Refused, Rejected, Round, RoundEnd, SeriesRow, Step, Value,
};
use std::sync::Arc;

const PHASES: [&str; 3] = ["searching", "finishing", "reporting"];

/// A procedure with kept rounds of many short tasks, then rounds of a few long ones.
#[derive(Clone, Debug)]
pub struct Fake {
    tasks: u32,
    rounds: u32,
    /// True if it has no finishing round.
    bare: bool,
    lanes: u32,
    /// Number of successes that settle a kept round; 0: all tasks must be done.
    successes: u32,
    /// True if it waits for a batch after each kept round but the last.
    serves: bool,
    waits: bool,
    number: u32,
    memory: u64,
}

fn mix(a: u64, b: u64) -> u64 {
    let z = (a ^ b.rotate_left(32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    (z ^ (z >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9)
}

fn word(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"))
}

/// Computes a task's result. One task in seven fails, but never the first of a round.
pub fn result_of(task: &[u8]) -> Vec<u8> {
    let bits = mix(word(task, 1), u64::from(task[0]));
    let fails = bits.is_multiple_of(7) && word(task, 9) > 0;
    encode((!fails).then_some(bits >> 1))
}

/// Returns a wrong but well-formed result of this task.
pub fn wrong_result_of(task: &[u8], how: u64) -> Vec<u8> {
    encode(Some(word(&result_of(task), 1) ^ (1 + how)))
}

/// Encodes a result: a success with a value, or a failure.
pub fn encode(value: Option<u64>) -> Vec<u8> {
    [&[u8::from(value.is_some())], value.unwrap_or(0).to_le_bytes().as_slice()].concat()
}

impl Fake {
    pub fn new(tasks: u32, rounds: u32) -> Self {
        let (bare, serves, waits) = (false, false, false);
        Self { tasks, rounds, bare, lanes: 1, successes: 0, serves, waits, number: 0, memory: 17 }
    }

    /// Creates the procedure for a job of this name.
    pub fn of(name: &str, tasks: u32, rounds: u32) -> Self {
        Self { bare: name.starts_with("bare"), ..Self::new(tasks, rounds) }
    }

    /// Sets the number of tasks that take as long together as one alone.
    pub fn with_lanes(self, lanes: u32) -> Self {
        Self { lanes, ..self }
    }

    /// Settles each kept round once this many of its first tasks succeeded.
    pub fn settled_by(self, successes: u32) -> Self {
        Self { successes, ..self }
    }

    /// Makes it wait for a batch after each kept round but the last.
    pub fn serving(self) -> Self {
        Self { serves: true, ..self }
    }

    pub fn load(saved: &[u8]) -> Result<Self, BadState> {
        if saved.len() != 72 {
            return Err(BadState(format!("a saved state has {} bytes, not 72", saved.len())));
        }
        let w = |i: usize| word(saved, 8 * i);
        Ok(Self {
            tasks: w(0) as u32,
            rounds: w(1) as u32,
            bare: w(2) == 1,
            lanes: w(3) as u32,
            successes: w(4) as u32,
            serves: w(5) == 1,
            waits: w(6) == 1,
            number: w(7) as u32,
            memory: w(8),
        })
    }

    fn phase(&self) -> usize {
        match self.number.checked_sub(self.rounds) {
            None => 0,
            Some(0) if !self.bare => 1,
            Some(_) => 2,
        }
    }

    fn last_round(&self) -> u32 {
        self.rounds + u32::from(!self.bare)
    }
}

impl Procedure for Fake {
    fn round(&self) -> Round {
        let phase = self.phase();
        let (tasks, at_most) = [(self.tasks, 1000), (8, 1), (4, 1)][phase];
        let shared: Arc<[u8]> = if self.number == 0 { Arc::new([]) } else { PHASES[phase].as_bytes().into() };
        let lanes = if phase == 0 { self.lanes } else { 1 };
        Round { number: self.number, tasks, at_most, lanes, phase: PHASES[phase], shared, kept: phase == 0 }
    }

    fn task(&self, index: u32) -> Vec<u8> {
        let words = [mix(self.memory, u64::from(index)), u64::from(index)];
        [&[self.phase() as u8], words.map(u64::to_le_bytes).concat().as_slice()].concat()
    }

    fn describe(&self, index: u32) -> String {
        format!("task {index} of round {}", self.number)
    }

    fn check(&self, index: u32, result: &[u8]) -> Result<(), Rejected> {
        let whole = result.len() == 9 && encode((result[0] == 1).then(|| word(result, 1))) == result;
        let reason = "a result must have 9 bytes: 1 and a value, or 0 and zeros".to_owned();
        if whole { Ok(()) } else { Err(Rejected { task: self.describe(index), reason }) }
    }

    fn show(&self, result: &[u8]) -> String {
        format!("{:016x}", word(result, 1))
    }

    fn decided(&self, so_far: &[Option<Arc<[u8]>>]) -> Option<u32> {
        if self.successes == 0 || self.phase() > 0 {
            return None;
        }
        let there = so_far.iter().map_while(Option::as_ref).enumerate();
        let last = there.filter(|(_, result)| result[0] == 1).nth(self.successes as usize - 1)?.0;
        Some(last as u32 + 1)
    }

    fn tell(&mut self, results: &[Arc<[u8]>]) -> RoundEnd {
        for result in results {
            self.memory = mix(self.memory, word(result, 1) + u64::from(result[0]));
        }
        let failed = results.iter().all(|result| result[0] == 0);
        let value = Value { name: "memory".into(), unit: "".into(), value: Some((self.memory >> 12) as f64) };
        let row = SeriesRow { series: "rounds".into(), index: self.number, values: vec![value] };
        let row = (self.phase() == 0).then_some(row);
        self.number += 1;
        self.waits = self.serves && self.number < self.rounds;
        let step = if failed {
            Step::Failed(format!("all {} tasks of a round failed", results.len()))
        } else if self.number > self.last_round() {
            let content = self.memory.to_le_bytes().to_vec();
            Step::Done(vec![Artefact { name: "memory".into(), media_type: "text/plain".into(), content }])
        } else if self.waits {
            Step::Waiting
        } else {
            Step::Next
        };
        RoundEnd { row, step }
    }

    fn offer(&mut self, batch: &[u8]) -> Result<(), Refused> {
        if !self.waits || batch.is_empty() {
            return Err(Refused(
                "a batch is accepted only while the procedure waits, and must not be empty".to_owned(),
            ));
        }
        self.waits = false;
        self.memory = batch.iter().fold(self.memory, |memory, byte| mix(memory, u64::from(*byte)));
        Ok(())
    }

    fn save(&self) -> Vec<u8> {
        let numbers = [self.tasks, self.rounds, self.bare.into(), self.lanes, self.successes, self.serves.into()];
        let rest = [u64::from(self.waits), u64::from(self.number), self.memory];
        numbers.map(u64::from).iter().chain(&rest).flat_map(|number| number.to_le_bytes()).collect()
    }

    fn progress(&self) -> Progress {
        let value = Value { name: "memory".into(), unit: "".into(), value: Some((self.memory >> 12) as f64) };
        Progress {
            phase: PHASES[self.phase()].into(),
            unit: "rounds".into(),
            done: self.number,
            total: self.last_round() + 1,
            values: vec![value],
        }
    }
}
