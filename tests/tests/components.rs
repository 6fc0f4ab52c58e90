//! A program that adds a component of every kind, and runs jobs with them by the coordinator and the workers that everybody
//! else has.

use cluster_tests::sandbox::PATIENCE;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{GetJobRequest, GetResultRequest, GetResultResponse, JobState, SubmitJobRequest};
use sim_core::base::error::Invalid;
use sim_core::base::random::{Purpose, Stream};
use sim_core::base::registry::{Component, Registered};
use sim_core::base::score::Direction;
use sim_core::base::settings::{Configurable, Setting, Settings};
use sim_core::control::{Controller, Infeasible, Parameter, Signals};
use sim_core::genotype::Space;
use sim_core::model::environment::Environment;
use sim_core::model::{FaceKind, HingeKind, Kind, PartKind, Place};
use sim_core::objective::{Objective, ObjectiveKind};
use sim_core::plan::{Ask as PlannerAsk, Node, Planner, PlannerKind, PlannerSettings, Tree};
use sim_core::problem::{Checked, Job};
use sim_core::procedure::{
    Artefact, BadState, Hooks, NotRun, Procedure, ProcedureKind, Progress, Rejected, Round, Step, Told,
};
use sim_core::search::{self, Ask, Batch, Evaluation, GENERATIONS, Search, SearchKind};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// A kind of module: two cubes with a hinge across.
static ELBOW: Kind = Kind {
    name: "elbow",
    parts: &[
        PartKind { name: "rear", center: [-0.25, 0.0, 0.0], half: [0.24; 3], mass: 0.5 },
        PartKind { name: "front", center: [0.25, 0.0, 0.0], half: [0.24; 3], mass: 0.5 },
    ],
    hinges: &[HingeKind::new("axis", [0, 1], [0.0; 3], [0.0, 1.0, 0.0])],
    faces: &[
        FaceKind { name: "back", part: 0, position: [-0.5, 0.0, 0.0], normal: [-1.0, 0.0, 0.0], up: [0.0, 0.0, 1.0] },
        FaceKind { name: "front", part: 1, position: [0.5, 0.0, 0.0], normal: [1.0, 0.0, 0.0], up: [0.0, 0.0, 1.0] },
    ],
};

/// A controller: each joint to and fro between ± its height, a second each. None higher than [`Square::MOST`].
struct Square;

impl Square {
    const MOST: f64 = 0.7;
}

impl Component for Square {
    fn name(&self) -> &'static str {
        "square"
    }
}

impl Controller for Square {
    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "height", unit: "rad", bounds: (0.2, 0.9) }]
    }

    fn signals(&self, gait: &[f64], _: Option<&[u8]>, ticks: usize) -> Result<Signals, Infeasible> {
        if gait.iter().any(|height| *height > Self::MOST) {
            return Err(Infeasible("it is too high".to_owned()));
        }
        let signal = |height: &f64| (0..ticks).map(|t| if t / 200 % 2 == 0 { *height } else { -height }).collect();
        Ok(Signals { joints: gait.iter().map(signal).collect(), end: Vec::new() })
    }
}

/// A planner: expands nodes in the order in which they were added, and adds wherever a gait arrives.
struct BreadthFirst;

#[derive(Debug)]
struct Growing {
    tree: Tree,
    expanded: usize,
    most: usize,
}

impl Component for BreadthFirst {
    fn name(&self) -> &'static str {
        "breadth-first"
    }
}

impl PlannerKind for BreadthFirst {
    fn start(&self, settings: PlannerSettings, root: Place, _: Stream) -> Box<dyn Planner> {
        Box::new(Growing { tree: Tree::new(root), expanded: 0, most: settings.iterations as usize })
    }
}

impl Planner for Growing {
    fn ask(&mut self, _: &dyn Fn(f64, f64) -> f64) -> PlannerAsk {
        let last = self.expanded == self.most.min(self.tree.nodes.len());
        if last { PlannerAsk::Done } else { PlannerAsk::Expand(self.expanded) }
    }

    fn tell(&mut self, arrivals: Vec<Option<Place>>) {
        for (gait, place) in arrivals.into_iter().enumerate() {
            self.tree.nodes.extend(place.map(|place| Node { place, edge: Some((self.expanded, gait)) }));
        }
        self.expanded += 1;
    }

    fn tree(&self) -> &Tree {
        &self.tree
    }

    fn at_goal(&self) -> bool {
        false
    }
}

/// An objective: how far the tree's farthest node is from its root, times a factor.
struct Reach;

const FACTOR: Setting = Setting::real("factor", "", 1.0).within(0.1, 10.0);

#[derive(Debug)]
struct Farthest(f64);

impl Component for Reach {
    fn name(&self) -> &'static str {
        "reach"
    }
}

impl Configurable for Reach {
    fn settings(&self) -> &'static [Setting] {
        &[FACTOR]
    }
}

impl ObjectiveKind for Reach {
    fn validate(&self, _: &Settings, _: &Environment) -> Result<(), Invalid> {
        Ok(())
    }

    fn direction(&self) -> Direction {
        Direction::Maximise
    }

    fn label(&self) -> (&'static str, &'static str) {
        ("reach", "mu")
    }

    fn range(&self) -> (f64, f64) {
        (0.0, f64::MAX)
    }

    fn prepare(&self, settings: &Settings, _: &Environment, _: f64) -> Result<Box<dyn Objective>, Invalid> {
        Ok(Box::new(Farthest(settings.real(&FACTOR))))
    }
}

impl Objective for Farthest {
    fn score(&self, tree: &Tree) -> f64 {
        let root = tree.nodes[0].place;
        self.0 * tree.nodes.iter().map(|node| node.place.planar_distance(&root)).fold(0.0, f64::max)
    }
}

/// A search: every candidate is drawn anew.
struct Scatter;

const CANDIDATES: Setting = Setting::whole("candidates", 8).within(1.0, 100.0);

struct Drawing {
    candidates: u32,
    space: Space,
    direction: Direction,
    seed: u64,
    generation: u32,
}

impl Component for Scatter {
    fn name(&self) -> &'static str {
        "scatter"
    }
}

impl Configurable for Scatter {
    fn settings(&self) -> &'static [Setting] {
        &[CANDIDATES, GENERATIONS]
    }
}

impl SearchKind for Scatter {
    fn population(&self, settings: &Settings) -> u32 {
        settings.whole(&CANDIDATES)
    }

    fn build(&self, settings: &Settings, space: Space, direction: Direction, seed: u64) -> Box<dyn Search> {
        Box::new(Drawing { candidates: settings.whole(&CANDIDATES), space, direction, seed, generation: 0 })
    }
}

impl Search for Drawing {
    fn ask(&self) -> Batch {
        let stream = |candidate| Stream::new(self.seed, Purpose::Sample, self.generation, candidate, 0);
        let draw = |candidate| self.space.draw(&mut stream(candidate));
        Batch { ask: Ask::Set, genotypes: (0..self.candidates).map(draw).collect() }
    }

    fn tell(&mut self, evaluations: &[Evaluation]) {
        assert_eq!(evaluations.len(), self.candidates as usize);
        self.generation += 1;
    }

    fn generation(&self) -> u32 {
        self.generation
    }

    fn save(&self) -> Vec<u8> {
        self.generation.to_le_bytes().to_vec()
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), search::BadState> {
        let bytes = state.try_into().map_err(|_| search::BadState("four bytes are needed".to_owned()))?;
        self.generation = u32::from_le_bytes(bytes);
        Ok(())
    }

    fn direction(&self) -> Direction {
        self.direction
    }
}

/// A procedure: one round of three tasks, each of which multiplies the height of the settled pivot by its number.
struct Heights;

struct Asked;

impl Component for Heights {
    fn name(&self) -> &'static str {
        "heights"
    }
}

impl ProcedureKind for Heights {
    fn start(&self, _: &Checked) -> Result<Box<dyn Procedure>, Invalid> {
        Ok(Box::new(Asked))
    }

    fn load(&self, _: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState> {
        if saved.is_empty() { Ok(Box::new(Asked)) } else { Err(BadState("it is not empty".to_owned())) }
    }

    fn run(&self, problem: &Job, tasks: &[(u32, Vec<u8>)], _: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
        let height = f64::from(problem.start().pivot.translation.z);
        Ok(tasks.iter().map(|(_, task)| (height * f64::from(task[0])).to_le_bytes().to_vec()).collect())
    }
}

impl Procedure for Asked {
    fn round(&self) -> Round {
        Round { number: 0, tasks: 3, at_most: 1, lanes: 1, phase: "measuring", shared: Arc::new([]), kept: true }
    }

    fn task(&self, index: u32) -> Vec<u8> {
        vec![1 + index as u8]
    }

    fn describe(&self, index: u32) -> String {
        format!("height {index}")
    }

    fn check(&self, index: u32, result: &[u8]) -> Result<(), Rejected> {
        let reason = "8 bytes are needed".to_owned();
        if result.len() == 8 { Ok(()) } else { Err(Rejected { task: self.describe(index), reason }) }
    }

    fn show(&self, result: &[u8]) -> String {
        format!("{result:?}")
    }

    fn tell(&mut self, results: &[Arc<[u8]>]) -> Told {
        let content = results.concat();
        let artefact = Artefact { name: "heights".into(), media_type: "application/octet-stream".into(), content };
        Told { row: None, step: Step::Done(vec![artefact]) }
    }

    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    fn progress(&self) -> Progress {
        Progress { phase: "measuring".into(), ..Progress::default() }
    }
}

fn job(procedure: &str) -> String {
    format!(
        r#"
        name = "added"
        procedure = "{procedure}"
        environment = "empty"
        gaits = {{ count = 2, duration = 2.0, controller = "square" }}
        planner = {{ iterations = 3, algorithm = "breadth-first" }}
        fitness = {{ kind = "reach", factor = 2.0 }}
        optimiser = {{ kind = "scatter", candidates = 12, generations = 3 }}
        finish = {{ kind = "none" }}
        [robot]
        name = "snake"
        pivot = "b/rear"
        [[robot.module]]
        name = "a"
        kind = "elbow"
        [[robot.module]]
        name = "b"
        kind = "elbow"
        attach = {{ to = "a", port = "front" }}
        "#
    )
}

/// The result of a job on so many workers, all within this process.
async fn result(job_toml: &str, workers: usize) -> GetResultResponse {
    let folder = tempfile::tempdir().expect("a folder");
    let store = coordinator::StoreUrl::Sqlite(folder.path().join("store.sqlite"));
    let coordinator = coordinator::serve(coordinator::Config::embedded(store)).await.expect("it serves");
    let url = format!("http://{}", coordinator.local_addr());
    let (stop, stopped) = watch::channel(false);
    let working: Vec<_> = (0..workers)
        .map(|_| {
            let (config, mut stopped) = (worker::Config::new(url.clone(), 1), stopped.clone());
            tokio::spawn(worker::run(config, async move {
                let _ = stopped.wait_for(|stop| *stop).await;
            }))
        })
        .collect();
    let mut client = JobServiceClient::connect(url).await.expect("it answers");
    let request = SubmitJobRequest { request_id: "r".to_owned(), job_toml: job_toml.to_owned(), priority: 0 };
    let id = client.submit_job(request).await.expect("the job is taken").into_inner().job.expect("a job").id;
    let start = Instant::now();
    loop {
        let job =
            client.get_job(GetJobRequest { id: id.clone() }).await.expect("a job").into_inner().job.expect("a job");
        match job.state() {
            JobState::Succeeded => break,
            JobState::Failed => panic!("{}", job.reason),
            _ => assert!(start.elapsed() < PATIENCE, "it does not end: {job:?}"),
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let result = client.get_result(GetResultRequest { id }).await.expect("a result").into_inner();
    stop.send(true).expect("workers run");
    for worker in working {
        worker.await.expect("it ends").expect("it ends well");
    }
    coordinator.shutdown().await.expect("it ends");
    result
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn jobs_with_a_component_of_every_kind_run_like_any_other() {
    let refused = Checked::from_toml(&job("heights")).expect_err("nobody has added anything").to_string();
    assert!(refused.contains("unknown field `factor`"), "the objective is not known: {refused}");

    Kind::registry().add(&ELBOW).unwrap();
    <dyn Controller>::registry().add(&Square).unwrap();
    <dyn PlannerKind>::registry().add(&BreadthFirst).unwrap();
    <dyn ObjectiveKind>::registry().add(&Reach).unwrap();
    <dyn SearchKind>::registry().add(&Scatter).unwrap();
    <dyn ProcedureKind>::registry().add(&Heights).unwrap();

    // Evolved with a kind of module, a controller, a planner, an objective and a search that were added.
    let evolved = result(&job("evolve"), 1).await;
    assert_eq!(evolved.result_digest, result(&job("evolve"), 3).await.result_digest, "bits go by no number of workers");
    let report = evolved.artefacts.iter().find(|artefact| artefact.name == "report").expect("a report");
    let report: serde_json::Value = serde_json::from_slice(&report.content).expect("the report is JSON");
    let genome = report["winner"]["genome"].as_array().expect("a winner");
    assert_eq!(genome.len(), 4, "two gaits of two joints: {report}");
    assert!(genome.iter().all(|height| height.as_f64().is_some_and(|h| h <= Square::MOST)), "it can be carried out");
    // Of 36 candidates some have a joint that is told to go too high: they have failed, and the job has not.
    let failed = evolved.history.iter().flat_map(|row| row.values.iter().filter(|v| v.name == "failed"));
    let failed: f64 = failed.filter_map(|value| value.value).sum();
    assert!((1.0..36.0).contains(&failed), "{failed} failed");

    // A procedure of another program.
    let measured = result(&job("heights"), 2).await;
    let settled = Job::from_toml(&job("heights")).expect("a valid job");
    let height = f64::from(settled.start().pivot.translation.z);
    let [artefact] = &measured.artefacts[..] else { panic!("{:?}", measured.artefacts) };
    assert_eq!(artefact.content, [1.0, 2.0, 3.0].map(|factor| (height * factor).to_le_bytes()).concat());
}
