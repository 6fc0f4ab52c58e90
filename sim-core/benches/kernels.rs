//! Benchmarks of single kernels of an evaluation: `cargo bench -p sim-core`. `evogait bench` measures whole evaluations
//! of any robot and job.

use criterion::{Criterion, criterion_group, criterion_main};
use sim_core::base::random::{Purpose, Stream};
use sim_core::control::Run;
use sim_core::evaluate::{Trial, grow, search_streams};
use sim_core::model::catalogue;
use sim_core::physics::lockstep::{Level, run_at};
use sim_core::physics::{Engine, EngineKind, JointKind, Physics, RapierEngine, Request, Scale};
use sim_core::plan::Growth;
use sim_core::problem::Job;
use std::hint::black_box;

fn job() -> Job {
    let entry = catalogue::find(catalogue::jobs(), "quadropod-empty").expect("the catalogue must have this job");
    Job::from_toml(entry.toml).expect("jobs of the catalogue must be valid")
}

/// Returns a gait drawn uniformly within the controller's bounds.
fn gait(job: &Job) -> Vec<f64> {
    let mut stream = Stream::new(1, Purpose::Sample, 0, 0, 0);
    job.controller().space(job.robot()).bounds().map(|(low, high)| stream.uniform(low, high)).collect()
}

fn rollout(c: &mut Criterion) {
    let job = job();
    let motion = job.controller().compile(&Run::new(job.robot(), 1.0), &gait(&job)).unwrap();
    let request = Request { start: job.start(), motion: &motion };
    for (name, joints) in [("impulse", JointKind::Impulse), ("multibody", JointKind::Multibody)] {
        let physics = Physics { joints, ..Physics::of(EngineKind::Rapier, Scale::Paper) };
        c.bench_function(&format!("rapier: rollout of 1 s, {name} joints"), |b| {
            b.iter(|| RapierEngine.run(job.robot(), &physics, &[], black_box(&[request])))
        });
    }
    // 16 rollouts fill the lanes of the widest vectors; narrower vectors take several passes.
    let physics = Physics::of(EngineKind::Lockstep, Scale::Paper);
    let best = Level::new();
    let mut levels = vec![("best", best)];
    #[cfg(target_arch = "x86_64")]
    {
        levels.extend(best.as_avx2().map(|level| ("avx2", Level::Avx2(level))));
        levels.extend(best.as_sse2().map(|level| ("sse2", Level::Sse2(level))));
    }
    for (name, level) in levels {
        c.bench_function(&format!("lockstep: 16 rollouts of 1 s, {name}"), |b| {
            b.iter(|| run_at(level, job.robot(), &physics, &[], black_box(&[request; 16])))
        });
    }
}

fn targets(c: &mut Criterion) {
    let job = job();
    let gait = gait(&job);
    c.bench_function("target table of 10 s", |b| {
        b.iter(|| job.controller().compile(&Run::new(job.robot(), 10.0), black_box(&gait)))
    });
}

fn kinematics(c: &mut Criterion) {
    let job = job();
    let (robot, state) = (job.robot(), job.start());
    c.bench_function("poses of all bodies", |b| b.iter(|| robot.body_poses(black_box(state))));
    c.bench_function("bounds of the robot", |b| b.iter(|| robot.bounds(black_box(state))));
}

/// Measures the growth of the main job's tree of 150 iterations when all of its transitions are known.
fn tree(c: &mut Criterion) {
    let job = job();
    let genotype = &job.optimiser().ask().genotypes[0];
    let stream = search_streams(&job, 0, 0).next().expect("a candidate has a tree");
    let mut trials = [Trial::new(&job, genotype, job.spec().planner.reuse_tolerance, [stream.clone()])];
    grow(&job, &mut trials, &|| false).expect("this growth is never stopped");
    let [Trial { mut table, .. }] = trials;
    c.bench_function("tree of known transitions", |b| {
        b.iter(|| {
            let mut growth = Growth::new(job.planner(), job.root(), stream.clone());
            assert!(growth.advance(&job.setting(), &mut table).is_empty());
            growth
        })
    });
}

criterion_group!(kernels, rollout, targets, kinematics, tree);
criterion_main!(kernels);
