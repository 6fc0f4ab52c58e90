//! Motion planning with gaits: trees of configurations, grown by running a candidate's gaits.

mod grow;
mod metric;
mod nearest;
mod rrt_mp;
mod settings;
mod swept;
mod transitions;
mod tree;

pub(crate) use grow::standing_at;
pub use grow::{Growth, Setting};
pub use metric::Metric;
pub use nearest::Nearest;
pub use rrt_mp::{Ask, Planner, RrtMp};
pub(crate) use settings::validate_planner;
pub use settings::{Algorithm, PlannerSpec};
pub use swept::{Extent, leaves_map, on_terrain, touches};
pub use transitions::{Reuse, StartId, Transition, TransitionKey, Transitions};
pub use tree::{Node, Tree};
