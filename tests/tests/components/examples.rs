//! Example components, one of each kind, as another program would write them.

use sim_core::base::error::Invalid;
use sim_core::base::random::{Purpose, Stream};
use sim_core::base::registry::{Component, Registered};
use sim_core::base::score::Direction;
use sim_core::base::settings::{Configurable, Setting, Settings};
use sim_core::control::{Controller, Infeasible, Parameter, Signals};
use sim_core::genotype::{Rules, Space};
use sim_core::model::environment::Environment;
use sim_core::model::{FaceKind, Gender, HingeKind, ModuleKind, PartKind, Robot};
use sim_core::objective::{Centers, Objective, ObjectiveKind};
use sim_core::plan::{Arrival, Ask as PlannerAsk, Node, Planner, PlannerKind, PlannerSettings, Root, Tree};
use sim_core::problem::{Checked, Job};
use sim_core::procedure::{
    Artefact, BadState, Hooks, NotRun, Procedure, ProcedureKind, Progress, Rejected, Round, RoundEnd, Step,
};
use sim_core::search::{self, Ask, Batch, Evaluation, GENERATIONS, Search, SearchKind};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Once};

/// Adds all examples to their registries, once per process.
pub fn add() {
    static ADDED: Once = Once::new();
    ADDED.call_once(|| {
        ModuleKind::registry().add(&ELBOW).unwrap();
        <dyn Controller>::registry().add(&Square).unwrap();
        <dyn PlannerKind>::registry().add(&BreadthFirst).unwrap();
        <dyn ObjectiveKind>::registry().add(&Reach).unwrap();
        <dyn SearchKind>::registry().add(&Scatter).unwrap();
        <dyn ProcedureKind>::registry().add(&HEIGHTS).unwrap();
    });
}

/// Kind of module with two cubes and a hinge between them.
pub static ELBOW: ModuleKind = ModuleKind {
    name: "elbow",
    parts: &[
        PartKind::cuboid("rear", [-0.25, 0.0, 0.0], [0.24; 3], 0.5),
        PartKind::cuboid("front", [0.25, 0.0, 0.0], [0.24; 3], 0.5),
    ],
    hinges: &[HingeKind::new("axis", [0, 1], [0.0; 3], [0.0, 1.0, 0.0])],
    faces: &[
        FaceKind {
            name: "back",
            part: 0,
            position: [-0.5, 0.0, 0.0],
            normal: [-1.0, 0.0, 0.0],
            up: [0.0, 0.0, 1.0],
            gender: Gender::Any,
        },
        FaceKind {
            name: "front",
            part: 1,
            position: [0.5, 0.0, 0.0],
            normal: [1.0, 0.0, 0.0],
            up: [0.0, 0.0, 1.0],
            gender: Gender::Any,
        },
    ],
};

/// Controller that moves each joint between + and − its height, holding each for one second. Heights over
/// [`Square::MOST`] fail.
pub struct Square;

impl Square {
    pub const MOST: f64 = 0.7;
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

    fn signals(&self, _: &Robot, gait: &[f64], _: Option<&[u8]>, ticks: usize) -> Result<Signals, Infeasible> {
        if gait.iter().any(|height| *height > Self::MOST) {
            return Err(Infeasible("the height is too large".to_owned()));
        }
        let signal = |height: &f64| (0..ticks).map(|t| if t / 200 % 2 == 0 { *height } else { -height }).collect();
        Ok(Signals { joints: gait.iter().map(signal).collect(), end: Vec::new() })
    }
}

/// Planner that expands nodes in the order in which they were added, and adds every place where a gait arrives.
pub struct BreadthFirst;

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
    fn start(&self, settings: PlannerSettings, root: Root, _: Stream) -> Box<dyn Planner> {
        Box::new(Growing { tree: Tree::new(root.place), expanded: 0, most: settings.iterations as usize })
    }
}

impl Planner for Growing {
    fn ask(&mut self, _: &dyn Fn(f64, f64) -> f64) -> PlannerAsk {
        let last = self.expanded == self.most.min(self.tree.nodes.len());
        if last { PlannerAsk::Done } else { PlannerAsk::Expand(self.expanded) }
    }

    fn tell(&mut self, arrivals: Vec<Arrival>) {
        for (gait, arrival) in arrivals.into_iter().enumerate() {
            self.tree.nodes.extend(arrival.free().map(|place| Node { place, edge: Some((self.expanded, gait)) }));
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

/// Objective: distance of the tree's farthest node from its root, times a factor.
pub struct Reach;

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
    fn score(&self, tree: &Tree, _: &Centers<'_>) -> f64 {
        let root = tree.nodes[0].place;
        self.0 * tree.nodes.iter().map(|node| node.place.planar_distance(&root)).fold(0.0, f64::max)
    }
}

/// Search that draws every candidate at random.
pub struct Scatter;

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

    fn build(
        &self,
        settings: &Settings,
        space: Space,
        _: Arc<dyn Rules>,
        direction: Direction,
        seed: u64,
    ) -> Box<dyn Search> {
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
        let bytes = state.try_into().map_err(|_| search::BadState("the state must have 4 bytes".to_owned()))?;
        self.generation = u32::from_le_bytes(bytes);
        Ok(())
    }

    fn direction(&self) -> Direction {
        self.direction
    }
}

/// Procedure with one round of three tasks. Each task multiplies the height of the settled pivot by its index plus one.
pub struct Heights {
    pub name: &'static str,
    pub revision: AtomicU32,
}

pub static HEIGHTS: Heights = Heights { name: "heights", revision: AtomicU32::new(1) };

struct Asked;

impl Component for Heights {
    fn name(&self) -> &'static str {
        self.name
    }

    fn revision(&self) -> u32 {
        self.revision.load(Ordering::Relaxed)
    }
}

impl ProcedureKind for Heights {
    fn start(&self, _: &Checked) -> Result<Box<dyn Procedure>, Invalid> {
        Ok(Box::new(Asked))
    }

    fn load(&self, _: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState> {
        if saved == b"asked" { Ok(Box::new(Asked)) } else { Err(BadState("the state must be \"asked\"".to_owned())) }
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
        let reason = "the result must have 8 bytes".to_owned();
        if result.len() == 8 { Ok(()) } else { Err(Rejected { task: self.describe(index), reason }) }
    }

    fn show(&self, result: &[u8]) -> String {
        format!("{result:?}")
    }

    fn tell(&mut self, results: &[Arc<[u8]>]) -> RoundEnd {
        let content = results.concat();
        let artefact = Artefact { name: "heights".into(), media_type: "application/octet-stream".into(), content };
        RoundEnd { row: None, step: Step::Done(vec![artefact]) }
    }

    fn save(&self) -> Vec<u8> {
        b"asked".to_vec()
    }

    fn progress(&self) -> Progress {
        Progress { phase: "measuring".into(), ..Progress::default() }
    }
}
