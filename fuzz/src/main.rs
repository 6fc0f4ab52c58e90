//! Fuzz target of all parsers. `EVOGAIT_PARSER` names the parser to fuzz. `EVOGAIT_SEEDS` names a folder into which
//! initial inputs are written.

#![no_main]

use cluster_tests::parsers::{PARSERS, Parser, seeds};
use std::sync::OnceLock;

static CHOSEN: OnceLock<Parser> = OnceLock::new();

libfuzzer_sys::fuzz_target!(
    init: {
        let name = std::env::var("EVOGAIT_PARSER").unwrap_or_default();
        let known: Vec<&str> = PARSERS.iter().map(|(name, _)| *name).collect();
        let found = PARSERS.iter().find(|(n, _)| *n == name);
        let (_, parser) = found.unwrap_or_else(|| panic!("EVOGAIT_PARSER must be one of {}", known.join(", ")));
        CHOSEN.get_or_init(|| *parser);
        if let Some(folder) = std::env::var_os("EVOGAIT_SEEDS") {
            for (i, seed) in seeds(&name).iter().enumerate() {
                let path = std::path::Path::new(&folder).join(format!("seed-{i}"));
                std::fs::write(path, seed).expect("the folder EVOGAIT_SEEDS must be writable");
            }
        }
    },
    |bytes: &[u8]| {
        if let Some(parser) = CHOSEN.get() {
            parser(bytes);
        }
    }
);
