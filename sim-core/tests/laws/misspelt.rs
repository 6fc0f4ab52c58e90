//! Tests that a misspelt name is refused with its line: elements and attributes of MJCF and URDF, keys of TOML.

use sim_core::base::error::Invalid;
use sim_core::base::random::{Purpose, Stream};
use sim_core::base::toml_file;
use sim_core::exchange::{Format, read};
use sim_core::job::JobSpec;
use sim_core::model::environment::Environment;
use sim_core::model::{Robot, RobotSpec, catalogue};
use sim_core::physics::{Physics, Scale};
use std::collections::BTreeSet;

/// Number of misspelt names tried per format.
const EACH: usize = 100;
/// Elements that the import ignores with their whole content.
const WHOLE: [&str; 5] = ["light", "camera", "site", "visual", "custom"];

/// Positions of a name that must be changed together (start tag and end tag), and its length, in bytes.
struct Name {
    starts: Vec<usize>,
    length: usize,
}

/// A valid file, the function that reads it, and its names.
struct Good {
    text: String,
    read: fn(&str) -> Result<(), Invalid>,
    names: Vec<Name>,
}

impl Good {
    fn written(&self, name: &Name) -> &str {
        &self.text[name.starts[0]..name.starts[0] + name.length]
    }
}

fn xml(text: String) -> Good {
    let document = roxmltree::Document::parse(&text).unwrap();
    let mut names = Vec::new();
    for element in document.descendants().filter(|node| node.is_element()) {
        if element.ancestors().any(|node| WHOLE.contains(&node.tag_name().name())) {
            continue;
        }
        let (tag, range) = (element.tag_name().name(), element.range());
        let mut starts = vec![range.start + 1];
        let end = format!("</{tag}>");
        if text[range.clone()].ends_with(&end) {
            starts.push(range.end - end.len() + 2);
        }
        // Another root element is another format, so a misspelt root is left out.
        if element != document.root_element() {
            names.push(Name { starts, length: tag.len() });
        }
        names.extend(element.attributes().map(|a| Name { starts: vec![a.range().start], length: a.name().len() }));
    }
    drop(document);
    Good { text, read: |text| read(text).map(|_| ()), names }
}

/// Finds the names of a TOML file: keys before `=`, and tables. Names that a user chooses (variants) are left out.
fn toml_file(text: String, read: fn(&str) -> Result<(), Invalid>) -> Good {
    let mut names = Vec::new();
    let (mut at, mut inside_text, mut chosen) = (0, false, false);
    for line in text.split_inclusive('\n') {
        let quotes = line.matches("\"\"\"").count();
        if !inside_text {
            if line.starts_with('[') {
                chosen = line.contains("variants");
                let name = line.trim().trim_matches(|c| c == '[' || c == ']');
                let last = name.rsplit('.').next().unwrap();
                let start = at + line.find(name).unwrap() + name.len() - last.len();
                names.push(Name { starts: vec![start], length: last.len() });
            } else if !chosen {
                let code = line.split(" #").next().unwrap();
                for (equals, _) in code.match_indices(" = ") {
                    let key = code[..equals].rsplit([' ', '{', ',']).next().unwrap();
                    if !key.is_empty() && key.bytes().all(|b| b.is_ascii_lowercase() || b == b'_') {
                        names.push(Name { starts: vec![at + equals - key.len()], length: key.len() });
                    }
                }
            }
        }
        inside_text ^= quotes % 2 == 1;
        at += line.len();
    }
    Good { text, read, names }
}

/// Doubles, removes or replaces a letter, or exchanges two neighbours.
fn misspell(name: &str, stream: &mut Stream) -> String {
    let mut letters: Vec<char> = name.chars().collect();
    let at = pick(stream, letters.len());
    match pick(stream, 4) {
        0 => letters.insert(at, letters[at]),
        1 if letters.len() > 2 => drop(letters.remove(at)),
        2 if at + 1 < letters.len() => letters.swap(at, at + 1),
        _ => letters[at] = if letters[at] == 'q' { 'x' } else { 'q' },
    }
    letters.into_iter().collect()
}

fn pick(stream: &mut Stream, among: usize) -> usize {
    (stream.uniform(0.0, among as f64) as usize).min(among - 1)
}

/// Misspells one name at a time, [`EACH`] times, and asserts that every file is refused with the line of the name.
fn check(seed: u64, goods: &[Good]) {
    let mut stream = Stream::new(seed, Purpose::Sample, 0, 0, 0);
    let known: BTreeSet<&str> = goods.iter().flat_map(|g| g.names.iter().map(|n| g.written(n))).collect();
    for good in goods {
        (good.read)(&good.text).unwrap_or_else(|e| panic!("{e}\n{}", good.text));
    }
    let mut tried = 0;
    while tried < EACH {
        let good = &goods[pick(&mut stream, goods.len())];
        let place = &good.names[pick(&mut stream, good.names.len())];
        let name = good.written(place);
        let wrong = misspell(name, &mut stream);
        // A misspelling that is another name of the format can't be detected.
        if known.contains(wrong.as_str()) || wrong.as_str() == name || wrong == "kd" {
            continue;
        }
        let mut text = good.text.clone();
        for start in place.starts.iter().rev() {
            text.replace_range(*start..start + place.length, &wrong);
        }
        let line = good.text[..place.starts[0]].matches('\n').count() + 1;
        let said = match (good.read)(&text) {
            Ok(()) => panic!("line {line}: {name} written as {wrong} is accepted:\n{text}"),
            Err(invalid) => invalid.to_string(),
        };
        let told = [format!("line {line}, "), format!("line {line}\n"), format!("line {line}:")];
        assert!(told.iter().any(|told| said.contains(told)), "{name} as {wrong} in line {line}: {said}");
        tried += 1;
    }
}

/// Robots that can be read back from MJCF and URDF.
fn robots() -> Vec<Robot> {
    let spec = |toml: &str| toml::from_str::<RobotSpec>(toml).unwrap();
    let robots = catalogue::robots().iter().map(|entry| Robot::compile(&spec(entry.toml)).unwrap());
    robots.filter(|robot| robot.bodies.iter().all(|body| body.prisms.is_empty())).collect()
}

#[test]
fn misspelt_names_in_mjcf_are_refused_with_their_line() {
    let physics = Physics::of_scale(Scale::Paper);
    let mut goods: Vec<Good> = robots().iter().map(|robot| xml(Format::Mjcf.write(robot, &physics).unwrap())).collect();
    goods.extend((0..3).map(|_| xml(include_str!("oracle.xml").to_owned())));
    check(1, &goods);
}

#[test]
fn misspelt_names_in_urdf_are_refused_with_their_line() {
    let physics = Physics::of_scale(Scale::Paper);
    let goods: Vec<Good> = robots().iter().map(|robot| xml(Format::Urdf.write(robot, &physics).unwrap())).collect();
    check(2, &goods);
}

#[test]
fn misspelt_keys_in_toml_are_refused_with_their_line() {
    let robot = |text: &str| toml_file::read::<RobotSpec>(text).map(|_| ());
    let job = |text: &str| toml_file::read::<JobSpec>(text).map(|_| ());
    let environment = |text: &str| Environment::from_toml(text).map(|_| ());
    let of = |entries: &'static [catalogue::Entry], read: fn(&str) -> Result<(), Invalid>| {
        entries.iter().map(move |entry| toml_file(entry.toml.to_owned(), read))
    };
    let mut goods: Vec<Good> = of(catalogue::robots(), robot).collect();
    goods.extend(of(catalogue::environments(), environment));
    goods.extend(of(catalogue::jobs(), job));
    let bodies = read(include_str!("oracle.xml")).unwrap().robot;
    goods.push(toml_file(toml::to_string(&bodies).unwrap(), robot));
    check(3, &goods);
}
