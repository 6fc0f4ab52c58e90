//! What happens to the processes.

use cluster_tests::proxy::{Direction, Proxy};
use cluster_tests::sandbox::{PATIENCE, Process, Sandbox};
use proto::v1::ListWorkersRequest;
use std::time::{Duration, Instant};

const WORKERS: usize = 6;
const EVERY: Duration = Duration::from_secs(2);
const COORDINATOR_EVERY: Duration = Duration::from_secs(20);
/// What a worker is told to add to each candidate, so that jobs last without a core.
const SLOW: &str = "slow@ms=60";

/// What is wrong with a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    Killed,
    Drains,
    Stopped,
    Network,
}

struct Subject {
    proxy: Proxy,
    process: Process,
    trouble: Option<(Trouble, Instant)>,
}

pub struct Chaos {
    sandbox: Sandbox,
    coordinator: Option<Process>,
    workers: Vec<Subject>,
    random: u64,
    next: Instant,
    next_coordinator: Instant,
    coordinator_back: Instant,
    start: Instant,
    tally: [u32; 7],
}

const NAMES: [&str; 7] =
    ["kills", "drains", "stops", "partitions", "cuts", "slow networks", "kills of the coordinator"];

impl Chaos {
    pub fn start(mut sandbox: Sandbox, seed: u64) -> Self {
        let coordinator = sandbox.coordinator();
        let workers = (0..WORKERS)
            .map(|_| {
                let proxy = Proxy::to(&sandbox.url());
                Subject { process: worker(&sandbox, &proxy), proxy, trouble: None }
            })
            .collect();
        let now = Instant::now();
        Self {
            sandbox,
            coordinator: Some(coordinator),
            workers,
            random: seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1,
            next: now + EVERY,
            next_coordinator: now + COORDINATOR_EVERY,
            coordinator_back: now,
            start: now,
            tally: [0; 7],
        }
    }

    pub fn url(&self) -> String {
        self.sandbox.url()
    }

    pub fn tally(&self) -> String {
        let told: Vec<String> = self.tally.iter().zip(NAMES).map(|(count, name)| format!("{count} {name}")).collect();
        told.join(", ")
    }

    /// Repairs what was broken long enough, and breaks something if it is time.
    pub fn go_on(&mut self) -> Result<(), String> {
        let now = Instant::now();
        if self.coordinator.is_none() && now >= self.coordinator_back {
            self.coordinator = Some(self.sandbox.coordinator());
            self.say("the coordinator is back");
        }
        if self.coordinator.as_mut().is_some_and(Process::has_ended) {
            return Err("the coordinator ended by itself".to_owned());
        }
        for at in 0..WORKERS {
            let due = self.workers[at].trouble.is_some_and(|(_, until)| now >= until);
            if due {
                self.repair(at);
            }
            let fine = !matches!(self.workers[at].trouble, Some((Trouble::Killed | Trouble::Drains, _)));
            if fine && self.workers[at].process.has_ended() {
                return Err(format!("worker {at} ended by itself"));
            }
        }
        if now >= self.next {
            self.next += EVERY;
            self.strike(now);
        }
        if now >= self.next_coordinator {
            self.next_coordinator += COORDINATOR_EVERY;
            if let Some(coordinator) = self.coordinator.take() {
                coordinator.kill_9();
                self.tally[6] += 1;
                self.coordinator_back = now + self.time(0, 2000);
                self.say("the coordinator is killed");
            }
        }
        Ok(())
    }

    /// Repairs everything.
    pub fn calm_down(&mut self) {
        if self.coordinator.is_none() {
            self.coordinator = Some(self.sandbox.coordinator());
        }
        (0..WORKERS).for_each(|at| self.repair(at));
    }

    pub async fn assert_slots_are_free(&self) -> Result<(), String> {
        let start = Instant::now();
        loop {
            let answer = self.sandbox.client().list_workers(ListWorkersRequest {}).await;
            let workers = answer.map_err(|e| e.to_string())?.into_inner().workers;
            if workers.len() == WORKERS && workers.iter().all(|w| w.busy == 0) {
                return Ok(());
            }
            if start.elapsed() > PATIENCE {
                return Err(format!("slots are held, or workers lost: {workers:?}"));
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    fn strike(&mut self, now: Instant) {
        let at = (self.number() % WORKERS as u64) as usize;
        if self.workers[at].trouble.is_some() {
            // It has enough to bear; another time.
            self.next = now;
            return;
        }
        let until = now + self.time(300, 6000);
        let what = self.number() % 10;
        let delay = self.time(5, 200);
        let subject = &mut self.workers[at];
        let (trouble, kind, told) = match what {
            0..=2 => {
                subject.process.signal("KILL");
                (Trouble::Killed, 0, "is killed")
            }
            3 => {
                subject.process.signal("TERM");
                (Trouble::Drains, 1, "drains")
            }
            4..=5 => {
                subject.process.signal("STOP");
                (Trouble::Stopped, 2, "is stopped")
            }
            6 => {
                subject.proxy.block(Direction::Up, true);
                (Trouble::Network, 3, "can't be heard")
            }
            7 => {
                subject.proxy.block(Direction::Down, true);
                (Trouble::Network, 3, "hears nothing")
            }
            8 => {
                subject.proxy.cut();
                (Trouble::Network, 4, "is cut off for a moment")
            }
            _ => {
                subject.proxy.slow(delay, 50_000);
                (Trouble::Network, 5, "has a slow network")
            }
        };
        subject.trouble = Some((trouble, until));
        self.tally[kind] += 1;
        self.say(&format!("worker {at} {told}"));
    }

    fn repair(&mut self, at: usize) {
        let Self { sandbox, workers, .. } = self;
        let subject = &mut workers[at];
        match subject.trouble.take() {
            Some((Trouble::Killed | Trouble::Drains, _)) => subject.process = worker(sandbox, &subject.proxy),
            Some((Trouble::Stopped, _)) => subject.process.signal("CONT"),
            Some((Trouble::Network, _)) => subject.proxy.heal(),
            None => {}
        }
    }

    fn say(&self, what: &str) {
        println!("{:7.1} s: {what}", self.start.elapsed().as_secs_f64());
    }

    /// xorshift64*: any seed gives the same disturbances again, though not at the same moments of the jobs.
    fn number(&mut self) -> u64 {
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        self.random.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 32
    }

    fn time(&mut self, least_ms: u64, most_ms: u64) -> Duration {
        Duration::from_millis(least_ms + self.number() % (most_ms - least_ms))
    }
}

fn worker(sandbox: &Sandbox, proxy: &Proxy) -> Process {
    Process::start(sandbox.worker_command(&proxy.url(), 1).args(["--grace", "1"]).env("EVOGAIT_FAULT", SLOW))
}
