//! Random disturbances of the worker processes and their networks.

use crate::coordinators::Coordinators;
use crate::random::Random;
use cluster_tests::proxy::{Direction, Proxy};
use cluster_tests::sandbox::{Process, TIMEOUT};
use proto::v1::ListWorkersRequest;
use proto::v1::job_service_client::JobServiceClient;
use std::time::{Duration, Instant};

const WORKERS: usize = 6;
const EVERY: Duration = Duration::from_secs(2);
/// Fault that makes a worker wait for each candidate, so that jobs take time without using a core.
const SLOW: &str = "slow@ms=60";

/// Current disturbance of a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    Killed,
    Drains,
    Stopped,
    Network,
}

struct Subject {
    /// Proxies to the coordinators, one each.
    network: Vec<Proxy>,
    process: Process,
    trouble: Option<(Trouble, Instant)>,
}

impl Subject {
    /// Disturbs the connections to all coordinators in the same way.
    fn everywhere(&self, what: impl Fn(&Proxy)) {
        self.network.iter().for_each(what);
    }
}

pub struct Chaos {
    coordinators: Coordinators,
    workers: Vec<Subject>,
    random: Random,
    next: Instant,
    start: Instant,
    tally: [u32; 6],
}

const NAMES: [&str; 6] = ["kills", "drains", "stops", "partitions", "cuts", "slow networks"];

impl Chaos {
    pub fn start(coordinators: Coordinators, seed: u64) -> Self {
        let workers = (0..WORKERS)
            .map(|_| {
                let network: Vec<Proxy> = coordinators.urls().iter().map(|url| Proxy::to(url)).collect();
                Subject { process: worker(&coordinators, &network), network, trouble: None }
            })
            .collect();
        let now = Instant::now();
        Self { coordinators, workers, random: Random::new(seed), next: now + EVERY, start: now, tally: [0; 6] }
    }

    pub fn tally(&self) -> String {
        let told: Vec<String> = self.tally.iter().zip(NAMES).map(|(count, name)| format!("{count} {name}")).collect();
        format!("{} of workers; {}", told.join(", "), self.coordinators.tally())
    }

    pub fn coordinators(&self) -> &Coordinators {
        &self.coordinators
    }

    /// Ends the disturbances that have lasted their time, and starts a new one if it is due.
    pub async fn go_on(&mut self) -> Result<(), String> {
        self.coordinators.go_on(&mut self.random).await?;
        let now = Instant::now();
        for at in 0..WORKERS {
            let due = self.workers[at].trouble.is_some_and(|(_, until)| now >= until);
            if due {
                self.repair(at);
            }
            let fine = !matches!(self.workers[at].trouble, Some((Trouble::Killed | Trouble::Drains, _)));
            if fine && self.workers[at].process.has_ended() {
                return Err(format!("worker {at} exited without being killed"));
            }
        }
        if now >= self.next {
            self.next += EVERY;
            self.strike(now);
        }
        Ok(())
    }

    /// Ends all disturbances.
    pub async fn calm_down(&mut self) -> Result<(), String> {
        (0..WORKERS).for_each(|at| self.repair(at));
        self.coordinators.calm_down(&mut self.random).await
    }

    pub async fn assert_slots_are_free(&self) -> Result<(), String> {
        let mut client = JobServiceClient::new(self.coordinators.dial().channel());
        let start = Instant::now();
        loop {
            // The first coordinator that receives the request may be a standby.
            let answer = client.list_workers(ListWorkersRequest {}).await.map(|answer| answer.into_inner().workers);
            if answer.as_ref().is_ok_and(|workers| workers.len() == WORKERS && workers.iter().all(|w| w.busy == 0)) {
                return Ok(());
            }
            if start.elapsed() > TIMEOUT {
                return Err(format!("all workers must be connected with no busy slot: {answer:?}"));
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    fn strike(&mut self, now: Instant) {
        let at = (self.random.number() % WORKERS as u64) as usize;
        if self.workers[at].trouble.is_some() {
            // This worker is disturbed already: try another one in the next step.
            self.next = now;
            return;
        }
        let until = now + self.random.time(300, 6000);
        let what = self.random.number() % 10;
        let delay = self.random.time(5, 200);
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
                subject.everywhere(|way| way.block(Direction::Up, true));
                (Trouble::Network, 3, "can't send to the coordinators")
            }
            7 => {
                subject.everywhere(|way| way.block(Direction::Down, true));
                (Trouble::Network, 3, "can't receive from the coordinators")
            }
            8 => {
                subject.everywhere(Proxy::cut);
                (Trouble::Network, 4, "loses its connections once")
            }
            _ => {
                subject.everywhere(|way| way.slow(delay, 50_000));
                (Trouble::Network, 5, "has a slow network")
            }
        };
        subject.trouble = Some((trouble, until));
        self.tally[kind] += 1;
        self.say(&format!("worker {at} {told}"));
    }

    fn repair(&mut self, at: usize) {
        let Self { coordinators, workers, .. } = self;
        let subject = &mut workers[at];
        match subject.trouble.take() {
            Some((Trouble::Killed | Trouble::Drains, _)) => subject.process = worker(coordinators, &subject.network),
            Some((Trouble::Stopped, _)) => subject.process.signal("CONT"),
            Some((Trouble::Network, _)) => subject.everywhere(Proxy::heal),
            None => {}
        }
    }

    fn say(&self, what: &str) {
        println!("{:7.1} s: {what}", self.start.elapsed().as_secs_f64());
    }
}

fn worker(coordinators: &Coordinators, network: &[Proxy]) -> Process {
    let urls: Vec<String> = network.iter().map(Proxy::url).collect();
    let mut command = coordinators.worker_command(&urls.join(","));
    Process::start(command.args(["--grace", "1"]).env("EVOGAIT_FAULT", SLOW))
}
