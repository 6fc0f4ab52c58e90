//! Errors of the commands for jobs of a coordinator: unknown and ended jobs, refused credentials, unfit addresses.

mod common;
#[path = "common/transcript.rs"]
mod transcript;

use common::{SMALL_JOB, evogait, run};
use coordinator::{Access, Config, Running, StoreUrl, Tls};
use proto::credentials::{Identity, identity};
use rcgen::{BasicConstraints, CertificateParams, IsCa, Issuer, KeyPair, date_time_ymd};
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use tempfile::TempDir;
use tokio::runtime::Runtime;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::transport;
use tonic_health::ServingStatus;
use transcript::{errors, without_digests};

/// Coordinator in this process, with its jobs in memory and without workers.
struct Host {
    runtime: Runtime,
    running: Option<Running>,
    address: String,
}

impl Host {
    fn start(tls: Option<Tls>, access: Option<Access>) -> Self {
        let runtime = Runtime::new().unwrap();
        let config = Config { tls, access: access.map(Arc::new), ..Config::embedded(StoreUrl::Memory) };
        let running = runtime.block_on(coordinator::serve(config)).unwrap();
        let address = running.local_addr().to_string();
        Self { runtime, running: Some(running), address }
    }

    /// Runs failing commands, with ADDRESS in place of this coordinator's address.
    fn errors(&self, folder: &Path, lines: &str) -> String {
        errors(folder, &lines.replace("ADDRESS", &self.address)).replace(&self.address, "ADDRESS")
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        if let Some(running) = self.running.take() {
            self.runtime.block_on(running.shutdown()).unwrap();
        }
    }
}

/// Creates a folder with the small job.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.toml"), SMALL_JOB).unwrap();
    folder
}

#[test]
fn unknown_jobs_are_refused() {
    let (folder, host) = (folder(), Host::start(None, None));
    let long = "x".repeat(65);
    let lines = ["show", "watch", "cancel", "pause", "resume", "restart", "fetch"]
        .map(|command| format!("{command} none --coordinator http://ADDRESS\n"));
    let others = format!(
        "
        evaluate j9-0123456789ab --coordinator http://ADDRESS
        plan j9-0123456789ab --coordinator http://ADDRESS
        simulate j9-0123456789ab --gait 1 --coordinator http://ADDRESS
        EVOGAIT_COORDINATOR=http://ADDRESS show none
        show '' --coordinator http://ADDRESS
        show {long} --coordinator http://ADDRESS
        "
    );
    let said = without_digests(&host.errors(folder.path(), &(lines.concat() + &others)));
    insta::assert_snapshot!(said);
}

#[test]
fn commands_on_unfit_job_states_are_refused() {
    let (folder, host) = (folder(), Host::start(None, None));
    let url = format!("http://{}", host.address);
    fs::write(folder.path().join("renamed.toml"), SMALL_JOB.replace("\"small\"", "\"renamed\"")).unwrap();
    let id = run(folder.path(), &["submit", "job.toml", "--coordinator", &url]).success().trim().to_owned();
    let queued = host.errors(
        folder.path(),
        &"
        submit job.toml --priority 3 --coordinator http://ADDRESS
        submit renamed.toml --coordinator http://ADDRESS
        fetch ID --out out --coordinator http://ADDRESS
        plan ID --coordinator http://ADDRESS
        simulate ID --gait 1 --coordinator http://ADDRESS
        restart ID --coordinator http://ADDRESS
        evaluate ID --coordinator http://ADDRESS
        evaluate ID --genome 1,2 --coordinator http://ADDRESS
        "
        .replace("ID", &id),
    );
    run(folder.path(), &["cancel", &id, "--coordinator", &url]).success();
    let cancelled = host.errors(
        folder.path(),
        &"
        watch ID --coordinator http://ADDRESS
        pause ID --coordinator http://ADDRESS
        resume ID --coordinator http://ADDRESS
        fetch ID --out out --coordinator http://ADDRESS
        plan ID --coordinator http://ADDRESS
        restart ID --coordinator http://ADDRESS
        restart ID --from-generation 7 --coordinator http://ADDRESS
        "
        .replace("ID", &id),
    );
    let said = without_digests(&format!("With a queued job:\n\n{queued}\nWith a cancelled job:\n\n{cancelled}"));
    insta::assert_snapshot!(said);
}

#[test]
fn cancelled_job_of_coordinator_fails_its_run() {
    let (folder, host) = (folder(), Host::start(None, None));
    let url = format!("http://{}", host.address);
    let id = run(folder.path(), &["submit", "job.toml", "--coordinator", &url]).success().trim().to_owned();
    run(folder.path(), &["cancel", &id, "--coordinator", &url]).success();
    let arguments = ["run", "job.toml", "--coordinator", &url, "--out", "out", "--quiet"];
    let seen = run(folder.path(), &arguments);
    assert_eq!((seen.code, seen.out.as_str()), (1, ""), "{}", seen.err);
    let said = without_digests(&seen.err);
    insta::assert_snapshot!(said);
}

/// Interrupts a command once it has printed a line, to standard output with `--json`; returns its error.
fn interrupted(folder: &Path, arguments: &[&str]) -> String {
    let mut command = evogait(folder, arguments);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut out = BufReader::new(child.stdout.take().unwrap());
    let mut err = BufReader::new(child.stderr.take().unwrap());
    let mut said = String::new();
    if arguments.contains(&"--json") { out.read_line(&mut said) } else { err.read_line(&mut said) }.unwrap();
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    err.read_to_string(&mut said).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{said}");
    let error = said.lines().find(|line| line.starts_with("error: "));
    error.unwrap_or(&said).to_owned() + "\n"
}

#[test]
fn interrupted_commands_name_the_next_command() {
    let (folder, host) = (folder(), Host::start(None, None));
    let (path, url) = (folder.path(), format!("http://{}", host.address));
    let long = SMALL_JOB.replace("generations = 2", "generations = 2000");
    fs::write(path.join("long.toml"), long).unwrap();
    let id = run(path, &["submit", "job.toml", "--coordinator", &url]).success().trim().to_owned();
    let said = [
        interrupted(path, &["watch", &id, "--json", "--coordinator", &url]),
        interrupted(path, &["run", "job.toml", "--out", "out", "--coordinator", &url]),
        interrupted(path, &["run", "long.toml", "--out", "long", "--workers", "1"]),
    ];
    let said = without_digests(&said.join("\n")).replace(&host.address, "ADDRESS");
    // The number of generations depends on the time.
    let (head, tail) = said.rsplit_once(" after ").unwrap();
    let said = format!("{head} after N {}", tail.split_once(' ').unwrap().1);
    insta::assert_snapshot!(said);
}

#[test]
fn unaccepted_credentials_are_refused() {
    let folder = folder();
    for certs in ["certs", "other"] {
        run(folder.path(), &["certs", "init", certs]).success();
    }
    let at = |name: &str| folder.path().join("certs").join(name);
    let tls = Tls { identity: identity(&at("coordinator.pem"), &at("coordinator.key")).unwrap(), clients: None };
    let host = Host::start(Some(tls), Some(Access::read(&at("tokens")).unwrap()));
    let named = "--coordinator https://ADDRESS";
    let said = host.errors(
        folder.path(),
        &format!(
            "
            list {named}
            list {named} --ca other/ca.pem
            list {named} --ca certs/ca.pem
            list {named} --ca certs/ca.pem --token-file other/client.token
            list {named} --ca certs/ca.pem --token-file certs/worker.token
            submit job.toml {named} --ca certs/ca.pem --token-file certs/worker.token
            health {named} --ca other/ca.pem
            "
        ),
    );
    insta::assert_snapshot!(said);
}

/// Returns a coordinator's certificate and key for a host, valid until a year, and stores its CA in `ca.pem`.
fn certificate(folder: &Path, host: &str, until: i32) -> Identity {
    let mut params = CertificateParams::new(Vec::<String>::new()).unwrap();
    params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
    let key = KeyPair::generate().unwrap();
    fs::write(folder.join("ca.pem"), params.self_signed(&key).unwrap().pem()).unwrap();
    let ca = Issuer::new(params, key);
    let mut params = CertificateParams::new([host.to_owned()]).unwrap();
    (params.not_before, params.not_after) = (date_time_ymd(2000, 1, 1), date_time_ymd(until, 1, 1));
    let key = KeyPair::generate().unwrap();
    let cert = params.signed_by(&key, &ca).unwrap().pem();
    Identity { identity: transport::Identity::from_pem(cert, key.serialize_pem()), valid_until: until.to_string() }
}

#[test]
fn unfit_certificate_of_coordinator_is_refused() {
    let folder = folder();
    let list = "list --coordinator https://ADDRESS --ca ca.pem";
    let plain = Host::start(None, None);
    let mut said = Vec::new();
    for (what, host, until) in [("Another host", "node1.example", 4000), ("Expired", "127.0.0.1", 2001)] {
        let identity = certificate(folder.path(), host, until);
        let host = Host::start(Some(Tls { identity, clients: None }), None);
        said.push(format!("{what}:\n{}", host.errors(folder.path(), list)));
    }
    said.push(format!("Without TLS:\n{}", plain.errors(folder.path(), list)));
    let said = said.join("\n");
    insta::assert_snapshot!(said);
}

/// Starts a server that gives the same answer to each connection; returns its address.
fn server(answer: &'static str) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            // The request is read to its end, so that closing the connection does not reset it.
            let read = stream.read(&mut [0; 4096]).unwrap();
            assert!(read > 0 && stream.write_all(answer.as_bytes()).is_ok());
        }
    });
    address
}

#[test]
fn unhealthy_processes_are_reported() {
    let folder = folder();
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let standby = standby();
    let servers = [
        ("STANDBY", standby.address.clone()),
        ("UNHEALTHY", server("HTTP/1.1 503 Service Unavailable\r\n\r\nthe store does not respond")),
        ("FOREIGN", server("220 mail.example ESMTP\r\n")),
        ("SILENT", silent.local_addr().unwrap().to_string()),
    ];
    let mut lines = "
        health --coordinator http://STANDBY
        health --process UNHEALTHY
        health --process FOREIGN
        health --process SILENT
    "
    .to_owned();
    servers.iter().for_each(|(name, address)| lines = lines.replace(name, address));
    let mut said = errors(folder.path(), &lines);
    servers.iter().for_each(|(name, address)| said = said.replace(address, name));
    insta::assert_snapshot!(said);
}

/// Server that answers requests for its health as a standby does.
struct Standby {
    address: String,
    _runtime: Runtime,
}

fn standby() -> Standby {
    let runtime = Runtime::new().unwrap();
    let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).unwrap();
    let address = listener.local_addr().unwrap().to_string();
    runtime.spawn(async move {
        let (reporter, service) = tonic_health::server::health_reporter();
        reporter.set_service_status("evogait.v1.JobService", ServingStatus::NotServing).await;
        let incoming = TcpListenerStream::new(listener);
        transport::Server::builder().add_service(service).serve_with_incoming(incoming).await
    });
    Standby { address, _runtime: runtime }
}
