//! Limits. Each has a name, and the error of a value beyond it names the limit.

/// Longest name of a robot, module, environment or job.
pub const MAX_NAME_LENGTH: usize = 64;
/// Longest description, in bytes.
pub const MAX_DESCRIPTION_LENGTH: usize = 4096;
/// Longest text of a job, robot or environment, in bytes.
pub const MAX_TOML_LENGTH: usize = 256 * 1024;
/// Largest seed of a job: TOML has no larger integers.
pub const MAX_SEED: u64 = i64::MAX as u64;
/// Most modules of a robot.
pub const MAX_MODULES: usize = 64;
/// Most rigid bodies of a robot that is written out body by body.
pub const MAX_BODIES: usize = 64;
/// Most links of an imported robot, before those without a joint between them become one body.
pub const MAX_LINKS: usize = 1024;
/// Most boxes and capsules of all its bodies.
pub const MAX_SHAPES: usize = 256;
/// Deepest nesting of elements in a robot's XML.
pub const MAX_XML_DEPTH: usize = 128;
/// Most faults of a file that are listed at once.
pub const MAX_FAULTS: usize = 10;
/// Faults of a file after which no more are sought: finding the line of each takes time.
pub const MAX_FAULTS_SOUGHT: usize = 1000;
/// Most obstacles, and most pieces of terrain, of an environment.
pub const MAX_BOXES: usize = 256;
/// Most gaits of a candidate, k.
pub const MAX_GAITS: u32 = 32;
/// Longest gait, s.
pub const MAX_DURATION: f64 = 600.0;
/// Most iterations of a planner, K.
pub const MAX_ITERATIONS: u32 = 100_000;
/// Most candidates of a generation.
pub const MAX_POPULATION: u32 = 10_000;
/// Most generations of a job.
pub const MAX_GENERATIONS: u32 = 1_000_000;
/// Most trees of an evaluation.
pub const MAX_REPEATS: u32 = 1_000;
/// Most physics steps, each with all of its substeps, that an evaluation may be able to take: on rapier some 20 hours of a
/// core.
pub const MAX_EVALUATION_STEPS: u64 = 10_000_000_000;
/// Most body-substeps that settling a job's robot may be able to take: half a minute to a minute of a core. Measured by
/// study's example `preparing` in a release build on one core of a 2-core x86-64 machine, 0.25 to 0.66 µs each: 64 bodies
/// with 1 and 4 boxes each, 2 with 128, on rapier with both kinds of joints and on lockstep, in 1, 10 and 100 substeps.
pub const MAX_PREPARATION: u64 = 100_000_000;
/// Most substeps in a second of simulated time.
pub const MAX_SUBSTEPS_PER_SECOND: u32 = 100_000;
/// Most genotypes in a search's archive.
pub const MAX_ARCHIVE: u32 = 1_000;
/// Most fresh seeds a candidate of the finish is scored on.
pub const MAX_FINISH_SEEDS: u32 = 1_000;
/// Most trees of a job that plans.
pub const MAX_PLAN_SEEDS: u32 = 1_000;
/// Most iterations of all trees of a job that plans, which also is the longest that all its plans can be together.
pub const MAX_PLAN_STEPS: u64 = 1_000_000;
/// Most repeats of a job that simulates.
pub const MAX_SIMULATIONS: u32 = 1_000;
/// Most gaits in turn of a job that simulates.
pub const MAX_MOTION_STEPS: usize = 1_000;
/// Most times that a repeat plans anew.
pub const MAX_REPLANS: u32 = 1_000;
/// Most simulated variants of a transition.
pub const MAX_VARIANTS: u32 = 16;
/// Largest side of a map, mu.
pub const MAX_MAP_SIZE: f64 = 10_000.0;
/// Most cells of a coverage grid.
pub const MAX_CELLS: usize = 4_000_000;
/// Longest genotype.
pub const MAX_GENOTYPE: usize = 16_384;
/// Most parameters in all genotypes of a generation together: the state of a search, which is stored after each of them,
/// has some 40 bytes for each.
pub const MAX_GENERATION_PARAMETERS: usize = 8_000_000;
/// Bytes of genotypes in the tasks of one assignment: it stays far below the largest message.
pub const MAX_ASSIGNMENT_GENOTYPES: usize = 8 * 1024 * 1024;
/// Longest reason for a robot that can't be prepared, in bytes.
pub const MAX_REFUSAL: usize = 4096;
