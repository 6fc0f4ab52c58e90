//! The worker's side of a job that simulates.

use super::replan::Replanning;
use super::vary::with_noise;
use super::{Drawn, Ended, Recorded, Run, Task, TaskResult};
use crate::base::score::Counts;
use crate::control::Run as Compile;
use crate::evaluate::{Executed, Stage, Standing, Stopped};
use crate::model::{Place, Robot, bodies_touching};
use crate::physics::{Effort, Motion, Outcome, Physics};
use crate::plan::{Extent, first_touch, goes_outside};
use crate::problem::{Job, Reference, SimulateSpec, Way};
use crate::procedure::{Hooks, NotRun};
use crate::report::{sample, stride};

/// Most points in the paths of all runs together, without the ends of steps.
const MAX_PATH_POINTS: u32 = 50_000;
/// Most points in the path of one run, without the ends of steps.
const MOST_POINTS: u32 = 200;

/// Carries out tasks one after the other: friction differs between runs, so they can't share an engine's lanes.
pub(super) fn run(job: &Job, tasks: &[(u32, Vec<u8>)], hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
    let simulate = job.spec().simulate.as_ref().ok_or_else(|| NotRun::Task("the job has no motion".to_owned()))?;
    let motions = motions(job, simulate).map_err(NotRun::Task)?;
    let mover = Mover { job, simulate, motions: &motions, stop: &|| hooks.stop() };
    let carry_out = |(index, bytes): &(u32, Vec<u8>)| {
        let task = Task::decode(bytes).map_err(|e| NotRun::Task(format!("task {index}: {e}")))?;
        let mut counts = Counts::default();
        let ways = simulate.ways.iter().flatten();
        Ok(match task {
            Task::Repeat { repeat } => {
                let run = |&way: &Way| mover.carry_out(way, Some(repeat), &mut counts).map(|(run, _)| run);
                TaskResult::Repeated(ways.map(run).collect::<Result<_, Stopped>>()?, counts)
            }
            Task::Unvaried => {
                let run = |&way: &Way| mover.carry_out(way, None, &mut counts);
                let runs: Vec<(Run, Vec<Done>)> = ways.map(run).collect::<Result<_, Stopped>>()?;
                TaskResult::Unvaried(recorded(job, runs), counts)
            }
        }
        .encode())
    };
    tasks.iter().map(carry_out).collect()
}

/// Returns the motion of each gait. Without gaits, returns the one motion of the job.
fn motions(job: &Job, simulate: &SimulateSpec) -> Result<Vec<Motion>, String> {
    let (robot, duration) = (job.robot(), job.gaits().duration);
    if let Some(gaits) = job.given_gaits() {
        let compile = |gait: &[f64]| job.controller().compile(&Compile::new(robot, duration), gait);
        return gaits
            .gaits(job.gaits().count as usize)
            .map(compile)
            .collect::<Result<_, _>>()
            .map_err(|e| e.to_string());
    }
    Ok(vec![match &simulate.targets {
        Some(Reference::Inline(table)) => Motion::from(table.targets(duration).within(&robot.hinges, None)),
        _ => Motion::standing(robot.hinges.len(), duration),
    }])
}

/// An executed motion of a run.
struct Done {
    executed: Executed,
    motion: Motion,
}

struct Mover<'a> {
    job: &'a Job,
    simulate: &'a SimulateSpec,
    motions: &'a [Motion],
    stop: &'a dyn Fn() -> bool,
}

impl Mover<'_> {
    /// Executes the motion once.
    fn carry_out(&self, way: Way, repeat: Option<u32>, counts: &mut Counts) -> Result<(Run, Vec<Done>), Stopped> {
        let job = self.job;
        let mut run = not_begun(job, way, Drawn::of(job, repeat));
        let [x, y, yaw] = run.drawn.start;
        // The start without variation was checked with the job.
        let place = if repeat.is_none() { Ok(job.root()) } else { job.root_at(x, y, yaw) };
        let place = match place {
            Ok(place) => place,
            Err(blocked) => {
                run.ended = Ended::NoStart(blocked.to_string());
                return Ok((run, Vec::new()));
            }
        };
        let drawn = run.drawn.clone();
        let (robot, physics) = weakened(job.robot(), job.physics(), &drawn);
        let stage = Stage { robot: &robot, engine: job.engine(), physics: &physics, environment: job.environment() };
        let attempt = Attempt { mover: self, stage, repeat, drawn: &drawn };
        let start = Standing { state: job.start().clone(), place };
        let done = match (&self.simulate.replan, &self.simulate.steps) {
            (Some(replan), _) => {
                let mut planning = Replanning::new(job, self.simulate, replan, repeat, self.stop);
                let (done, gaits) = attempt.planned_anew(&start, &mut planning, counts)?;
                (run.gaits, run.replans) = (gaits, planning.made());
                done
            }
            (None, Some(steps)) => {
                run.gaits = steps.iter().map(|step| step - 1).collect();
                match way {
                    Way::Continuous => vec![attempt.execute(&start, &run.gaits, 0, counts)?],
                    Way::Resimulated => attempt.in_turn(&start, &run.gaits, counts)?,
                }
            }
            (None, None) => vec![attempt.execute(&start, &[0], 0, counts)?],
        };
        if way == Way::Resimulated {
            run.gaits.truncate(done.len());
        }
        self.sum_up(&mut run, &stage, &done);
        Ok((run, done))
    }

    /// Adds the outcomes of a run's motions to the run.
    fn sum_up(&self, run: &mut Run, stage: &Stage<'_>, done: &[Done]) {
        let (mut effort, mut samples) = (Effort::default(), 0);
        let step = self.path_step(done);
        for Done { executed, .. } in done {
            let rollout = &executed.rollout;
            let extent = Extent::of(rollout);
            if run.touched.is_none() {
                let sample = first_touch_of(stage, executed);
                run.touched = sample.map(|i| run.seconds + f64::from(rollout.trace.time(i)));
            }
            run.left_map |= goes_outside(stage.environment, &executed.frame, rollout, &extent);
            effort += rollout.effort;
            let points: Vec<[f64; 2]> = (0..rollout.trace.len()).map(|i| executed.point(i)).collect();
            run.travelled += points.windows(2).map(|pair| length(pair[0], pair[1])).sum::<f64>();
            for touching in (0..rollout.trace.len()).map(|i| touching(stage, executed, i)) {
                run.contact
                    .iter_mut()
                    .zip(touching)
                    .for_each(|(share, touches)| *share += f64::from(u8::from(touches)));
                samples += 1;
            }
            run.path.extend(executed.way(step));
            run.seconds += rollout.simulated_ms as f64 / 1000.0;
            if rollout.outcome != Outcome::Completed {
                run.ended = Ended::Broken(rollout.outcome.to_string());
            }
        }
        run.contact.iter_mut().for_each(|share| *share /= f64::from(samples.max(1)));
        (run.work, run.turnover) = (effort.work, effort.turnover);
        if let Some(last) = done.last() {
            let Place { x, y, z, yaw } = last.executed.end().place;
            run.end = [x, y, z, yaw];
        }
    }

    /// Returns the time between two points of a run's path, s.
    fn path_step(&self, done: &[Done]) -> f32 {
        let runs = (self.simulate.repeats.unwrap_or(0) + 1) * self.simulate.ways.as_ref().map_or(1, |w| w.len() as u32);
        let points = (MAX_PATH_POINTS / runs).clamp(1, MOST_POINTS);
        let seconds: f64 = done.iter().map(|one| one.motion.duration()).sum();
        (seconds / f64::from(points)) as f32
    }
}

/// A run in execution.
struct Attempt<'a> {
    mover: &'a Mover<'a>,
    stage: Stage<'a>,
    repeat: Option<u32>,
    drawn: &'a Drawn,
}

impl Attempt<'_> {
    /// Executes planned gaits until there is none left, the simulation breaks, or the robot touches an obstacle.
    fn planned_anew(
        &self,
        start: &Standing,
        planning: &mut Replanning<'_>,
        counts: &mut Counts,
    ) -> Result<(Vec<Done>, Vec<u32>), Stopped> {
        let (mut done, mut gaits) = (Vec::new(), Vec::new());
        let mut at = start.clone();
        while let Some(gait) = planning.next(&at, counts)? {
            let one = self.execute(&at, &[gait], done.len() as u32, counts)?;
            at = one.executed.end();
            let over = one.is_broken() || first_touch_of(&self.stage, &one.executed).is_some();
            gaits.push(gait);
            done.push(one);
            if over {
                break;
            }
        }
        Ok((done, gaits))
    }

    /// Executes every step from the exact end of the one before, at rest, until one breaks.
    fn in_turn(&self, start: &Standing, steps: &[u32], counts: &mut Counts) -> Result<Vec<Done>, Stopped> {
        let mut done: Vec<Done> = Vec::new();
        let mut at = start.clone();
        for (i, &step) in steps.iter().enumerate() {
            let one = self.execute(&at, &[step], i as u32, counts)?;
            at = one.executed.end();
            let broken = one.is_broken();
            done.push(one);
            if broken {
                break;
            }
        }
        Ok(done)
    }

    /// Executes steps in one simulation. `first` is the index of the first of them in the run.
    fn execute(&self, from: &Standing, steps: &[u32], first: u32, counts: &mut Counts) -> Result<Done, Stopped> {
        let Mover { job, motions, stop, .. } = self.mover;
        if stop() {
            return Err(Stopped);
        }
        let noisy = |(i, &step): (usize, &u32)| with_noise(job, &motions[step as usize], self.repeat, first + i as u32);
        let noisy: Vec<Motion> = steps.iter().enumerate().map(noisy).collect();
        let motion = self.drawn.kill(Motion::chain(&noisy.iter().collect::<Vec<_>>()));
        let executed = self.stage.execute(from, &motion);
        counts.rollouts += 1;
        counts.unstable += u64::from(executed.rollout.outcome != Outcome::Completed);
        counts.simulated_ms += executed.rollout.simulated_ms;
        Ok(Done { executed, motion })
    }
}

impl Done {
    fn is_broken(&self) -> bool {
        self.executed.rollout.outcome != Outcome::Completed
    }
}

/// Makes a run that has not begun.
fn not_begun(job: &Job, way: Way, drawn: Drawn) -> Run {
    let [x, y, yaw] = drawn.start;
    Run {
        way,
        drawn,
        ended: Ended::Completed,
        seconds: 0.0,
        end: [x, y, 0.0, yaw],
        travelled: 0.0,
        touched: None,
        left_map: false,
        work: 0.0,
        turnover: 0.0,
        contact: vec![0.0; job.robot().bodies.len()],
        gaits: Vec::new(),
        replans: 0,
        path: vec![[x, y]],
    }
}

/// Returns robot and physics with the drawn motor strength and friction.
fn weakened(robot: &Robot, physics: &Physics, drawn: &Drawn) -> (Robot, Physics) {
    let mut robot = robot.clone();
    let strength = drawn.motor_strength as f32;
    for hinge in &mut robot.hinges {
        hinge.torque = Some(hinge.torque_or(physics.max_torque) * strength);
    }
    (robot, Physics { friction: drawn.friction as f32, ..*physics })
}

/// Returns the first sample at which the robot touches an obstacle.
fn first_touch_of(stage: &Stage<'_>, executed: &Executed) -> Option<usize> {
    let extent = Extent::of(&executed.rollout);
    first_touch(stage.robot, &stage.environment.obstacles, &executed.frame, &executed.rollout, &extent)
}

fn touching(stage: &Stage<'_>, executed: &Executed, sample: usize) -> Vec<bool> {
    bodies_touching(stage.robot, &stage.environment.terrain, &executed.state(sample))
}

fn length([x, y]: [f64; 2], [u, v]: [f64; 2]) -> f64 {
    ((x - u) * (x - u) + (y - v) * (y - v)).sqrt()
}

/// Returns runs with their samples. The stride of samples is chosen so that all ways together fit into a report.
fn recorded(job: &Job, runs: Vec<(Run, Vec<Done>)>) -> Vec<Recorded> {
    let stage = Stage::of(job);
    let all: Vec<&Executed> = runs.iter().flat_map(|(_, done)| done.iter().map(|one| &one.executed)).collect();
    let stride = stride(all.iter().copied());
    let record = |(run, done): (Run, Vec<Done>)| {
        let (mut samples, mut touches, mut before) = (Vec::new(), Vec::new(), 0.0);
        for Done { executed, motion } in &done {
            // The first sample of a step equals the last one of the step before.
            let first = if samples.is_empty() { 0 } else { stride };
            for i in (first..executed.rollout.trace.len()).step_by(stride) {
                let mut moment = sample(executed, motion, i);
                moment.time += before;
                samples.push(moment);
                touches.push(touching(&stage, executed, i));
            }
            before += motion.duration();
        }
        Recorded { run, samples, touching: touches }
    };
    runs.into_iter().map(record).collect()
}
