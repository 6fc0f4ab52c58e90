//! Spaces of controllers that another program adds: the space of a job, and the searches that accept it.

use sim_core::base::registry::{Component, Registered};
use sim_core::base::score::{Counts, Direction};
use sim_core::base::settings::{Configurable, Setting, Settings};
use sim_core::control::{Controller, Infeasible, Parameter, Signals};
use sim_core::genotype::{Gene, Length, NamedGene, Rules, Space};
use sim_core::model::Robot;
use sim_core::problem::Checked;
use sim_core::procedure::evolve::{Evolve, TaskResult};
use sim_core::procedure::{Procedure, Step};
use sim_core::search::{GENERATIONS, Pso, Search, SearchKind};
use std::sync::{Arc, Once};

/// Controller with one number and one choice for any robot.
struct Chooser;
/// Controller with a sequence of 2 to [`MOST`] segments of three genes.
struct Segments;

const MOST: u32 = 9;

fn real(name: &str) -> NamedGene {
    NamedGene { name: name.into(), unit: "rad", gene: Gene::Real { low: -1.0, high: 1.0 } }
}

impl Component for Chooser {
    fn name(&self) -> &'static str {
        "chooser"
    }
}

impl Controller for Chooser {
    fn parameters(&self) -> &'static [Parameter] {
        &[]
    }

    fn space(&self, _: &Robot) -> Space {
        let leg = NamedGene { name: "leg".into(), unit: "", gene: Gene::Choice { options: 3 } };
        Space { genes: vec![real("all.swing"), leg], length: Length::Fixed }
    }

    fn signals(&self, _: &Robot, _: &[f64], _: Option<&[u8]>, _: usize) -> Result<Signals, Infeasible> {
        unreachable!("the test simulates nothing")
    }
}

impl Component for Segments {
    fn name(&self) -> &'static str {
        "segments"
    }
}

impl Controller for Segments {
    fn parameters(&self) -> &'static [Parameter] {
        &[]
    }

    fn space(&self, _: &Robot) -> Space {
        let genes = ["from", "to", "speed"].map(real).into();
        Space { genes, length: Length::Sequence { least: 2, most: MOST } }
    }

    fn signals(&self, _: &Robot, _: &[f64], _: Option<&[u8]>, _: usize) -> Result<Signals, Infeasible> {
        unreachable!("the test simulates nothing")
    }
}

/// Search that accepts every space.
struct Anything;

impl Component for Anything {
    fn name(&self) -> &'static str {
        "anything"
    }
}

impl Configurable for Anything {
    fn settings(&self) -> &'static [Setting] {
        &[GENERATIONS]
    }
}

impl SearchKind for Anything {
    fn population(&self, _: &Settings) -> u32 {
        20
    }

    fn takes(&self, _: &Space) -> Result<(), sim_core::base::error::Invalid> {
        Ok(())
    }

    fn build(
        &self,
        _: &Settings,
        space: Space,
        rules: Arc<dyn Rules>,
        direction: Direction,
        seed: u64,
    ) -> Box<dyn Search> {
        Pso.build(&Settings::defaults(Pso.settings()), space, rules, direction, seed)
    }
}

fn job(gaits: &str, kind: &str) -> Result<Checked, String> {
    static ADDED: Once = Once::new();
    ADDED.call_once(|| {
        <dyn Controller>::registry().add(&Chooser).unwrap();
        <dyn Controller>::registry().add(&Segments).unwrap();
        <dyn SearchKind>::registry().add(&Anything).unwrap();
    });
    let text = format!(
        "name = 'a'\nrobot = 'lizard'\nenvironment = 'empty'\ngaits = {{ {gaits} }}\nfitness = {{ kind = 'coverage' }}\n\
         optimiser = {{ kind = '{kind}' }}"
    );
    Checked::from_toml(&text).map_err(|e| e.to_string())
}

#[test]
fn search_of_real_vectors_refuses_other_spaces() {
    for kind in ["pso", "pso-constriction", "ga"] {
        assert_eq!(
            job("count = 2, controller = 'chooser'", kind).unwrap_err(),
            format!(
                "optimiser.kind: \"{kind}\" searches vectors of real numbers, and gait1.leg is a choice: choose another \
                 kind, or another controller"
            )
        );
        assert_eq!(
            job("count = 1, controller = 'segments'", kind).unwrap_err(),
            format!(
                "optimiser.kind: \"{kind}\" searches vectors of real numbers, and the genotypes of this job are sequences \
                 of segments: choose another kind, or another controller"
            )
        );
        assert!(job("count = 2", kind).is_ok());
    }
    assert!(job("count = 2, controller = 'chooser'", "anything").is_ok());
    assert!(job("count = 1, controller = 'segments'", "anything").is_ok());
}

#[test]
fn gait_set_space_repeats_space_of_one_gait() {
    let checked = job("count = 3", "pso").unwrap();
    let (set, gait) = (checked.space(), checked.controller().space(checked.robot()));
    let each = gait.genes.len();
    assert_eq!(each, checked.robot().hinges.len() * checked.controller().parameters().len());
    assert_eq!(set.genes.len(), 3 * each);
    for (i, gene) in set.genes.iter().enumerate() {
        let (own, count) = (&gait.genes[i % each], i / each + 1);
        assert_eq!(gene.name, format!("gait{count}.{}", own.name));
        assert_eq!((gene.gene, gene.unit), (own.gene, own.unit));
    }
    let joint = &checked.robot().hinges[1].name;
    assert_eq!(set.genes[each + 6].name, format!("gait2.{joint}.mu"), "genes are ordered by joint");
    assert_eq!(set.genes[each + 6].parameter(), "mu");
}

#[test]
fn job_bounds_apply_to_all_genes_of_a_parameter() {
    let checked = job("count = 2, bounds = { omega1 = [1.0, 2.0] }", "pso").unwrap();
    for gene in &checked.space().genes {
        let own = checked.controller().parameters().iter().find(|p| p.name == gene.parameter()).unwrap();
        let wanted = if own.name == "omega1" { (1.0, 2.0) } else { own.bounds };
        assert_eq!(gene.gene.bounds(), wanted, "{}", gene.name);
    }
    let said = job("count = 2, controller = 'chooser', bounds = { leg = [0.0, 1.0] }", "anything").unwrap_err();
    assert_eq!(said, "gaits.bounds = \"leg\" is unknown: known are swing", "a choice must have no bounds");
}

#[test]
fn job_with_two_sequences_per_candidate_is_refused() {
    let said = job("count = 2, controller = 'segments'", "anything").unwrap_err();
    assert_eq!(
        said,
        "gaits.count: a gait of controller \"segments\" is a sequence, and a candidate has only one sequence: set it to 1"
    );
    let one = job("count = 1, controller = 'segments'", "anything").unwrap();
    assert_eq!(one.space().names(), ["gait1.from", "gait1.to", "gait1.speed"]);
    assert_eq!(one.space().longest(), 3 * MOST as usize);
}

#[test]
fn search_of_sequences_refuses_other_spaces() {
    for gaits in ["count = 2", "count = 2, controller = 'chooser'"] {
        assert_eq!(
            job(gaits, "sequence-ga").unwrap_err(),
            "optimiser.kind: \"sequence-ga\" searches sequences of segments, and the genotypes of this job have a fixed \
             length: choose another kind, or another controller"
        );
    }
    assert!(job("count = 1, controller = 'segments'", "sequence-ga").is_ok());
}

/// The first generation has a whole population of candidates, later ones have only its children.
#[test]
fn evolution_of_sequences_has_generations_of_different_sizes() {
    let job = job("count = 1, controller = 'segments'", "sequence-ga").unwrap();
    let mut evolve = Evolve::new(&job);
    let mut sizes = Vec::new();
    for _ in 0..3 {
        let tasks = evolve.round().tasks;
        let result = |i: u32| {
            let score = (i != 3).then(|| f64::from(i % 7));
            TaskResult::Evaluated { genotype: None, score, descriptors: Vec::new(), counts: Counts::default() }
        };
        let results: Vec<Arc<[u8]>> = (0..tasks).map(|i| result(i).encode().into()).collect();
        for (i, result) in (0..).zip(&results) {
            evolve.check(i, result).unwrap();
        }
        assert_eq!(evolve.tell(&results).step, Step::Next);
        let saved = evolve.save();
        evolve = Evolve::load(&job, &saved).unwrap();
        assert_eq!(evolve.save(), saved);
        sizes.push(tasks);
    }
    assert_eq!((sizes, evolve.round().tasks), (vec![40, 22, 22], 22));
    let counted = |name| evolve.progress().values.into_iter().find(|value| value.name == name).unwrap().value;
    assert_eq!((counted("evaluations"), counted("failed")), (Some(84.0), Some(3.0)));
}
