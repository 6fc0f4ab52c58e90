//! Batches: rollouts are assigned to lanes, and their outcomes are read out.

use super::contact::Surface;
use super::kinematics::{Motion, Spatial, Velocity};
use super::lanes::{Lanes, Mask, V3, all, fma};
use super::model::Model;
use super::step::Stepper;
use crate::base::math::{Pose, Rotation, Vector};
use crate::model::{State, Twist, Velocities};
use crate::physics::{Bound, Course, Effort, Outcome, Physics, Request, Rollout, Trace, sample_every, spans};
use fearless_simd::prelude::*;

/// Simulates a batch, as many rollouts at once as there are lanes. Rollouts of different length are not simulated
/// together. `stop` is called before every step; once it returns true, the result is `None`.
#[inline(always)]
pub(super) fn run<S: Simd, G: Surface<S>>(
    simd: S,
    model: &Model,
    physics: &Physics,
    ground: G,
    batch: &[(Request<'_>, Course)],
    stop: &dyn Fn() -> bool,
) -> Option<Vec<Rollout>> {
    let width = Lanes::<S>::LEN;
    let steps = |i: usize| batch[i].1.steps;
    let mut order: Vec<usize> = (0..batch.len()).collect();
    order.sort_by_key(|&i| steps(i));
    let mut rollouts: Vec<Option<Rollout>> = batch.iter().map(|_| None).collect();
    let mut stepper = Stepper::new(simd, model, ground);
    let mut rest = &order[..];
    while let Some(&first) = rest.first() {
        let alike = rest.iter().take(width).take_while(|&&i| steps(i) == steps(first)).count();
        let (group, later) = rest.split_at(alike);
        let requests: Vec<&(Request<'_>, Course)> = group.iter().map(|&i| &batch[i]).collect();
        for (&i, rollout) in group.iter().zip(roll(simd, model, physics, &mut stepper, &requests, stop)?) {
            rollouts[i] = Some(rollout);
        }
        rest = later;
    }
    Some(rollouts.into_iter().map(|r| r.expect("every request was in a group")).collect())
}

/// Rollout of a lane in progress.
struct Lane {
    trace: Trace,
    boxes: Vec<(Vector, Vector)>,
    /// Velocities at the last sample of the trace.
    velocities: Velocities,
    /// First exceeded bound, and the step at the end of which it was exceeded.
    broken: Option<(u32, Bound)>,
    /// Work of the motors until then; 0 if no bound is exceeded.
    effort: Effort,
}

impl Lane {
    /// Makes the rollout of the lane. `rate` is the number of steps per second, `end_speed` the greatest speed at the
    /// end, mu/s, and `effort` the work of the motors over all steps.
    fn into_rollout(
        self,
        (request, course): &(Request<'_>, Course),
        rate: u32,
        end_speed: f32,
        effort: Effort,
    ) -> Rollout {
        let (outcome, done) = match self.broken {
            None => (course.outcome, course.steps),
            Some((step, bound)) => {
                (Outcome::Unstable { time: (f64::from(step) / f64::from(rate)) as f32, bound }, step)
            }
        };
        // Last sample at which the simulation was sound.
        let sound = (0..self.trace.len()).take_while(|&s| self.trace.time(s) * rate as f32 <= done as f32).last();
        let mut end = request.start.clone();
        if let Some(s) = sound {
            let state = self.trace.state(s);
            end = State { velocities: Some(self.velocities), connections: end.connections, phase: end.phase, ..state };
        }
        if outcome == Outcome::Completed {
            end.phase = request.motion.end_phase().clone();
        }
        let kept = sound.map_or(1, |s| s + 1);
        Rollout {
            end,
            end_speed,
            swept: spans(&self.boxes[..kept.min(self.boxes.len())]),
            trace: self.trace,
            outcome,
            simulated_ms: u64::from(done) * 1000 / u64::from(rate),
            effort: self.broken.map_or(effort, |_| self.effort),
        }
    }
}

/// Simulates up to one rollout per lane, all of the same number of steps.
#[inline(always)]
fn roll<S: Simd, G: Surface<S>>(
    simd: S,
    model: &Model,
    physics: &Physics,
    stepper: &mut Stepper<'_, S, G>,
    requests: &[&(Request<'_>, Course)],
    stop: &dyn Fn() -> bool,
) -> Option<Vec<Rollout>> {
    let rate = physics.steps_per_second;
    let steps = requests[0].1.steps;
    let every = sample_every(rate);
    let joints = model.hinges.len();
    let mut motion = start(simd, model, requests);
    let lane = || {
        let (trace, velocities) = (Trace::new(joints), velocities(&motion, 0));
        Lane { trace, boxes: Vec::new(), velocities, broken: None, effort: Effort::default() }
    };
    let mut lanes: Vec<Lane> = requests.iter().map(|_| lane()).collect();
    stepper.unlock();
    let mut targets = vec![all(simd, 0.0); joints];
    let mut rows = vec![vec![0.0; joints]; requests.len()];
    let mut speeds = all(simd, 0.0);
    let mut ledger = Ledger::new(simd);
    for done in 0..=steps {
        if stop() {
            return None;
        }
        stepper.place(&motion);
        if done % every == 0 || done == steps {
            sample(simd, model, stepper, &motion, done as f32 / rate as f32, &mut lanes);
        }
        if done == steps {
            stepper.measure(&motion);
        } else {
            let time = f64::from(done + 1) / f64::from(rate);
            for (lane, (request, course)) in requests.iter().enumerate() {
                request.motion.targets().at(time, &mut rows[lane]);
                course.failing(done).for_each(|joint| stepper.lock(joint, lane));
            }
            for (joint, target) in targets.iter_mut().enumerate() {
                *target = gather(simd, requests.len(), |lane| rows[lane][joint]);
            }
            stepper.step(&mut motion, &targets);
        }
        // Checks the motion after `done` steps.
        speeds = stepper.extremes.0;
        check(simd, model, done, stepper, &mut ledger, &mut lanes);
        if done < steps {
            ledger.post(stepper.work, stepper.turnover);
        }
        if lanes.iter().all(|lane| lane.broken.is_some()) {
            break;
        }
    }
    let finished = lanes.into_iter().zip(requests).enumerate();
    let rollout = |(i, (lane, request)): (usize, (Lane, &&(Request<'_>, Course)))| {
        lane.into_rollout(request, rate, speeds[i].sqrt(), ledger.effort(i))
    };
    Some(finished.map(rollout).collect())
}

/// Returns the values of the lanes in use; unused lanes get the value of the last one.
#[inline(always)]
fn gather<S: Simd>(simd: S, used: usize, value: impl Fn(usize) -> f32) -> Lanes<S> {
    let mut lanes = all(simd, 0.0);
    for lane in 0..Lanes::<S>::LEN {
        lanes[lane] = value(lane.min(used - 1));
    }
    lanes
}

#[inline(always)]
fn start<S: Simd>(simd: S, model: &Model, requests: &[&(Request<'_>, Course)]) -> Motion<S> {
    let pick = |f: &dyn Fn(&State) -> f32| gather(simd, requests.len(), |lane| f(requests[lane].0.start));
    let speed = |f: &dyn Fn(&Velocities) -> f32| pick(&|s| s.velocities.as_ref().map_or(0.0, f));
    let base = Spatial {
        a: V3 { x: speed(&|v| v.pivot.angular.x), y: speed(&|v| v.pivot.angular.y), z: speed(&|v| v.pivot.angular.z) },
        l: V3 { x: speed(&|v| v.pivot.linear.x), y: speed(&|v| v.pivot.linear.y), z: speed(&|v| v.pivot.linear.z) },
    };
    Motion {
        position: V3 {
            x: pick(&|s| s.pivot.translation.x),
            y: pick(&|s| s.pivot.translation.y),
            z: pick(&|s| s.pivot.translation.z),
        },
        rotation: [
            pick(&|s| s.pivot.rotation.x),
            pick(&|s| s.pivot.rotation.y),
            pick(&|s| s.pivot.rotation.z),
            pick(&|s| s.pivot.rotation.w),
        ],
        angles: (0..model.hinges.len()).map(|joint| pick(&|s| s.joints[joint])).collect(),
        velocity: Velocity { base, rates: (0..model.hinges.len()).map(|joint| speed(&|v| v.rates[joint])).collect() },
    }
}

/// Returns the velocities of a lane.
fn velocities<S: Simd>(motion: &Motion<S>, lane: usize) -> Velocities {
    let at = |v: V3<S>| Vector::new(v.x[lane], v.y[lane], v.z[lane]);
    let base = motion.velocity.base;
    let pivot = Twist { angular: at(base.a), linear: at(base.l) };
    Velocities { pivot, rates: motion.velocity.rates.iter().map(|rate| rate[lane]).collect() }
}

/// Adds a sample and the box around the robot to every sound lane.
#[inline(always)]
fn sample<S: Simd, G: Surface<S>>(
    simd: S,
    model: &Model,
    stepper: &Stepper<'_, S, G>,
    motion: &Motion<S>,
    time: f32,
    lanes: &mut [Lane],
) {
    let (low, high) = stepper.bounds(simd, model, motion);
    let [x, y, z, w] = motion.rotation;
    for (i, lane) in lanes.iter_mut().enumerate().filter(|(_, lane)| lane.broken.is_none()) {
        let at = |v: V3<S>| Vector::new(v.x[i], v.y[i], v.z[i]);
        let rotation = Rotation::from_xyzw(x[i], y[i], z[i], w[i]);
        let joints = motion.angles.iter().map(|angle| angle[i]).collect();
        lane.trace.push(time, &State::new(Pose::from_parts(at(motion.position), rotation), joints));
        lane.velocities = velocities(motion, i);
        lane.boxes.push((at(low), at(high)));
    }
}

/// Energy that the motors of each lane gave, with and without signs.
struct Ledger<S: Simd> {
    /// Kinetic and potential energy at the start.
    start: Option<Lanes<S>>,
    given: Lanes<S>,
    turnover: Lanes<S>,
    /// Sum over the motors of the energy of each, without signs.
    of_each: Lanes<S>,
}

impl<S: Simd> Ledger<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let zero = all(simd, 0.0);
        Self { start: None, given: zero, turnover: zero, of_each: zero }
    }

    #[inline(always)]
    fn post(&mut self, work: Lanes<S>, of_each: Lanes<S>) {
        self.given += work;
        self.turnover += work.abs();
        self.of_each += of_each;
    }

    fn effort(&self, lane: usize) -> Effort {
        Effort { work: self.given[lane].into(), turnover: self.of_each[lane].into() }
    }
}

/// Finds lanes that left the bounds of a sound simulation.
#[inline(always)]
fn check<S: Simd, G: Surface<S>>(
    simd: S,
    model: &Model,
    step: u32,
    stepper: &Stepper<'_, S, G>,
    ledger: &mut Ledger<S>,
    lanes: &mut [Lane],
) {
    let ((fastest, lowest), energy) = (stepper.extremes, stepper.energy);
    let most = all(simd, f32::MAX);
    let finite: Mask<S> = fastest.simd_le(most) & energy.abs().simd_le(most) & lowest.abs().simd_le(most);
    let slow: Mask<S> = fastest.simd_le(all(simd, Bound::SPEED * Bound::SPEED));
    let above: Mask<S> = lowest.simd_ge(all(simd, -Bound::DEPTH));
    let calm: Mask<S> = energy.simd_le(all(simd, Bound::ENERGY * model.mass));
    let whole = energy + stepper.potential;
    let start = *ledger.start.get_or_insert(whole);
    let slack = fma::<S>(all(simd, Bound::DRIFT), ledger.turnover, all(simd, Bound::LIFT * model.weight()));
    let paid: Mask<S> = (whole - start - ledger.given).simd_le(slack);
    if (finite & slow & above & calm & paid).all_true() {
        return;
    }
    for (i, lane) in lanes.iter_mut().enumerate().filter(|(_, lane)| lane.broken.is_none()) {
        let bounds = [
            (finite, Bound::Finite),
            (slow, Bound::Speed),
            (above, Bound::Penetration),
            (calm, Bound::Energy),
            (paid, Bound::Work),
        ];
        let left = bounds.into_iter().find(|(sound, _)| !sound.test(i));
        lane.broken = left.map(|(_, bound)| (step, bound));
        lane.effort = ledger.effort(i);
    }
}
