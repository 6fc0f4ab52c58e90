//! One line of the table: a fresh coordinator with its workers and jobs, measured after a warm-up.

use super::super::dispatch::Scratch;
use super::host::{self, Host};
use super::ideal::{self, FleetSize};
use super::light::{Behaviour, work};
use super::scrape::Numbers;
use super::tally::Tally;
use super::times::Times;
use crate::arguments::BenchFleet;
use crate::client::{Client, Url};
use crate::error::Error;
use crate::values::Generation;
use proto::v1;
use serde::Serialize;
use sim_core::base::statistics::{median, quantile};
use sim_core::job::JobSpec;
use sim_core::physics::EngineChoice;
use sim_core::problem::{Checked, Unprepared};
use sim_core::procedure::preparing::PreparationOutcome;
use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tokio::task::JoinSet;

/// Time limit for all workers to connect.
const CONNECT: Duration = Duration::from_secs(120);
/// Workers that connect at the same time. The coordinator limits the sessions that have not sent Hello yet.
const AT_ONCE: u32 = 500;
/// Number of watchers that share a connection.
const SHARED_BY: usize = 100;

/// Measurement of one line.
#[derive(Serialize)]
pub struct Line {
    /// Number of light workers.
    pub workers: u32,
    /// Slots of all workers together.
    pub slots: u64,
    /// Number of jobs that run side by side.
    pub jobs: u32,
    /// Measuring time, s.
    pub seconds: f64,
    /// Evaluations committed in the measuring time.
    pub evaluations: u64,
    /// Slot time of evaluations that counted, over all slots and seconds.
    pub efficiency: f64,
    /// Efficiency of the same times if assigning costs nothing; `null` where evaluations take no time.
    pub ideal: Option<f64>,
    /// Candidates of the current generations of all jobs over slots, at most 1.
    pub fill: f64,
    /// Number of sealed generations.
    pub generations: u64,
    /// Time from seal to seal, ms.
    pub generation_ms: Option<Spread>,
    /// Part of `generation_ms` that the slowest chain did not need, ms.
    pub overhead_ms: Option<Spread>,
    /// Number of evaluated ranges.
    pub ranges: u64,
    /// Transactions of the store per second.
    pub commits_per_s: f64,
    /// Changes in these transactions per second: results of a range, a sealed generation.
    pub changes_per_s: f64,
    /// Mean time of a transaction, ms.
    pub commit_ms: Option<f64>,
    /// CPU time of the coordinator over time; 1 is one core.
    pub coordinator_cores: f64,
    /// CPU time of the light workers and watchers over time. Its sum with the coordinator's is limited by the machine's
    /// cores.
    pub workers_cores: f64,
    /// CPU time of the coordinator per evaluation, µs.
    pub coordinator_us: Option<f64>,
    /// Peak resident set of the coordinator so far, MiB.
    pub peak_mib: Option<f64>,
    /// Number of workers that crashed.
    pub deaths: u64,
    /// Number of workers that the coordinator treated as lost.
    pub workers_lost: u64,
    /// Number of leases that ended because their worker was lost.
    pub leases_lost: u64,
}

/// Median and 95th percentile of values.
#[derive(Serialize)]
pub struct Spread {
    /// Value that half of the values are below.
    pub median: f64,
    /// Value that 95 % of the values are below.
    pub p95: f64,
}

impl Spread {
    fn of(values: &[f64]) -> Option<Self> {
        Some(Self { median: median(values)?, p95: quantile(values, 0.95)? })
    }
}

/// Counters at a point in time.
struct Moment {
    at: Instant,
    useful: f64,
    coordinator: Duration,
    own: Duration,
    numbers: Numbers,
    deaths: u64,
    ranges: u64,
}

impl Moment {
    async fn now(host: &Host, tally: &Tally) -> Result<Self, Error> {
        let numbers = host.numbers().await?;
        let at = Instant::now();
        Ok(Self {
            at,
            useful: tally.usage().useful(at),
            coordinator: host.cpu(),
            own: host::cpu("self"),
            numbers,
            deaths: tally.deaths.load(Ordering::Relaxed),
            ranges: tally.ranges.load(Ordering::Relaxed),
        })
    }
}

/// Returns the result of the preparation of each job of a fleet. It is the same, as all jobs have the same robot and
/// physics.
pub fn prepared(job: &Checked) -> Result<Vec<u8>, Error> {
    match variant(job, 1, 0)?.prepare(&|| false) {
        Ok(preparation) => Ok(PreparationOutcome::Prepared(preparation).encode()),
        Err(Unprepared::Refused(source)) => Err(Error::Invalid { file: "the job of the fleet".to_owned(), source }),
        Err(Unprepared::Stopped) => Err(Error::Interrupted { hint: String::new() }),
    }
}

/// Measures one line. `prepared` is the result of [`prepared`]; the last argument is (workers, jobs).
pub async fn measure(
    args: &BenchFleet,
    job: &Checked,
    prepared: &[u8],
    (workers, jobs): (u32, u32),
) -> Result<Line, Error> {
    #[cfg(unix)]
    coordinator::open_files::raise();
    let scratch = Scratch::new()?;
    let host = Host::start(&scratch.0)?;
    let times = Times { median: args.median, sigma: args.sigma };
    let all: Vec<Checked> = (0..jobs).map(|n| variant(job, args.population, n)).collect::<Result<_, _>>()?;
    let engine = all.first().unwrap_or(job).engine_digest();
    let behaviour = Arc::new(Behaviour {
        slots: args.slots,
        times,
        claim: args.claim(),
        fails: args.fail,
        lifetime: args.lifetime(),
        seed: job.spec().seed,
        engines: sim_core::engines::engine_digests().iter().map(|(_, digest)| digest.0.to_vec()).collect(),
        engine: engine.0.to_vec(),
        prepared: prepared.to_vec(),
    });
    let tally = Arc::new(Tally::new());
    let _fleet = connect(&host.url, workers, &behaviour, &tally).await?;

    let mut watched = JoinSet::new();
    let begun = Instant::now();
    for share in all.chunks(SHARED_BY) {
        let client = Client::connect(&host.url).await?;
        for job in share {
            watched.spawn(watch(client.clone(), job.clone(), tally.clone()));
        }
    }
    let seconds = |s: u32| Duration::from_secs(s.into());
    pass(&mut watched, seconds(args.warm_up)).await?;
    let from = Moment::now(&host, &tally).await?;
    pass(&mut watched, seconds(args.seconds)).await?;
    let to = Moment::now(&host, &tally).await?;

    let setting = FleetSize { slots: u64::from(workers) * u64::from(args.slots), jobs, population: args.population };
    let window = from.at - begun..to.at - begun;
    let seeds: Vec<u64> = all.iter().map(|job| job.spec().seed).collect();
    let time = |job: u32, generation, candidate| times.of(seeds[job as usize], generation, candidate);
    let ideal = (args.median > 0.0).then(|| ideal::efficiency(setting, window, time));
    let sealed = tally.chains().sealed(from.at, to.at);
    let ms =
        |of: fn(&super::chains::Sealed) -> f64| Spread::of(&sealed.iter().map(|s| 1e3 * of(s)).collect::<Vec<_>>());
    let (seconds, counted) = ((to.at - from.at).as_secs_f64(), to.numbers.since(from.numbers));
    let coordinator = (to.coordinator - from.coordinator).as_secs_f64();
    Ok(Line {
        workers,
        slots: setting.slots,
        jobs,
        seconds,
        evaluations: counted.evaluations as u64,
        efficiency: (to.useful - from.useful) / (seconds * setting.slots as f64),
        ideal,
        fill: setting.fill(),
        generations: counted.generations as u64,
        generation_ms: ms(|s| s.took),
        overhead_ms: ms(|s| s.overhead),
        ranges: to.ranges - from.ranges,
        commits_per_s: counted.commits / seconds,
        changes_per_s: counted.changes / seconds,
        commit_ms: (counted.commits > 0.0).then(|| 1e3 * counted.commit_seconds / counted.commits),
        coordinator_cores: coordinator / seconds,
        workers_cores: (to.own - from.own).as_secs_f64() / seconds,
        coordinator_us: (counted.evaluations > 0.0).then(|| 1e6 * coordinator / counted.evaluations),
        peak_mib: host.peak_mib(),
        deaths: to.deaths - from.deaths,
        workers_lost: counted.workers_lost as u64,
        leases_lost: counted.leases_lost as u64,
    })
}

/// Starts `workers` light workers and waits until they are connected.
async fn connect(
    url: &Url,
    workers: u32,
    behaviour: &Arc<Behaviour>,
    tally: &Arc<Tally>,
) -> Result<JoinSet<()>, Error> {
    let (mut fleet, begun) = (JoinSet::new(), Instant::now());
    for number in 0..workers {
        fleet.spawn(work(url.clone(), number, behaviour.clone(), tally.clone()));
        let (started, last) = (number + 1, number + 1 == workers);
        while (last || started.is_multiple_of(AT_ONCE)) && tally.sessions.load(Ordering::Relaxed) < u64::from(started) {
            if begun.elapsed() > CONNECT {
                let reason = format!(
                    "only {} of {workers} workers connected within {} s: check that `ulimit -n` allows enough open files",
                    tally.sessions.load(Ordering::Relaxed),
                    CONNECT.as_secs()
                );
                return Err(Error::LocalWorker { reason });
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }
    Ok(fleet)
}

/// Waits for `time`, or returns the error of a job that ends earlier.
async fn pass(watched: &mut JoinSet<Result<Infallible, Error>>, time: Duration) -> Result<(), Error> {
    tokio::select! {
        () = tokio::time::sleep(time) => Ok(()),
        Some(ended) = watched.join_next() => match ended {
            Ok(Err(error)) => Err(error),
            Err(error) => Err(Error::LocalCoordinator { reason: error.to_string() }),
        },
    }
}

/// Submits a job and records its seals until an error. The job has more generations than the measurement lasts.
async fn watch(mut client: Client, job: Checked, tally: Arc<Tally>) -> Result<Infallible, Error> {
    let request_id = job.digest().to_string();
    let request = v1::SubmitJobRequest { request_id, job_toml: job.to_toml(), priority: 0 };
    let (submitted, _) = client.submit(request).await?;
    let lost = |client: &Client, status| client.error(&status, Some(&submitted.id));
    let mut events = client.watch(&submitted.id, 0).await.map_err(|status| lost(&client, status))?;
    while let Some(event) = events.message().await.map_err(|status| lost(&client, status))? {
        if let Some(sealed) = Generation::sealed(&event) {
            tally.chains().seal(job.spec().seed, sealed.generation, Instant::now());
        }
    }
    let ended = client.get(&submitted.id).await?.0;
    let how = format!("ended before it was measured: {}", ended.reason);
    Err(Error::JobEnded { name: ended.name, id: ended.id, how })
}

/// Returns the job with another seed, a swarm of `population` particles that never ends, and an engine that evaluates
/// candidates one by one.
fn variant(job: &Checked, population: u32, number: u32) -> Result<Checked, Error> {
    let refused = |source| Error::Invalid { file: "the job of the fleet".to_owned(), source };
    let mut spec: JobSpec = job.spec().clone();
    spec.seed = spec.seed.wrapping_add(number.into()) & i64::MAX as u64;
    spec.physics.engine = EngineChoice::Rapier;
    let generations = sim_core::base::limits::MAX_GENERATIONS;
    let swarm = format!("kind = \"pso\"\nparticles = {population}\ngenerations = {generations}");
    spec.optimiser = Some(toml::from_str(&swarm).map_err(|e: toml::de::Error| refused(e.into()))?);
    Checked::new(spec).map_err(refused)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fleet_jobs_differ_only_in_seed_and_never_end() {
        let toml = "name = \"x\"\nseed = 5\nrobot = \"quadropod\"\nenvironment = \"empty\"\n[gaits]\ncount = 1\n\
                    [fitness]\nkind = \"coverage\"\n[optimiser]\nkind = \"ga\"\n";
        let job = Checked::from_toml(toml).unwrap();
        let [a, b] = [0, 1].map(|number| variant(&job, 7, number).unwrap());
        assert_eq!((a.spec().seed, b.spec().seed), (5, 6));
        assert_ne!(a.digest(), b.digest());
        assert_eq!((a.optimiser_spec().population(), a.candidates_at_once()), (7, 1));
        assert_eq!(a.optimiser_spec().generations(), sim_core::base::limits::MAX_GENERATIONS);
        let same = JobSpec { seed: 5, ..b.spec().clone() };
        assert_eq!(Checked::new(same).unwrap().digest(), a.digest());
    }
}
