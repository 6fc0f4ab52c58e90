//! Reader of TOML files that lists all misspelt keys at once.

use crate::base::error::{Invalid, nearest};
use crate::base::limits::MAX_FAULTS;
use serde::de::DeserializeOwned;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer, Error};

/// Reads a value from TOML.
///
/// # Errors
/// If the text is not TOML, has unknown keys (all are listed), lacks a key, or holds a value of the wrong type. The
/// error gives line and column.
pub fn read<T: DeserializeOwned>(text: &str) -> Result<T, Invalid> {
    let mut error = match toml::from_str(text) {
        Ok(value) => return Ok(value),
        Err(error) => error,
    };
    let Ok(mut table) = DeTable::parse(text) else { return Err(error.into()) };
    let place = |error: &Error| error.span().map_or(0, |span| span.start);
    let mut faults = vec![(place(&error), Invalid::from(error.clone()))];
    // Each pass corrects or removes one unknown key, so that the parser reports the next one. Other faults are not
    // collected, because they may be consequences of the correction.
    for _ in 1..MAX_FAULTS {
        let Some(key) = unknown_key(&error) else { break };
        mend(table.get_mut(), &key, &expected(&error));
        match T::deserialize(Deserializer::from(table.clone())) {
            Err(mut next) if unknown_key(&next).is_some_and(|found| found != key) => {
                next.set_input(Some(text));
                faults.push((place(&next), next.clone().into()));
                error = next;
            }
            _ => break,
        }
    }
    faults.sort_by_key(|(place, _)| *place);
    let all = Invalid::all(faults.into_iter().map(|(_, fault)| fault).collect());
    all.and(Err(error.into()))
}

/// Returns the place of the key in an error about an unknown key.
fn unknown_key(error: &Error) -> Option<Range<usize>> {
    error.span().filter(|_| error.message().starts_with("unknown field"))
}

/// Returns the allowed keys that an error lists.
fn expected(error: &Error) -> Vec<&str> {
    let (_, known) = error.message().split_once("expected").unwrap_or_default();
    known.split('`').skip(1).step_by(2).collect()
}

/// Renames the entry at this key to the most similar allowed key, or removes it.
fn mend(table: &mut DeTable, key: &Range<usize>, known: &[&str]) {
    if let Some(wrong) = table.keys().find(|found| found.span() == *key).cloned() {
        let value = table.remove(&wrong);
        let free: Vec<&str> = known.iter().copied().filter(|name| !table.contains_key(*name)).collect();
        if let (Some(value), Some(meant)) = (value, nearest(wrong.get_ref(), &free)) {
            table.insert(Spanned::new(key.clone(), meant.to_owned().into()), value);
        }
    }
    table.iter_mut().for_each(|(_, value)| mend_within(value, key, known));
}

fn mend_within(value: &mut Spanned<DeValue>, key: &Range<usize>, known: &[&str]) {
    match value.get_mut() {
        DeValue::Table(table) => mend(table, key, known),
        DeValue::Array(array) => array.iter_mut().for_each(|value| mend_within(value, key, known)),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::JobSpec;

    const JOB: &str = r#"
name = "a"
robot = "lizard"
environment = "empty"
gaits = { count = 2 }
[fitness]
kind = "coverage"
[optimiser]
kind = "pso"
"#;

    #[test]
    fn all_unknown_keys_are_listed_with_their_lines() {
        read::<JobSpec>(JOB).unwrap();
        let text = JOB
            .replace("count = 2", "cuont = 2, duraton = 1.0")
            .replace("[fitness]", "sed = 3\n[fitness]\ncel = 1.0")
            .replace("[optimiser]", "[planer]\niterations = 3\n[optimiser]\nparticle = 3");
        let said = read::<JobSpec>(&text).unwrap_err().to_string();
        assert!(said.starts_with("6 faults\n"), "{said}");
        for (line, key) in [(5, "cuont"), (5, "duraton"), (6, "sed"), (8, "cel"), (10, "planer"), (13, "particle")] {
            assert!(
                said.contains(&format!("line {line}, ")) && said.contains(&format!("unknown field `{key}`")),
                "{said}"
            );
        }
    }

    #[test]
    fn misspelt_key_causes_no_further_fault() {
        let said = read::<JobSpec>(&JOB.replace("name =", "nam =")).unwrap_err().to_string();
        assert!(
            said.contains("unknown field `nam`") && !said.contains("missing") && !said.contains("faults"),
            "{said}"
        );
        let said = read::<JobSpec>(&JOB.replace("count = 2", "count = \"two\"")).unwrap_err().to_string();
        assert!(said.contains("line 5") && !said.contains("faults"), "{said}");
        assert!(read::<JobSpec>("name = ").unwrap_err().to_string().contains("line 1"));
    }

    #[test]
    fn search_for_faults_stops_at_listed_maximum() {
        let many: String = (0..30).map(|i| format!("unknown{i} = {i}\n")).collect();
        let said = read::<JobSpec>(&(many + JOB)).unwrap_err().to_string();
        assert!(said.starts_with("10 faults\n"), "{said}");
    }
}
