//! Resolved arguments of `evogait bench`.

use super::raw;

#[derive(Debug)]
pub enum Bench {
    Rollout(raw::BenchRollout),
    Evaluate(raw::BenchEvaluate),
    Fidelity(raw::BenchFidelity),
    Fitness(raw::BenchFitness),
    Plan(raw::BenchPlan),
    Dispatch(raw::BenchDispatch),
    Fleet(raw::BenchFleet),
    Reuse(raw::BenchReuse),
    Soundness(raw::BenchSoundness),
}

impl From<raw::Bench> for Bench {
    fn from(raw: raw::Bench) -> Self {
        match raw.what {
            raw::BenchCommand::Rollout(args) => Self::Rollout(args),
            raw::BenchCommand::Evaluate(args) => Self::Evaluate(args),
            raw::BenchCommand::Fidelity(args) => Self::Fidelity(args),
            raw::BenchCommand::Fitness(args) => Self::Fitness(args),
            raw::BenchCommand::Plan(args) => Self::Plan(args),
            raw::BenchCommand::Dispatch(args) => Self::Dispatch(args),
            raw::BenchCommand::Fleet(args) => Self::Fleet(args),
            raw::BenchCommand::Reuse(args) => Self::Reuse(args),
            raw::BenchCommand::Soundness(args) => Self::Soundness(args),
        }
    }
}
