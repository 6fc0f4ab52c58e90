//! Pose of the settled robot on the map: at its start on flat ground or terrain, and at its goal.

use crate::base::error::Invalid;
use crate::base::math::Vector;
use crate::model::environment::{Block, Environment};
use crate::model::{Place, Robot, State, state_touches};

/// Least difference of heights that count as different, mu.
const SAME_HEIGHT: f64 = 1e-6;
/// Number of the robot's headings that are tested at the goal.
const GOAL_HEADINGS: u32 = 72;

/// Returns the height of the terrain that the robot starts on, mu; 0 on flat ground. The robot is settled on flat
/// ground and then raised to the highest terrain that it would touch at its start.
///
/// # Errors
/// If part of the robot stands beside that terrain, or the robot touches an obstacle.
pub(super) fn ground_of_start(robot: &Robot, environment: &Environment, start: &State) -> Result<f64, Invalid> {
    let at = &environment.start;
    let place = Place { x: at.x, y: at.y, z: 0.0, yaw: at.yaw };
    let misplaced = |wrong| Err(Invalid::Misplaced { what: "the start", x: at.x, y: at.y, wrong });
    let mut ground = 0.0;
    let mut below = None;
    let mut state = start.clone();
    // Each iteration ends at the top of another block, so there are at most as many iterations as blocks.
    loop {
        let touched = environment
            .terrain
            .iter()
            .enumerate()
            .filter(|(_, block)| block.top > ground + SAME_HEIGHT && state_touches(robot, block, &place, &state));
        let Some((highest, block)) = touched.max_by(|(_, a), (_, b)| a.top.total_cmp(&b.top)) else { break };
        ground = block.top;
        below = Some(highest);
        state.pivot.translation.z = (f64::from(start.pivot.translation.z) + ground) as f32;
    }
    if let Some(i) = below {
        let level: Vec<&Block> = environment.terrain.iter().filter(|b| (b.top - ground).abs() < SAME_HEIGHT).collect();
        let plane = place.plane();
        let stands = footprint(robot, &state).into_iter().all(|point| {
            let (x, y) = plane.point(point.x.into(), point.y.into());
            level.iter().any(|block| block.covers(x, y, 0.0))
        });
        if !stands {
            return misplaced(format!(
                "where the robot touches environment.terrain[{i}] and part of the robot is beside that terrain: the whole \
                 robot must stand on flat ground, or over terrain of one height"
            ));
        }
    }
    match environment.obstacles.iter().position(|block| state_touches(robot, block, &place, &state)) {
        Some(i) => misplaced(format!("where the robot touches environment.obstacle[{i}]")),
        None => Ok(ground),
    }
}

/// Returns an obstacle at the goal if the settled robot, with its pivot at the goal, touches an obstacle at every
/// heading.
pub(super) fn blocked_goal(robot: &Robot, environment: &Environment, start: &State) -> Option<usize> {
    let goal = environment.goal.as_ref()?;
    let over = environment.terrain.iter().filter(|block| block.covers(goal.x, goal.y, 0.0));
    let mut state = start.clone();
    state.pivot.translation.z += over.map(|block| block.top).fold(0.0, f64::max) as f32;
    let touched = |heading: u32| {
        let yaw = f64::from(heading) * std::f64::consts::TAU / f64::from(GOAL_HEADINGS);
        let place = Place { x: goal.x, y: goal.y, z: 0.0, yaw };
        environment.obstacles.iter().position(|block| state_touches(robot, block, &place, &state))
    };
    let first = touched(0)?;
    (1..GOAL_HEADINGS).all(|heading| touched(heading).is_some()).then_some(first)
}

/// Returns the corners of the robot's boxes and prisms and the outermost points of its capsules, in the robot's frame.
fn footprint(robot: &Robot, state: &State) -> Vec<Vector> {
    let mut points = Vec::new();
    for (body, pose) in robot.bodies.iter().zip(robot.body_poses(state)) {
        for part in &body.boxes {
            for corner in 0..8 {
                let sign = |axis: u32| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
                points.push(pose * part.pose * (part.half * Vector::new(sign(0), sign(1), sign(2))));
            }
        }
        points.extend(body.prisms.iter().flat_map(|prism| prism.corners()).map(|corner| pose * *corner));
        for part in &body.capsules {
            for offset in [Vector::X, Vector::NEG_X, Vector::Y, Vector::NEG_Y] {
                points.extend(part.ends.map(|end| pose * end + offset * part.radius));
            }
        }
    }
    points
}
