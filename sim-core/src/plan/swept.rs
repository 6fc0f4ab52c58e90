//! Tests of a transition laid out in the map: whether it leaves the map, touches an obstacle or passes over terrain.
//!
//! Obstacles are not simulated: rejecting a motion needs no contact forces. A transition is laid out hundreds of times,
//! so bounds in its own frame are computed once ([`Extent`]); they decide most layouts. The others are tested with
//! boxes around the robot over short spans of time. Only where such a box comes near an obstacle are the robot's own
//! boxes tested, at every sample of that span (20 or more per second of motion).

use super::Transition;
use crate::model::environment::{Block, Environment};
use crate::model::{Place, Plane, Robot, Solid};
use crate::physics::{Rollout, Span};

/// Margin for rounding where bounds alone decide, mu.
const SLACK: f64 = 1e-6;

/// Bounds of a rollout, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Centre of the box around the pivot's path in the plane, mu.
    way: [f64; 2],
    /// Half of that box's sides, mu.
    way_half: [f64; 2],
    /// Centre of a disc that holds the discs of all spans, mu.
    center: [f64; 2],
    /// Radius of that disc, mu.
    reach: f64,
    /// Lowest and highest point of the robot, mu.
    heights: [f64; 2],
}

impl Extent {
    /// Computes the bounds of a rollout.
    pub fn of(rollout: &Rollout) -> Self {
        let pivots = (0..rollout.trace.len()).map(|i| {
            let p = rollout.trace.pivot(i).translation;
            ([f64::from(p.x), f64::from(p.y)], [f64::from(p.x), f64::from(p.y)])
        });
        let (way, way_half) = middle(pivots);
        let corners = |s: &Span| ([f64::from(s.low.x), f64::from(s.low.y)], [f64::from(s.high.x), f64::from(s.high.y)]);
        let (center, _) = middle(rollout.swept.iter().map(corners));
        let reach = rollout.swept.iter().map(|span| {
            let ([x, y], radius) = disc(span);
            let (dx, dy) = (x - center[0], y - center[1]);
            (dx * dx + dy * dy).sqrt() + radius
        });
        Self {
            way,
            way_half,
            center,
            reach: reach.fold(0.0, f64::max) + SLACK,
            heights: [
                rollout.swept.iter().map(|s| f64::from(s.low.z)).fold(f64::INFINITY, f64::min),
                rollout.swept.iter().map(|s| f64::from(s.high.z)).fold(f64::NEG_INFINITY, f64::max),
            ],
        }
    }

    /// Returns true if the bounds show that the pivot's whole path, laid out, lies inside the map.
    fn stays_inside(&self, environment: &Environment, plane: &Plane) -> bool {
        let ([x, y], [w, h]) = (self.way, self.way_half);
        [(-w, -h), (w, -h), (-w, h), (w, h)].iter().all(|(dx, dy)| {
            let (x, y) = plane.point(x + dx, y + dy);
            environment.contains(x.abs() + SLACK, y.abs() + SLACK)
        })
    }

    /// Returns true if a span's disc, laid out, may overlap a block, seen from above.
    fn may_cover(&self, block: &Block, plane: &Plane) -> bool {
        let (x, y) = plane.point(self.center[0], self.center[1]);
        block.covers(x, y, self.reach)
    }
}

/// Returns centre and half sides of the box around boxes that are given by their corners.
fn middle(boxes: impl Iterator<Item = ([f64; 2], [f64; 2])>) -> ([f64; 2], [f64; 2]) {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for (l, h) in boxes {
        for axis in 0..2 {
            low[axis] = low[axis].min(l[axis]);
            high[axis] = high[axis].max(h[axis]);
        }
    }
    ([0, 1].map(|i| (low[i] + high[i]) / 2.0), [0, 1].map(|i| (high[i] - low[i]) / 2.0))
}

/// Returns true if the pivot leaves the map on a transition laid out from `place`.
pub fn leaves_map(environment: &Environment, place: &Place, transition: &Transition) -> bool {
    goes_outside(environment, place, &transition.rollout, &transition.extent)
}

/// Returns true if the pivot leaves the map on a rollout laid out from `place`.
pub fn goes_outside(environment: &Environment, place: &Place, rollout: &Rollout, extent: &Extent) -> bool {
    let (plane, trace) = (place.plane(), &rollout.trace);
    // From the end: a robot that leaves the map is usually still outside at the end.
    !extent.stays_inside(environment, &plane)
        && (0..trace.len()).rev().any(|i| {
            let p = trace.pivot(i).translation;
            let (x, y) = plane.point(p.x.into(), p.y.into());
            !environment.contains(x, y)
        })
}

/// Returns true if any part of the robot touches an obstacle on a transition laid out from `place`.
pub fn touches(robot: &Robot, obstacles: &[Block], place: &Place, transition: &Transition) -> bool {
    first_touch(robot, obstacles, place, &transition.rollout, &transition.extent).is_some()
}

/// Returns the first sample of a rollout laid out from `place` at which any part of the robot touches an obstacle.
pub fn first_touch(
    robot: &Robot,
    obstacles: &[Block],
    place: &Place,
    rollout: &Rollout,
    extent: &Extent,
) -> Option<usize> {
    let plane = place.plane();
    let [lowest, highest] = extent.heights;
    let near = obstacles.iter().filter(|b| lowest <= b.top && highest >= b.base && extent.may_cover(b, &plane));
    let near: Vec<Solid<'_>> = near.map(Solid::of).collect();
    if near.is_empty() {
        return None;
    }
    let frame = place.frame();
    rollout.swept.iter().find_map(|span| {
        let nearer: Vec<&Solid<'_>> = near.iter().filter(|solid| is_near(solid.block, span, &plane)).collect();
        let touched = |&i: &usize| {
            let poses = robot.body_poses(&rollout.trace.state(i));
            nearer.iter().any(|solid| solid.meets(robot, &frame, &poses))
        };
        if nearer.is_empty() { None } else { (span.first..=span.last).find(touched) }
    })
}

/// Returns true if the disc around a swept box of a transition laid out from `place` overlaps any of these blocks, seen
/// from above.
pub fn on_terrain(terrain: &[Block], place: &Place, transition: &Transition) -> bool {
    let plane = place.plane();
    let swept = &transition.rollout.swept;
    let mut near = terrain.iter().filter(|block| transition.extent.may_cover(block, &plane));
    near.any(|block| swept.iter().any(|span| footprint(block, &plane, span)))
}

/// Returns true if a span's box, laid out, may touch a block. Compares a disc around the box with the block's
/// footprint, and their heights.
fn is_near(block: &Block, span: &Span, plane: &Plane) -> bool {
    f64::from(span.low.z) <= block.top && f64::from(span.high.z) >= block.base && footprint(block, plane, span)
}

fn footprint(block: &Block, plane: &Plane, span: &Span) -> bool {
    let ([x, y], radius) = disc(span);
    let (x, y) = plane.point(x, y);
    block.covers(x, y, radius)
}

/// Returns centre and radius of a disc around a span's box, mu.
fn disc(span: &Span) -> ([f64; 2], f64) {
    let (low, high) = (span.low, span.high);
    let center = [f64::from(low.x + high.x) / 2.0, f64::from(low.y + high.y) / 2.0];
    let (w, h) = (f64::from(high.x - low.x) / 2.0, f64::from(high.y - low.y) / 2.0);
    (center, (w * w + h * h).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::{Purpose, Stream};
    use crate::model::state_touches;
    use crate::physics::{Effort, Outcome, Trace};
    use crate::plan::{Reuse, StartId, TransitionKey, Transitions};

    /// Makes a transition of a robot that moves along a random path with random joint angles.
    fn drawn(robot: &Robot, stream: &mut Stream) -> Transition {
        let mut state = robot.neutral();
        let (mut trace, mut boxes) = (Trace::new(robot.hinges.len()), Vec::new());
        let toward = [stream.uniform(-0.5, 0.5), stream.uniform(-0.5, 0.5)];
        for i in 0..=40 {
            trace.push(i as f32 / 20.0, &state);
            boxes.push(robot.bounds(&state));
            state.pivot.translation.x += (toward[0] + stream.uniform(-0.2, 0.2)) as f32;
            state.pivot.translation.y += (toward[1] + stream.uniform(-0.2, 0.2)) as f32;
            state.joints.iter_mut().for_each(|a| *a = stream.uniform(-1.5, 1.5) as f32);
        }
        let span = |first: usize| {
            let (mut low, mut high) = boxes[first];
            for (l, h) in &boxes[first..=first + 10] {
                (low, high) = (low.min(*l), high.max(*h));
            }
            Span { first, last: first + 10, low, high }
        };
        let rollout = Rollout {
            end: trace.state(40),
            end_speed: 0.0,
            trace,
            swept: [0, 10, 20, 30].map(span).to_vec(),
            outcome: Outcome::Completed,
            simulated_ms: 2000,
            effort: Effort::default(),
        };
        let key = TransitionKey { start: StartId(0), gait: 0 };
        let mut table = Transitions::new(1, Reuse { tolerance: 0.0, variants: 1 }, &robot.neutral());
        table.insert(key, rollout);
        table.get(key).unwrap().clone()
    }

    #[test]
    fn bounds_give_same_result_as_testing_every_sample() {
        let robot = crate::model::catalogue::robots().iter().find(|r| r.name == "lizard").unwrap().toml;
        let robot = Robot::compile(&toml::from_str(robot).unwrap()).unwrap();
        let mut stream = Stream::new(1, Purpose::Sample, 0, 0, 0);
        let (mut left, mut touched, mut covered) = (0, 0, 0);
        for _ in 0..60 {
            let transition = drawn(&robot, &mut stream);
            for _ in 0..10 {
                let mut block = || Block {
                    center: [stream.uniform(-10.0, 10.0), stream.uniform(-8.0, 8.0)],
                    size: [stream.uniform(0.1, 4.0), stream.uniform(0.1, 4.0)],
                    base: 0.0,
                    top: stream.uniform(0.1, 2.0),
                    yaw: stream.uniform(-7.0, 7.0),
                };
                let blocks = [block(), block()];
                let place = Place {
                    x: stream.uniform(-10.0, 10.0),
                    y: stream.uniform(-8.0, 8.0),
                    z: 0.0,
                    yaw: stream.uniform(-7.0, 7.0),
                };
                let toml = "name = \"map\"\nsize = [24, 18]\nstart = { x = 0, y = 0 }";
                let environment = Environment::from_toml(toml).unwrap();
                let trace = &transition.rollout.trace;
                let outside = (0..trace.len()).any(|i| {
                    let p = trace.pivot(i).translation;
                    let (x, y) = place.point(p.x.into(), p.y.into());
                    !environment.contains(x, y)
                });
                let meets = |i| blocks.iter().any(|b| state_touches(&robot, b, &place, &trace.state(i)));
                let touching = (0..trace.len()).any(meets);
                let spans = &transition.rollout.swept;
                let over = blocks.iter().any(|b| spans.iter().any(|s| footprint(b, &place.plane(), s)));
                assert_eq!(leaves_map(&environment, &place, &transition), outside);
                assert_eq!(touches(&robot, &blocks, &place, &transition), touching);
                assert_eq!(on_terrain(&blocks, &place, &transition), over);
                assert!(over || !touching, "a block is touched outside the swept boxes");
                left += u32::from(outside);
                touched += u32::from(touching);
                covered += u32::from(over);
            }
        }
        for n in [left, touched, covered] {
            assert!(
                (50..550).contains(&n),
                "too few cases of one result to test both: {left} {touched} {covered} of 600"
            );
        }
    }
}
