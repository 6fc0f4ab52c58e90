//! Searches over real vectors.

mod constriction;
mod ga;
mod pso;

pub use constriction::Constriction;
pub use ga::Ga;
pub use pso::Pso;
