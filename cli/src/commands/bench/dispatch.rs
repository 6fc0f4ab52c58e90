//! `evogait bench dispatch`: cost of dispatching evaluations. Coordinator and worker are connected over a loopback
//! connection, as in `evogait run`.
//!
//! Each line of the table is measured in a process of its own, so its peak memory is not mixed with that of other
//! lines.

use super::subject::Machine;
use crate::arguments::{self, BenchDispatch, Load};
use crate::client::Client;
use crate::console::{self, table};
use crate::error::Error;
use crate::load;
use crate::local::Local;
use crate::progress::Pieces;
use proto::v1;
use proto::v1::job_event::Event;
use serde::{Deserialize, Serialize};
use sim_core::job::JobSpec;
use sim_core::problem::Checked;
use sim_core::problem::Job;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use study::cost::{self, Budget};

/// A job of almost no work: one gait of a tenth of a second, one iteration.
const TRIVIAL: &str = r#"
name = "trivial"
robot = "quadropod"
environment = "empty"
[gaits]
count = 1
duration = 0.1
[planner]
iterations = 1
[fitness]
kind = "coverage"
[optimiser]
kind = "pso"
"#;

/// Time limit for the worker to connect.
const CONNECT: Duration = Duration::from_secs(30);

#[derive(Serialize)]
struct View {
    job: String,
    machine: Machine,
    lines: Vec<Line>,
    /// Time of a trivial evaluation on one thread without coordinator and worker, µs.
    #[serde(skip_serializing_if = "Option::is_none")]
    direct_us: Option<f64>,
    /// Time that coordinator, store, connection and worker add to a trivial evaluation, with one slot, µs.
    #[serde(skip_serializing_if = "Option::is_none")]
    overhead_us: Option<f64>,
    /// Peak memory of one more slot, MiB, for the loads job and plain; from the fewest to the most slots.
    memory_per_slot: Vec<Memory>,
}

#[derive(Serialize)]
struct Memory {
    load: Load,
    mib: f64,
}

/// Measurement of one process.
#[derive(Clone, Serialize, Deserialize)]
struct Line {
    load: Load,
    slots: u32,
    evaluations: u32,
    /// Time from the end of the preparation to the seal of the generation, s.
    seconds: f64,
    /// Peak resident set, MiB; `null` if the system does not report it.
    peak_mib: Option<f64>,
    /// Evaluations per second and slot, relative to those of the line with the fewest slots.
    #[serde(default)]
    efficiency: Option<f64>,
}

impl Line {
    fn rate(&self) -> f64 {
        f64::from(self.evaluations) / self.seconds
    }
}

/// Measures all lines and prints them.
pub fn run(args: BenchDispatch, quiet: bool) -> Result<(), Error> {
    let slots = if args.slots.is_empty() { doublings(arguments::cores()) } else { args.slots.clone() };
    let job = load::checked(&args.file.clone().into())?;
    load::must_evolve(&job, &args.file.job)?;
    if let Some(load) = args.line {
        let line = measure(&job, load, evaluations(&args, load), slots[0])?;
        return console::say_json(&line);
    }
    let loads = [Load::Job, Load::Plain, Load::Trivial].into_iter().filter(|l| evaluations(&args, *l) > 0);
    let planned: Vec<(Load, u32)> = loads.flat_map(|load| slots.iter().map(move |n| (load, *n))).collect();
    let progress = Pieces::new("lines", planned.len() as u64, quiet);
    let mut lines = Vec::new();
    for (load, slots) in planned {
        lines.push(in_a_process(&args, load, slots)?);
        progress.one_done();
    }
    drop(progress);
    compare(&mut lines);
    let direct_us = (args.trivial > 0).then(|| direct(args.trivial)).transpose()?;
    let dispatched = lines.iter().find(|l| l.load == Load::Trivial && l.slots == 1);
    let overhead_us = dispatched.zip(direct_us).map(|(line, direct)| 1e6 / line.rate() - direct);
    let a_slot = |load| Some(Memory { load, mib: per_slot(&lines, load)? });
    let memory = [Load::Job, Load::Plain].into_iter().filter_map(a_slot).collect();
    let view = View {
        job: job.spec().name.clone(),
        machine: Machine::here(),
        memory_per_slot: memory,
        lines,
        direct_us,
        overhead_us,
    };
    if args.json { console::say_json(&view) } else { console::say(&text(&view)) }
}

fn evaluations(args: &BenchDispatch, load: Load) -> u32 {
    match load {
        Load::Job => args.evaluations,
        Load::Plain => args.plain,
        Load::Trivial => args.trivial,
    }
}

/// Returns 1, 2, 4, … below the number of cores, and the number itself.
fn doublings(cores: u32) -> Vec<u32> {
    let powers = std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n < cores);
    powers.chain([cores]).collect()
}

/// Runs this program in a new process for one line.
fn in_a_process(args: &BenchDispatch, load: Load, slots: u32) -> Result<Line, Error> {
    let failed = |reason: String| Error::LocalWorker { reason };
    let program = std::env::current_exe().map_err(|e| failed(e.to_string()))?;
    let mut command = Command::new(program);
    command.args(["bench", "dispatch", &args.file.job, "--json", "--quiet", "--slots", &slots.to_string()]);
    command.args(["--evaluations", &args.evaluations.to_string(), "--plain", &args.plain.to_string()]);
    command.args(["--trivial", &args.trivial.to_string(), "--line", word(load)]);
    if let Some(seed) = args.file.seed {
        command.args(["--seed", &seed.to_string()]);
    }
    let output = command.output().map_err(|e| failed(e.to_string()))?;
    if !output.status.success() {
        return Err(failed(String::from_utf8_lossy(&output.stderr).trim().to_owned()));
    }
    serde_json::from_slice(&output.stdout).map_err(|e| failed(e.to_string()))
}

fn word(load: Load) -> &'static str {
    match load {
        Load::Job => "job",
        Load::Plain => "plain",
        Load::Trivial => "trivial",
    }
}

fn measure(job: &Checked, load: Load, evaluations: u32, slots: u32) -> Result<Line, Error> {
    let job = one_generation(job, load, evaluations)?;
    let scratch = Scratch::new()?;
    let seconds = super::super::with_runtime(dispatched(&job, &scratch.0, slots))?;
    Ok(Line { load, slots, evaluations, seconds, peak_mib: peak_mib("self"), efficiency: None })
}

/// Returns a job with one generation of this number of candidates.
fn one_generation(job: &Checked, load: Load, evaluations: u32) -> Result<Checked, Error> {
    let refused = |source| Error::Invalid { file: "the job to dispatch".to_owned(), source };
    let mut spec: JobSpec = match load {
        Load::Trivial => toml::from_str(TRIVIAL).map_err(|e| refused(e.into()))?,
        Load::Job | Load::Plain => job.spec().clone(),
    };
    if load == Load::Plain {
        spec.planner.reuse_tolerance = 0.0;
    }
    let swarm = format!("kind = \"pso\"\nparticles = {evaluations}\ngenerations = 1");
    spec.optimiser = Some(toml::from_str(&swarm).map_err(|e| refused(e.into()))?);
    Checked::new(spec).map_err(refused)
}

/// Returns the time from the end of a job's preparation to the seal of its only generation, s.
async fn dispatched(job: &Checked, folder: &Path, slots: u32) -> Result<f64, Error> {
    let mut local = Local::start(&folder.join("store.sqlite"), slots).await?;
    let url = local.url().clone();
    let measured = tokio::select! {
        measured = generation(job, &url) => measured,
        error = local.broken() => Err(error),
    };
    let stopped = local.stop().await;
    measured.and_then(|seconds| stopped.map(|()| seconds))
}

async fn generation(job: &Checked, url: &crate::client::Url) -> Result<f64, Error> {
    let mut client = Client::connect(url).await?;
    let begun = Instant::now();
    while client.workers().await?.is_empty() {
        if begun.elapsed() > CONNECT {
            return Err(Error::LocalWorker {
                reason: format!("the worker did not connect within {} s", CONNECT.as_secs()),
            });
        }
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    let request_id = job.digest().to_string();
    let request = v1::SubmitJobRequest { request_id, job_toml: job.to_toml(), priority: 0 };
    let (submitted, _) = client.submit(request).await?;
    let lost = |client: &Client, status| client.error(&status, Some(&submitted.id));
    let mut events = client.watch(&submitted.id, 0).await.map_err(|status| lost(&client, status))?;
    let mut prepared = None;
    let seconds = loop {
        match events.message().await.map_err(|status| lost(&client, status))?.map(|event| event.event) {
            Some(Some(Event::RoundSealed(sealed))) => match prepared {
                None => prepared = Some(Instant::now()),
                Some(started) if sealed.phase == "searching" => break started.elapsed().as_secs_f64(),
                Some(_) => {}
            },
            Some(_) => {}
            None => {
                return Err(Error::JobEnded {
                    name: job.spec().name.clone(),
                    id: submitted.id.clone(),
                    how: "ended before its generation".to_owned(),
                });
            }
        }
    };
    // The report is not part of the measurement.
    client.cancel(&submitted.id).await?;
    Ok(seconds)
}

/// Returns the time of a trivial evaluation on this thread, µs.
fn direct(evaluations: u32) -> Result<f64, Error> {
    let refused = |source| Error::Invalid { file: "the trivial job".to_owned(), source };
    let job = Job::from_toml(TRIVIAL).map_err(refused)?;
    let budget = Budget { evaluations, time: Duration::MAX, first: Duration::MAX };
    let cost = cost::measure(&job, cost::at_once(&job, arguments::cores()), budget, &|| ());
    Ok(1e6 * cost.total.wall / f64::from(cost.evaluations))
}

fn compare(lines: &mut [Line]) {
    let firsts: Vec<Line> = lines.to_vec();
    for line in lines {
        let same = firsts.iter().filter(|l| l.load == line.load);
        if let Some(fewest) = same.min_by_key(|l| l.slots) {
            let a_slot = |l: &Line| l.rate() / f64::from(l.slots);
            line.efficiency = Some(a_slot(line) / a_slot(fewest));
        }
    }
}

/// Returns the peak memory of each slot beyond the fewest, MiB.
fn per_slot(lines: &[Line], load: Load) -> Option<f64> {
    let of = || lines.iter().filter(|l| l.load == load);
    let (fewest, most) = (of().min_by_key(|l| l.slots)?, of().max_by_key(|l| l.slots)?);
    let slots = most.slots - fewest.slots;
    (slots > 0).then_some((most.peak_mib? - fewest.peak_mib?) / f64::from(slots))
}

/// Returns the peak resident set of a process, MiB; `self` is this process.
pub fn peak_mib(process: &str) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kib| kib / 1024.0)
}

/// Temporary folder that is removed on drop.
pub struct Scratch(pub PathBuf);

impl Scratch {
    /// Creates an empty folder.
    pub fn new() -> Result<Self, Error> {
        let path = std::env::temp_dir().join(format!("evogait-bench-{}", std::process::id()));
        fs::create_dir_all(&path).map_err(|e| Error::write(&path, e))?;
        Ok(Self(path))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // If this fails, some small temporary files remain.
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn text(view: &View) -> String {
    let rows: Vec<Vec<String>> = view
        .lines
        .iter()
        .map(|l| {
            vec![
                word(l.load).to_owned(),
                l.slots.to_string(),
                console::count(l.evaluations.into()),
                format!("{:.2}", l.seconds),
                console::score(l.rate()),
                l.efficiency.map_or("–".to_owned(), |e| format!("{:.0} %", 100.0 * e)),
                l.peak_mib.map_or("–".to_owned(), |m| format!("{m:.1}")),
            ]
        })
        .collect();
    let head = ["load", "slots", "evaluations", "s", "evaluations / s", "efficiency", "peak MiB"];
    let mut text = format!("{} ({})\n{}", view.job, view.machine.line(), table(&head, &rows));
    if let (Some(direct), Some(overhead)) = (view.direct_us, view.overhead_us) {
        text +=
            &format!("\n\nA trivial evaluation takes {direct:.0} µs; dispatching adds {overhead:.0} µs (one slot).");
    }
    for Memory { load, mib } in &view.memory_per_slot {
        text += &format!("\nOne more slot takes {mib:.1} MiB ({}).", word(*load));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(slots: u32, seconds: f64, peak: f64) -> Line {
        Line { load: Load::Job, slots, evaluations: 100, seconds, peak_mib: Some(peak), efficiency: None }
    }

    #[test]
    fn efficiency_is_relative_to_fewest_slots() {
        let mut lines = [line(1, 8.0, 30.0), line(2, 4.0, 33.0), line(4, 4.0, 39.0)];
        compare(&mut lines);
        assert_eq!(lines.each_ref().map(|l| l.efficiency), [Some(1.0), Some(1.0), Some(0.5)]);
        assert_eq!(per_slot(&lines, Load::Job), Some(3.0));
        assert_eq!((per_slot(&lines[..1], Load::Job), per_slot(&lines, Load::Plain)), (None, None));
    }

    #[test]
    fn slot_counts_double_up_to_core_count() {
        assert_eq!((doublings(1), doublings(2), doublings(6)), (vec![1], vec![1, 2], vec![1, 2, 4, 6]));
    }

    #[test]
    fn plain_load_is_one_generation_without_reuse() {
        let job = Checked::from_toml(TRIVIAL).unwrap();
        let plain = one_generation(&job, Load::Plain, 7).unwrap();
        assert_eq!((plain.optimiser_spec().population(), plain.optimiser_spec().generations()), (7, 1));
        assert_eq!(plain.spec().planner.reuse_tolerance, 0.0);
        assert_eq!(plain.robot_spec(), job.robot_spec());
    }
}
