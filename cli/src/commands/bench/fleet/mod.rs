//! `evogait bench dispatch --workers N`: one coordinator and many light workers.
//!
//! The coordinator is the real one, with SQLite on disk, in a process of its own; the workers are sessions of this
//! process that speak the real protocol and simulate nothing. What is measured is what handing out, taking in and
//! keeping costs.

mod host;
mod light;

use super::dispatch::Scratch;
use super::subject::Machine;
use crate::arguments::BenchDispatch;
use crate::client::{Client, Url};
use crate::console::{self, table};
use crate::error::Error;
use crate::load;
use host::Host;
use light::{Behaviour, Tally, work};
use proto::v1;
use proto::v1::job_event::Event;
use serde::Serialize;
use sim_core::job::{Job, JobSpec};
use sim_core::measure::statistics::{median, quantile};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::task::JoinSet;

/// How long all workers may take to connect.
const CONNECT: Duration = Duration::from_secs(60);
/// How long nothing may happen.
const PATIENCE: Duration = Duration::from_secs(120);
/// Candidates of a small generation, as in the paper.
const SMALL: u32 = 20;
/// Small generations that are timed.
const SMALL_GENERATIONS: u32 = 100;
/// What an evaluation is said to take where each is to come alone.
const LONG: Duration = Duration::from_secs(60);

#[derive(Serialize)]
struct View {
    job: String,
    machine: Machine,
    workers: u32,
    slots: u32,
    /// What an evaluation takes in the light workers, ms.
    sleep_ms: u64,
    idle: Option<Idle>,
    lines: Vec<Line>,
    /// Deaths of light workers over all.
    deaths: u64,
}

/// The coordinator while its workers have nothing to do.
#[derive(Serialize)]
struct Idle {
    seconds: f64,
    /// CPU time over time: 1 is a core.
    cores: f64,
    peak_mib: Option<f64>,
}

/// A job.
#[derive(Serialize)]
struct Line {
    population: u32,
    generations: u32,
    /// Each candidate is an assignment of its own.
    alone: bool,
    assignments: u64,
    /// From seal to seal, ms.
    generation_ms: Spread,
    /// The median over the population, µs.
    candidate_us: f64,
    /// CPU time of the coordinator a candidate, µs.
    coordinator_us: f64,
    peak_mib: Option<f64>,
}

#[derive(Serialize)]
struct Spread {
    median: f64,
    p95: f64,
}

/// The coordinator's process.
pub fn host(folder: PathBuf) -> Result<(), Error> {
    super::super::with_runtime(host::serve(folder))
}

/// Measures and tells.
pub fn run(args: &BenchDispatch, workers: u32) -> Result<(), Error> {
    let job = load::job(&args.file.clone().into())?;
    let view = super::super::with_runtime(measure(args, &job, workers))?;
    if args.json { console::say_json(&view) } else { console::say(&text(&view)) }
}

async fn measure(args: &BenchDispatch, job: &Job, workers: u32) -> Result<View, Error> {
    #[cfg(unix)]
    coordinator::open_files::raise();
    let scratch = Scratch::new()?;
    let host = Host::start(&scratch.0)?;
    let slots = args.slots.first().copied().unwrap_or(1);
    let behaviour = Behaviour {
        slots,
        each: Duration::from_millis(args.sleep_ms),
        claim: None,
        fails: args.fail,
        dies: args.die,
        engines: sim_core::engine_digests().iter().map(|(_, digest)| digest.0.to_vec()).collect(),
        engine: job.engine_digest().0.to_vec(),
    };
    let mut fleet = Fleet::default();
    fleet.start(&host.url, workers, &behaviour).await?;
    let idle = if args.idle_seconds > 0 { Some(idle(&host, args.idle_seconds).await) } else { None };
    let mut lines = Vec::new();
    for (population, generations) in [(args.population, args.generations), (SMALL, SMALL_GENERATIONS)] {
        lines.push(line(&host, &fleet, job, population, generations, false).await?);
    }
    // The worst case: the sizes of ranges follow what workers say that evaluations take.
    let claim = Some(LONG);
    fleet.start(&host.url, workers, &Behaviour { claim, ..behaviour }).await?;
    for (population, generations) in [(args.population, args.generations.min(3)), (SMALL, SMALL_GENERATIONS)] {
        lines.push(line(&host, &fleet, job, population, generations, true).await?);
    }
    let deaths = fleet.tally.deaths.load(Ordering::Relaxed);
    let (job, machine) = (job.spec().name.clone(), Machine::here());
    Ok(View { job, machine, workers, slots, sleep_ms: args.sleep_ms, idle, lines, deaths })
}

/// Light workers.
#[derive(Default)]
struct Fleet {
    workers: JoinSet<()>,
    tally: Arc<Tally>,
}

impl Fleet {
    /// Starts so many and waits until all are connected; those there were before are gone.
    async fn start(&mut self, url: &Url, workers: u32, behaviour: &Behaviour) -> Result<(), Error> {
        self.workers.shutdown().await;
        let (behaviour, begun) = (Arc::new(behaviour.clone()), Instant::now());
        for number in 0..u64::from(workers) {
            self.workers.spawn(work(url.clone(), number, behaviour.clone(), self.tally.clone()));
        }
        while self.tally.connected.load(Ordering::Relaxed) < u64::from(workers) {
            if begun.elapsed() > CONNECT {
                let reason = format!(
                    "only {} of {workers} connect within {} s (is `ulimit -n` large enough?)",
                    self.tally.connected.load(Ordering::Relaxed),
                    CONNECT.as_secs()
                );
                return Err(Error::LocalWorker { reason });
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        Ok(())
    }
}

async fn idle(host: &Host, seconds: u32) -> Idle {
    let (begun, before) = (Instant::now(), host.cpu());
    tokio::time::sleep(Duration::from_secs(seconds.into())).await;
    let (seconds, cpu) = (begun.elapsed().as_secs_f64(), host.cpu() - before);
    Idle { seconds, cores: cpu.as_secs_f64() / seconds, peak_mib: host.peak_mib() }
}

async fn line(
    host: &Host,
    fleet: &Fleet,
    job: &Job,
    population: u32,
    generations: u32,
    alone: bool,
) -> Result<Line, Error> {
    // The first generation measures what an evaluation takes, and is not timed; with another one after those that
    // are, the search is not over before the job is cancelled.
    let job = swarm(job, population, generations + 2)?;
    let assignments = || fleet.tally.assignments.load(Ordering::Relaxed);
    let (mut seals, mut before) = (Vec::new(), (assignments(), host.cpu()));
    let mut client = Client::connect(&host.url).await?;
    let request_id = format!("{}-{alone}", job.digest().short());
    let request = v1::SubmitJobRequest { request_id, job_toml: job.to_toml(), priority: 0 };
    let (submitted, _) = client.submit(request).await?;
    let lost = |client: &Client, status| client.error(&status, Some(&submitted.id));
    let mut events = client.watch(&submitted.id, 0).await.map_err(|status| lost(&client, status))?;
    while seals.len() <= generations as usize {
        let next = tokio::time::timeout(PATIENCE, events.message()).await;
        let stuck = || Error::LocalCoordinator { reason: format!("nothing happened for {} s", PATIENCE.as_secs()) };
        match next.map_err(|_| stuck())?.map_err(|status| lost(&client, status))? {
            Some(event) => {
                if let Some(Event::GenerationSealed(_)) = event.event {
                    seals.push(Instant::now());
                }
                if seals.len() == 1 && matches!(event.event, Some(Event::GenerationSealed(_))) {
                    before = (assignments(), host.cpu());
                }
            }
            None => {
                let job = client.get(&submitted.id).await?.0;
                let how = format!("ended before its generations: {}", job.reason);
                return Err(Error::JobEnded { name: job.name, id: job.id, how });
            }
        }
    }
    let (assignments, cpu) = (assignments() - before.0, host.cpu() - before.1);
    client.cancel(&submitted.id).await?;
    let each: Vec<f64> = seals.windows(2).map(|w| 1e3 * (w[1] - w[0]).as_secs_f64()).collect();
    let spread = Spread { median: median(&each).unwrap_or(f64::NAN), p95: quantile(&each, 0.95).unwrap_or(f64::NAN) };
    Ok(Line {
        population,
        generations,
        alone,
        assignments,
        candidate_us: 1e3 * spread.median / f64::from(population),
        generation_ms: spread,
        coordinator_us: 1e6 * cpu.as_secs_f64() / f64::from(population * generations),
        peak_mib: host.peak_mib(),
    })
}

/// The job with a swarm of so many particles.
fn swarm(job: &Job, population: u32, generations: u32) -> Result<Job, Error> {
    let refused = |source| Error::Invalid { file: "the job to dispatch".to_owned(), source };
    let mut spec: JobSpec = job.spec().clone();
    let swarm = format!("kind = \"pso\"\nparticles = {population}\ngenerations = {generations}");
    spec.optimiser = toml::from_str(&swarm).map_err(|e: toml::de::Error| refused(e.into()))?;
    Job::new(spec).map_err(refused)
}

fn text(view: &View) -> String {
    let rows: Vec<Vec<String>> = view
        .lines
        .iter()
        .map(|l| {
            vec![
                console::count(l.population.into()),
                l.generations.to_string(),
                if l.alone { "one candidate" } else { "as sized" }.to_owned(),
                console::count(l.assignments),
                format!("{:.2}", l.generation_ms.median),
                format!("{:.2}", l.generation_ms.p95),
                format!("{:.1}", l.candidate_us),
                format!("{:.1}", l.coordinator_us),
                l.peak_mib.map_or("–".to_owned(), |m| format!("{m:.1}")),
            ]
        })
        .collect();
    let head = [
        "candidates",
        "generations",
        "an assignment",
        "assignments",
        "generation, median ms",
        "95 % ms",
        "µs / candidate",
        "coordinator CPU µs",
        "peak MiB",
    ];
    let mut text = format!(
        "{} ({}), {} workers of {} slots\n{}",
        view.job,
        view.machine.line(),
        console::count(view.workers.into()),
        view.slots,
        table(&head, &rows)
    );
    if let Some(Idle { seconds, cores, peak_mib }) = &view.idle {
        let peak = peak_mib.map_or("–".to_owned(), |m| format!("{m:.1}"));
        text += &format!("\n\nIdle for {seconds:.0} s: {cores:.3} cores, peak {peak} MiB.");
    }
    if view.deaths > 0 {
        text += &format!("\n{} light workers died.", console::count(view.deaths));
    }
    text
}
