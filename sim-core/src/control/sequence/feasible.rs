//! Static feasibility of programs that keep the connections of their robot, for searches (Yoshida et al. 2003, section
//! 3.2 B: connectivity, and collision between modules).

use super::program::{Segment, Turn};
use super::{Genes, MAX_CONNECTIONS, MAX_TURNS, Refusal, Rule, Semantics};
use crate::base::random::Stream;
use crate::genotype::{Genotype, Rules, Space};
use crate::model::mtran::{Angle, Configuration, PENETRATION, Port};

/// Greatest number of draws for one segment. About one in three is feasible on three modules.
const MAX_DRAWS: u32 = 10_000;

/// Rules for programs on one robot: no segment cuts a connection, and modules do not collide, neither the first time
/// nor when the program begins again.
///
/// The connections that a segment cuts do not depend on the segments before it, so crossover keeps the first rule.
#[derive(Clone, Debug)]
pub struct Feasible {
    configuration: Configuration,
    genes: Genes,
    /// Allowed overlap of modules, mu; `None`: any.
    overlap: Option<f64>,
}

impl Feasible {
    /// Creates the rules for a configuration. `overlap` is the allowed overlap of modules, mu, by default
    /// [`PENETRATION`]; 1 or more allows any.
    pub fn new(configuration: Configuration, overlap: Option<f64>) -> Self {
        let genes = Genes::of(configuration.len());
        let overlap = Some(overlap.unwrap_or(PENETRATION)).filter(|overlap| *overlap < 1.0);
        Self { configuration, genes, overlap }
    }

    /// Returns a random segment that cuts no connection: 1 to [`MAX_TURNS`] turns of different modules and 0 to
    /// [`MAX_CONNECTIONS`] connections, everything drawn uniformly. It is empty if none is found.
    fn segment(&self, random: &mut Stream) -> Segment {
        for _ in 0..MAX_DRAWS {
            let segment = self.any_segment(random);
            if self.keeps_connections(&segment) {
                return segment;
            }
        }
        Segment::default()
    }

    fn any_segment(&self, random: &mut Stream) -> Segment {
        let modules = self.configuration.len() as u32;
        let mut left: Vec<u32> = (0..modules).collect();
        let turns = 1 + random.below(modules.min(MAX_TURNS as u32));
        let mut segment = Segment::default();
        for _ in 0..turns {
            let module = left.swap_remove(random.below(left.len() as u32) as usize);
            let base = random.below(2) as u8;
            let mut angle = || {
                let step = random.below(2 * Angle::MOST as u32 + 1) as i8 - Angle::MOST;
                Angle::of_steps(step).unwrap_or_default()
            };
            segment.turns.push(Turn { module, base, angles: [angle(), angle()] });
        }
        for _ in 0..random.below(MAX_CONNECTIONS as u32 + 1) {
            let (module, part) = (random.below(modules), random.below(2) as u8);
            let port = Port { module, part, face: random.below(3) as u8 };
            if !segment.connections.contains(&port) {
                segment.connections.push(port);
            }
        }
        segment
    }

    fn keeps_connections(&self, segment: &Segment) -> bool {
        let semantics = Semantics { penetration: None, ..Semantics::default() };
        self.configuration.apply_with(segment, &semantics).is_ok_and(|step| step.cut.is_empty() && step.made.is_empty())
    }

    /// Checks a program: each segment, and its first two repeats.
    ///
    /// # Errors
    /// The first refusal, with the index of its segment.
    pub fn check(&self, genotype: &Genotype) -> Result<(), Refusal> {
        let program = self.genes.program(genotype.numbers());
        let semantics = Semantics { penetration: self.overlap, ..Semantics::default() };
        let mut configuration = self.configuration.clone();
        for _ in 0..2 {
            for (index, segment) in program.segments().enumerate() {
                let step =
                    configuration.apply_with(segment, &semantics).map_err(|refusal| refusal.in_segment(index))?;
                if !(step.cut.is_empty() && step.made.is_empty()) {
                    let reason = "it cuts or makes a connection, and connections stay as they are here".to_owned();
                    return Err(Refusal::new(Rule::Connectivity, Vec::new(), reason).in_segment(index));
                }
                configuration = step.after;
            }
            if self.overlap.is_none() {
                break;
            }
        }
        Ok(())
    }
}

impl Rules for Feasible {
    fn draw(&self, _: &Space, random: &mut Stream) -> Vec<f64> {
        self.genes.of_segment(&self.segment(random)).unwrap_or_else(|| vec![0.0; self.genes.count()])
    }

    fn allows(&self, _: &Space, genotype: &Genotype) -> bool {
        self.check(genotype).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Purpose;
    use crate::control::sequence::{Program, parse};

    fn figure_2() -> Configuration {
        let text = "ID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (0, 0)\nID 1 p(-1,1,0) z(-1,0,0) y(0,1,0) (0, 0)\n\
                    ID 2 p(-1,-1,0) z(-1,0,0) y(0,-1,0) (0, 0)";
        Configuration::of_text(text).unwrap()
    }

    fn genotype(program: &Program) -> Genotype {
        program.segments().flat_map(|segment| Genes::of(3).of_segment(segment).unwrap()).collect()
    }

    #[test]
    fn drawn_segments_keep_all_connections() {
        let rules = Feasible::new(figure_2(), None);
        let space = Space { genes: Genes::of(3).named(), length: crate::genotype::Length::Fixed };
        let mut turns = [0; 4];
        for i in 0..300 {
            let genes = rules.draw(&space, &mut Stream::new(1, Purpose::Sample, i, 0, 0));
            let segment = Genes::of(3).segment(&genes);
            assert!(rules.keeps_connections(&segment), "{segment}");
            turns[segment.turns.len()] += 1;
            assert_eq!(space.check(&genes.into()), Ok(()));
        }
        assert!(turns[0] == 0 && turns[1..].iter().all(|&count| count > 20), "{turns:?}");
    }

    /// The first program is feasible once, and not from the angles at its end.
    #[test]
    fn program_must_be_feasible_when_it_begins_again() {
        let check = |text: &str, overlap| Feasible::new(figure_2(), overlap).check(&genotype(&parse(text).unwrap()));
        assert_eq!(check("{ m [1 0] 0, 60 } { m [1 0] 0, 0 }", None), Ok(()));
        let refused = check("{ m [1 0] 0, 60 } { m [0 0] 0, 90 }", None).unwrap_err();
        assert_eq!((refused.segment, refused.rule), (Some(1), Rule::Connectivity));
        // Module 1 stands up or hangs down with its outer part turned by 60°, and part 0 of module 0 turns to the same side
        // or to the other one.
        let sides = [90, -90].into_iter().flat_map(|one| [90, -90].map(|other| (one, other)));
        let programs = sides.map(|(one, other)| format!("{{ m [1 0] {one}, 60 }} {{ m [0 1] 0, {other} }}"));
        let rules: Vec<Option<Rule>> = programs
            .map(|text| {
                assert_eq!(check(&text, Some(1.0)), Ok(()), "{text}");
                check(&text, None).err().map(|refusal| refusal.rule)
            })
            .collect();
        assert_eq!(rules, [None, None, None, Some(Rule::Collision)]);
    }
}
