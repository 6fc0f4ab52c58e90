//! Motion planning with gaits: trees of configurations, grown by running a candidate's gaits.

mod grow;
mod metric;
mod nearest;
mod planner;
mod rrt_mp;
mod settings;
mod swept;
mod transitions;
mod tree;

pub(crate) use grow::standing_at;
pub use grow::{Growth, TreeScene};
pub use metric::{Metric, Posture};
pub use nearest::Nearest;
pub use planner::{Arrival, Ask, Planner, PlannerKind, PlannerSettings, Root};
pub(crate) use settings::validate_planner;
pub use settings::{MetricSpec, PlannerSpec};
pub use swept::{Extent, first_touch, goes_outside, leaves_map, on_terrain, touches};
pub use transitions::{Reuse, StartId, Transition, TransitionKey, Transitions};
pub use tree::{Node, Tree};

use crate::base::registry::{Registered, Registry};

/// Built-in planners. Error messages list them in this order; the first is the default.
static PLANNERS: Registry<dyn PlannerKind> =
    Registry::new(&[&rrt_mp::FLOOD_FILL, &rrt_mp::ORIGINAL, &rrt_mp::NEAREST_VALID]);

impl Registered for dyn PlannerKind {
    fn registry() -> &'static Registry<Self> {
        &PLANNERS
    }
}
