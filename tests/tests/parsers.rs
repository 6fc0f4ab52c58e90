//! Runs every parser on its seed inputs, on recorded inputs that once made it fail, and on changed seeds.

use cluster_tests::parsers::{PARSERS, seeds};
use std::fs;
use std::path::{Path, PathBuf};

fn files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else {
        return Vec::new();
    };
    let mut files: Vec<_> = entries.map(|entry| entry.expect("the folder can be read").path()).collect();
    files.sort();
    files
}

#[test]
fn recorded_inputs_crash_no_parser() {
    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/regressions");
    for folder in files(&fuzz) {
        let name = folder.file_name().and_then(|n| n.to_str()).expect("a folder is named after a parser").to_owned();
        let (_, parser) =
            PARSERS.iter().find(|(n, _)| *n == name).unwrap_or_else(|| panic!("there is no parser named {name}"));
        for file in files(&folder) {
            println!("{}", file.display());
            parser(&fs::read(&file).expect("a recorded input can be read"));
        }
    }
}

#[test]
fn each_parser_has_seeds_that_do_not_crash_it() {
    for (name, parser) in PARSERS {
        let seeds = seeds(name);
        assert!(!seeds.is_empty(), "{name} must have seeds");
        for seed in seeds {
            parser(&seed);
        }
    }
}

#[test]
fn empty_truncated_or_binary_input_crashes_no_parser() {
    let shipped =
        concat!(include_str!("../../scenarios/jobs/quadropod-quick.toml"), "\n", "[planner]\niterations = 1e400");
    for (_, parser) in PARSERS {
        for cut in [0, 1, 50, 200, shipped.len()] {
            parser(&shipped.as_bytes()[..cut]);
        }
        parser(&[0xff; 64]);
        parser(&[0x0a, 0xff, 0xff, 0xff, 0xff, 0x0f]);
    }
}

/// Random numbers with a fixed seed, so that the inputs are the same each time.
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) % n.max(1) as u64) as usize
    }
}

/// Unusual values that replace parts of an input.
const ODD: [&[u8]; 14] = [
    b"",
    b"0",
    b"-1",
    b"1e400",
    b"nan",
    b"inf",
    b"4294967296",
    b"18446744073709551615",
    b"[[",
    b"\"",
    b"\n",
    b"\0",
    b"\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01",
    b"\xf0\x9f\xa6\x8e",
];

/// Returns a seed with one to four changes.
fn made_up(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut input = seeds[random.below(seeds.len())].clone();
    for _ in 0..=random.below(4) {
        let at = random.below(input.len());
        let end = (at + random.below(12)).min(input.len());
        match random.below(6) {
            0 if !input.is_empty() => input[at] ^= 1 << random.below(8),
            1 if !input.is_empty() => input[at] = random.below(256) as u8,
            2 => drop(input.drain(at..end)),
            3 => drop(input.splice(at..end, ODD[random.below(ODD.len())].iter().copied())),
            4 => {
                let other = &seeds[random.below(seeds.len())];
                let from = random.below(other.len());
                let part = other[from..(from + random.below(64)).min(other.len())].to_vec();
                drop(input.splice(at..at, part));
            }
            _ => input.truncate(at),
        }
    }
    input
}

/// A short version of the fuzzing in `tests/fuzz.sh`, without coverage guidance. `EVOGAIT_INPUTS` sets the number of
/// inputs.
#[test]
fn changed_seeds_crash_no_parser() {
    let more: Option<usize> = std::env::var("EVOGAIT_INPUTS").ok().and_then(|n| n.parse().ok());
    let only = std::env::var("EVOGAIT_PARSER").ok();
    for (name, parser) in PARSERS.iter().filter(|(name, _)| only.as_ref().is_none_or(|only| only == name)) {
        let (seeds, mut random) = (seeds(name), Random(1));
        // Nearly valid jobs are slow, because the parser settles the robot.
        let inputs = more.unwrap_or(if *name == "job" { 20 } else { 500 });
        for _ in 0..inputs {
            let input = made_up(&seeds, &mut random);
            let outcome = std::panic::catch_unwind(|| parser(&input));
            assert!(outcome.is_ok(), "{name} panics on {:?}", String::from_utf8_lossy(&input));
        }
        println!("{name}: {inputs} inputs");
    }
}
