//! Motion sequences of M-TRAN modules: programs of segments (Yoshida, Murata, Kamimura, Tomita, Kurokawa and Kokaji
//! 2003, sections 2.2 and 3.1).

mod apply;
mod chain;
mod cuts;
mod feasible;
mod genes;
mod parse;
mod parse_error;
mod print;
mod program;
mod rules;
#[cfg(test)]
mod samples;
mod timetable;

pub use apply::{ANGLE_STEP, SERVO_SPEED, Step};
pub use feasible::Feasible;
pub use genes::{Genes, MAX_CONNECTIONS, MAX_TURNS};
pub use parse::parse;
pub use parse_error::{Expected, MAX_FOUND, ParseError, Place};
pub use program::*;
pub use rules::{Reading, Refusal, Rule, Semantics};
pub use timetable::{Timetable, radians};

use super::{Controller, Infeasible, Parameter, Signals, phase};
use crate::base::error::Invalid;
use crate::base::limits::MAX_GAIT_SEGMENTS;
use crate::base::registry::Component;
use crate::genotype::{Length, Rules, Space};
use crate::model::mtran::Configuration;
use crate::model::{Module, Robot};
use crate::physics::{TICK, Targets};
use std::sync::Arc;

/// Controller of motion sequences. A gait is a program: it turns the servos of M-TRAN modules, segment after segment,
/// and begins again until its time is over.
///
/// Modules are numbered from 0 in the order of the robot file. Connections stay as they are: the connections that a
/// segment names decide only if it is feasible.
pub struct Sequence;

/// Reason for which a robot has no M-TRAN configuration.
const NO_MTRAN: &str = "a motion sequence needs a robot of modules of kind \"mtran\"";

/// Number of segments of a program if a job gives none, L of the paper's section 4.
pub const SEGMENTS: u32 = 10;

impl Component for Sequence {
    fn name(&self) -> &'static str {
        "sequence"
    }
}

impl Controller for Sequence {
    fn parameters(&self) -> &'static [Parameter] {
        &[]
    }

    fn fits(&self, robot: &Robot) -> Result<(), Invalid> {
        servos(robot).map(|_| ())
    }

    fn space(&self, robot: &Robot) -> Space {
        let genes = Genes::of(robot.modules.len()).named();
        Space { genes, length: Length::Sequence { least: 1, most: MAX_GAIT_SEGMENTS } }
    }

    fn segments(&self) -> Option<(u32, u32)> {
        Some((SEGMENTS, SEGMENTS))
    }

    fn rules(&self, robot: &Robot, overlap: Option<f64>) -> Result<Arc<dyn Rules>, Invalid> {
        let refused = |reason: String| Invalid::Conflict { field: "robot.module".into(), reason };
        let configuration = Configuration::of_robot(robot).ok_or_else(|| refused(NO_MTRAN.to_owned()))?;
        let configuration = configuration.map_err(|error| refused(error.to_string()))?;
        Ok(Arc::new(Feasible::new(configuration, overlap)))
    }

    /// Computes the signals. The state is the number of ticks since the start, eight bytes.
    fn signals(&self, robot: &Robot, gait: &[f64], from: Option<&[u8]>, ticks: usize) -> Result<Signals, Infeasible> {
        let number = |bytes: &[u8]| bytes.try_into().map(u64::from_le_bytes).map_err(|_| phase::unfit());
        let first = from.map(number).transpose()?.unwrap_or(0);
        let program = Genes::of(robot.modules.len()).program(gait);
        let rows = rows(&program, robot, first as usize, ticks).map_err(|invalid| Infeasible(invalid.to_string()))?;
        let joints = (0..robot.hinges.len()).map(|joint| rows.iter().map(|row| row[joint]).collect()).collect();
        Ok(Signals { joints, end: (first + ticks as u64 - 1).to_le_bytes().to_vec() })
    }
}

/// Returns the joint targets of a program at `ticks` ticks from the tick `first`, rad.
fn rows(program: &Program, robot: &Robot, first: usize, ticks: usize) -> Result<Vec<Vec<f64>>, Invalid> {
    let servos = servos(robot)?;
    let speeds: Vec<f64> = servos.iter().map(|servo| servo.speed).collect();
    let mut table = Timetable::new(program.segments().collect(), &speeds);
    let mut rows = Vec::with_capacity(ticks);
    for tick in 0..first + ticks {
        if tick > 0 {
            table.advance();
        }
        if tick >= first {
            let mut row = vec![0.0; robot.hinges.len()];
            for (servo, target) in servos.iter().zip(table.targets()) {
                if let Some(joint) = servo.joint {
                    row[joint] = *target;
                }
            }
            rows.push(row);
        }
    }
    Ok(rows)
}

/// Returns the joint targets of a program that is repeated until `duration`, s: rows of a time, s, and one target per
/// joint, rad, linear in between. There is a row wherever a servo starts or stops.
///
/// # Errors
/// If the robot does not consist of M-TRAN modules.
pub fn target_rows(program: &Program, robot: &Robot, duration: f64) -> Result<Vec<Vec<f64>>, Invalid> {
    let all = rows(program, robot, 0, Targets::ticks(duration))?;
    let bends = |tick: usize| {
        let around = all[tick - 1].iter().zip(&all[tick]).zip(&all[tick + 1]);
        around.into_iter().any(|((before, at), after)| (after - 2.0 * at + before).abs() > 1e-6)
    };
    let last = all.len() - 1;
    let kept = (0..=last).filter(|&tick| tick == 0 || tick == last || bends(tick));
    Ok(kept.map(|tick| [&[(tick as f64 * TICK).min(duration)], all[tick].as_slice()].concat()).collect())
}

/// Servo of a module.
struct Servo {
    /// Index of its joint; `None` if it is stuck.
    joint: Option<usize>,
    /// Greatest speed, rad/s.
    speed: f64,
}

/// Returns the servos of a robot, module by module.
///
/// # Errors
/// If a module does not have two hinges with speeds, or the robot consists of bodies.
fn servos(robot: &Robot) -> Result<Vec<Servo>, Invalid> {
    let refused = |what: String| {
        let reason = format!(
            "a motion sequence turns the two servos of M-TRAN modules, and {what}: choose a robot of modules of kind \
             \"mtran\", or another controller"
        );
        Err(Invalid::Conflict { field: "gaits.controller".into(), reason })
    };
    if robot.modules.is_empty() {
        return refused("this robot consists of bodies".to_owned());
    }
    let mut servos = Vec::new();
    for Module { name, kind, joints } in &robot.modules {
        let [Some(first), Some(second)] = [0, 1].map(|hinge| kind.hinges.get(hinge).and_then(|hinge| hinge.speed))
        else {
            return refused(format!("module \"{name}\" is of kind \"{}\"", kind.name));
        };
        let speeds = [first, second].map(f64::from);
        servos.extend(joints.iter().zip(speeds).map(|(&joint, speed)| Servo { joint, speed }));
    }
    Ok(servos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Run;
    use crate::model::catalogue;

    fn three() -> Robot {
        let entry = catalogue::find(catalogue::robots(), "mtran-three").unwrap();
        Robot::compile(&toml::from_str(entry.toml).unwrap()).unwrap()
    }

    fn genotype(robot: &Robot, text: &str) -> Vec<f64> {
        let genes = Genes::of(robot.modules.len());
        let program = parse(text).unwrap();
        program.segments().flat_map(|segment| genes.of_segment(segment).unwrap()).collect()
    }

    #[test]
    fn genes_hold_programs_without_loops() {
        let robot = three();
        let text = "{ m [1 1] 0, -90 c [1 1] 0 }\n{ m [0 0] 30, 60 m [2 1] -30, 90 }\n{ }";
        let genes = Genes::of(3);
        let numbers = genotype(&robot, text);
        assert_eq!(numbers.len(), 3 * genes.count());
        assert_eq!(genes.program(&numbers).to_string(), text);
        let named = genes.named();
        for (i, number) in numbers.iter().enumerate() {
            let (low, high) = named[i % named.len()].gene.bounds();
            assert!((low..=high).contains(number), "{}", named[i % named.len()].name);
        }
    }

    /// A motion in two parts is the motion in one.
    #[test]
    fn program_continues_where_it_ended() {
        let robot = three();
        let gait = genotype(&robot, "{ m [1 1] 0, -90 } { m [0 0] 30, 60 m [2 1] -30, 90 } { m [1 1] 60, 0 }");
        let rows = |motion: &crate::physics::Motion| motion.targets().rows().map(<[f32]>::to_vec).collect::<Vec<_>>();
        let whole = Sequence.compile(&Run::new(&robot, 20.0), &gait).unwrap();
        let first = Sequence.compile(&Run::new(&robot, 7.5), &gait).unwrap();
        let from = Some(first.end_phase());
        let second = Sequence.compile(&Run { from, ..Run::new(&robot, 12.5) }, &gait).unwrap();
        let mut joined = rows(&first);
        joined.extend(rows(&second).into_iter().skip(1));
        assert_eq!(joined, rows(&whole));
        assert_eq!(second.end_phase(), whole.end_phase());
    }

    #[test]
    fn robots_without_two_servos_a_module_are_refused() {
        let refused = Sequence.fits(&crate::control::test_robot()).unwrap_err().to_string();
        assert_eq!(
            refused,
            "gaits.controller: a motion sequence turns the two servos of M-TRAN modules, and module \"body\" is of \
             kind \"block\": choose a robot of modules of kind \"mtran\", or another controller"
        );
    }
}
