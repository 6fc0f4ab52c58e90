//! Motion planning with gaits: trees of configurations, grown by running a candidate's gaits.

mod grow;
mod nearest;
mod place;
mod rrt_mp;
mod swept;
mod transitions;
mod tree;

pub(crate) use grow::standing_at;
pub use grow::{Growth, Setting};
pub use nearest::Nearest;
pub use place::{Metric, Place, Plane};
pub use rrt_mp::{Ask, Planner, RrtMp};
pub(crate) use swept::state_touches;
pub use swept::{Extent, leaves_map, on_terrain, touches};
pub use transitions::{Reuse, StartId, Transition, TransitionKey, Transitions};
pub use tree::{Node, Tree};
