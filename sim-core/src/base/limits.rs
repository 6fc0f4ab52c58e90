//! Limits. The error of a value beyond a limit gives the allowed range.

/// Maximum length of the name of a robot, module, environment or job, in bytes.
pub const MAX_NAME_LENGTH: usize = 64;
/// Maximum length of a description, in bytes.
pub const MAX_DESCRIPTION_LENGTH: usize = 4096;
/// Maximum length of the text of a job, robot or environment, in bytes.
pub const MAX_TOML_LENGTH: usize = 256 * 1024;
/// Largest seed of a job: TOML has no larger integers.
pub const MAX_SEED: u64 = i64::MAX as u64;
/// Maximum number of modules of a robot.
pub const MAX_MODULES: usize = 64;
/// Maximum number of rigid bodies of a robot that is written out body by body.
pub const MAX_BODIES: usize = 64;
/// Maximum number of links of an imported robot, before links without a joint between them are joined to one body.
pub const MAX_LINKS: usize = 1024;
/// Maximum number of boxes and capsules of all bodies of a robot.
pub const MAX_SHAPES: usize = 256;
/// Maximum nesting depth of elements in a robot's XML.
pub const MAX_XML_DEPTH: usize = 128;
/// Maximum number of faults of a file that are listed at once.
pub const MAX_FAULTS: usize = 10;
/// Number of faults in a file at which the search for more ends: finding the line of each takes time.
pub const MAX_FAULTS_SOUGHT: usize = 1000;
/// Maximum number of obstacles, and of pieces of terrain, of an environment.
pub const MAX_BOXES: usize = 256;
/// Maximum number of gaits of a candidate, k.
pub const MAX_GAITS: u32 = 32;
/// Maximum number of segments of a gait that is a sequence.
pub const MAX_GAIT_SEGMENTS: u32 = 200;
/// Maximum duration of a gait, s.
pub const MAX_DURATION: f64 = 600.0;
/// Maximum number of iterations of a planner, K.
pub const MAX_ITERATIONS: u32 = 100_000;
/// Maximum number of candidates of a generation.
pub const MAX_POPULATION: u32 = 10_000;
/// Maximum number of times that a search breeds a candidate again because it breaks the rules of the job.
pub const MAX_TRIES: usize = 1_000;
/// Maximum number of generations of a job.
pub const MAX_GENERATIONS: u32 = 1_000_000;
/// Maximum number of trees of an evaluation.
pub const MAX_REPEATS: u32 = 1_000;
/// Maximum number of physics steps, substeps included, that an evaluation may be able to take: on rapier some 20 hours
/// of one core.
pub const MAX_EVALUATION_STEPS: u64 = 10_000_000_000;
/// Maximum number of body-substeps that settling a job's robot may be able to take: half a minute to a minute of one
/// core. A body-substep takes 0.25 to 0.66 µs, measured by study's example `preparing` in a release build on one core
/// of a 2-core x86-64 machine: 64 bodies with 1 and 4 boxes each, 2 with 128, on rapier with both kinds of joints and
/// on lockstep, in 1, 10 and 100 substeps.
pub const MAX_PREPARATION: u64 = 100_000_000;
/// Maximum number of substeps per second of simulated time.
pub const MAX_SUBSTEPS_PER_SECOND: u32 = 100_000;
/// Maximum number of genotypes in a search's archive.
pub const MAX_ARCHIVE: u32 = 1_000;
/// Maximum number of fresh seeds for scoring a candidate in the finish.
pub const MAX_FINISH_SEEDS: u32 = 1_000;
/// Maximum number of trees of a planning job.
pub const MAX_PLAN_SEEDS: u32 = 1_000;
/// Maximum number of iterations of all trees of a planning job, and so maximum total length of its plans, in steps.
pub const MAX_PLAN_STEPS: u64 = 1_000_000;
/// Maximum number of repeats of a simulation job.
pub const MAX_SIMULATIONS: u32 = 1_000;
/// Maximum number of successive gaits of a simulation job.
pub const MAX_MOTION_STEPS: usize = 1_000;
/// Maximum number of replans in a repeat.
pub const MAX_REPLANS: u32 = 1_000;
/// Maximum number of simulated variants of a transition.
pub const MAX_VARIANTS: u32 = 16;
/// Maximum side of a map, mu.
pub const MAX_MAP_SIZE: f64 = 10_000.0;
/// Maximum number of cells of a coverage grid.
pub const MAX_CELLS: usize = 4_000_000;
/// Maximum number of numbers in a genotype.
pub const MAX_GENOTYPE: usize = 16_384;
/// Maximum number of parameters in all genotypes of a generation together. The state of a search, which is stored after
/// each generation, takes some 40 bytes for each parameter.
pub const MAX_GENERATION_PARAMETERS: usize = 8_000_000;
/// Maximum size of the genotypes in the tasks of one assignment, in bytes. It is far below the maximum size of a
/// message.
pub const MAX_ASSIGNMENT_GENOTYPES: usize = 8 * 1024 * 1024;
/// Maximum length of the reason that a robot can't be prepared, in bytes.
pub const MAX_REFUSAL: usize = 4096;
