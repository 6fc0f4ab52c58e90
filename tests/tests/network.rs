//! Bad networks between processes: delays, one-way partitions and cut connections. Jobs continue, and their results do
//! not change.

use cluster_tests::proxy::{Direction, Proxy};
use cluster_tests::sandbox::{Process, Sandbox, TIMEOUT, is_last, tiny_job, undisturbed};
use proto::v1::job_event::Event;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{CancelJobRequest, Job, JobEvent, JobState, WatchJobRequest};
use std::time::{Duration, Instant};

/// Returns a tiny job on the lockstep engine, which is faster.
fn cheap_job(seed: u32, generations: u32) -> String {
    tiny_job(seed, generations).replace("engine = \"rapier\"", "engine = \"lockstep\"")
}

/// Starts a worker behind a proxy. Its evaluations take time without using a core.
fn behind(sandbox: &Sandbox, proxy: &Proxy, slots: u32) -> Process {
    Process::start(sandbox.worker_command(&proxy.url(), slots).env("EVOGAIT_FAULT", "slow@ms=20"))
}

fn has_progressed_since(before: &Job) -> impl Fn(&Job) -> bool {
    let (rounds, tasks) = (before.rounds_sealed, before.tasks_done);
    move |job| (job.rounds_sealed, job.tasks_done) > (rounds, tasks) || job.state() == JobState::Succeeded
}

/// Checks that no slot stays busy after a test, and that the slots get new work.
async fn assert_slots_are_free(sandbox: &Sandbox) {
    let start = Instant::now();
    loop {
        let workers = sandbox.workers().await;
        if !workers.is_empty() && workers.iter().all(|w| w.busy == 0) {
            break;
        }
        assert!(start.elapsed() < TIMEOUT, "slots must become free: {workers:?}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let next = sandbox.submit("afterwards", &cheap_job(39, 1)).await;
    sandbox.result(&next.id).await;
}

#[tokio::test]
async fn job_survives_bad_networks_with_same_result() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let proxy = Proxy::to(&sandbox.url());
    let _worker = behind(&sandbox, &proxy, 2);
    let job = sandbox.submit("r", &cheap_job(30, 40)).await;
    sandbox.until(&job.id, |job| job.rounds_sealed > 1).await;

    // Each block lasts longer than a lease (2 s). The leases expire, and their tasks are assigned again. Late and
    // repeated results must do no harm.
    for direction in [Direction::Up, Direction::Down] {
        proxy.block(direction, true);
        tokio::time::sleep(Duration::from_millis(2500)).await;
        let before = sandbox.job(&job.id).await;
        assert_ne!(before.state(), JobState::Succeeded, "the job must not end before the network is repaired");
        proxy.block(direction, false);
        sandbox.until(&job.id, has_progressed_since(&before)).await;
    }
    for _ in 0..3 {
        let before = sandbox.job(&job.id).await;
        proxy.cut();
        sandbox.until(&job.id, has_progressed_since(&before)).await;
    }
    proxy.slow(Duration::from_millis(50), 100_000);
    let before = sandbox.job(&job.id).await;
    sandbox.until(&job.id, has_progressed_since(&before)).await;
    proxy.heal();
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&cheap_job(30, 40)).await);
    assert_slots_are_free(&sandbox).await;
}

/// Blocks both directions without closing the connection, as if the other machine had lost power.
fn block_both_directions(proxy: &Proxy) {
    proxy.block(Direction::Up, true);
    proxy.block(Direction::Down, true);
}

#[tokio::test]
async fn worker_switches_from_silent_coordinator_to_next_address() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let (silent, other) = (Proxy::to(&sandbox.url()), Proxy::to(&sandbox.url()));
    let both = format!("{},{}", silent.url(), other.url());
    let _worker = Process::start(sandbox.worker_command(&both, 2).env("EVOGAIT_FAULT", "slow@ms=20"));
    let job = sandbox.submit("r", &cheap_job(35, 20)).await;
    sandbox.until(&job.id, |job| job.rounds_sealed > 1).await;
    block_both_directions(&silent);
    assert_ne!(
        sandbox.job(&job.id).await.state(),
        JobState::Succeeded,
        "the job must not end before the network fails"
    );
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&cheap_job(35, 20)).await);
}

#[tokio::test]
async fn commands_switch_from_silent_coordinator_to_next_address() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let (silent, other) = (Proxy::to(&sandbox.url()), Proxy::to(&sandbox.url()));
    let both = format!("{},{}", silent.url(), other.url());
    let job = sandbox.submit("r", &cheap_job(36, 20)).await;
    std::thread::scope(|scope| {
        let watching = scope.spawn(|| sandbox.evogait(&["watch", &job.id, "--coordinator", &both]));
        // Longer than the command needs to connect.
        std::thread::sleep(Duration::from_secs(2));
        block_both_directions(&silent);
        // The watch loses a working connection; the cancel command meets a silent coordinator from the start.
        let cancelled = sandbox.evogait(&["cancel", &job.id, "--coordinator", &both]);
        assert!(cancelled.status.success(), "{}", String::from_utf8_lossy(&cancelled.stderr));
        let watched = watching.join().expect("the thread does not panic");
        let told = String::from_utf8_lossy(&watched.stderr);
        assert!(told.contains("lost the coordinator") && told.contains("was cancelled"), "{told}");
    });
}

#[tokio::test]
async fn cancelled_job_ignores_late_results() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let proxy = Proxy::to(&sandbox.url());
    let _worker = behind(&sandbox, &proxy, 2);
    let job = sandbox.submit("r", &cheap_job(32, 1000)).await;
    sandbox.until(&job.id, |job| job.rounds_sealed > 1).await;
    proxy.block(Direction::Up, true);
    tokio::time::sleep(Duration::from_millis(200)).await;
    let cancel = CancelJobRequest { id: job.id.clone() };
    let cancelled = sandbox
        .client()
        .cancel_job(cancel)
        .await
        .expect("the job can be cancelled")
        .into_inner()
        .job
        .expect("the response has the job");
    assert_eq!(cancelled.state(), JobState::Cancelled);
    proxy.heal();
    assert_slots_are_free(&sandbox).await;
    assert_eq!(sandbox.job(&job.id).await, cancelled);
}

#[tokio::test]
async fn watch_over_breaking_network_has_no_gap() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let direct = Proxy::to(&sandbox.url());
    let _worker = behind(&sandbox, &direct, 2);
    let proxy = Proxy::to(&sandbox.url());
    let job = sandbox.submit("r", &cheap_job(33, 12)).await;

    let mut events: Vec<JobEvent> = Vec::new();
    while !events.last().is_some_and(is_last) {
        let after = events.last().map_or(0, |e| e.sequence);
        let mut client = JobServiceClient::connect(proxy.url()).await.expect("the network is available again");
        let request = WatchJobRequest { id: job.id.clone(), after };
        let mut stream = client.watch_job(request).await.expect("the watch starts").into_inner();
        let until = events.len() + 3;
        // Events that are in transit are lost with the connection.
        while let Ok(Some(event)) = stream.message().await {
            if !matches!(event.event, Some(Event::TasksDone(_))) {
                events.push(event);
            }
            if events.len() == until {
                proxy.cut();
            }
        }
    }
    let sequence: Vec<u64> = events.iter().map(|e| e.sequence).collect();
    assert_eq!(sequence, (1..=events.len() as u64).collect::<Vec<_>>());
    assert!(events.len() >= 12, "{}", events.len());
}

#[tokio::test]
async fn watch_command_over_breaking_network_repeats_no_event() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let direct = Proxy::to(&sandbox.url());
    let _worker = behind(&sandbox, &direct, 2);
    let proxy = Proxy::to(&sandbox.url());
    let job = sandbox.submit("r", &cheap_job(37, 12)).await;
    let watched = std::thread::scope(|scope| {
        let url = proxy.url();
        let (sandbox, id) = (&sandbox, &job.id);
        let watching = scope.spawn(move || sandbox.told(&["watch", id, "--json", "--coordinator", &url]));
        while !watching.is_finished() {
            std::thread::sleep(Duration::from_millis(500));
            proxy.cut();
        }
        watching.join().expect("the thread does not panic")
    });
    let lines: Vec<serde_json::Value> =
        watched.lines().map(|l| serde_json::from_str(l).expect("each line is JSON")).collect();
    let stored = |line: &&serde_json::Value| line["sequence"].is_u64() && line["event"] != "progress";
    let sequence: Vec<u64> = lines.iter().filter(stored).filter_map(|line| line["sequence"].as_u64()).collect();
    assert_eq!(sequence, (1..=sequence.len() as u64).collect::<Vec<_>>());
    assert!(sequence.len() >= 12, "{watched}");
}

#[tokio::test]
async fn kills_stops_and_delays_do_not_change_result() {
    // Without a finish: its tasks take long, and three kills during the same task would rightly fail the job.
    let job = cheap_job(34, 20).replace("particles = 5", "particles = 14");
    let job = format!("{}[finish]\nkind = \"none\"\n", job.split("[finish]").next().expect("the job is not empty"));
    let fast = |sandbox: &Sandbox, proxy: &Proxy| {
        Process::start(sandbox.worker_command(&proxy.url(), 1).env("EVOGAIT_FAULT", "slow@ms=10"))
    };
    let expected = undisturbed(&job).await;
    for workers in [1, 2, 7] {
        let mut sandbox = Sandbox::new();
        let mut coordinator = sandbox.coordinator();
        let proxy = Proxy::to(&sandbox.url());
        let mut running: Vec<Process> = (0..workers).map(|_| fast(&sandbox, &proxy)).collect();
        let job = sandbox.submit("r", &job).await;
        let mut turn = 0;
        loop {
            let now = sandbox.job(&job.id).await;
            if now.state() == JobState::Succeeded {
                break;
            }
            assert!(
                turn < 300 && now.state() != JobState::Failed,
                "the job must succeed within 300 turns; after {turn}: {now:?}"
            );
            let victim = turn % workers;
            match turn % 5 {
                0 => proxy.slow(Duration::from_millis(20), 0),
                1 => running[victim].signal("STOP"),
                // A new worker replaces the victim. A stopped process can also be killed.
                2 => running[victim] = fast(&sandbox, &proxy),
                3 => proxy.cut(),
                _ => {
                    proxy.heal();
                    coordinator.kill_9();
                    coordinator = sandbox.coordinator();
                    running.iter().for_each(|worker| worker.signal("CONT"));
                }
            }
            turn += 1;
            tokio::time::sleep(Duration::from_millis(200)).await;
        }
        running.iter().for_each(|worker| worker.signal("CONT"));
        assert!(turn >= 4, "too few disturbances with {workers} workers: {turn}");
        assert_eq!(sandbox.result(&job.id).await.result_digest, expected, "{workers} workers");
        drop(coordinator);
    }
}
