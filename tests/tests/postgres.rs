//! Coordinators on a shared PostgreSQL store: results equal those on SQLite, and a standby takes over when the active
//! coordinator fails. Run by `tests/postgres.sh`.

use cluster_tests::crashes::{ClientGoal, POINTS, cancelled_through_crashes, paused_through_crashes, through_crashes};
use cluster_tests::postgres::{
    ask, ask_server, beyond_a_network, new_database, new_database_by_tcp, new_database_by_tls,
};
use cluster_tests::proxy::Direction;
use cluster_tests::sandbox::{Process, Sandbox, output_of, program, tiny_job};
use proto::v1::{GetJobRequest, Job, JobState};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

const GENERATIONS: u32 = 3;
/// Options of a coordinator that the next one may replace soon.
const SOON_REPLACED: &[&str] = &["--takeover-seconds", "0.5"];
const SOON: Duration = Duration::from_secs(1);
const LATER: Duration = Duration::from_secs(8);
/// Limit on a takeover. After a crash it takes [`SOON`], a check every 200 ms and the start; after a clean stop only
/// the last two.
const WITHIN: Duration = Duration::from_secs(6);

async fn digest(mut sandbox: Sandbox, toml: &str, workers: usize) -> Vec<u8> {
    let coordinator = sandbox.coordinator();
    let _workers: Vec<Process> = (0..workers).map(|_| sandbox.worker(1)).collect();
    let job = sandbox.submit("r", toml).await;
    let digest = sandbox.result(&job.id).await.result_digest;
    assert_eq!(coordinator.terminate(), Some(0));
    digest
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn both_stores_give_same_result_with_any_workers() {
    let toml = tiny_job(31, GENERATIONS);
    let reference = digest(Sandbox::new(), &toml, 1).await;
    assert_eq!(reference.len(), 32);
    for workers in [2, 7] {
        assert_eq!(digest(Sandbox::new(), &toml, workers).await, reference, "SQLite, {workers} workers");
    }
    for workers in [1, 2, 7] {
        let sandbox = Sandbox::on(&new_database());
        assert_eq!(digest(sandbox, &toml, workers).await, reference, "PostgreSQL, {workers} workers");
    }
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn job_survives_coordinator_crash_at_every_commit() {
    let toml = tiny_job(21, 1);
    let mut sandbox = Sandbox::on(&new_database());
    let passed = through_crashes(&mut sandbox, SOON_REPLACED, &toml, ClientGoal::Result, POINTS).await;
    assert!(passed.lives >= 2 * POINTS.len(), "too few crashes: {}", passed.lives);
    assert_eq!(digest(Sandbox::new(), &toml, 1).await, passed.digest);
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn acknowledged_cancel_survives_every_crash() {
    cancelled_through_crashes(|| Sandbox::on(&new_database()), SOON_REPLACED, &tiny_job(22, 1000)).await;
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn acknowledged_pause_survives_every_crash() {
    let toml = tiny_job(23, 20);
    let passed = paused_through_crashes(&mut Sandbox::on(&new_database()), SOON_REPLACED, &toml).await;
    assert_eq!(digest(Sandbox::new(), &toml, 1).await, passed);
}

/// Starts a coordinator that may be replaced when it has not renewed its claim for the time `takeover`.
fn coordinator(sandbox: &mut Sandbox, takeover: Duration, more: &[&str]) -> Process {
    let mut command = sandbox.coordinator_command();
    command.args(["--takeover-seconds", &takeover.as_secs_f64().to_string()]).args(more);
    sandbox.start(command)
}

async fn health(sandbox: &Sandbox) -> ServingStatus {
    let channel = tonic::transport::Endpoint::from_shared(sandbox.url())
        .unwrap()
        .connect()
        .await
        .expect("the coordinator listens");
    let request = HealthCheckRequest { service: "evogait.v1.JobService".to_owned() };
    HealthClient::new(channel).check(request).await.expect("the health check is always answered").into_inner().status()
}

/// Returns the job from this coordinator once it is active, and the time that took.
async fn taken_over(sandbox: &Sandbox, id: &str) -> (Job, Duration) {
    let start = Instant::now();
    loop {
        match sandbox.client().get_job(GetJobRequest { id: id.to_owned() }).await {
            Ok(answer) => return (answer.into_inner().job.expect("the response has the job"), start.elapsed()),
            Err(status) => assert_eq!(status.code(), Code::Unavailable, "{status}"),
        }
        assert!(start.elapsed() < WITHIN, "the standby must take over in time");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn standby_takeover_does_not_change_result() {
    let toml = tiny_job(33, 6);
    let url = new_database();
    let (mut first, mut second) = (Sandbox::on(&url), Sandbox::on(&url));
    let dies = coordinator(&mut first, SOON, &[]);
    let _worker = first.worker(1);
    let job = first.submit("r", &toml).await;
    let stops = coordinator(&mut second, LATER, &["--standby"]);
    let _other_worker = second.worker(1);
    let refused = second.client().get_job(GetJobRequest { id: job.id.clone() }).await.unwrap_err();
    assert_eq!(refused.code(), Code::Unavailable);
    assert!(refused.message().starts_with("standby"), "{refused}");
    assert_eq!(health(&second).await, ServingStatus::NotServing);
    assert_eq!(health(&first).await, ServingStatus::Serving);

    let before = first.until(&job.id, |job| job.rounds_sealed > 2).await;
    dies.kill_9();
    let (after, took) = taken_over(&second, &job.id).await;
    println!("taken over {} ms after a kill", took.as_millis());
    assert!(after.rounds_sealed >= before.rounds_sealed, "sealed rounds that were reported must be stored");
    assert_eq!(after.state(), JobState::Running, "the coordinator must be killed before the job ends");
    assert_eq!(health(&second).await, ServingStatus::Serving);

    // Starts the first coordinator again as standby; then the second one stops in an orderly way.
    let _back = coordinator(&mut first, SOON, &["--standby"]);
    assert_eq!(health(&first).await, ServingStatus::NotServing);
    second.until(&job.id, |job| job.rounds_sealed > 4).await;
    assert_eq!(stops.terminate(), Some(0));
    // Without an orderly stop the takeover would need [`LATER`].
    let (_, took) = taken_over(&first, &job.id).await;
    println!("taken over {} ms after a stop", took.as_millis());
    assert_eq!(first.result(&job.id).await.result_digest, digest(Sandbox::new(), &toml, 1).await);
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn replaced_coordinator_writes_nothing_when_continued() {
    let url = new_database();
    let (mut first, mut second) = (Sandbox::on(&url), Sandbox::on(&url));
    let mut sleeps = coordinator(&mut first, SOON, &[]);
    let _worker = first.worker(2);
    let job = first.submit("r", &tiny_job(34, 1000)).await;
    first.until(&job.id, |job| job.rounds_sealed > 1).await;
    sleeps.signal("STOP");
    let _other = coordinator(&mut second, SOON, &["--standby"]);
    taken_over(&second, &job.id).await;
    // Without a worker the second coordinator writes nothing, so any change was written by the first one.
    tokio::time::sleep(Duration::from_millis(300)).await;
    let written = "SELECT (SELECT count(*) FROM evogait.events), (SELECT count(*) FROM evogait.rounds),
                          (SELECT count(*) FROM evogait.results), (SELECT epoch FROM evogait.coordinator),
                          (SELECT md5(string_agg(record::TEXT, ',')) FROM evogait.jobs)";
    let before = ask(&url, written);
    sleeps.signal("CONT");
    assert_eq!(sleeps.wait(), Some(3), "exit code 3 reports that another coordinator has taken over");
    assert_eq!(ask(&url, written), before);
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn partitioned_coordinator_exits_and_late_writes_are_void() {
    let toml = tiny_job(36, 12);
    let reference = digest(Sandbox::new(), &toml, 1).await;
    for blocked in [vec![Direction::Up], vec![Direction::Down], vec![Direction::Up, Direction::Down]] {
        let url = new_database_by_tcp();
        let (proxy, beyond) = beyond_a_network(&url);
        let (mut first, mut second) = (Sandbox::on(&beyond), Sandbox::on(&url));
        let mut cut_off = coordinator(&mut first, SOON, &[]);
        let _worker = first.worker(1);
        let job = first.submit("r", &toml).await;
        let _stands_by = coordinator(&mut second, LATER, &["--standby"]);
        let _other_worker = second.worker(1);
        first.until(&job.id, |job| job.rounds_sealed > 2).await;

        blocked.iter().for_each(|direction| proxy.block(*direction, true));
        let (after, _) = taken_over(&second, &job.id).await;
        assert!(after.rounds_sealed > 2, "{blocked:?}: sealed rounds that were reported must be stored");
        assert_eq!(cut_off.wait(), Some(1), "{blocked:?}: exit code 1 reports that the database can't be reached");
        // Packets that the proxy held back reach the database now, after the coordinator has exited.
        proxy.heal();
        assert_eq!(second.result(&job.id).await.result_digest, reference, "{blocked:?}");
    }
}

#[test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
fn coordinator_without_database_exits_and_refuses_to_start() {
    let (proxy, beyond) = beyond_a_network(&new_database_by_tcp());
    let mut sandbox = Sandbox::on(&beyond);
    let stops = coordinator(&mut sandbox, SOON, &[]);
    proxy.block(Direction::Up, true);
    proxy.block(Direction::Down, true);
    assert_eq!(stops.terminate(), Some(1), "the exit must report that the claim could not be released");

    let output = output_of(&mut sandbox.coordinator_command());
    let text = String::from_utf8(output.stderr).expect("error messages are UTF-8");
    assert!(output.status.code() == Some(1) && text.contains("the database did not respond within 10 s"), "{text}");
}

/// Locks the table that all coordinators use, for some seconds.
fn lock_coordinator_table(url: &str, seconds: u32) -> Process {
    let held =
        format!("BEGIN; LOCK TABLE evogait.coordinator IN ACCESS EXCLUSIVE MODE; SELECT pg_sleep({seconds}); COMMIT");
    let mut holder = Command::new("psql");
    holder.args(["--no-psqlrc", "--quiet", "--command", &held]);
    Process::start(holder.arg(url).stdout(Stdio::null()))
}

#[test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
fn coordinator_with_silent_database_exits_before_a_takeover() {
    let url = new_database();
    let mut waits = coordinator(&mut Sandbox::on(&url), SOON, &[]);
    let mut holder = lock_coordinator_table(&url, 20);
    assert_eq!(waits.wait(), Some(1));
    assert!(!holder.has_ended(), "the coordinator must exit before the lock is released");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn standby_repeats_lost_query() {
    let url = new_database_by_tcp();
    let (proxy, beyond) = beyond_a_network(&url);
    let (mut first, mut second) = (Sandbox::on(&url), Sandbox::on(&beyond));
    let dies = coordinator(&mut first, 3 * SOON, &[]);
    let _worker = first.worker(1);
    let job = first.submit("r", &tiny_job(37, 1000)).await;
    let _stands_by = coordinator(&mut second, SOON, &["--standby"]);
    // The standby waits for its query, and the active coordinator for its commit.
    let mut holder = lock_coordinator_table(&url, 4);
    let waits = "SELECT count(*) FROM pg_locks WHERE NOT granted AND relation = 'evogait.coordinator'::regclass";
    let start = Instant::now();
    while ask(&url, waits).parse::<u32>().expect("the query returns a count") < 2 {
        assert!(start.elapsed() < 3 * SOON, "the standby and the active coordinator must wait for the lock");
    }
    dies.kill_9();
    proxy.lose();
    assert_eq!(holder.wait(), Some(0));
    taken_over(&second, &job.id).await;
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn second_coordinator_is_refused_without_showing_password() {
    let url = new_database().replace("evogait@", "evogait:s3cret@");
    let mut sandbox = Sandbox::on(&url);
    let _coordinator = sandbox.coordinator();
    let start = Instant::now();
    let second = output_of(Sandbox::on(&url).coordinator_command().env("RUST_LOG", "debug"));
    let text = String::from_utf8(second.stderr).expect("error messages are UTF-8");
    assert_eq!(second.status.code(), Some(1), "{text}");
    assert!(text.contains("another coordinator (start 1) is active") && text.contains("--standby"), "{text}");
    assert!(start.elapsed() < WITHIN);
    assert!(!text.contains("s3cret"), "{text}");

    for wrong in ["postgres://ann:s3cret@127.0.0.1:1/gaits", "postgres://ann:s3cret@host:port/gaits"] {
        let output = output_of(program("coordinator").args(["--listen", "127.0.0.1:0", "--store", wrong]));
        let text = String::from_utf8(output.stderr).expect("error messages are UTF-8");
        assert!(output.status.code() == Some(1) && !text.contains("s3cret"), "{text}");
    }
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn database_connection_is_encrypted_and_verified() {
    let (url, ca, other_ca) = new_database_by_tls();
    let toml = tiny_job(34, 1);
    let mut sandbox = Sandbox::on(&format!("{url}?sslmode=verify-full&sslrootcert={ca}"));
    let coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(1);
    let job = sandbox.submit("r", &toml).await;
    let name = url.rsplit('/').next().expect("the URL names a database");
    let encrypted = format!(
        "SELECT count(*) > 0 AND bool_and(ssl) FROM pg_stat_ssl JOIN pg_stat_activity USING (pid) WHERE datname = '{name}'"
    );
    assert_eq!(ask_server(&encrypted), "t", "all connections must be encrypted");
    let by_tls = sandbox.result(&job.id).await.result_digest;
    assert_eq!(coordinator.terminate(), Some(0));
    assert_eq!(digest(Sandbox::new(), &toml, 1).await, by_tls);

    let refused = |store: &str| {
        let mut sandbox = Sandbox::on(store);
        sandbox.reserve_port();
        let output = output_of(sandbox.coordinator_command().env_remove("PGSSLROOTCERT"));
        assert_eq!(output.status.code(), Some(1), "{store}");
        let text = String::from_utf8(output.stderr).expect("error messages are UTF-8");
        assert_eq!(text.lines().count(), 1, "{text}");
        text
    };
    for mode in ["verify-full", "verify-ca"] {
        let text = refused(&format!("{url}?sslmode={mode}&sslrootcert={other_ca}"));
        assert!(text.contains("not signed by a trusted CA") && text.contains("sslrootcert=FILE"), "{text}");
    }
    let text = refused(&format!("{url}?sslmode=verify-full"));
    assert!(text.contains("not signed by a trusted CA"), "{text}");
    // The server also listens on 127.0.0.2, but its certificate is not valid for that address.
    let elsewhere = url.replace("localhost", "127.0.0.2");
    let text = refused(&format!("{elsewhere}?sslmode=verify-full&sslrootcert={ca}"));
    assert!(text.contains("not for 127.0.0.2, but for ") && text.contains("localhost"), "{text}");
    let text = refused(&format!("{url}?sslmode=verify-full&sslrootcert={ca}.missing"));
    assert!(text.contains(&format!("can't read {ca}.missing")), "{text}");
    let text = refused(&format!("{url}?sslmode=disable"));
    assert!(text.contains("add ?sslmode=verify-full to --store"), "{text}");
    let text = refused(&format!("{}?sslmode=verify-full", new_database()));
    assert!(text.contains("does not encrypt connections: set ssl = on"), "{text}");

    // verify-ca does not check the address, so the certificate is accepted.
    let mut sandbox = Sandbox::on(&format!("{elsewhere}?sslmode=verify-ca&sslrootcert={ca}"));
    assert_eq!(sandbox.coordinator().terminate(), Some(0));
}
