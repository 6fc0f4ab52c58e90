//! Prints the number of random robots that do not come to rest, and their greatest speed. Each row is for one scale,
//! kind of robot and setting.
//!
//! `cargo run --release -p study --example settling [ROBOTS]`; the default is 25 robots of each kind.

use sim_core::base::random::{Purpose, Stream};
use sim_core::engines::engine;
use sim_core::model::Robot;
use sim_core::physics::{EngineKind, JointKind, Physics, Scale, Unsettled, settle};
use study::soundness::{random_arms, random_robot};

const SETTINGS: [(EngineKind, JointKind, u32, u32); 8] = [
    (EngineKind::Rapier, JointKind::Impulse, 30, 8),
    (EngineKind::Rapier, JointKind::Impulse, 60, 16),
    (EngineKind::Rapier, JointKind::Impulse, 240, 16),
    (EngineKind::Rapier, JointKind::Impulse, 960, 4),
    (EngineKind::Rapier, JointKind::Multibody, 30, 8),
    (EngineKind::Rapier, JointKind::Multibody, 240, 4),
    (EngineKind::Lockstep, JointKind::Impulse, 200, 2),
    (EngineKind::Lockstep, JointKind::Impulse, 600, 2),
];

/// Function that draws a random robot.
type Draw = fn(&mut Stream) -> Robot;

fn main() {
    let robots = std::env::args().nth(1).map_or(25, |n| n.parse().expect("ROBOTS must be a whole number"));
    let kinds: [(&str, Draw); 3] = [
        ("modules", random_robot),
        ("boxes", |stream| random_arms(stream, false)),
        ("capsules", |stream| random_arms(stream, true)),
    ];
    println!("scale  robots    setting              moving  fastest, mu/s");
    for (scale, scale_name) in [(Scale::Paper, "paper"), (Scale::Real, "real")] {
        for (kind, draw) in kinds {
            let drawn: Vec<Robot> = (0..robots).map(|i| draw(&mut Stream::new(7, Purpose::Sample, i, 0, 0))).collect();
            for (on, joints, steps_per_second, substeps) in SETTINGS {
                if on == EngineKind::Lockstep && kind == "capsules" {
                    continue;
                }
                let physics = Physics { steps_per_second, substeps, joints, ..Physics::of_scale(scale) };
                let speeds: Vec<f32> = drawn
                    .iter()
                    .filter_map(|robot| match settle(engine(on), robot, &physics) {
                        Ok(_) => None,
                        Err(Unsettled::Moving { speed, .. }) => Some(speed),
                        Err(Unsettled::Unstable(_) | Unsettled::Stopped) => Some(f32::INFINITY),
                    })
                    .collect();
                let joints = if joints == JointKind::Multibody { ", multibody" } else { "" };
                let setting = format!("{steps_per_second}x{substeps} {on}{joints}");
                let fastest = speeds.iter().copied().fold(0.0, f32::max);
                println!("{scale_name:<6} {kind:<9} {setting:<24} {:>2} of {robots}  {fastest:.2}", speeds.len());
            }
        }
    }
}
