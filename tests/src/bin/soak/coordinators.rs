//! Coordinators of the soak test: one on SQLite, or two on PostgreSQL, one of them active and the other on standby.

use crate::random::Random;
use cluster_tests::certificates::{Certificates, closed};
use cluster_tests::postgres::{ask, beyond_a_network};
use cluster_tests::proxy::{Direction, Proxy};
use cluster_tests::sandbox::{Process, Sandbox};
use proto::credentials::Credentials;
use proto::dial::{Dial, FailoverChannel};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

/// Time between two disturbances of the active coordinator.
const EVERY: Duration = Duration::from_secs(20);
/// Option `--takeover-seconds`: time without contact to the database after which the standby takes over, s.
const TAKEOVER_SECONDS: &str = "3";
/// Limit on the time without an active coordinator, and on the time until a replaced one exits. Long, for a busy
/// machine.
const WITHIN: Duration = Duration::from_secs(60);
/// Time after which a coordinator that reaches the database again has detected whether it was replaced.
const SETTLED: Duration = Duration::from_secs(10);
/// Timeout of a health check.
const ANSWERED_WITHIN: Duration = Duration::from_secs(1);
/// Interval of the client's keepalive pings, which detect a hanging coordinator.
const KEEPALIVE: Duration = Duration::from_secs(1);
/// Exit code of a coordinator that was replaced.
const REPLACED: Option<i32> = Some(3);
/// Exit code of a coordinator that can't reach its database, so that it can't check whether it was replaced.
const OUT_OF_TOUCH: Option<i32> = Some(1);

/// Trigger that lets the database check the order of commits: within an epoch, each commit follows the one before.
/// Comparing results and events might miss a commit of an old epoch, because results that are computed twice are the
/// same.
const WATCH: &str = "
    CREATE TABLE public.late (what TEXT);
    CREATE FUNCTION public.watch() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN
        IF NOT (NEW.epoch = OLD.epoch AND NEW.commits - OLD.commits IN (0, 1)
                OR NEW.epoch = OLD.epoch + 1 AND NEW.commits = 0) THEN
            INSERT INTO public.late VALUES (format('epoch %s, commit %s after epoch %s, commit %s',
                NEW.epoch, NEW.commits, OLD.epoch, OLD.commits));
        END IF;
        RETURN NULL;
    END $$;
    CREATE TRIGGER watch AFTER UPDATE ON evogait.coordinator FOR EACH ROW EXECUTE FUNCTION public.watch()";

/// Current disturbance of a coordinator.
#[derive(Clone, Copy)]
enum Trouble {
    /// The process was killed; it starts again at this time.
    Killed(Instant),
    /// The process is stopped, and the standby has not taken over yet.
    Hangs,
    /// The standby has taken over; the process stays stopped until this time.
    Replaced(Instant),
    /// The process continues since this time and must detect that it was replaced.
    Late(Instant),
    /// The process can't reach the database until this time, unless it exits before.
    CutOff(Instant),
    /// The process reaches the database again since this time. It may have been replaced.
    InTouch(Instant),
}

struct Seat {
    sandbox: Sandbox,
    /// Proxy to the PostgreSQL database; none on SQLite.
    network: Option<Proxy>,
    health: HealthClient<FailoverChannel>,
    process: Option<Process>,
    trouble: Option<Trouble>,
}

/// Counts of the disturbances and of their effects.
#[derive(Default)]
struct Tally {
    kills: u32,
    stops: u32,
    cuts: u32,
    /// Number of times that another coordinator than before became active.
    takeovers: u32,
    /// Takeovers from a coordinator that was not disturbed: the machine was too busy for its keepalives.
    overtaken: u32,
    /// Longest time without an active coordinator.
    longest: Duration,
}

pub struct Coordinators {
    seats: Vec<Seat>,
    /// URL of the PostgreSQL database; none on SQLite.
    database: Option<String>,
    /// Certificates, on PostgreSQL only: all connections use TLS, and all clients and workers show a certificate and a
    /// token.
    certificates: Option<Certificates>,
    /// Index of the active coordinator, if known.
    at_work: Option<usize>,
    /// Index of the last coordinator that was active.
    last: usize,
    /// Time since which no coordinator has been active.
    idle_since: Instant,
    next: Instant,
    tally: Tally,
    start: Instant,
}

impl Coordinators {
    /// Starts one coordinator on a SQLite file, or two on a PostgreSQL database with mutual TLS and tokens.
    pub fn start(database: Option<String>, logs: &Path) -> Self {
        let sandboxes = match &database {
            Some(url) => [(); 2]
                .map(|()| beyond_a_network(url))
                .map(|(network, beyond)| (Sandbox::on(&beyond), Some(network)))
                .into(),
            None => vec![(Sandbox::new(), None)],
        };
        let certificates = database.as_ref().map(|_| Certificates::make(&logs.join("certificates")));
        let dial = |url: &str| dial(certificates.as_ref(), url);
        let now = Instant::now();
        let mut coordinators = Self {
            seats: sandboxes.into_iter().map(|(sandbox, network)| Seat::new(sandbox, network, logs, dial)).collect(),
            database,
            certificates,
            at_work: None,
            last: 0,
            idle_since: now,
            next: now + EVERY,
            tally: Tally::default(),
            start: now,
        };
        (0..coordinators.seats.len()).for_each(|at| coordinators.sit_down(at));
        // The tables exist once one of the coordinators listens.
        if let Some(database) = &coordinators.database {
            ask(database, WATCH);
        }
        coordinators
    }

    /// Checks that no coordinator wrote to the database after it was replaced.
    fn nothing_late(&self) -> Result<(), String> {
        let Some(database) = &self.database else { return Ok(()) };
        let late = ask(database, "SELECT what FROM public.late");
        if late.is_empty() {
            Ok(())
        } else {
            Err(format!("commits out of order (a replaced coordinator wrote to the database):\n{late}"))
        }
    }

    /// On PostgreSQL: checks that the standby took over at least once, and returns the last epoch.
    pub fn verdict(&self) -> Result<Option<String>, String> {
        let Some(database) = &self.database else { return Ok(None) };
        self.nothing_late()?;
        match self.tally.takeovers {
            0 => Err("the standby never took over".to_owned()),
            _ => Ok(Some(ask(database, "SELECT epoch FROM evogait.coordinator"))),
        }
    }

    pub fn tally(&self) -> String {
        let Tally { kills, stops, cuts, takeovers, overtaken, longest } = &self.tally;
        let longest = format!("at most {:.1} s without an active coordinator", longest.as_secs_f64());
        if self.alone() {
            return format!("{kills} kills of the coordinator, {longest}");
        }
        format!(
            "{kills} kills and {stops} stops of the active coordinator, {cuts} times it was cut off from the database, \
             {takeovers} takeovers, {overtaken} of them from an undisturbed coordinator, {longest}"
        )
    }

    fn alone(&self) -> bool {
        self.seats.len() == 1
    }

    /// Returns the plain URL of each coordinator (without the `https` scheme that TLS needs).
    pub fn urls(&self) -> Vec<String> {
        self.seats.iter().map(|seat| seat.sandbox.url()).collect()
    }

    /// Returns a client's dial that finds the active coordinator.
    pub fn dial(&self) -> Dial {
        dial(self.certificates.as_ref(), &self.urls().join(","))
    }

    /// Returns the command of a worker with one slot; the caller may add options.
    pub fn worker_command(&self, addresses: &str) -> Command {
        let sandbox = &self.seats[0].sandbox;
        let Some(certificates) = &self.certificates else { return sandbox.worker_command(addresses, 1) };
        let mut command = sandbox.worker_command(&closed(addresses), 1);
        certificates.show(&mut command, "worker");
        command
    }

    /// Ends the disturbances that have lasted their time, and starts a new one if it is due.
    pub async fn go_on(&mut self, random: &mut Random) -> Result<(), String> {
        self.repair(random).await?;
        // Without an active coordinator, the disturbance waits until one is active.
        if let Some(at) = self.at_work.filter(|_| Instant::now() >= self.next) {
            self.next = Instant::now() + EVERY;
            self.strike(at, random);
        }
        Ok(())
    }

    /// Ends all disturbances.
    pub async fn calm_down(&mut self, random: &mut Random) -> Result<(), String> {
        loop {
            self.repair(random).await?;
            if self.at_work.is_some() && self.seats.iter().all(|seat| seat.trouble.is_none()) {
                return Ok(());
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    fn strike(&mut self, at: usize, random: &mut Random) {
        // A stopped or cut off coordinator is only replaced if the other one is on standby.
        let watched = !self.alone() && self.seats.iter().all(|seat| seat.trouble.is_none());
        let strikes = self.tally.kills + self.tally.stops + self.tally.cuts;
        let what = if watched { strikes % 3 } else { 0 };
        let now = Instant::now();
        let seat = &mut self.seats[at];
        let told = match (what, &seat.network) {
            (1, _) => {
                seat.signal("STOP");
                seat.trouble = Some(Trouble::Hangs);
                self.tally.stops += 1;
                "is stopped while active"
            }
            (2, Some(network)) => {
                let ways = self.tally.cuts % 3;
                network.block(Direction::Up, ways != 1);
                network.block(Direction::Down, ways != 0);
                seat.trouble = Some(Trouble::CutOff(now + random.time(500, 8000)));
                self.tally.cuts += 1;
                match ways {
                    0 => "can't send to its database",
                    1 => "can't receive from its database",
                    _ => "is cut off from its database",
                }
            }
            _ => {
                if let Some(process) = seat.process.take() {
                    process.kill_9();
                }
                // With a standby, the coordinator restarts before or after the takeover.
                let away = if self.alone() { 2000 } else { 8000 };
                self.seats[at].trouble = Some(Trouble::Killed(now + random.time(0, away)));
                self.tally.kills += 1;
                "is killed while active"
            }
        };
        self.at_work = None;
        self.idle_since = now;
        self.say(at, told);
    }

    async fn repair(&mut self, random: &mut Random) -> Result<(), String> {
        self.look().await?;
        for at in 0..self.seats.len() {
            let now = Instant::now();
            let replaced = self.at_work.is_some_and(|other| other != at);
            let alone = self.alone();
            let seat = &mut self.seats[at];
            if let Some(code) = seat.has_ended() {
                let told = code.map_or("no exit code".to_owned(), |code| format!("exit code {code}"));
                let may_end = match seat.trouble {
                    Some(Trouble::CutOff(_) | Trouble::InTouch(_)) => code == OUT_OF_TOUCH || code == REPLACED,
                    _ => code == REPLACED && !alone,
                };
                // The new coordinator may not be active yet, but its epoch has begun.
                let overtaken = seat.trouble.is_none();
                // Packets that the proxy held back reach the database now.
                seat.in_touch();
                self.nothing_late()?;
                if !may_end {
                    return Err(format!("coordinator {at} exited unexpectedly with {told}"));
                }
                self.tally.overtaken += u32::from(overtaken);
                self.say(at, &format!("exits by itself with {told}"));
                self.sit_down(at);
                continue;
            }
            match seat.trouble {
                Some(Trouble::Killed(until)) if now >= until => {
                    self.sit_down(at);
                    self.say(at, "is started again");
                }
                Some(Trouble::Hangs) if replaced => {
                    seat.trouble = Some(Trouble::Replaced(now + random.time(0, 4000)));
                }
                Some(Trouble::Replaced(until)) if now >= until => {
                    seat.signal("CONT");
                    seat.trouble = Some(Trouble::Late(now));
                    self.say(at, "continues");
                }
                Some(Trouble::CutOff(until)) if now >= until => {
                    seat.in_touch();
                    seat.trouble = Some(Trouble::InTouch(now));
                    self.say(at, "reaches its database again");
                }
                // It was not replaced and stays active, or it is on standby.
                Some(Trouble::InTouch(since)) if now > since + SETTLED => seat.trouble = None,
                Some(Trouble::Late(since)) if now > since + WITHIN => {
                    return Err(format!("coordinator {at} still runs a minute after it was replaced"));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Finds the active coordinator.
    async fn look(&mut self) -> Result<(), String> {
        let count = self.seats.len();
        let mut found = None;
        // The other one first: a replaced coordinator may not have detected its replacement yet.
        for at in (1..=count).map(|step| (self.last + step) % count) {
            if self.seats[at].serves().await {
                found = Some(at);
                break;
            }
        }
        if let Some(at) = found {
            let without = self.idle_since.elapsed();
            // The first coordinator to become active replaces none.
            let struck = self.tally.kills + self.tally.stops + self.tally.cuts > 0;
            if struck && self.at_work != found {
                self.tally.takeovers += u32::from(at != self.last);
                self.tally.longest = self.tally.longest.max(without);
                let what = if at == self.last { "is active again" } else { "has taken over" };
                self.say(at, &format!("{what} after {:.1} s", without.as_secs_f64()));
            }
            self.last = at;
            self.idle_since = Instant::now();
        }
        self.at_work = found;
        if self.idle_since.elapsed() > WITHIN {
            Err("no coordinator became active within a minute".to_owned())
        } else {
            Ok(())
        }
    }

    /// Starts a coordinator; on PostgreSQL with `--standby`.
    fn sit_down(&mut self, at: usize) {
        let alone = self.alone();
        let seat = &mut self.seats[at];
        let mut command = seat.sandbox.coordinator_command();
        if !alone {
            command.args(["--standby", "--takeover-seconds", TAKEOVER_SECONDS]);
        }
        if let Some(certificates) = &self.certificates {
            certificates.close(&mut command);
        }
        seat.process = Some(seat.sandbox.start(command));
        seat.trouble = None;
    }

    fn say(&self, at: usize, what: &str) {
        println!("{:7.1} s: coordinator {at} {what}", self.start.elapsed().as_secs_f64());
    }
}

/// Returns a client's dial that detects a hanging coordinator within twice [`KEEPALIVE`].
fn dial(certificates: Option<&Certificates>, urls: &str) -> Dial {
    let dial = match certificates {
        Some(certificates) => certificates.dial(urls, Some("client"), Some("client")),
        None => Dial::new(urls.parse().expect("the URLs of the coordinators are valid"), &Credentials::default())
            .expect("a dial without TLS and token is valid"),
    };
    dial.keepalive(KEEPALIVE)
}

impl Seat {
    fn new(mut sandbox: Sandbox, network: Option<Proxy>, logs: &Path, dial: impl Fn(&str) -> Dial) -> Self {
        sandbox.log_to(logs);
        sandbox.reserve_port();
        Self {
            health: HealthClient::new(dial(&sandbox.url()).channel()),
            sandbox,
            network,
            process: None,
            trouble: None,
        }
    }

    /// Restores the connection to the database.
    fn in_touch(&self) {
        if let Some(network) = &self.network {
            network.heal();
        }
    }

    /// Returns true if the health check reports the coordinator as active. A disturbed coordinator is not checked.
    async fn serves(&self) -> bool {
        if self.trouble.is_some_and(|trouble| !matches!(trouble, Trouble::InTouch(_))) {
            return false;
        }
        let mut health = self.health.clone();
        let request = HealthCheckRequest { service: "evogait.v1.JobService".to_owned() };
        let answer = tokio::time::timeout(ANSWERED_WITHIN, health.check(request)).await;
        matches!(answer, Ok(Ok(answer)) if answer.get_ref().status() == ServingStatus::Serving)
    }

    fn signal(&self, name: &str) {
        if let Some(process) = &self.process {
            process.signal(name);
        }
    }

    /// Returns the exit code if the process has ended.
    fn has_ended(&mut self) -> Option<Option<i32>> {
        let process = self.process.as_mut()?;
        process.has_ended().then(|| process.wait())
    }
}
