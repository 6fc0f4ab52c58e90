//! Errors that prevent the start of a coordinator or a worker: options, addresses, stores, certificates and tokens.

use cluster_tests::certificates::Certificates;
use cluster_tests::sandbox::{Sandbox, output_of, program};
use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Runs programs that must not start, one a line, and returns each line with the error and the exit code.
///
/// The words of a line are separated by blanks, and `''` is an empty word. Words with `=` before the program set
/// environment variables. Blank lines and indentation are ignored.
fn errors(folder: &Path, lines: &str) -> String {
    let lines = lines.lines().map(str::trim).filter(|line| !line.is_empty());
    lines.map(|line| error(folder, line)).collect::<Vec<_>>().join("\n")
}

fn error(folder: &Path, line: &str) -> String {
    let words: Vec<&str> = line.split_whitespace().map(|word| if word == "''" { "" } else { word }).collect();
    let (variables, words) = words.split_at(words.iter().take_while(|word| word.contains('=')).count());
    let (name, arguments) = words.split_first().expect("a line has a program");
    let mut command = program(name);
    command.args(arguments).current_dir(folder).env("RUST_LOG", "error").env_remove("EVOGAIT_COORDINATOR");
    command.envs(variables.iter().filter_map(|variable| variable.split_once('=')));
    let output = output_of(&mut command);
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("messages are UTF-8");
    let (code, out, err) = (output.status.code().unwrap_or(-1), text(output.stdout), text(output.stderr));
    assert!((code == 1 || code == 2) && out.is_empty(), "{line}: exit code {code}: {out}{err}");
    format!("$ {line}\n{}→ {code}\n", err.replace("\n\nFor more information, try '--help'.", ""))
}

/// Creates a folder with certificates and tokens in `certs`.
fn certified() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    Certificates::make(&folder.path().join("certs"));
    folder
}

fn write(folder: &Path, files: &[(&str, &str)]) {
    files.iter().for_each(|(name, content)| fs::write(folder.join(name), content).expect("the file can be written"));
}

/// Reserves a port, and returns its address.
fn taken() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
    let address = listener.local_addr().expect("a bound socket has an address").to_string();
    (listener, address)
}

#[test]
fn coordinator_refuses_options_out_of_range() {
    let folder = certified();
    let said = errors(
        folder.path(),
        "
        coordinator --store memory: --lease-seconds soon
        coordinator --store memory: --lease-seconds -1
        coordinator --store memory: --lease-seconds nan
        coordinator --store memory: --lease-seconds 1e30
        coordinator --store memory: --lease-seconds 0
        coordinator --store memory: --lease-seconds 3601
        coordinator --store memory: --takeover-seconds -0.5
        coordinator --store memory: --takeover-seconds 0.4
        coordinator --store memory: --takeover-seconds 601
        coordinator --store memory: --log-format xml
        coordinator --store memory: --metrics-insecure-bind
        coordinator --store memory: --keda-insecure-bind
        coordinator --store memory: --workers 2
        coordinator evogait.db
        ",
    );
    insta::assert_snapshot!(said);
}

#[test]
fn coordinator_refuses_unfit_addresses() {
    let folder = certified();
    let (_listener, taken) = taken();
    let said = errors(
        folder.path(),
        &"
        coordinator --store memory: --listen localhost
        coordinator --store memory: --metrics http://localhost:9464
        coordinator --store memory: --keda 9465
        coordinator --store memory: --listen 0.0.0.0:0
        coordinator --store memory: --listen 0.0.0.0:0 --tokens certs/tokens
        coordinator --store memory: --listen 0.0.0.0:0 --tls-cert certs/coordinator.pem --tls-key certs/coordinator.key
        coordinator --store memory: --listen 127.0.0.1:0 --metrics 0.0.0.0:0
        coordinator --store memory: --listen 127.0.0.1:0 --keda 0.0.0.0:0
        coordinator --store memory: --listen TAKEN
        coordinator --store memory: --listen 127.0.0.1:0 --metrics TAKEN
        coordinator --store memory: --listen 127.0.0.1:0 --keda TAKEN
        coordinator --store memory: --listen 192.0.2.1:7077 --insecure-bind
        coordinator --store memory: --listen 127.0.0.1:0 --metrics 192.0.2.1:9464 --metrics-insecure-bind
        coordinator --store memory: --listen 127.0.0.1:0 --keda 192.0.2.1:9465 --keda-insecure-bind
        "
        .replace("TAKEN", &taken),
    );
    let said = said.replace(&taken, "TAKEN");
    insta::assert_snapshot!(said);
}

#[test]
fn coordinator_refuses_unfit_stores() {
    let mut sandbox = Sandbox::new();
    let _running = sandbox.coordinator();
    let fixtures = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    fs::copy(fixtures.join("store-v3.sqlite"), sandbox.file("old.db")).expect("the fixture can be copied");
    write(sandbox.path(), &[("job.toml", "name = \"a job\"\n# and no store\n")]);
    let (listener, closed) = taken();
    drop(listener);
    let said = errors(
        sandbox.path(),
        &"
        coordinator --store evogait.db
        coordinator --store ''
        coordinator --store sqlite:
        coordinator --store memory:x
        coordinator --store sqlite::memory:
        coordinator --store sqlite:file:a.db
        coordinator --store sqlite:a.db?mode=ro
        coordinator --store mysql://ann:s3cret@db/gaits
        coordinator --store postgres:gaits
        coordinator --store postgres://ann:s3cret@db:port/gaits
        coordinator --store postgres://ann:1/s3cret@db/gaits
        coordinator --store postgres://db/gaits?pasword=s3cret
        coordinator --store postgres://db/gaits?sslmode=perhaps
        coordinator --store postgres://ann:s3cret@CLOSED/gaits
        coordinator --store memory: --standby
        coordinator --store sqlite:a.db --standby
        coordinator --listen 127.0.0.1:0 --store sqlite:.
        coordinator --listen 127.0.0.1:0 --store sqlite:none/a.db
        coordinator --listen 127.0.0.1:0 --store sqlite:/dev/null
        coordinator --listen 127.0.0.1:0 --store sqlite:/proc/a.db
        coordinator --listen 127.0.0.1:0 --store sqlite:job.toml
        coordinator --listen 127.0.0.1:0 --store sqlite:old.db
        coordinator --listen 127.0.0.1:0 --store sqlite:store.db
        "
        .replace("CLOSED", &closed),
    );
    let said = said.replace(&closed, "CLOSED");
    insta::assert_snapshot!(said);
}

#[test]
fn coordinator_refuses_unfit_certificates() {
    let folder = certified();
    write(folder.path(), &[("long.pem", &"#".repeat((1 << 20) + 1))]);
    let said = errors(
        folder.path(),
        "
        coordinator --store memory: --tls-cert certs/coordinator.pem
        coordinator --store memory: --tls-key certs/coordinator.key
        coordinator --store memory: --client-ca certs/ca.pem
        EVOGAIT_TLS_CERT=certs/coordinator.pem coordinator --store memory:
        coordinator --store memory: --tls-cert none.pem --tls-key certs/coordinator.key
        coordinator --store memory: --tls-cert certs/coordinator.pem --tls-key none.key
        coordinator --store memory: --tls-cert long.pem --tls-key certs/coordinator.key
        coordinator --store memory: --tls-cert certs/tokens --tls-key certs/coordinator.key
        coordinator --store memory: --tls-cert certs/coordinator.pem --tls-key certs/tokens
        coordinator --store memory: --tls-cert certs/coordinator.pem --tls-key certs/worker.key
        coordinator --store memory: --client-ca none.pem
        coordinator --store memory: --client-ca certs/client.pem
        EVOGAIT_CLIENT_CA=certs/tokens coordinator --store memory:
        ",
    );
    insta::assert_snapshot!(said);
}

#[test]
fn coordinator_refuses_unfit_token_files() {
    let folder = certified();
    let many: String = (0..=10_000).map(|i| format!("client client-token-{i:08}\n")).collect();
    write(
        folder.path(),
        &[
            ("empty", "# no token\n"),
            ("one-word", "client\n"),
            ("no-role", "# tokens\nguest secret-token-0123456\n"),
            ("short", "client secret\n"),
            ("odd", "client sécret-token-0123456\n"),
            ("digest", "client sha256:123abc\n"),
            ("two-roles", "client secret-token-0123456\nworker secret-token-0123456\n"),
            ("many", &many),
            ("long", &"#".repeat((1 << 20) + 1)),
        ],
    );
    fs::write(folder.path().join("bytes"), b"client \xff\n").expect("the file can be written");
    let said = errors(
        folder.path(),
        "
        coordinator --store memory: --tokens none
        coordinator --store memory: --tokens certs
        coordinator --store memory: --tokens bytes
        coordinator --store memory: --tokens empty
        coordinator --store memory: --tokens one-word
        coordinator --store memory: --tokens no-role
        coordinator --store memory: --tokens certs/client.token
        coordinator --store memory: --tokens short
        coordinator --store memory: --tokens odd
        coordinator --store memory: --tokens digest
        coordinator --store memory: --tokens two-roles
        coordinator --store memory: --tokens many
        coordinator --store memory: --tokens long
        EVOGAIT_TOKENS=none coordinator --store memory:
        ",
    );
    assert!(!said.contains("secret") && !said.contains("sécret"), "no error may contain a token: {said}");
    insta::assert_snapshot!(said);
}

#[test]
fn worker_refuses_options_out_of_range() {
    let folder = certified();
    let (_listener, taken) = taken();
    let name = "x".repeat(257);
    let said = errors(
        folder.path(),
        &"
        worker --slots two
        worker --slots 0
        worker --slots 4097
        worker --name NAME
        worker --grace soon
        worker --grace -1
        worker --grace nan
        worker --grace 31622401
        worker --stuck-after 0.5
        worker --keepalive 0.01
        worker --keepalive -1
        worker --time-left UNLIMITED
        worker --time-left 1:2:3:4
        worker --time-left -5
        worker --time-left 400-00:00:00
        worker --time-left 0:10
        worker --time-left 65 --grace 60
        worker --log-format xml
        worker --metrics-insecure-bind
        worker --metrics 9464
        worker --metrics 0.0.0.0:0
        worker --metrics TAKEN
        worker --metrics 192.0.2.1:9464 --metrics-insecure-bind
        "
        .replace("NAME", &name)
        .replace("TAKEN", &taken),
    );
    let said = said.replace(&taken, "TAKEN").replace(&name, "NAME");
    insta::assert_snapshot!(said);
}

#[test]
fn worker_refuses_unfit_addresses_and_credentials() {
    let folder = certified();
    let path = folder.path();
    write(path, &[("short.token", "secret\n"), ("odd.token", "sécret-token-0123456789\n")]);
    Certificates::make(&path.join("other"));
    let mut sandbox = Sandbox::new();
    let tokens = path.join("certs/tokens");
    let _coordinator = sandbox.coordinator_with(&["--tokens", tokens.to_str().expect("a path in UTF-8")]);
    let many = vec!["http://h:1"; 17].join(",");
    let said = errors(
        path,
        &"
        worker --coordinator cluster
        worker --coordinator ''
        worker --coordinator http://cluster
        EVOGAIT_COORDINATOR=cluster:7077 worker
        worker --coordinator MANY
        worker --coordinator https://127.0.0.1:7077
        worker --coordinator http://10.0.0.1:7077 --token-file certs/worker.token
        worker --ca none.pem
        worker --ca certs/worker.pem
        worker --ca certs/tokens
        worker --cert certs/worker.pem
        EVOGAIT_KEY=certs/worker.key worker
        worker --cert certs/worker.pem --key certs/client.key
        worker --token-file none.token
        worker --token-file short.token
        worker --token-file odd.token
        EVOGAIT_TOKEN=secret worker
        worker --coordinator URL
        worker --coordinator URL --token-file certs/client.token
        worker --coordinator URL --token-file other/worker.token
        "
        .replace("MANY", &many)
        .replace("URL", &sandbox.url()),
    );
    let said = said.replace(&sandbox.url(), "URL");
    insta::assert_snapshot!(said);
}
