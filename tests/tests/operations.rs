//! Metrics, health checks and logs of coordinator and worker.

use cluster_tests::openmetrics::{self, Series};
use cluster_tests::proxy::{Direction, Proxy};
use cluster_tests::sandbox::{Process, Sandbox, TIMEOUT, free_port, output_of, tiny_job};
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{Job, WatchJobRequest};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Sends an HTTP request and returns the status line and the body.
fn ask(address: &str, method: &str, path: &str) -> (String, String) {
    let mut stream = TcpStream::connect(address).expect("metrics are served");
    stream.set_read_timeout(Some(TIMEOUT)).expect("the timeout can be set");
    write!(stream, "{method} {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")
        .expect("the request can be sent");
    let mut text = String::new();
    stream.read_to_string(&mut text).expect("the response is UTF-8");
    let (head, body) = text.split_once("\r\n\r\n").expect("the response has a head and a body");
    if path == "/metrics" && method == "GET" {
        assert!(head.contains("application/openmetrics-text; version=1.0.0"), "{head}");
    }
    (head.lines().next().expect("the response has a status line").to_owned(), body.to_owned())
}

fn scrape(address: &str) -> Series {
    let (status, body) = ask(address, "GET", "/metrics");
    assert_eq!(status, "HTTP/1.1 200 OK");
    openmetrics::parse(&body).unwrap_or_else(|why| panic!("{why}\n{body}"))
}

/// Returns the number of completed tasks of all phases.
fn tasks(series: &Series) -> f64 {
    series.iter().filter(|(name, _)| name.starts_with("evogait_tasks_total{")).map(|(_, count)| count).sum()
}

/// Scrapes until the metrics fulfil a condition.
fn until(address: &str, wanted: impl Fn(&Series) -> bool) -> Series {
    let start = Instant::now();
    loop {
        let series = scrape(address);
        if wanted(&series) {
            return series;
        }
        assert!(start.elapsed() < TIMEOUT, "{series:#?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Twice the coordinator's keepalive, and a margin for a busy machine.
const CLOSED_WITHIN: Duration = Duration::from_secs(45);

#[tokio::test]
async fn connection_without_other_end_is_closed() {
    let mut sandbox = Sandbox::new();
    let metrics = free_port();
    let _coordinator = sandbox.coordinator_with(&["--metrics", &metrics]);
    let job = sandbox.submit("r", &tiny_job(22, 2)).await;
    let proxy = Proxy::to(&sandbox.url());
    let mut client = JobServiceClient::connect(proxy.url()).await.expect("the network is available");
    let mut events =
        client.watch_job(WatchJobRequest { id: job.id, after: 0 }).await.expect("the watch starts").into_inner();
    events.message().await.expect("the first event arrives");
    let watched = until(&metrics, |s| s["evogait_connections"] == 1.0);
    proxy.block(Direction::Up, true);
    proxy.block(Direction::Down, true);
    let start = Instant::now();
    while scrape(&metrics)["evogait_connections"] > 0.0 {
        assert!(start.elapsed() < CLOSED_WITHIN, "{watched:#?}");
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}

#[tokio::test]
async fn unanswered_result_is_not_assigned_again() {
    let mut sandbox = Sandbox::new();
    let metrics = free_port();
    let _coordinator = sandbox.coordinator_with(&["--metrics", &metrics]);
    let proxy = Proxy::to(&sandbox.url());
    let mut worker = sandbox.worker_command(&proxy.url(), 1);
    let _worker = Process::start(worker.env("EVOGAIT_FAULT", "slow@ms=400"));
    let job = sandbox.submit("r", &tiny_job(25, 2)).await;
    for _ in 0..6 {
        until(&metrics, |s| s["evogait_slots_busy"] == 1.0);
        // The result is blocked in the proxy while the connection breaks.
        proxy.block(Direction::Up, true);
        tokio::time::sleep(Duration::from_millis(700)).await;
        proxy.cut();
        proxy.heal();
        tokio::time::sleep(Duration::from_millis(300)).await;
    }
    sandbox.result(&job.id).await;
    let done = scrape(&metrics);
    assert_eq!(done["evogait_leases_ended_total{why=\"undelivered\"}"], 0.0, "{done:#?}");
    assert_eq!(done["evogait_workers_lost_total"], 0.0, "{done:#?}");
}

/// Worker with one slot that is slow with the first of five candidates and has begun a job.
struct SlowWorker {
    sandbox: Sandbox,
    coordinator: Process,
    way: Proxy,
    worker: Process,
    job: Job,
    of_coordinator: String,
    of_worker: String,
}

impl SlowWorker {
    async fn at_work() -> Self {
        let mut sandbox = Sandbox::new();
        let (of_coordinator, of_worker) = (free_port(), free_port());
        let coordinator = sandbox.coordinator_with(&["--metrics", &of_coordinator]);
        let way = Proxy::to(&sandbox.url());
        let mut command = sandbox.worker_command(&way.url(), 1);
        command.args(["--metrics", &of_worker]).env("EVOGAIT_FAULT", "slow@ms=2000,round=1,index=0");
        let worker = Process::start(&mut command);
        until(&of_coordinator, |s| s["evogait_slots"] == 1.0);
        let job = sandbox.submit("r", &tiny_job(38, 1)).await;
        until(&of_worker, |s| s["evogait_worker_slots_busy"] == 1.0);
        Self { sandbox, coordinator, way, worker, job, of_coordinator, of_worker }
    }

    /// Waits until the job has succeeded, and checks that no task was computed twice.
    async fn computed_once(self) {
        self.sandbox.result(&self.job.id).await;
        let (taken, done) = (scrape(&self.of_coordinator), scrape(&self.of_worker));
        assert_eq!(taken["evogait_tasks_total{phase=\"searching\"}"], 5.0);
        let needed = tasks(&taken);
        assert_eq!(done["evogait_worker_tasks_total"], needed, "{done:#?}");
        assert_eq!(self.worker.terminate(), Some(0));
    }
}

#[tokio::test]
async fn undeliverable_result_is_delivered_after_coordinator_returns() {
    let mut slow = SlowWorker::at_work().await;
    slow.coordinator.kill_9();
    until(&slow.of_worker, |s| s["evogait_worker_delivery_retries_total"] >= 2.0);
    slow.coordinator = slow.sandbox.coordinator_with(&["--metrics", &slow.of_coordinator]);
    slow.computed_once().await;
}

#[tokio::test]
async fn partitioned_worker_continues_and_delivers_late() {
    let slow = SlowWorker::at_work().await;
    slow.way.block(Direction::Up, true);
    slow.way.block(Direction::Down, true);
    until(&slow.of_coordinator, |s| s["evogait_leases_ended_total{why=\"lost\"}"] > 0.0);
    until(&slow.of_worker, |s| s["evogait_worker_tasks_total"] > 0.0);
    assert_eq!(slow.sandbox.job(&slow.job.id).await.rounds_sealed, 0);
    slow.way.heal();
    slow.computed_once().await;
}

#[tokio::test]
async fn stopped_coordinator_charges_no_worker_when_continued() {
    let mut sandbox = Sandbox::new();
    let metrics = free_port();
    let coordinator = sandbox.coordinator_with(&["--metrics", &metrics]);
    let mut worker = sandbox.worker_command(&sandbox.url(), 1);
    let _worker = Process::start(worker.env("EVOGAIT_FAULT", "slow@ms=1500"));
    let job = sandbox.submit("r", &tiny_job(24, 1)).await;
    until(&metrics, |s| s["evogait_slots_busy"] == 1.0);
    for _ in 0..3 {
        // Longer than a lease. The worker can't renew its leases in this time.
        coordinator.signal("STOP");
        tokio::time::sleep(Duration::from_millis(2500)).await;
        coordinator.signal("CONT");
        tokio::time::sleep(Duration::from_millis(300)).await;
    }
    sandbox.result(&job.id).await;
    let done = scrape(&metrics);
    assert_eq!((done["evogait_workers_lost_total"], done["evogait_attempts_total"]), (0.0, 0.0), "{done:#?}");
}

#[tokio::test]
async fn metrics_count_tasks_results_and_lost_workers() {
    let mut sandbox = Sandbox::new();
    let (coordinator_metrics, worker_metrics) = (free_port(), free_port());
    let _coordinator = sandbox.coordinator_with(&["--metrics", &coordinator_metrics]);
    let fresh = scrape(&coordinator_metrics);
    assert_eq!(fresh["evogait_rounds_sealed_total"], 0.0);
    assert_eq!((fresh["evogait_epoch"], fresh["evogait_active"], fresh["evogait_slots"]), (1.0, 1.0, 0.0));
    assert!(fresh.keys().any(|k| k.starts_with("evogait_engine_info{engine=\"rapier")), "{fresh:#?}");

    let worker = sandbox.worker_with(2, &["--metrics", &worker_metrics]);
    until(&coordinator_metrics, |s| s["evogait_workers{state=\"ready\"}"] == 1.0 && s["evogait_slots"] == 2.0);
    let job = sandbox.submit("r", &tiny_job(21, 2)).await;
    sandbox.result(&job.id).await;
    let done = scrape(&coordinator_metrics);
    // Rounds: the preparation, two generations, the finish and the report.
    assert_eq!(done["evogait_rounds_sealed_total"], 5.0);
    assert_eq!(done["evogait_round_seconds_count"], 5.0);
    let of = |phase: &str| done[&format!("evogait_tasks_total{{phase=\"{phase}\"}}")];
    assert_eq!((of("preparing"), of("searching")), (1.0, 10.0));
    assert!(of("finishing") > 0.0 && of("reporting") > 0.0, "{done:#?}");
    assert_eq!(done["evogait_jobs_ended_total{state=\"succeeded\"}"], 1.0);
    let results = done["evogait_results_total{verdict=\"accepted\"}"];
    assert!(results > of("finishing") + of("reporting"), "{done:#?}");
    assert_eq!((done["evogait_results_total{verdict=\"refused\"}"], done["evogait_marks_total"]), (0.0, 0.0));
    assert!(done["evogait_commit_seconds_count"] >= 4.0 && done["evogait_commit_seconds_sum"] > 0.0);
    assert_eq!(done["evogait_jobs{state=\"running\"}"], 0.0);

    let theirs = until(&worker_metrics, |s| s["evogait_worker_results_total{verdict=\"accepted\"}"] == results);
    assert_eq!(theirs["evogait_worker_tasks_total"], tasks(&done));
    assert_eq!((theirs["evogait_worker_slots"], theirs["evogait_worker_connected"]), (2.0, 1.0));

    // Kills a worker that holds leases.
    sandbox.submit("long", &tiny_job(22, 1000)).await;
    until(&coordinator_metrics, |s| s["evogait_round_tasks{state=\"leased\"}"] > 0.0);
    worker.kill_9();
    let lost = until(&coordinator_metrics, |s| s["evogait_workers_lost_total"] == 1.0);
    assert!(lost["evogait_leases_ended_total{why=\"lost\"}"] > 0.0, "{lost:#?}");
    assert_eq!((lost["evogait_slots"], lost["evogait_round_tasks{state=\"leased\"}"]), (0.0, 0.0));
    assert_eq!(lost["evogait_jobs{state=\"running\"}"], 1.0);

    assert_eq!(ask(&coordinator_metrics, "GET", "/healthz"), ("HTTP/1.1 200 OK".to_owned(), "active\n".to_owned()));
    assert!(ask(&coordinator_metrics, "POST", "/metrics").0.contains("405"));
    assert!(ask(&coordinator_metrics, "GET", "/etc/passwd").0.contains("404"));
}

#[test]
fn metrics_on_public_address_need_a_flag() {
    let sandbox = Sandbox::new();
    let output = output_of(sandbox.coordinator_command().args(["--metrics", "0.0.0.0:0"]));
    let text = String::from_utf8(output.stderr).expect("error messages are UTF-8");
    assert!(!output.status.success() && text.contains("--metrics-insecure-bind"), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
}

#[tokio::test]
async fn json_log_names_job_worker_and_call() {
    let mut sandbox = Sandbox::new();
    let log = sandbox.path().join("log");
    let file = std::fs::File::create(&log).expect("the log file can be created");
    let mut command = sandbox.coordinator_command();
    command.args(["--log-format", "json"]).env("RUST_LOG", "debug").stderr(Stdio::from(file));
    let coordinator = sandbox.start(command);
    let _worker = sandbox.worker(1);
    let job = sandbox.submit("r", &tiny_job(23, 1)).await;
    sandbox.result(&job.id).await;
    assert_eq!(coordinator.terminate(), Some(0));
    let text = std::fs::read_to_string(&log).expect("the log is UTF-8");
    let lines: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"))).collect();
    let said = |message: &str| {
        let line = lines.iter().find(|l| l["message"] == message);
        line.unwrap_or_else(|| panic!("no line has the message '{message}': {text}")).clone()
    };
    assert_eq!(said("job submitted")["job"], job.id.as_str());
    let sealed = said("round sealed");
    assert_eq!((&sealed["job"], &sealed["round"], &sealed["epoch"]), (&job.id.as_str().into(), &0.into(), &1.into()));
    let result = said("result");
    assert!(
        result["worker"].is_string() && result["assignment"].is_u64() && result["verdict"] == "accepted",
        "{result}"
    );
    let call = lines.iter().map(|l| &l["span"]).find(|s| s["method"] == "/evogait.v1.JobService/SubmitJob");
    let call = call.unwrap_or_else(|| panic!("no span of the call: {text}"));
    assert!(call["status"] == "Ok" && call["ms"].is_f64(), "{call}");
    assert!(call["peer"].as_str().is_some_and(|peer| peer.starts_with("127.0.0.1:")), "{call}");
}
