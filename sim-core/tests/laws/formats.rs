//! Comparison of docs/formats.md with the code: every key, and the defaults.

use sim_core::base::registry::Registered;
use sim_core::objective::ObjectiveKind;
use sim_core::problem::Checked;
use sim_core::search::SearchKind;

const PAGE: &str = include_str!("../../../docs/formats.md");

/// TOML blocks of the page.
fn blocks() -> Vec<&'static str> {
    PAGE.split("```toml\n").skip(1).map(|rest| rest.split("```").next().unwrap()).collect()
}

/// A block as a job file, with a gait set in place of the path to one.
fn file(block: &str) -> String {
    let evolving = "name = \"a\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\ngaits = { count = 3 }\n\
                    fitness = { kind = \"coverage\" }\noptimiser = { kind = \"pso\" }";
    let evolving = Checked::from_toml(evolving).unwrap();
    let genotype = &evolving.optimiser().ask().genotypes[0];
    let gaits: Vec<String> = genotype.gaits(3).map(|gait| format!("{gait:?}")).collect();
    let joints = evolving.robot().joint_names();
    let set = format!("gaits = {{ joints = {joints:?}, genome = [{}] }}", gaits.join(", "));
    let line = |line: &str| if line.starts_with("gaits = \"runs/") { set.clone() } else { line.to_owned() };
    block.lines().map(line).collect::<Vec<_>>().join("\n")
}

/// Returns true if a line sets a key.
fn is_setting(line: &str) -> bool {
    line.contains(" = ") && !line.starts_with('#')
}

#[test]
fn documented_keys_have_their_default_values() {
    let [evolve, plan, _, simulate, replan, _] = blocks()[..] else { panic!("{} blocks of TOML", blocks().len()) };
    // A motion that is replanned has only one way.
    let ways = simulate.lines().find(|line| line.starts_with("ways")).unwrap();
    let replanned = simulate.replace(ways, "") + replan;
    for block in [evolve, plan, simulate, &replanned] {
        let digest = |text: &str| Checked::from_toml(text).unwrap_or_else(|e| panic!("{e}\n{text}")).digest();
        let whole = file(block);
        let expected = digest(&whole);
        let (mut tried, mut needed) = (0, 0);
        for (i, line) in block.lines().enumerate().filter(|(_, line)| is_setting(line)) {
            let without: Vec<&str> = whole.lines().enumerate().filter(|(j, _)| *j != i).map(|(_, line)| line).collect();
            let without = without.join("\n");
            if line.contains("# needed") {
                let key = line.split(" = ").next().unwrap();
                // With [simulate.replan] the first plan may be left out, because it is made, too.
                let spared = key == "procedure" || key == "steps" && block.contains("[simulate.replan]");
                assert!(spared || Checked::from_toml(&without).is_err(), "{line}");
                needed += 1;
            } else {
                assert_eq!(digest(&without), expected, "the value of this line is not the default: {line}");
                tried += 1;
            }
        }
        assert!(tried > 8 && needed > 4, "{tried} defaults, {needed} needed");
    }
}

#[test]
fn page_documents_every_key() {
    let evolve = file(blocks()[0]);
    let plan = file(blocks()[1]);
    let simulate = file(blocks()[3]);
    let replan = format!("{simulate}\n{}", blocks()[4]);
    let mut keys: Vec<String> = Vec::new();
    for (text, table) in [
        (&evolve, ""),
        (&evolve, "[gaits]"),
        (&evolve, "[planner]"),
        (&evolve, "[physics]"),
        (&evolve, "[finish]"),
        (&plan, "[plan]"),
        (&simulate, "[simulate]"),
        (&simulate, "[simulate.vary]"),
        (&replan, "[simulate.replan]"),
    ] {
        // The error about an unknown key lists the known keys.
        let wrong = match table {
            "" => format!("qqqqqqqq = 1\n{text}"),
            table => text.replace(&format!("{table}\n"), &format!("{table}\nqqqqqqqq = 1\n")),
        };
        let said = Checked::from_toml(&wrong).unwrap_err().to_string();
        let known = said.split_once("expected").unwrap_or_else(|| panic!("{table}: {said}")).1;
        let known = known.lines().next().unwrap_or_default();
        keys.extend(known.split('`').skip(1).step_by(2).map(str::to_owned));
    }
    for kind in <dyn ObjectiveKind>::registry().all() {
        keys.push(format!("\"{}\"", kind.name()));
        keys.extend(kind.settings().iter().map(|setting| setting.name.to_owned()));
    }
    for kind in <dyn SearchKind>::registry().all() {
        keys.push(format!("\"{}\"", kind.name()));
        keys.extend(kind.settings().iter().map(|setting| setting.name.to_owned()));
    }
    assert!(keys.len() > 40, "{keys:?}");
    let code: String = blocks().concat();
    for key in keys.iter().filter(|key| *key != "particles") {
        let tables = ["gaits", "planner", "fitness", "optimiser", "plan", "simulate", "physics", "finish"];
        let stands = code.contains(&format!("{key} = "))
            || key.starts_with('"') && code.contains(key.as_str())
            || tables.contains(&key.as_str()) && code.contains(&format!("[{key}]"))
            || code.contains(&format!("[simulate.{key}]"));
        assert!(stands, "docs/formats.md lacks {key}");
    }
}
