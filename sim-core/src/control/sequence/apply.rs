//! Effect of a segment on a configuration.

use super::chain::{Chain, Opened};
use super::cuts::cut_connections;
use super::program::{Segment, Turn};
use super::{Reading, Refusal, Rule, Semantics};
use crate::model::mtran::{
    Configuration, Connection, FACES, Frame, MEET, PARTS, Port, components, describe_port, may_connect, ordered,
    part_of_link, penetration,
};
use std::collections::BTreeSet;

/// Speed of a servo, degrees/s: the paper's π/6 rad/s (Yoshida et al. 2003, section 4).
pub const SERVO_SPEED: i32 = 30;

/// Angle by which the fastest servo turns between two checks of a motion, degrees.
pub const ANGLE_STEP: i32 = 5;

/// Effect of a segment.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Connections that were cut at the beginning.
    pub cut: BTreeSet<Connection>,
    /// Connections that were made at the end.
    pub made: BTreeSet<Connection>,
    /// Time until the slowest servo arrives, s.
    pub duration: f64,
    /// Configuration at the end.
    pub after: Configuration,
}

impl Configuration {
    /// Returns the effect of a segment with the default [`Semantics`]; see [`Configuration::apply_with`].
    ///
    /// # Errors
    ///
    /// The segment breaks a [`Rule`].
    pub fn apply(&self, segment: &Segment) -> Result<Step, Refusal> {
        self.apply_with(segment, &Semantics::default())
    }

    /// Returns the effect of a segment (Yoshida et al. 2003, section 2.2 B).
    ///
    /// 1. Connections of moving parts are cut, as [`Reading`] says.
    /// 2. All servos turn at [`SERVO_SPEED`] until they arrive. The base part of the first turned module stays where it
    ///    is, and the modules connected to it move with it. The same holds in each further piece of a divided robot;
    ///    a piece without a turned module stays where it is. Ground and gravity have no effect.
    /// 3. Faces that the segment names connect to the faces that they meet, if both are free and may connect.
    ///
    /// Loops and collisions are checked at each [`ANGLE_STEP`] of the fastest servo. All pairs of parts of different
    /// modules are checked for collisions, except those that are connected to each other.
    ///
    /// # Errors
    ///
    /// The segment breaks a [`Rule`]. The first one in the order of [`Rule::ALL`] is reported, but loops and collisions
    /// in the order of time.
    pub fn apply_with(&self, segment: &Segment, semantics: &Semantics) -> Result<Step, Refusal> {
        refuse_unknown(self, segment)?;
        let cut = cut_connections(self, segment, semantics.reading);
        let kept: BTreeSet<Connection> = self.connections().difference(&cut).copied().collect();
        if semantics.connectivity {
            refuse_pieces(self, &kept, &cut)?;
        }
        if semantics.reading == Reading::FixedBase {
            refuse_free_bases(segment, &kept)?;
        }
        let mut angles = self.angles().to_vec();
        segment.turns.iter().for_each(|turn| angles[turn.module as usize] = turn.angles);
        let start: Vec<[i32; 2]> = self.angles().iter().map(|a| a.map(|angle| angle.degrees())).collect();
        let target: Vec<[i32; 2]> = angles.iter().map(|a| a.map(|angle| angle.degrees())).collect();
        let (links, degrees) = self.turn(segment, &kept, &start, &target, semantics.penetration)?;
        let moved = Configuration::of_parts(links, angles, kept);
        let made = new_connections(&moved, segment);
        let connections = moved.connections().union(&made).copied().collect();
        let after = Configuration::of_parts(moved.links().to_vec(), moved.angles().to_vec(), connections);
        Ok(Step { cut, made, duration: f64::from(degrees) / f64::from(SERVO_SPEED), after })
    }

    /// Returns the effects of the segments of a program, one after another.
    ///
    /// # Errors
    ///
    /// A segment breaks a [`Rule`]. The refusal holds its index, from 0.
    pub fn apply_all<'s>(
        &self,
        segments: impl IntoIterator<Item = &'s Segment>,
        semantics: &Semantics,
    ) -> Result<Vec<Step>, Refusal> {
        let mut steps: Vec<Step> = Vec::new();
        for (index, segment) in segments.into_iter().enumerate() {
            let from = steps.last().map_or(self, |step| &step.after);
            let step = from.apply_with(segment, semantics).map_err(|refusal| refusal.in_segment(index))?;
            steps.push(step);
        }
        Ok(steps)
    }

    /// Turns all servos from `start` to `target`, degrees. Returns the links at the end, and the greatest change of an
    /// angle in degrees.
    fn turn(
        &self,
        segment: &Segment,
        kept: &BTreeSet<Connection>,
        start: &[[i32; 2]],
        target: &[[i32; 2]],
        allowed: Option<f64>,
    ) -> Result<(Vec<Frame>, i32), Refusal> {
        let chain = Chain::new(self, kept, segment);
        let rigid: BTreeSet<[(u32, u8); 2]> =
            kept.iter().map(|(a, b)| [(a.module, a.part), (b.module, b.part)]).collect();
        let changes = start.iter().flatten().zip(target.iter().flatten()).map(|(a, b)| (b - a).abs());
        let greatest = changes.max().unwrap_or(0);
        let mut links = self.links().to_vec();
        let mut turned = 0;
        while turned < greatest {
            turned = (turned + ANGLE_STEP).min(greatest);
            let towards = |from: &[i32; 2], to: &[i32; 2]| {
                std::array::from_fn(|i| from[i] + (to[i] - from[i]).clamp(-turned, turned))
            };
            let degrees: Vec<[i32; 2]> = start.iter().zip(target).map(|(a, b)| towards(a, b)).collect();
            links = chain.links(&degrees).map_err(|opened| loop_refusal(&opened, turned))?;
            if let Some(allowed) = allowed {
                refuse_collision(&links, &degrees, &rigid, allowed, turned)?;
            }
        }
        Ok((links, greatest))
    }
}

/// Returns the time in which a servo turns by so many degrees, s.
fn seconds(degrees: i32) -> f64 {
    f64::from(degrees) / f64::from(SERVO_SPEED)
}

/// Returns the refusal of a motion that opens a kept connection.
fn loop_refusal(opened: &Opened, turned: i32) -> Refusal {
    let (a, b) = opened.connection;
    let reason = format!(
        "the modules form a loop, and {} and {} come apart by {:.2e} mu and {:.2e} rad {:.2} s after the start: \
         allowed is {MEET:e}. Turn the modules of the loop so that it stays closed, or cut one of its connections",
        describe_port(a),
        describe_port(b),
        opened.gap,
        opened.turn,
        seconds(turned),
    );
    Refusal::new(Rule::Loop, vec![a.module, b.module], reason)
}

/// Refuses modules, parts and faces that do not exist, and modules that are turned twice.
fn refuse_unknown(configuration: &Configuration, segment: &Segment) -> Result<(), Refusal> {
    let last = configuration.len() - 1;
    let modules = segment.turns.iter().map(|turn| turn.module).chain(segment.connections.iter().map(|c| c.module));
    if let Some(module) = modules.into_iter().find(|&module| module as usize > last) {
        return Err(Refusal::new(
            Rule::Module,
            vec![module],
            format!("module {module} does not exist: allowed are 0 to {last}"),
        ));
    }
    let wrong_face = |port: &&Port| port.part >= PARTS || port.face >= FACES;
    let form = |module, reason| Err(Refusal::new(Rule::Form, vec![module], reason));
    if let Some(turn) = segment.turns.iter().find(|turn| turn.base >= PARTS) {
        return form(turn.module, format!("module {} has base part {}: allowed are 0 and 1", turn.module, turn.base));
    }
    if let Some(&port) = segment.connections.iter().find(wrong_face) {
        let reason = format!("{} does not exist: allowed are parts 0 and 1, faces 0 to 2", describe_port(port));
        return form(port.module, reason);
    }
    let mut seen = BTreeSet::new();
    match segment.turns.iter().find(|turn: &&Turn| !seen.insert(turn.module)) {
        Some(turn) => form(turn.module, format!("module {} is turned twice: allowed is once a segment", turn.module)),
        None => Ok(()),
    }
}

/// Refuses cuts that divide the robot.
fn refuse_pieces(
    configuration: &Configuration,
    kept: &BTreeSet<Connection>,
    cut: &BTreeSet<Connection>,
) -> Result<(), Refusal> {
    let pieces = components(configuration.len(), kept);
    let apart: Vec<u32> = (0..).zip(&pieces).filter(|(_, piece)| **piece != 0).map(|(module, _)| module).collect();
    if apart.is_empty() {
        return Ok(());
    }
    let count = pieces.iter().collect::<BTreeSet<_>>().len();
    let list = |modules: &[u32]| modules.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
    let cuts: Vec<String> =
        cut.iter().map(|&(a, b)| format!("{} and {}", describe_port(a), describe_port(b))).collect();
    let reason = format!(
        "the robot is in {count} pieces, and modules {} are not connected to module 0: allowed is one piece. Cut: {}. \
         Name a face of a connection by `c` to keep it, or choose another base part",
        list(&apart),
        if cuts.is_empty() { "nothing".to_owned() } else { cuts.join("; ") },
    );
    Err(Refusal::new(Rule::Connectivity, apart, reason))
}

/// Refuses turns whose base part is not connected.
fn refuse_free_bases(segment: &Segment, kept: &BTreeSet<Connection>) -> Result<(), Refusal> {
    let connected = |turn: &Turn| {
        let on_base = |port: &Port| port.module == turn.module && port.part == turn.base;
        kept.iter().any(|(a, b)| on_base(a) || on_base(b))
    };
    match segment.turns.iter().find(|turn| !connected(turn)) {
        None => Ok(()),
        Some(Turn { module, base, .. }) => {
            let reason =
                format!("base part {base} of module {module} has 0 connections after the cuts: allowed are 1 to 3");
            Err(Refusal::new(Rule::Base, vec![*module], reason))
        }
    }
}

/// Refuses parts that overlap by more than `allowed`, mu, unless they are connected to each other.
fn refuse_collision(
    links: &[Frame],
    degrees: &[[i32; 2]],
    rigid: &BTreeSet<[(u32, u8); 2]>,
    allowed: f64,
    turned: i32,
) -> Result<(), Refusal> {
    let poses = (0_u32..).zip(links).zip(degrees);
    let parts: Vec<(u32, u8, Frame)> = poses
        .flat_map(|((m, link), angles)| (0..PARTS).map(move |p| (m, p, part_of_link(link, p, angles[usize::from(p)]))))
        .collect();
    for (i, (m, p, a)) in parts.iter().enumerate() {
        for (n, q, b) in &parts[i + 1..] {
            if m == n || rigid.contains(&[(*m, *p), (*n, *q)]) {
                continue;
            }
            if let Some(depth) = penetration((a, *p), (b, *q), allowed) {
                let reason = format!(
                    "module {m} part {p} and module {n} part {q} overlap by {depth:.3} mu {:.2} s after the start: \
                     allowed is {allowed} mu",
                    seconds(turned),
                );
                return Err(Refusal::new(Rule::Collision, vec![*m, *n], reason));
            }
        }
    }
    Ok(())
}

/// Returns the connections that the named faces make.
fn new_connections(configuration: &Configuration, segment: &Segment) -> BTreeSet<Connection> {
    let mut busy: BTreeSet<Port> = configuration.connections().iter().flat_map(|&(a, b)| [a, b]).collect();
    let mut made = BTreeSet::new();
    for &named in &segment.connections {
        if busy.contains(&named) {
            continue;
        }
        let face = configuration.face(named);
        let fits = |&other: &Port| {
            may_connect(named, other) && !busy.contains(&other) && face.meets(&configuration.face(other))
        };
        if let Some(other) = configuration.ports().find(fits) {
            busy.extend([named, other]);
            made.insert(ordered(named, other));
        }
    }
    made
}
