//! Real coordinator and worker processes with their own folder and ports.

use proto::v1::job_event::Event;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{
    GetJobRequest, GetResultRequest, GetResultResponse, Job, JobEvent, JobState, ListWorkersRequest, Standing,
    SubmitJobRequest, WorkerInfo,
};
use sim_core::problem::Checked;
use std::ffi::OsString;
use std::fs::OpenOptions;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tonic::transport::{Channel, Endpoint};

/// Limit on every wait of a test.
pub const TIMEOUT: Duration = Duration::from_secs(120);

/// Returns the folder of the binaries. Builds them once per test process, with the profile of the tests.
fn binaries() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        // A test runs from TARGET/PROFILE/deps, a program of this package from TARGET/PROFILE.
        let own = std::env::current_exe().expect("the path of the running program is known");
        let mut folder = own.parent().expect("a program is in a folder").to_owned();
        // A program of this package was built together with the others.
        if !folder.ends_with("deps") {
            return folder;
        }
        folder.pop();
        let mut build = Command::new(cargo());
        // Builds the whole workspace with its tests, like `cargo test`. Otherwise cargo would build dependencies again
        // with fewer features, physics among them.
        build.args(["build", "--quiet", "--workspace", "--bins", "--tests"]).current_dir(env!("CARGO_MANIFEST_DIR"));
        build.arg("--target-dir").arg(folder.parent().expect("the profile's folder must be in the target folder"));
        // Cargo sets these variables for a test of its package. Some build scripts would take them for new settings;
        // cargo would then rebuild nearly everything, and again at the next build.
        for (name, _) in std::env::vars_os() {
            let text = name.to_string_lossy();
            if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_MANIFEST_") {
                build.env_remove(&name);
            }
        }
        if folder.ends_with("release") {
            build.arg("--release");
        }
        assert!(build.status().expect("cargo runs").success(), "coordinator and worker must build");
        folder
    })
}

/// Returns the cargo that runs this program, or else the one in the PATH. The path of the cargo that built the program
/// would not select the right toolchain.
pub fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// Returns the command of a program: coordinator, worker or evogait.
pub fn program(name: &str) -> Command {
    Command::new(binaries().join(name))
}

/// Process that is killed on drop.
#[derive(Debug)]
pub struct Process(Child);

impl Process {
    /// Starts a program.
    pub fn start(command: &mut Command) -> Self {
        Self(command.spawn().expect("the program starts"))
    }

    /// Kills the process with SIGKILL.
    pub fn kill_9(mut self) {
        self.0.kill().expect("an own process can be killed");
        self.0.wait().expect("a killed process ends");
    }

    /// Sends SIGTERM and returns the exit code.
    pub fn terminate(mut self) -> Option<i32> {
        self.signal("TERM");
        self.wait()
    }

    /// Sends a signal, given by its name: TERM, STOP, CONT, KILL.
    pub fn signal(&self, name: &str) {
        let status = Command::new("kill").arg(format!("-{name}")).arg(self.0.id().to_string()).status();
        assert!(status.expect("kill runs").success());
    }

    /// Returns the CPU time used so far, in steps of 10 ms.
    pub fn cpu_time(&self) -> Duration {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.0.id()))
            .expect("the process must have a /proc entry");
        // The process name may contain spaces.
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
        let ticks: u64 = fields[11..13].iter().map(|field| field.parse::<u64>().expect("a count")).sum();
        // Linux reports CPU times to programs in hundredths of a second.
        Duration::from_millis(ticks * 10)
    }

    /// Returns true if the process has ended.
    pub fn has_ended(&mut self) -> bool {
        self.0.try_wait().expect("a child can be waited for").is_some()
    }

    /// Waits until the process ends by itself, and returns its exit code.
    pub fn wait(&mut self) -> Option<i32> {
        let start = Instant::now();
        while start.elapsed() < TIMEOUT {
            if let Some(status) = self.0.try_wait().expect("a child can be waited for") {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("the process did not end in time");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // The process may have ended already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs a program to its end and returns its output. A program that takes too long is killed, and the test fails.
pub fn output_of(command: &mut Command) -> Output {
    let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let child = child.expect("the program starts");
    let pid = child.id().to_string();
    let (ended, end) = std::sync::mpsc::channel();
    let reading = std::thread::spawn(move || {
        let output = child.wait_with_output();
        // After a timeout the receiver waits no more.
        let _ = ended.send(());
        output
    });
    let in_time = end.recv_timeout(TIMEOUT).is_ok();
    if !in_time {
        let _ = Command::new("kill").args(["-9", &pid]).status();
    }
    let output = reading.join().expect("the reading thread does not panic").expect("a child can be waited for");
    assert!(in_time, "the program did not end in time: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// Folder with a store, and the address of its coordinator.
pub struct Sandbox {
    folder: TempDir,
    /// URL of the store, if it is not in the folder.
    store: Option<String>,
    /// `127.0.0.1:PORT`, once it is reserved or a coordinator was started.
    address: Option<String>,
    /// Folder for the logs of the processes; without it they log to the terminal.
    logs: Option<PathBuf>,
}

impl Default for Sandbox {
    fn default() -> Self {
        Self::new()
    }
}

impl Sandbox {
    /// Creates an empty folder.
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder"), store: None, address: None, logs: None }
    }

    /// Creates an empty folder for processes with a store elsewhere.
    pub fn on(store: &str) -> Self {
        Self { store: Some(store.to_owned()), ..Self::new() }
    }

    /// Makes processes log more, to files in a folder.
    pub fn log_to(&mut self, folder: &Path) {
        self.logs = Some(folder.to_owned());
    }

    /// Sets the log level and log file of a command.
    fn with_log(&self, mut command: Command, name: &str) -> Command {
        let level = if self.logs.is_some() { "info" } else { "error" };
        command.env("RUST_LOG", std::env::var("RUST_LOG").unwrap_or_else(|_| level.to_owned()));
        if let Some(folder) = &self.logs {
            let file = OpenOptions::new()
                .create(true)
                .append(true)
                .open(folder.join(name))
                .expect("the log file can be opened");
            command.stderr(file);
        }
        command
    }

    /// Returns the folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Chooses the coordinator's port before a coordinator is started.
    pub fn reserve_port(&mut self) {
        self.address = Some(free_port());
    }

    /// Starts a coordinator on the sandbox's store and waits until it listens. It has the same address as the one
    /// before, if any.
    pub fn coordinator(&mut self) -> Process {
        self.coordinator_with(&[])
    }

    /// Starts a coordinator with more arguments.
    pub fn coordinator_with(&mut self, arguments: &[&str]) -> Process {
        let mut command = self.coordinator_command();
        command.args(arguments);
        self.start(command)
    }

    /// Starts a coordinator by a command made from [`Self::coordinator_command`], and waits until it listens.
    pub fn start(&mut self, mut command: Command) -> Process {
        let mut child = command.stdout(Stdio::piped()).spawn().expect("coordinator starts");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("stdout is piped");
        BufReader::new(stdout).read_line(&mut line).expect("stdout is text");
        let address = line
            .trim()
            .strip_prefix("listening on ")
            .unwrap_or_else(|| panic!("expected \"listening on ADDRESS\", received {line:?}"));
        self.address = Some(address.to_owned());
        Process(child)
    }

    /// Returns the command that `coordinator` starts, for tests that change it.
    pub fn coordinator_command(&self) -> Command {
        let mut command = program("coordinator");
        let file = || format!("sqlite:{}", self.folder.path().join("store.db").display());
        let store = self.store.clone().unwrap_or_else(file);
        command.args(["--store", &store, "--lease-seconds", "2"]);
        command.args(["--listen", self.address.as_deref().unwrap_or("127.0.0.1:0")]);
        let port = self.address.as_deref().and_then(|address| address.rsplit(':').next()).unwrap_or("0");
        self.with_log(command, &format!("coordinator-{port}.log"))
    }

    /// Starts a worker of the sandbox's coordinator with a grace of 0.1 s: on SIGTERM it returns tasks that take
    /// longer.
    pub fn worker(&self, slots: u32) -> Process {
        self.worker_with(slots, &[])
    }

    /// Starts a worker with more arguments.
    pub fn worker_with(&self, slots: u32, arguments: &[&str]) -> Process {
        let mut command = self.worker_command(&self.url(), slots);
        Process::start(command.args(["--grace", "0.1"]).args(arguments))
    }

    /// Returns the command of a worker that dials the coordinator at a given URL; the caller may add options.
    pub fn worker_command(&self, url: &str, slots: u32) -> Command {
        let mut command = program("worker");
        command.args(["--coordinator", url, "--slots", &slots.to_string(), "--keepalive", "1"]);
        let name = url.rsplit(':').next().unwrap_or_default();
        self.with_log(command, &format!("worker-{name}.log"))
    }

    /// Returns the URL that clients dial.
    pub fn url(&self) -> String {
        format!("http://{}", self.address.as_deref().expect("a coordinator must be started first"))
    }

    /// Returns the path of a file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs `evogait` against the sandbox's coordinator to its end.
    pub fn evogait(&self, arguments: &[&str]) -> Output {
        let mut command = program("evogait");
        command.args(arguments).current_dir(self.folder.path()).env("EVOGAIT_COORDINATOR", self.url());
        output_of(&mut command)
    }

    /// Runs `evogait`, which must succeed, and returns its output.
    pub fn told(&self, arguments: &[&str]) -> String {
        let output = self.evogait(arguments);
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("the output is UTF-8");
        assert!(output.status.success(), "{arguments:?}: {}", text(output.stderr));
        text(output.stdout)
    }

    /// Returns a client. It connects at its first call.
    pub fn client(&self) -> JobServiceClient<Channel> {
        let endpoint = Endpoint::from_shared(self.url()).expect("the coordinator's URL is valid");
        JobServiceClient::new(endpoint.connect_lazy()).max_decoding_message_size(proto::limits::MAX_MESSAGE)
    }

    /// Submits a job and returns it.
    pub async fn submit(&self, request_id: &str, job_toml: &str) -> Job {
        let request =
            SubmitJobRequest { request_id: request_id.to_owned(), job_toml: job_toml.to_owned(), priority: 0 };
        let answer = self.client().submit_job(request).await.expect("the job is accepted").into_inner();
        answer.job.expect("the response has the job")
    }

    /// Returns the job's present state. Repeats the call while the coordinator is down.
    pub async fn job(&self, id: &str) -> Job {
        let start = Instant::now();
        loop {
            match self.client().get_job(GetJobRequest { id: id.to_owned() }).await {
                Ok(answer) => return answer.into_inner().job.expect("the response has the job"),
                Err(status) => assert!(start.elapsed() < TIMEOUT, "{status}"),
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Returns the standing of a job that has not ended: its leases and failures.
    pub async fn standing(&self, id: &str) -> Standing {
        let answer =
            self.client().get_job(GetJobRequest { id: id.to_owned() }).await.expect("the job exists").into_inner();
        answer.standing.expect("the job has not ended")
    }

    /// Returns the workers that the coordinator lists.
    pub async fn workers(&self) -> Vec<WorkerInfo> {
        let answer = self.client().list_workers(ListWorkersRequest {}).await;
        answer.expect("the coordinator lists its workers").into_inner().workers
    }

    /// Waits until a job fulfils a condition.
    pub async fn until(&self, id: &str, wanted: impl Fn(&Job) -> bool) -> Job {
        let start = Instant::now();
        loop {
            let job = self.job(id).await;
            if wanted(&job) {
                return job;
            }
            assert_ne!(job.state(), JobState::Failed, "{}", job.reason);
            assert!(start.elapsed() < TIMEOUT, "the job did not fulfil the condition in time: {job:?}");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    /// Waits until a job succeeded, and returns its result.
    pub async fn result(&self, id: &str) -> GetResultResponse {
        self.until(id, |job| job.state() == JobState::Succeeded).await;
        self.client()
            .get_result(GetResultRequest { id: id.to_owned() })
            .await
            .expect("a succeeded job has a result")
            .into_inner()
    }
}

/// Returns true if an event is the last one of a job that succeeded.
pub fn is_last(event: &JobEvent) -> bool {
    event.event == Some(Event::StateChanged(JobState::Succeeded.into()))
}

/// Returns the phase of a job's procedure, such as "searching".
pub fn phase(job: &Job) -> &str {
    job.progress.as_ref().map_or("", |progress| progress.phase.as_str())
}

/// Returns a value that a job's procedure reports, such as "evaluations".
pub fn value(job: &Job, name: &str) -> f64 {
    let values = job.progress.iter().flat_map(|progress| &progress.values);
    let value = values.filter(|value| value.name == name).find_map(|value| value.value);
    value.unwrap_or_else(|| panic!("the progress has no value {name}: {job:?}"))
}

/// Returns an address of this machine with a port that was free just now.
pub fn free_port() -> String {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    listener.local_addr().expect("a bound socket has an address").to_string()
}

/// Returns a small job on rapier, so that it takes one or two seconds of one core. Each seed gives another job.
pub fn tiny_job(seed: u32, generations: u32) -> String {
    format!(
        "name = \"tiny-{seed}\"\nseed = {seed}\nrobot = \"quadropod\"\nenvironment = \"empty\"\n\
         [gaits]\ncount = 2\nduration = 2.0\n[planner]\niterations = 10\n[fitness]\nkind = \"coverage\"\n\
         [optimiser]\nkind = \"pso\"\nparticles = 5\ngenerations = {generations}\n\
         [physics]\nengine = \"rapier\"\n[finish]\narchive = 3\nseeds = 2\n"
    )
}

/// Returns a job that grows `trees` small trees to a goal with the first gaits of a tiny job's search.
pub fn planning_job(seed: u32, trees: u32) -> String {
    let evolving = Checked::from_toml(&tiny_job(seed, 1)).expect("the tiny job is valid");
    let genotype = &evolving.optimiser().ask().genotypes[0];
    let gaits: Vec<String> = genotype.gaits(2).map(|gait| format!("{gait:?}")).collect();
    format!(
        "name = \"plans-{seed}\"\nprocedure = \"plan\"\nseed = {seed}\nrobot = \"quadropod\"\nenvironment = \"empty-goal\"\n\
         [gaits]\ncount = 2\nduration = 2.0\n[planner]\niterations = 10\n[physics]\nengine = \"rapier\"\n\
         [plan]\nseeds = {trees}\n[plan.gaits]\njoints = {:?}\ngenome = [{}]\n",
        evolving.robot().joint_names(),
        gaits.join(", ")
    )
}

/// Returns a job that simulates two gaits in turn, `repeats` times with different friction and targets.
pub fn simulating_job(seed: u32, repeats: u32) -> String {
    let planning = planning_job(seed, 1);
    let (head, gaits) = planning.split_once("[plan.gaits]").expect("the planning job has a table of gaits");
    let head = head.replace("\"plan\"", "\"simulate\"").replace("\"plans-", "\"simulation-");
    let head = head.replace("[planner]\niterations = 10\n", "").replace("[plan]\nseeds = 1\n", "");
    format!(
        "{head}[simulate]\nsteps = [1, 2, 1]\nrepeats = {repeats}\nvary = {{ friction = [0.6, 1.0], target_noise = 0.05 }}\n\
         [simulate.gaits]{gaits}"
    )
}

/// Returns the result digest of a job that runs without disturbances.
pub async fn undisturbed(job_toml: &str) -> Vec<u8> {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let job = sandbox.submit("r", job_toml).await;
    sandbox.result(&job.id).await.result_digest
}
