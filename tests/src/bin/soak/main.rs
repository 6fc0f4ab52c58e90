//! Three jobs and six workers under a random kill, stop or bad network every two seconds, and a kill of the coordinator every
//! twenty: all jobs end, with the bits of an undisturbed run, and nothing that was told is ever taken back. On PostgreSQL all
//! doors are closed (mutual TLS, tokens), and there is a second coordinator, which takes over when the one at work is killed,
//! hangs or is cut off from the database; one that hung goes on later, what was under way arrives later, and both must change
//! nothing.
//!
//! `tests/soak.sh` runs it. Ends with code 0 if all held; else says what did not, and leaves the logs of all processes.

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

/// Jobs that run at the same time, again and again until time is up.
const JOBS: u32 = 4;
/// Once the time is up, what still runs has this long to end by itself.
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

/// A job whose evaluations cost time rather than cores: workers are told to be slow. The last two plan and simulate, the others
/// evolve.
fn job(number: u32) -> String {
    let job = match JOBS - number {
        // A short motion: rollouts of different friction share no lanes, and these run all the time.
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
    println!("soak: {JOBS} jobs were run undisturbed");

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
            // Before the time is up only a failure ends one.
            let ended = followers.remove(at).await.map_err(|e| e.to_string())?;
            return Err(format!("{}; logs in {}", ended.err().unwrap_or_default(), logs.display()));
        }
    }
    chaos.calm_down().await.map_err(|e| format!("{e}; logs in {}", logs.display()))?;
    println!("soak: time is up after {}", chaos.tally());
    let mut rounds = 0;
    for follower in followers {
        let ended = tokio::time::timeout(END_WITHIN, follower).await;
        let ended = ended.map_err(|_| format!("a job does not end; logs in {}", logs.display()))?;
        rounds += ended.map_err(|e| e.to_string())?.map_err(|e| format!("{e}; logs in {}", logs.display()))?;
    }
    chaos.assert_slots_are_free().await.map_err(|e| format!("{e}; logs in {}", logs.display()))?;
    println!("soak: {rounds} jobs ended with the bits of an undisturbed run; every slot is free");
    let verdict = chaos.coordinators().verdict().map_err(|e| format!("{e}; logs in {}", logs.display()))?;
    if let Some(epoch) = verdict {
        println!("soak: nothing was written in an epoch that was over; the last one is {epoch}");
    }
    // Nobody needs them any more.
    let _ = std::fs::remove_dir_all(&logs);
    Ok(())
}

/// What a job gives when nothing happens.
async fn undisturbed(number: u32) -> Expected {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let id = sandbox.submit("r", &job(number)).await.id;
    let result = sandbox.result(&id).await;
    let ended = sandbox.client().get_job(GetJobRequest { id }).await.expect("the job").into_inner().job;
    Expected::of(result, ended.expect("the answer has the job"))
}
