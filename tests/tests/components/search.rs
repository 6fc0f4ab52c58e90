//! Search added by another program. Its settings are read, checked and written like those of shipped searches.

use sim_core::base::registry::{Component, Registered};
use sim_core::base::score::Direction;
use sim_core::base::settings::{Configurable, Setting, Settings};
use sim_core::genotype::{Rules, Space};
use sim_core::problem::Checked;
use sim_core::search::{Ask, GENERATIONS, OptimiserSpec, Pso, Search, SearchKind};
use std::sync::Arc;

/// Search for single motions, with a setting of its own.
struct Repertoire;

const CELLS: Setting = Setting::whole("cells", 100).within(1.0, 1000.0);

impl Component for Repertoire {
    fn name(&self) -> &'static str {
        "repertoire"
    }
}

impl Configurable for Repertoire {
    fn settings(&self) -> &'static [Setting] {
        &[CELLS, GENERATIONS]
    }
}

impl SearchKind for Repertoire {
    fn asks(&self) -> Ask {
        Ask::Motion
    }

    fn population(&self, settings: &Settings) -> u32 {
        settings.whole(&CELLS)
    }

    fn build(
        &self,
        _: &Settings,
        space: Space,
        rules: Arc<dyn Rules>,
        direction: Direction,
        seed: u64,
    ) -> Box<dyn Search> {
        Pso.build(&Settings::defaults(Pso.settings()), space, rules, direction, seed)
    }
}

fn add() {
    // Any of the tests may run first or alone, so each adds the search.
    let _ = <dyn SearchKind>::registry().add(&Repertoire);
}

fn job(optimiser: &str) -> Result<Checked, String> {
    let text = format!(
        "name = 'a'\nrobot = 'lizard'\nenvironment = 'empty'\ngaits = {{ count = 2 }}\nfitness = {{ kind = 'coverage' }}\n\
         optimiser = {{ {optimiser} }}"
    );
    Checked::from_toml(&text).map_err(|e| e.to_string())
}

#[test]
fn job_with_search_for_single_motions_is_refused() {
    add();
    let said = job("kind = 'repertoire'").unwrap_err();
    assert!(said.contains("optimiser.kind: \"repertoire\" needs evaluations of single motions"), "{said}");
    assert!(job("kind = 'pso'").is_ok());
}

#[test]
fn settings_of_added_search_are_read_and_written() {
    add();
    let spec: OptimiserSpec = toml::from_str("kind = 'repertoire'\ncells = 7").unwrap();
    assert_eq!((spec.population(), spec.generations()), (7, 150));
    assert_eq!(toml::to_string(&spec).unwrap(), "kind = \"repertoire\"\ncells = 7\ngenerations = 150\n");
    let stray = toml::from_str::<OptimiserSpec>("kind = 'pso'\ncells = 7").unwrap_err().to_string();
    assert!(stray.contains("`cells` is no setting of kind = \"pso\", which has `generations`, `particles`"), "{stray}");
    let said = job("kind = 'repertoire', cells = 0").unwrap_err();
    assert!(said.contains("optimiser.cells = 0 is out of range: allowed is 1 to 1000"), "{said}");
}
