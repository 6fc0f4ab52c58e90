//! Soak test: four jobs and six workers, with a random disturbance (a kill, stop or bad network) of a worker every two
//! seconds and one of the active coordinator every twenty. All jobs must end with the results of an undisturbed run,
//! and their reported progress must never decrease.
//!
//! On PostgreSQL, connections need mutual TLS and tokens. A second coordinator takes over when the active one is
//! killed, hangs or is cut off from the database. The replaced coordinator later continues, and packets that were held
//! back arrive late; neither must change anything.
//!
//! `tests/soak.sh` runs it. Exits with code 0 if all checks passed. Otherwise it prints the failed check and keeps the
//! logs of all processes.

mod chaos;
mod coordinators;
mod follow;
mod random;

use chaos::Chaos;
use cluster_tests::postgres::new_database_by_tcp;
use cluster_tests::sandbox::{Sandbox, planning_job, simulating_job, tiny_job};
use coordinators::Coordinators;
use follow::{Expected, follow};
use proto::v1::GetJobRequest;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Number of jobs at the same time. Each is repeated until the time is up.
const JOBS: u32 = 4;
/// Time that the last run of each job has to end after the time is up.
const END_WITHIN: Duration = Duration::from_secs(180);

#[tokio::main]
async fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1).peekable();
    let postgres = arguments.next_if(|argument| argument == "--postgres").is_some();
    let seconds = arguments.next().map_or(Ok(600), |text| text.parse());
    let seed = arguments.next().map_or(Ok(1), |text| text.parse());
    let (Ok(seconds), Ok(seed)) = (seconds, seed) else {
        eprintln!("usage: soak [--postgres] [SECONDS [SEED]]");
        return ExitCode::FAILURE;
    };
    match soak(postgres, Duration::from_secs(seconds), seed).await {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("soak failed: {reason}");
            ExitCode::FAILURE
        }
    }
}

/// Returns a job with evaluations that take time rather than cores, because the workers are slowed down. The last two
/// jobs plan and simulate, the others evolve.
fn job(number: u32) -> String {
    let job = match JOBS - number {
        // The motion is short: rollouts with different friction share no lanes, so they take longer.
        1 => simulating_job(100 + number, 1000).replace("steps = [1, 2, 1]", "steps = [2]"),
        2 => planning_job(100 + number, 1000),
        _ => tiny_job(100 + number, 60),
    };
    let job = job.replace("engine = \"rapier\"", "engine = \"lockstep\"");
    job.replace("particles = 5", "particles = 12").replace("iterations = 10", "iterations = 5")
}

async fn soak(postgres: bool, time: Duration, seed: u64) -> Result<(), String> {
    let logs = std::env::temp_dir().join(format!("evogait-soak-{}", std::process::id()));
    std::fs::create_dir_all(&logs).map_err(|e| format!("{}: {e}", logs.display()))?;
    let store = if postgres { "PostgreSQL, two coordinators, mutual TLS and tokens" } else { "SQLite" };
    println!("soak: {store}, {} s, seed {seed}; logs in {}", time.as_secs(), logs.display());

    let mut expected = Vec::new();
    for number in 0..JOBS {
        expected.push(undisturbed(number).await);
    }
    println!("soak: {JOBS} jobs completed without disturbance");

    let coordinators = Coordinators::start(postgres.then(new_database_by_tcp), &logs);
    let start = Instant::now();
    let mut chaos = Chaos::start(coordinators, seed);
    let follow = |number: u32| {
        let (dial, expected) = (chaos.coordinators().dial(), expected[number as usize].clone());
        tokio::spawn(async move { follow(&dial, number, &job(number), &expected, start + time).await })
    };
    let mut followers: Vec<_> = (0..JOBS).map(follow).collect();

    while start.elapsed() < time {
        chaos.go_on().await.map_err(|e| format!("{e}; logs in {}", logs.display()))?;
        tokio::time::sleep(Duration::from_millis(50)).await;
        if let Some(at) = followers.iter().position(|follower| follower.is_finished()) {
            // Before the time is up, only a failure ends a follower.
            let ended = followers.remove(at).await.map_err(|e| e.to_string())?;
            return Err(format!("{}; logs in {}", ended.err().unwrap_or_default(), logs.display()));
        }
    }
    chaos.calm_down().await.map_err(|e| format!("{e}; logs in {}", logs.display()))?;
    println!("soak: time is up after {}", chaos.tally());
    let mut rounds = 0;
    for follower in followers {
        let ended = tokio::time::timeout(END_WITHIN, follower).await;
        let ended = ended.map_err(|_| format!("a job did not end in time; logs in {}", logs.display()))?;
        rounds += ended.map_err(|e| e.to_string())?.map_err(|e| format!("{e}; logs in {}", logs.display()))?;
    }
    chaos.assert_slots_are_free().await.map_err(|e| format!("{e}; logs in {}", logs.display()))?;
    println!("soak: {rounds} jobs ended with the results of an undisturbed run; all slots are free");
    let verdict = chaos.coordinators().verdict().map_err(|e| format!("{e}; logs in {}", logs.display()))?;
    if let Some(epoch) = verdict {
        println!("soak: no coordinator wrote after it was replaced; the last epoch is {epoch}");
    }
    // All checks passed, so the logs are not needed.
    let _ = std::fs::remove_dir_all(&logs);
    Ok(())
}

/// Returns the result of a job without disturbances.
async fn undisturbed(number: u32) -> Expected {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let id = sandbox.submit("r", &job(number)).await.id;
    let result = sandbox.result(&id).await;
    let ended = sandbox.client().get_job(GetJobRequest { id }).await.expect("the job exists").into_inner().job;
    Expected::of(result, ended.expect("the response has the job"))
}
