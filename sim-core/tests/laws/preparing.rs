//! Tests of round 0: result and budget of settling, and results that are refused.

use crate::procedure::{Batches, SMALL, StopAfter, assert_refused, evaluated, results_of, small};
use sim_core::base::limits;
use sim_core::problem::{Checked, Job, Preparation, Unprepared};
use sim_core::procedure::preparing::PreparationOutcome;
use sim_core::procedure::{self, Bench, NotRun, RoundEnd, Step};
use std::cell::Cell;

#[test]
fn impossible_preparations_are_refused() {
    let job = small();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let procedure = procedure::start(&job).unwrap();
    let round = procedure.round();
    assert_eq!((round.number, round.tasks, round.phase, round.kept), (0, 1, "preparing", true));
    assert!(round.shared.is_empty() && procedure.task(0).is_empty());
    assert_eq!(procedure.describe(0), "the preparation of the robot");
    let of = |toml: &str| {
        let other = Checked::from_toml(toml).unwrap();
        PreparationOutcome::Prepared(other.prepare(&|| false).unwrap()).encode()
    };
    let sound = results_of(&*procedure, &bench, Batches::Full).swap_remove(0);
    assert_eq!(*sound, *of(SMALL));
    assert!(procedure.show(&sound).starts_with("settled with its pivot at a height of "));
    let bare = SMALL.replace("finish = {", "finish = { kind = \"none\" }\n#");
    // Replaces a number of the settled start; number 0 is the pivot's x.
    let altered = |at: usize, number: f32| {
        let mut bytes = sound.to_vec();
        bytes[2 + 4 * at..][..4].copy_from_slice(&number.to_le_bytes());
        bytes
    };
    assert_eq!(altered(0, 0.0), *sound);
    let refused = vec![
        (Vec::new(), "it is empty"),
        (of(&bare), "the preparation has 1 settled starts, but its job needs 2"),
        (of(&SMALL.replace("quadropod", "t-shape")), "joint angles"),
        (altered(0, 1.0), "impossible numbers"),
        (altered(2, f32::NAN), "impossible numbers"),
        (altered(6, 0.5), "impossible numbers"),
        (PreparationOutcome::Refused(String::new()).encode(), "its reason has 0 bytes"),
        (PreparationOutcome::Refused("x".repeat(5000)).encode(), "its reason has 5000 bytes"),
        (evaluated(Some(1.0)).encode(), "its format is "),
    ];
    assert_refused(&*procedure, 0, refused);
}

#[test]
fn encoded_preparation_keeps_its_bits() {
    for entry in sim_core::model::catalogue::robots() {
        let engine = if entry.name.starts_with("mtran") { "rapier" } else { "lockstep" };
        let text = SMALL.replace("quadropod", entry.name).replace("\"lockstep\"", &format!("\"{engine}\""));
        let job = Checked::from_toml(&text).unwrap();
        let preparation = job.prepare(&|| false).unwrap();
        let read = Preparation::decode(&preparation.encode()).unwrap();
        assert_eq!(read.encode(), preparation.encode());
        let (a, b) = (job.clone().with(read).unwrap(), Job::from_toml(&job.to_toml()).unwrap());
        let bits = |job: &Job| {
            let state = job.start();
            let (p, q) = (state.pivot.translation, state.pivot.rotation);
            [p.x, p.y, p.z, q.x, q.y, q.z, q.w].iter().chain(&state.joints).map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        assert_eq!(bits(&a), bits(&b), "{}", entry.name);
        assert_eq!(bits(a.reference().unwrap()), bits(b.reference().unwrap()), "{}", entry.name);
    }
}

/// A mast with its mass beside its foot. Under little gravity its fall takes longer than settling lasts.
const TIPPING: &str = r#"<mujoco model="mast"><worldbody><body name="root" pos="0 0 2"><freejoint/>
    <geom type="box" size="0.05 0.05 1" mass="0.1"/>
    <body name="a" pos="0.06 0 0.9"><joint name="j" axis="0 1 0" range="-90 90"/>
    <geom type="box" size="0.3 0.1 0.1" pos="0.35 0 0" mass="2"/></body></body></worldbody></mujoco>"#;

#[test]
fn robot_that_keeps_moving_fails_in_round_0() {
    let robot = toml::to_string(&sim_core::exchange::read(TIPPING).unwrap().robot).unwrap();
    let head = SMALL.replace("robot = \"quadropod\"\n", "").replace("engine =", "gravity = 0.05, engine =");
    let table = robot.lines().map(|line| match line.strip_prefix("[[").or(line.strip_prefix('[')) {
        Some(_) => line.replacen('[', "[robot.", 1).replacen("[robot.[", "[[robot.", 1),
        None => line.to_owned(),
    });
    let text = format!("{head}[robot]\n{}\n", table.collect::<Vec<_>>().join("\n"));
    let job = Checked::from_toml(&text).unwrap();
    let refusal = Job::from_toml(&text).map(|_| ()).unwrap_err().to_string();
    assert!(refusal.starts_with("robot: the robot still moves at "), "{refusal}");
    let bench = Bench::open(&job.to_toml()).unwrap();
    let mut procedure = procedure::start(&job).unwrap();
    let results = results_of(&*procedure, &bench, Batches::Full);
    assert_eq!(procedure.show(&results[0]), format!("refused: {refusal}"));
    assert_eq!(procedure.tell(&results), RoundEnd { row: None, step: Step::Failed(refusal) });
}

#[test]
fn job_beyond_the_budget_of_a_preparation_is_refused() {
    let with = |physics: &str| {
        let text = SMALL
            .replace("engine = \"lockstep\"", &format!("engine = \"rapier\", {physics}"))
            .replace("steps_per_second = 30, substeps = 8", "steps_per_second = 500, substeps = 100");
        Checked::from_toml(&text).map(|job| job.preparation_budget())
    };
    let usual = with("").unwrap();
    assert!(with("steps_per_second = 60").unwrap() > usual);
    assert!(with("joints = \"multibody\"").unwrap() > usual);
    let refused = with("joints = \"multibody\", steps_per_second = 1000, substeps = 100").unwrap_err().to_string();
    let (found, rest) = refused
        .strip_prefix("physics: settling the robot of 9 bodies could take ")
        .and_then(|rest| rest.split_once(" body-substeps: at most "))
        .expect(&refused);
    assert!(found.parse::<u64>().unwrap() > limits::MAX_PREPARATION);
    assert!(rest.starts_with(&format!("{} are allowed; lower physics.steps_per_second", limits::MAX_PREPARATION)));
    assert!(rest.contains("finish.substeps"), "{rest}");
}

#[test]
fn settling_ends_when_it_is_stopped() {
    for engine in ["rapier", "lockstep"] {
        let job = Checked::from_toml(&SMALL.replace("\"lockstep\"", &format!("\"{engine}\""))).unwrap();
        let asked = Cell::new(0);
        let counting = || {
            asked.set(asked.get() + 1);
            false
        };
        job.prepare(&counting).unwrap();
        let all = asked.get();
        for after in [1, 2, all] {
            asked.set(0);
            let stop = || {
                asked.set(asked.get() + 1);
                asked.get() == after
            };
            assert_eq!(job.prepare(&stop), Err(Unprepared::Stopped));
            assert_eq!(asked.get(), after);
        }
        let bench = Bench::open(&job.to_toml()).unwrap();
        let stopped = StopAfter(Cell::new(2));
        assert_eq!(bench.run(0, &[], &[(0, Vec::new())], &stopped), Err(NotRun::Stopped));
    }
}
