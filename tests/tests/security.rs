//! Encryption, authentication and roles across processes, and the switch of workers and clients to a standby
//! coordinator.

use cluster_tests::certificates::{Certificates, closed};
use cluster_tests::sandbox::{Process, Sandbox, TIMEOUT, free_port, output_of, program, tiny_job};
use cluster_tests::scripted::ScriptedWorker;
use proto::credentials::Credentials;
use proto::dial::{Dial, FailoverChannel, reason};
use proto::v1::job_event::Event;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::worker_service_client::WorkerServiceClient;
use proto::v1::{
    CompleteRequest, GetJobRequest, GetResultRequest, JobEvent, ListJobsRequest, ListJobsResponse, SubmitJobRequest,
    WatchJobRequest,
};
use std::error::Error as _;
use std::fs::{self, File};
use std::path::PathBuf;
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};
use tonic::{Code, Status, Streaming};

/// Child process that is killed on drop.
struct Started(Child);

impl Drop for Started {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Cluster with certificates and tokens on the loopback interface.
struct Cluster {
    sandbox: Sandbox,
    certificates: Certificates,
}

impl Cluster {
    fn new() -> Self {
        let sandbox = Sandbox::new();
        let certificates = Certificates::make(&sandbox.file("certs"));
        Self { sandbox, certificates }
    }

    fn cert(&self, name: &str) -> PathBuf {
        self.certificates.file(name)
    }

    fn log(&self, name: &str) -> File {
        File::create(self.sandbox.file(name)).unwrap()
    }

    fn coordinator(&mut self) -> Process {
        let mut command = self.sandbox.coordinator_command();
        command.env("RUST_LOG", "debug").stderr(self.log("coordinator.log"));
        self.certificates.close(&mut command);
        self.sandbox.start(command)
    }

    fn url(&self) -> String {
        closed(&self.sandbox.url())
    }

    /// Adds the coordinator's URL and the credentials of a role to the command of a client or worker.
    fn shown(&self, mut command: Command, who: &str) -> Command {
        command.args(["--coordinator", &self.url()]);
        self.certificates.show(&mut command, who);
        command
    }

    /// Revokes all tokens except the admin's while the coordinator runs.
    async fn revoke_all_tokens_but_admin(&self) {
        let tokens = fs::read_to_string(self.cert("tokens")).unwrap();
        let left: String = tokens.lines().filter(|l| l.starts_with("admin")).map(|l| format!("{l}\n")).collect();
        fs::write(self.cert("tokens"), left).unwrap();
        let listening = format!("--tokens\0{}", self.cert("tokens").display());
        let ours = fs::read_dir("/proc").unwrap().filter_map(|entry| {
            let folder = entry.ok()?.path();
            let line = fs::read_to_string(folder.join("cmdline")).ok()?;
            line.contains(&listening).then(|| folder.file_name().unwrap_or_default().to_string_lossy().into_owned())
        });
        let pids: Vec<String> = ours.collect();
        assert_eq!(pids.len(), 1, "one coordinator must use these tokens");
        assert!(Command::new("kill").args(["-HUP", &pids[0]]).status().unwrap().success());
        self.wait_for_log("tokens reloaded", 1).await;
    }

    /// Waits until the coordinator's log contains these words the given number of times.
    async fn wait_for_log(&self, words: &str, times: usize) {
        let (start, log) = (Instant::now(), self.sandbox.file("coordinator.log"));
        loop {
            let found = fs::read_to_string(&log).unwrap().matches(words).count();
            if found == times {
                return;
            }
            assert!(
                start.elapsed() < TIMEOUT,
                "the log must contain \"{words}\" {times} times, but contains it {found} times"
            );
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    fn dial(&self, certificate: Option<&str>, token: Option<&str>) -> FailoverChannel {
        self.certificates.dial(&self.sandbox.url(), certificate, token).channel()
    }

    fn client(&self) -> FailoverChannel {
        self.dial(Some("client"), Some("client"))
    }

    fn admin(&self) -> FailoverChannel {
        self.dial(Some("client"), Some("admin"))
    }
}

/// Returns the command of a program with debug logs.
fn verbose_program(name: &str) -> Command {
    let mut command = program(name);
    command.env("RUST_LOG", "debug").env("EVOGAIT_LOG", "debug");
    command
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

async fn list(channel: FailoverChannel) -> Result<ListJobsResponse, Status> {
    JobServiceClient::new(channel).list_jobs(ListJobsRequest::default()).await.map(|answer| answer.into_inner())
}

async fn submit(channel: FailoverChannel, request_id: &str, job_toml: String) -> Result<String, Status> {
    let request = SubmitJobRequest { request_id: request_id.to_owned(), job_toml, priority: 0 };
    let answer = JobServiceClient::new(channel).submit_job(request).await?.into_inner();
    Ok(answer.job.expect("the response has the job").id)
}

async fn watch(channel: FailoverChannel, id: &str) -> Streaming<JobEvent> {
    let request = WatchJobRequest { id: id.to_owned(), after: 0 };
    JobServiceClient::new(channel).watch_job(request).await.expect("the watch starts").into_inner()
}

async fn complete(channel: FailoverChannel) -> Result<(), Status> {
    WorkerServiceClient::new(channel).complete(CompleteRequest::default()).await.map(drop)
}

fn code<T>(answer: Result<T, Status>) -> Code {
    answer.map_or_else(|status| status.code(), |_| Code::Ok)
}

/// Runs a small job with `evogait run`, from submission to results.
fn run_job(cluster: &Cluster) {
    let job = cluster.sandbox.file("job.toml");
    fs::write(&job, tiny_job(21, 2)).unwrap();
    let mut command = verbose_program("evogait");
    command.arg("run").arg(&job).arg("--out").arg(cluster.sandbox.file("out"));
    let run = cluster.shown(command, "client").output().unwrap();
    assert!(run.status.success(), "{}", text(&run));
    fs::write(cluster.sandbox.file("evogait.log"), &run.stderr).unwrap();
}

/// Asserts that a cluster without encryption computes the same result as the first job of this one.
async fn result_is_that_of_open_cluster(cluster: &Cluster) {
    let listed = list(cluster.client()).await.unwrap();
    let id = listed.jobs[0].id.clone();
    let mut service = JobServiceClient::new(cluster.client()).max_decoding_message_size(1 << 28);
    let digest = service.get_result(GetResultRequest { id }).await.unwrap().into_inner().result_digest;
    let mut open = Sandbox::new();
    let _open = open.coordinator();
    let _open_worker = open.worker(2);
    let job = open.submit("r", &tiny_job(21, 2)).await;
    assert_eq!(open.result(&job.id).await.result_digest, digest, "encryption must not change the result");
}

/// Asserts that each role may call only its own methods.
async fn roles_are_enforced(cluster: &Cluster) {
    let tiny = || tiny_job(22, 1);
    let refused = submit(cluster.dial(Some("worker"), Some("worker")), "w", tiny()).await.unwrap_err();
    assert_eq!(refused.code(), Code::PermissionDenied);
    assert!(refused.message().contains("SubmitJob requires a token with role client"), "{refused}");
    assert_eq!(code(complete(cluster.client()).await), Code::PermissionDenied);
    // InvalidArgument shows that the call was authorised: only the message is invalid.
    assert_eq!(code(complete(cluster.dial(Some("worker"), Some("worker"))).await), Code::InvalidArgument);
    assert_eq!(code(complete(cluster.admin()).await), Code::InvalidArgument);
    assert_eq!(code(list(cluster.admin()).await), Code::Ok);
    let without_token = || cluster.dial(Some("client"), None);
    assert_eq!(code(submit(without_token(), "n", tiny()).await), Code::Unauthenticated);
    assert_eq!(code(complete(without_token()).await), Code::Unauthenticated);
    assert_eq!(code(list(without_token()).await), Code::Unauthenticated);
}

/// Asserts that connections without a client certificate, in plain text, or with another CA fail.
async fn connections_without_credentials_fail(cluster: &Cluster) {
    // The connection may break before the client reads the coordinator's alert. The client then does not learn the
    // reason, so the call is repeated.
    let start = Instant::now();
    loop {
        let refused = list(cluster.dial(None, Some("client"))).await.unwrap_err();
        if refused.source().map(reason).unwrap_or_default().contains("requires a client certificate") {
            break;
        }
        assert!(start.elapsed() < TIMEOUT, "no attempt reported the missing client certificate");
    }
    let plain = Dial::new(cluster.sandbox.url().parse().unwrap(), &Credentials::default()).unwrap();
    assert_ne!(code(list(plain.channel()).await), Code::Ok);
    let other = Cluster::new();
    let mut command = verbose_program("evogait");
    command.args(["list", "--coordinator", &cluster.url()]).env("EVOGAIT_CA", other.cert("ca.pem"));
    let output = command.env("EVOGAIT_TOKEN_FILE", cluster.cert("client.token")).output().unwrap();
    assert!(text(&output).contains("not signed by the CA that --ca names"), "{}", text(&output));
}

/// Asserts that a revoked token becomes invalid when the coordinator reloads its tokens, and that streams and workers
/// with this token end.
async fn revocation_ends_streams_and_workers(cluster: &Cluster, mut worker: Started) {
    let id = submit(cluster.client(), "long", tiny_job(23, 1000)).await.unwrap();
    let mut watched = watch(cluster.client(), &id).await;
    let mut by_admin = watch(cluster.admin(), &id).await;
    while !matches!(watched.message().await.unwrap().unwrap().event, Some(Event::RoundSealed(_))) {}
    cluster.revoke_all_tokens_but_admin().await;
    assert_eq!(code(list(cluster.client()).await), Code::Unauthenticated);
    assert_eq!(code(list(cluster.admin()).await), Code::Ok);
    let end = tokio::time::timeout(TIMEOUT, async {
        loop {
            match watched.message().await {
                Ok(Some(_)) => {}
                end => return end,
            }
        }
    });
    assert_eq!(code(end.await.expect("the stream ends")), Code::Unauthenticated);
    let start = Instant::now();
    let ended = loop {
        match worker.0.try_wait().unwrap() {
            Some(ended) => break ended,
            None => tokio::time::sleep(Duration::from_millis(10)).await,
        }
        assert!(start.elapsed() < TIMEOUT, "the worker must exit");
    };
    assert_eq!(ended.code(), Some(1), "a worker with a revoked token must exit with code 1");
    assert!(by_admin.message().await.unwrap().is_some(), "streams of the valid token must stay open");
    cluster.wait_for_log("worker expelled", 1).await;
    let request = GetJobRequest { id: id.clone() };
    let answer = JobServiceClient::new(cluster.admin()).get_job(request).await.unwrap().into_inner();
    let (job, standing) = (answer.job.unwrap(), answer.standing.unwrap());
    assert!(
        standing.held.is_empty() && standing.attempts.is_empty(),
        "leases must be revoked at once, without an attempt: {standing:?}"
    );
    assert!(job.reason.contains("none is connected"), "{}", job.reason);
}

/// Asserts that no process logs a secret.
fn logs_hold_no_token(cluster: &Cluster) {
    for log in ["coordinator.log", "worker.log", "evogait.log"] {
        let text = fs::read_to_string(cluster.sandbox.file(log)).unwrap();
        assert!(!text.is_empty(), "{log} must have lines at level debug");
        for who in ["client", "worker", "admin"] {
            assert!(!text.contains(&cluster.certificates.token(who)), "the {who} token must not be in {log}");
        }
    }
}

#[tokio::test]
async fn secured_cluster_gives_same_result_and_enforces_roles() {
    let mut cluster = Cluster::new();
    let coordinator = cluster.coordinator();
    let mut command = cluster.shown(verbose_program("worker"), "worker");
    let worker = Started(command.args(["--slots", "2"]).stderr(cluster.log("worker.log")).spawn().unwrap());
    run_job(&cluster);
    result_is_that_of_open_cluster(&cluster).await;
    roles_are_enforced(&cluster).await;
    connections_without_credentials_fail(&cluster).await;
    revocation_ends_streams_and_workers(&cluster, worker).await;
    assert_eq!(coordinator.terminate(), Some(0));
    logs_hold_no_token(&cluster);
}

/// Number of workers that lose their token at the same time. None of them may count as crashed, in any order of
/// disconnecting.
const EXPELLED: usize = 20;

#[tokio::test]
async fn worker_with_revoked_token_loses_leases_without_attempts() {
    let mut cluster = Cluster::new();
    let _coordinator = cluster.coordinator();
    let job = tiny_job(24, 1000).replace("particles = 5", &format!("particles = {EXPELLED}"));
    let id = submit(cluster.client(), "r", job).await.unwrap();
    let mut workers = Vec::new();
    for i in 0..EXPELLED {
        let channel = cluster.dial(Some("worker"), Some("worker"));
        workers.push(ScriptedWorker::join_by(channel, &format!("w{i}")).await);
    }
    workers[0].receive_lease().await;
    let standing = async || {
        let admin = cluster.admin();
        let answer = JobServiceClient::new(admin).get_job(GetJobRequest { id: id.clone() }).await.unwrap();
        answer.into_inner().standing.unwrap()
    };
    assert!(standing().await.held_total > 0);
    let refused = (0..EXPELLED).zip(workers).map(|(i, mut worker)| {
        tokio::spawn(async move {
            assert_eq!(worker.is_refused().await.code(), Code::Unauthenticated);
            // Every other worker keeps its connection open; the rest disconnect.
            (i % 2 == 0).then_some(worker)
        })
    });
    let refused: Vec<_> = refused.collect();
    cluster.revoke_all_tokens_but_admin().await;
    let mut talking = Vec::new();
    for worker in refused {
        talking.push(worker.await.unwrap());
    }
    cluster.wait_for_log("worker expelled", EXPELLED).await;
    let standing = standing().await;
    assert!(
        standing.held.is_empty() && standing.attempts.is_empty(),
        "leases must be revoked at once, without an attempt: {standing:?}"
    );
    drop(talking);
}

#[test]
fn plain_text_beyond_loopback_is_refused() {
    let cluster = Cluster::new();
    let coordinator = |options: &[(&str, &str)]| {
        let mut command = verbose_program("coordinator");
        command.args(["--listen", "0.0.0.0:0", "--store", "memory:"]).env("RUST_LOG", "error");
        for (option, file) in options {
            command.arg(option).arg(cluster.cert(file));
        }
        let output = output_of(&mut command);
        assert_eq!(output.status.code(), Some(1), "{}", text(&output));
        assert_eq!(text(&output).lines().count(), 1, "{}", text(&output));
        text(&output)
    };
    let (cert, key, tokens) =
        (("--tls-cert", "coordinator.pem"), ("--tls-key", "coordinator.key"), ("--tokens", "tokens"));
    assert!(coordinator(&[]).contains("neither encrypted (--tls-cert, --tls-key) nor authenticated (--tokens)"));
    assert!(coordinator(&[tokens]).contains("not encrypted (--tls-cert, --tls-key)"));
    assert!(coordinator(&[cert, key]).contains("not authenticated (--tokens)"));
    // Errors about credentials name the file, before the coordinator starts.
    assert!(coordinator(&[cert]).contains("must be given together"));
    assert!(
        coordinator(&[cert, ("--tls-key", "worker.key")]).contains("worker.key is not the key of the certificate in")
    );
    assert!(coordinator(&[("--tls-cert", "tokens"), key]).contains("tokens holds no certificate in PEM"));
    assert!(coordinator(&[cert, key, ("--tokens", "nowhere")]).contains("can't read the token file"));
    let text_of_token = coordinator(&[cert, key, ("--tokens", "client.token")]);
    let secret = cluster.certificates.token("client");
    assert!(text_of_token.contains("line 1") && !text_of_token.contains(&secret), "{text_of_token}");

    for program in ["worker", "evogait"] {
        let mut command = verbose_program(program);
        if program == "evogait" {
            command.arg("list");
        }
        command.args(["--coordinator", "http://192.0.2.1:7077"]).env("EVOGAIT_TOKEN", "a-token-of-some-length");
        let output = output_of(&mut command);
        assert!(!output.status.success());
        assert!(text(&output).contains("a token is not sent to http://192.0.2.1:7077"), "{}", text(&output));
        assert!(!text(&output).contains("a-token-of"), "{}", text(&output));
    }
}

#[tokio::test]
async fn workers_and_clients_switch_to_the_standby() {
    let mut sandbox = Sandbox::new();
    let first = sandbox.coordinator();
    let url = sandbox.url();
    let second = free_port();
    let both = format!("{url},http://{second}");
    let _worker = Started(program("worker").args(["--coordinator", &both, "--slots", "2"]).spawn().unwrap());
    let (job, out) = (sandbox.path().join("job.toml"), sandbox.path().join("out"));
    fs::write(&job, tiny_job(23, 6)).unwrap();
    let mut run = program("evogait");
    run.arg("--quiet").arg("run").arg(&job).args(["--coordinator", &both]).arg("--out").arg(&out);
    let mut run = Started(run.spawn().unwrap());

    let start = Instant::now();
    let id = loop {
        let listed = sandbox.client().list_jobs(ListJobsRequest::default()).await.unwrap().into_inner().jobs;
        if let Some(job) = listed.first().filter(|job| job.rounds_sealed > 1) {
            break job.id.clone();
        }
        assert!(start.elapsed() < TIMEOUT, "the job must progress");
        tokio::time::sleep(Duration::from_millis(10)).await;
    };
    first.kill_9();
    let mut command = sandbox.coordinator_command();
    // A repeated option would be ambiguous, so the command is built anew with the same store.
    let store = command.get_args().skip_while(|a| *a != "--store").nth(1).unwrap().to_owned();
    command = Command::new(command.get_program());
    command.arg("--store").arg(store).args(["--listen", &second, "--lease-seconds", "2"]);
    let _second = sandbox.start(command);
    assert!(sandbox.url().ends_with(&second));

    let digest = sandbox.result(&id).await.result_digest;
    while run.0.try_wait().unwrap().is_none() {
        assert!(start.elapsed() < TIMEOUT, "the client must end");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(run.0.wait().unwrap().success());
    let rows = fs::read_to_string(out.join("history.csv")).unwrap().lines().count();
    assert_eq!(rows, 1 + 6, "the file must have a header and each generation once");

    let mut undisturbed = Sandbox::new();
    let _coordinator = undisturbed.coordinator();
    let _other = undisturbed.worker(2);
    let job = undisturbed.submit("r", &tiny_job(23, 6)).await;
    assert_eq!(undisturbed.result(&job.id).await.result_digest, digest);
}

#[tokio::test]
async fn submitted_job_cannot_read_files() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let robot = sandbox.path().join("robot.toml");
    fs::write(&robot, include_str!("../../scenarios/robots/quadropod.toml")).unwrap();
    let channel = || Dial::new(sandbox.url().parse().unwrap(), &Credentials::default()).unwrap().channel();
    for path in ["/etc/passwd", "../scenarios/robots/quadropod.toml", "quadropod.toml", robot.to_str().unwrap()] {
        for field in ["robot = \"quadropod\"", "environment = \"empty\""] {
            let name = field.split_once(' ').unwrap().0;
            let job = tiny_job(24, 1).replace(field, &format!("{name} = \"{path}\""));
            let refused = submit(channel(), "r", job).await.unwrap_err();
            assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
            assert!(refused.message().contains(path) && !refused.message().contains("root:"), "{refused}");
        }
    }
    assert_eq!(list(channel()).await.unwrap().jobs.len(), 0);
}
