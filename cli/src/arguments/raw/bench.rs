//! `evogait bench` as it is typed.

use clap::{Args, Subcommand};

#[derive(Debug, Args)]
pub struct Bench {
    #[command(subcommand)]
    pub what: BenchCommand,
}

#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Physics alone: simulated seconds a CPU second
    Rollout(BenchRollout),

    /// Whole evaluations of a job, and what their time goes to
    Evaluate(BenchEvaluate),

    /// How near engine settings come to a converged reference, and at what speed
    Fidelity(BenchFidelity),

    /// The planner alone, on known transitions
    Plan(BenchPlan),

    /// Coordinator and workers: what dispatching an evaluation costs
    Dispatch(BenchDispatch),
}

#[derive(Debug, Args)]
pub struct BenchRollout {
    /// Name of a robot that ships, or a robot file
    #[arg(value_name = "NAME|FILE", default_value = "quadropod")]
    pub robot: String,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchEvaluate {
    #[command(flatten)]
    pub file: super::JobFile,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchFidelity {
    /// Name of a robot that ships, or a robot file
    #[arg(value_name = "NAME|FILE", default_value = "quadropod")]
    pub robot: String,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchPlan {
    #[command(flatten)]
    pub file: super::JobFile,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchDispatch {
    #[command(flatten)]
    pub file: super::JobFile,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}
