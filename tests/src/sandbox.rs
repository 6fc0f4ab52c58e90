//! Real coordinator and worker processes in a folder of their own, on ports of their own.

use proto::v1::job_event::Event;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{
    GetJobRequest, GetResultRequest, GetResultResponse, Job, JobEvent, JobState, Standing, SubmitJobRequest,
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

/// No test waits longer than this for anything.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// The folder of the binaries, built once a test process with the profile that the tests have.
fn binaries() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        // A test runs from TARGET/PROFILE/deps, a program of this package from TARGET/PROFILE.
        let own = std::env::current_exe().expect("a process knows its program");
        let mut folder = own.parent().expect("a program lies in a folder").to_owned();
        // Whoever started such a program built the others, too.
        if !folder.ends_with("deps") {
            return folder;
        }
        folder.pop();
        let mut build = Command::new(cargo());
        // The whole workspace with its tests, as `cargo test` built it: else dependencies, physics among them, would be built
        // again with fewer features.
        build.args(["build", "--quiet", "--workspace", "--bins", "--tests"]).current_dir(env!("CARGO_MANIFEST_DIR"));
        build.arg("--target-dir").arg(folder.parent().expect("the profile's folder is in the target folder"));
        // What cargo tells a test of its package would look to some build scripts like a new setting: nearly all would be built
        // again, and again by whoever builds next.
        for (name, _) in std::env::vars_os() {
            let text = name.to_string_lossy();
            if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_MANIFEST_") {
                build.env_remove(&name);
            }
        }
        if folder.ends_with("release") {
            build.arg("--release");
        }
        assert!(build.status().expect("cargo runs").success(), "coordinator and worker build");
        folder
    })
}

/// The cargo that runs this, or else the one that is found: the one that built it would not know which toolchain is meant.
pub fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// One of the programs: coordinator, worker, evogait.
pub fn program(name: &str) -> Command {
    Command::new(binaries().join(name))
}

/// A process that is killed when it is dropped.
#[derive(Debug)]
pub struct Process(Child);

impl Process {
    /// Starts a program.
    pub fn start(command: &mut Command) -> Self {
        Self(command.spawn().expect("the program starts"))
    }

    /// SIGKILL: it has no time for anything.
    pub fn kill_9(mut self) {
        self.0.kill().expect("a process of ours can be killed");
        self.0.wait().expect("a killed process ends");
    }

    /// SIGTERM, and its exit code.
    pub fn terminate(mut self) -> Option<i32> {
        self.signal("TERM");
        self.wait()
    }

    /// A signal by its name: TERM, STOP, CONT.
    pub fn signal(&self, name: &str) {
        let status = Command::new("kill").arg(format!("-{name}")).arg(self.0.id().to_string()).status();
        assert!(status.expect("kill runs").success());
    }

    /// CPU time that it has used so far, in steps of 10 ms.
    pub fn cpu_time(&self) -> Duration {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", self.0.id())).expect("a process has its numbers");
        // Its name may have spaces in it.
        let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
        let ticks: u64 = fields[11..13].iter().map(|field| field.parse::<u64>().expect("a count")).sum();
        // Linux counts hundredths of a second for programs.
        Duration::from_millis(ticks * 10)
    }

    /// Whether it has ended.
    pub fn has_ended(&mut self) -> bool {
        self.0.try_wait().expect("a child can be waited for").is_some()
    }

    /// Its exit code, once it has ended by itself.
    pub fn wait(&mut self) -> Option<i32> {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            if let Some(status) = self.0.try_wait().expect("a child can be waited for") {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("the process does not end");
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs a program to its end and takes what it says. One that goes on is killed, and the test fails.
pub fn output_of(command: &mut Command) -> Output {
    let child = command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let child = child.expect("the program starts");
    let pid = child.id().to_string();
    let (ended, end) = std::sync::mpsc::channel();
    let reading = std::thread::spawn(move || {
        let output = child.wait_with_output();
        // Nobody listens if it took too long.
        let _ = ended.send(());
        output
    });
    let in_time = end.recv_timeout(PATIENCE).is_ok();
    if !in_time {
        let _ = Command::new("kill").args(["-9", &pid]).status();
    }
    let output = reading.join().expect("it is only read").expect("it can be waited for");
    assert!(in_time, "it does not end by itself: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// A folder with a store, and the address its coordinator has or will have.
pub struct Sandbox {
    folder: TempDir,
    /// Where the store is, if not in the folder.
    store: Option<String>,
    /// `127.0.0.1:PORT` once a coordinator was started.
    address: Option<String>,
    /// Where processes write what they have to say, if not to the terminal.
    logs: Option<PathBuf>,
}

impl Default for Sandbox {
    fn default() -> Self {
        Self::new()
    }
}

impl Sandbox {
    /// An empty folder.
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().expect("a temporary folder"), store: None, address: None, logs: None }
    }

    /// The same with its store elsewhere.
    pub fn on(store: &str) -> Self {
        Self { store: Some(store.to_owned()), ..Self::new() }
    }

    /// Lets processes say more, into files in a folder.
    pub fn log_to(&mut self, folder: &Path) {
        self.logs = Some(folder.to_owned());
    }

    /// Adds to a command what it says and where.
    fn with_log(&self, mut command: Command, name: &str) -> Command {
        let level = if self.logs.is_some() { "info" } else { "error" };
        command.env("RUST_LOG", std::env::var("RUST_LOG").unwrap_or_else(|_| level.to_owned()));
        if let Some(folder) = &self.logs {
            let file = OpenOptions::new().create(true).append(true).open(folder.join(name)).expect("a log");
            command.stderr(file);
        }
        command
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Chooses the coordinator's port before there is a coordinator.
    pub fn reserve_port(&mut self) {
        self.address = Some(free_port());
    }

    /// Starts a coordinator on the sandbox's store and waits until it listens; where it was if there was one before.
    pub fn coordinator(&mut self) -> Process {
        self.coordinator_with(&[])
    }

    /// The same with more arguments.
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
        let address = line.trim().strip_prefix("listening on ").unwrap_or_else(|| panic!("it said {line:?}"));
        self.address = Some(address.to_owned());
        Process(child)
    }

    /// What `coordinator` starts, for tests of its refusals.
    pub fn coordinator_command(&self) -> Command {
        let mut command = program("coordinator");
        let file = || format!("sqlite:{}", self.folder.path().join("store.db").display());
        let store = self.store.clone().unwrap_or_else(file);
        command.args(["--store", &store, "--lease-seconds", "2"]);
        command.args(["--listen", self.address.as_deref().unwrap_or("127.0.0.1:0")]);
        let port = self.address.as_deref().and_then(|address| address.rsplit(':').next()).unwrap_or("0");
        self.with_log(command, &format!("coordinator-{port}.log"))
    }

    /// Starts a worker for the sandbox's coordinator. What it does not finish within a moment it gives back when stopped.
    pub fn worker(&self, slots: u32) -> Process {
        self.worker_with(slots, &[])
    }

    /// The same with more arguments.
    pub fn worker_with(&self, slots: u32, arguments: &[&str]) -> Process {
        let mut command = self.worker_command(&self.url(), slots);
        Process::start(command.args(["--grace", "0.1"]).args(arguments))
    }

    /// A worker that dials the coordinator at a URL of its own, with options still to be added.
    pub fn worker_command(&self, url: &str, slots: u32) -> Command {
        let mut command = program("worker");
        command.args(["--coordinator", url, "--slots", &slots.to_string(), "--keepalive", "1"]);
        let name = url.rsplit(':').next().unwrap_or_default();
        self.with_log(command, &format!("worker-{name}.log"))
    }

    /// Where clients connect to.
    pub fn url(&self) -> String {
        format!("http://{}", self.address.as_deref().expect("a coordinator was started"))
    }

    /// A file in its folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs `evogait` against the sandbox's coordinator to its end.
    pub fn evogait(&self, arguments: &[&str]) -> Output {
        let mut command = program("evogait");
        command.args(arguments).current_dir(self.folder.path()).env("EVOGAIT_COORDINATOR", self.url());
        output_of(&mut command)
    }

    /// What it prints; it has to succeed.
    pub fn told(&self, arguments: &[&str]) -> String {
        let output = self.evogait(arguments);
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("all output is UTF-8");
        assert!(output.status.success(), "{arguments:?}: {}", text(output.stderr));
        text(output.stdout)
    }

    /// A client; connects when it is used.
    pub fn client(&self) -> JobServiceClient<Channel> {
        let endpoint = Endpoint::from_shared(self.url()).expect("an address is a URL");
        JobServiceClient::new(endpoint.connect_lazy()).max_decoding_message_size(proto::limits::MAX_MESSAGE)
    }

    /// Submits a job and returns it.
    pub async fn submit(&self, request_id: &str, job_toml: &str) -> Job {
        let request =
            SubmitJobRequest { request_id: request_id.to_owned(), job_toml: job_toml.to_owned(), priority: 0 };
        let answer = self.client().submit_job(request).await.expect("the job is taken").into_inner();
        answer.job.expect("the answer has the job")
    }

    /// The job as it stands; waits while the coordinator is away.
    pub async fn job(&self, id: &str) -> Job {
        let start = Instant::now();
        loop {
            match self.client().get_job(GetJobRequest { id: id.to_owned() }).await {
                Ok(answer) => return answer.into_inner().job.expect("the answer has the job"),
                Err(status) => assert!(start.elapsed() < PATIENCE, "{status}"),
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Where a job that has not ended stands: who works on what, and what went wrong.
    pub async fn standing(&self, id: &str) -> Standing {
        let answer = self.client().get_job(GetJobRequest { id: id.to_owned() }).await.expect("an answer").into_inner();
        answer.standing.expect("it has not ended")
    }

    /// Waits until a job is as wanted.
    pub async fn until(&self, id: &str, wanted: impl Fn(&Job) -> bool) -> Job {
        let start = Instant::now();
        loop {
            let job = self.job(id).await;
            if wanted(&job) {
                return job;
            }
            assert_ne!(job.state(), JobState::Failed, "{}", job.reason);
            assert!(start.elapsed() < PATIENCE, "waited too long: {job:?}");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    }

    /// Waits until a job succeeded, and returns its result.
    pub async fn result(&self, id: &str) -> GetResultResponse {
        self.until(id, |job| job.state() == JobState::Succeeded).await;
        self.client().get_result(GetResultRequest { id: id.to_owned() }).await.expect("a result").into_inner()
    }
}

/// Whether an event is the last one of a job that has succeeded.
pub fn is_last(event: &JobEvent) -> bool {
    event.event == Some(Event::StateChanged(JobState::Succeeded.into()))
}

/// What a job's procedure does, in a word: "searching".
pub fn phase(job: &Job) -> &str {
    job.progress.as_ref().map_or("", |progress| progress.phase.as_str())
}

/// A number that a job's procedure reports, such as "evaluations".
pub fn value(job: &Job, name: &str) -> f64 {
    let values = job.progress.iter().flat_map(|progress| &progress.values);
    let value = values.filter(|value| value.name == name).find_map(|value| value.value);
    value.unwrap_or_else(|| panic!("{name} is not told: {job:?}"))
}

/// An address of this machine that was free a moment ago.
pub fn free_port() -> String {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    listener.local_addr().expect("it has an address").to_string()
}

/// A small job that takes a second or two of one core, for which it is on rapier. Other seeds are other jobs.
pub fn tiny_job(seed: u32, generations: u32) -> String {
    format!(
        "name = \"tiny-{seed}\"\nseed = {seed}\nrobot = \"quadropod\"\nenvironment = \"empty\"\n\
         [gaits]\ncount = 2\nduration = 2.0\n[planner]\niterations = 10\n[fitness]\nkind = \"coverage\"\n\
         [optimiser]\nkind = \"pso\"\nparticles = 5\ngenerations = {generations}\n\
         [physics]\nengine = \"rapier\"\n[finish]\narchive = 3\nseeds = 2\n"
    )
}

/// A job that grows so many small trees to a goal with the first gaits of a tiny job's search.
pub fn planning_job(seed: u32, trees: u32) -> String {
    let evolving = Checked::from_toml(&tiny_job(seed, 1)).expect("a valid job");
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

/// A job that simulates two gaits in turn, so many times with friction and targets varied.
pub fn simulating_job(seed: u32, repeats: u32) -> String {
    let planning = planning_job(seed, 1);
    let (head, gaits) = planning.split_once("[plan.gaits]").expect("a table of gaits");
    let head = head.replace("\"plan\"", "\"simulate\"").replace("\"plans-", "\"simulation-");
    let head = head.replace("[planner]\niterations = 10\n", "").replace("[plan]\nseeds = 1\n", "");
    format!(
        "{head}[simulate]\nsteps = [1, 2, 1]\nrepeats = {repeats}\nvary = {{ friction = [0.6, 1.0], target_noise = 0.05 }}\n\
         [simulate.gaits]{gaits}"
    )
}

/// The result digest of a job to which nothing happens.
pub async fn undisturbed(job_toml: &str) -> Vec<u8> {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let job = sandbox.submit("r", job_toml).await;
    sandbox.result(&job.id).await.result_digest
}
