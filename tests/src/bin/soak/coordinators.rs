//! The coordinators: one on SQLite; on PostgreSQL two, of which one is at work and the other one stands by.

use crate::random::Random;
use cluster_tests::certificates::{Certificates, closed};
use cluster_tests::postgres::{ask, beyond_a_network};
use cluster_tests::proxy::{Direction, Proxy};
use cluster_tests::sandbox::{Process, Sandbox};
use proto::credentials::Credentials;
use proto::dial::{Dial, Way};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

/// Whoever is at work is struck this often.
const EVERY: Duration = Duration::from_secs(20);
/// Out of touch with the database for this long, a coordinator is taken for dead.
const TAKEOVER_SECONDS: &str = "3";
/// Somebody is at work, and one that was replaced has noticed, within this time: with patience for a busy machine.
const WITHIN: Duration = Duration::from_secs(60);
/// Whoever can reach the database again knows within this time whether it was replaced.
const SETTLED: Duration = Duration::from_secs(10);
/// A health check that takes longer finds nobody.
const ANSWERED_WITHIN: Duration = Duration::from_secs(1);
/// How often a client looks whether a coordinator hangs.
const KEEPALIVE: Duration = Duration::from_secs(1);
/// The exit code of a coordinator that was replaced.
const REPLACED: Option<i32> = Some(3);
/// And of one that can't reach its database, and so does not know.
const OUT_OF_TOUCH: Option<i32> = Some(1);

/// Lets the database itself watch who writes: in an epoch each commit follows the one before. Bits and events may hide the
/// commit of an epoch that is over, since whatever was computed twice is the same.
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

/// What is wrong with a coordinator.
#[derive(Clone, Copy)]
enum Trouble {
    /// It is away until then.
    Killed(Instant),
    /// It hangs, and nobody has taken over yet.
    Hangs,
    /// Another one has taken over; it still hangs until then.
    Replaced(Instant),
    /// It goes on since then, and has to find out that it was replaced.
    Late(Instant),
    /// It is cut off from the database until then, if it does not end before.
    CutOff(Instant),
    /// It can reach the database again since then. It may have been replaced or not.
    InTouch(Instant),
}

struct Seat {
    sandbox: Sandbox,
    /// The way to the database, if it is one.
    network: Option<Proxy>,
    health: HealthClient<Way>,
    process: Option<Process>,
    trouble: Option<Trouble>,
}

/// What was done to them and what came of it.
#[derive(Default)]
struct Tally {
    kills: u32,
    stops: u32,
    cuts: u32,
    /// Times that another one than before was found at work.
    takeovers: u32,
    /// Those from one that nothing had been done to: the machine was too busy for its signs of life.
    overtaken: u32,
    /// Longest time without anybody at work.
    longest: Duration,
}

pub struct Coordinators {
    seats: Vec<Seat>,
    /// The PostgreSQL database, if it is one.
    database: Option<String>,
    /// Where there are any, all connections are encrypted, and everybody shows a certificate and a token.
    certificates: Option<Certificates>,
    /// Who is at work, if it is known.
    at_work: Option<usize>,
    /// Who was, when it was known last.
    last: usize,
    /// Since when nobody is.
    nobody_since: Instant,
    next: Instant,
    tally: Tally,
    start: Instant,
}

impl Coordinators {
    /// One coordinator on a file, or two on a PostgreSQL database and behind closed doors.
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
            nobody_since: now,
            next: now + EVERY,
            tally: Tally::default(),
            start: now,
        };
        (0..coordinators.seats.len()).for_each(|at| coordinators.sit_down(at));
        // The tables are there once one of them listens.
        if let Some(database) = &coordinators.database {
            ask(database, WATCH);
        }
        coordinators
    }

    /// Whether nobody wrote who had been replaced.
    fn nothing_late(&self) -> Result<(), String> {
        let Some(database) = &self.database else { return Ok(()) };
        let late = ask(database, "SELECT what FROM public.late");
        if late.is_empty() { Ok(()) } else { Err(format!("a commit does not follow the one before:\n{late}")) }
    }

    /// Where there are two: whether one ever took over. Tells the last epoch.
    pub fn verdict(&self) -> Result<Option<String>, String> {
        let Some(database) = &self.database else { return Ok(None) };
        self.nothing_late()?;
        match self.tally.takeovers {
            0 => Err("no coordinator ever took over".to_owned()),
            _ => Ok(Some(ask(database, "SELECT epoch FROM evogait.coordinator"))),
        }
    }

    pub fn tally(&self) -> String {
        let Tally { kills, stops, cuts, takeovers, overtaken, longest } = &self.tally;
        let longest = format!("{:.1} s at most without one", longest.as_secs_f64());
        if self.alone() {
            return format!("{kills} kills of the coordinator, {longest}");
        }
        format!(
            "{kills} kills and {stops} stops of the coordinator at work, {cuts} times it was cut off from the database, \
             {takeovers} takeovers, {overtaken} of them from one that was only slow, {longest}"
        )
    }

    fn alone(&self) -> bool {
        self.seats.len() == 1
    }

    /// Of each of them, as it would be with open doors.
    pub fn urls(&self) -> Vec<String> {
        self.seats.iter().map(|seat| seat.sandbox.url()).collect()
    }

    /// A way to whoever is at work, for a client.
    pub fn dial(&self) -> Dial {
        dial(self.certificates.as_ref(), &self.urls().join(","))
    }

    /// A worker with one slot, with options still to be added.
    pub fn worker_command(&self, addresses: &str) -> Command {
        let sandbox = &self.seats[0].sandbox;
        let Some(certificates) = &self.certificates else { return sandbox.worker_command(addresses, 1) };
        let mut command = sandbox.worker_command(&closed(addresses), 1);
        certificates.show(&mut command, "worker");
        command
    }

    /// Repairs what was broken long enough, and breaks something if it is time.
    pub async fn go_on(&mut self, random: &mut Random) -> Result<(), String> {
        self.repair(random).await?;
        // If nobody is at work just now, it is struck as soon as somebody is.
        if let Some(at) = self.at_work.filter(|_| Instant::now() >= self.next) {
            self.next = Instant::now() + EVERY;
            self.strike(at, random);
        }
        Ok(())
    }

    /// Repairs everything.
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
        // One that stands by is needed if the one at work is to find itself replaced.
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
                "is stopped at work"
            }
            (2, Some(network)) => {
                let ways = self.tally.cuts % 3;
                network.block(Direction::Up, ways != 1);
                network.block(Direction::Down, ways != 0);
                seat.trouble = Some(Trouble::CutOff(now + random.time(500, 8000)));
                self.tally.cuts += 1;
                match ways {
                    0 => "can't be heard by its database",
                    1 => "hears nothing from its database",
                    _ => "is cut off from its database",
                }
            }
            _ => {
                if let Some(process) = seat.process.take() {
                    process.kill_9();
                }
                // Where another one takes over, it is back before that or after.
                let away = if self.alone() { 2000 } else { 8000 };
                self.seats[at].trouble = Some(Trouble::Killed(now + random.time(0, away)));
                self.tally.kills += 1;
                "is killed at work"
            }
        };
        self.at_work = None;
        self.nobody_since = now;
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
                let told = code.map_or("no code".to_owned(), |code| format!("code {code}"));
                let may_end = match seat.trouble {
                    Some(Trouble::CutOff(_) | Trouble::InTouch(_)) => code == OUT_OF_TOUCH || code == REPLACED,
                    _ => code == REPLACED && !alone,
                };
                // Whoever took over may not be at work yet, but its epoch has begun.
                let overtaken = seat.trouble.is_none();
                // What was under way arrives now.
                seat.in_touch();
                self.nothing_late()?;
                if !may_end {
                    return Err(format!("coordinator {at} ended by itself with {told}"));
                }
                self.tally.overtaken += u32::from(overtaken);
                self.say(at, &format!("ends by itself with {told}"));
                self.sit_down(at);
                continue;
            }
            match seat.trouble {
                Some(Trouble::Killed(until)) if now >= until => {
                    self.sit_down(at);
                    self.say(at, "is back");
                }
                Some(Trouble::Hangs) if replaced => {
                    seat.trouble = Some(Trouble::Replaced(now + random.time(0, 4000)));
                }
                Some(Trouble::Replaced(until)) if now >= until => {
                    seat.signal("CONT");
                    seat.trouble = Some(Trouble::Late(now));
                    self.say(at, "goes on");
                }
                Some(Trouble::CutOff(until)) if now >= until => {
                    seat.in_touch();
                    seat.trouble = Some(Trouble::InTouch(now));
                    self.say(at, "reaches its database again");
                }
                // It goes on, replaced by nobody, or waits for its turn.
                Some(Trouble::InTouch(since)) if now > since + SETTLED => seat.trouble = None,
                Some(Trouble::Late(since)) if now > since + WITHIN => {
                    return Err(format!("coordinator {at} goes on though another one has taken over"));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Finds out who is at work.
    async fn look(&mut self) -> Result<(), String> {
        let count = self.seats.len();
        let mut found = None;
        // The other one first: the old one may not know yet that it was replaced.
        for at in (1..=count).map(|step| (self.last + step) % count) {
            if self.seats[at].serves().await {
                found = Some(at);
                break;
            }
        }
        if let Some(at) = found {
            let without = self.nobody_since.elapsed();
            // The first one to work replaces nobody.
            let struck = self.tally.kills + self.tally.stops + self.tally.cuts > 0;
            if struck && self.at_work != found {
                self.tally.takeovers += u32::from(at != self.last);
                self.tally.longest = self.tally.longest.max(without);
                let what = if at == self.last { "is at work again" } else { "has taken over" };
                self.say(at, &format!("{what} after {:.1} s", without.as_secs_f64()));
            }
            self.last = at;
            self.nobody_since = Instant::now();
        }
        self.at_work = found;
        if self.nobody_since.elapsed() > WITHIN { Err("no coordinator is at work".to_owned()) } else { Ok(()) }
    }

    /// Starts a coordinator; where there are two, as the one that waits for its turn.
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

/// As a client, who finds within twice the time below that a coordinator hangs.
fn dial(certificates: Option<&Certificates>, urls: &str) -> Dial {
    let dial = match certificates {
        Some(certificates) => certificates.dial(urls, Some("client"), Some("client")),
        None => Dial::new(urls.parse().expect("they have addresses"), &Credentials::default())
            .expect("without TLS and token there is nothing to refuse"),
    };
    dial.keepalive(KEEPALIVE)
}

impl Seat {
    fn new(mut sandbox: Sandbox, network: Option<Proxy>, logs: &Path, dial: impl Fn(&str) -> Dial) -> Self {
        sandbox.log_to(logs);
        sandbox.reserve_port();
        Self { health: HealthClient::new(dial(&sandbox.url()).way()), sandbox, network, process: None, trouble: None }
    }

    /// The way to the database is free.
    fn in_touch(&self) {
        if let Some(network) = &self.network {
            network.heal();
        }
    }

    /// Whether it says that it is at work. One that hangs, is cut off or was replaced is not asked.
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

    /// Its exit code if it has ended.
    fn has_ended(&mut self) -> Option<Option<i32>> {
        let process = self.process.as_mut()?;
        process.has_ended().then(|| process.wait())
    }
}
