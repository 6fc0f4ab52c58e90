//! The job file and its identity.

pub use crate::problem::{JobSpec, Reference};

use crate::base::digest::Digest;
use crate::base::registry::Registered;
use crate::objective::FitnessSpec;
use crate::problem::Checked;
use crate::procedure::{ProcedureKind, kinds};
use crate::search::OptimiserSpec;
use serde::Serialize;
use std::collections::BTreeMap;

impl Checked {
    /// Returns the job digest: resolved job, robot, environment, optimiser and engine, but not their names or
    /// descriptions.
    pub fn digest(&self) -> Digest {
        self.digest_on(self.engine_digest())
    }

    /// Returns the digest of the same job with another engine digest, as in another build of evogait.
    pub fn digest_on(&self, engine: Digest) -> Digest {
        // Only fields that the job uses and that are not neutral take part. So fields that are added later do not
        // change existing digests.
        #[derive(Serialize)]
        struct Identity<'a> {
            spec: &'a JobSpec,
            engine: Digest,
            #[serde(skip_serializing_if = "BTreeMap::is_empty")]
            revisions: BTreeMap<&'static str, u32>,
        }
        let mut spec = self.spec().clone();
        spec.name.clear();
        spec.description.clear();
        if let (Reference::Inline(robot), Reference::Inline(environment)) = (&mut spec.robot, &mut spec.environment) {
            robot.name.clear();
            robot.description.clear();
            environment.name.clear();
            environment.description.clear();
        }
        let unless_named = <dyn ProcedureKind>::registry().default().name();
        spec.procedure.take_if(|name| name == unless_named);
        let used = [
            ("controller", spec.gaits.as_ref().map_or(1, |gaits| gaits.controller.0.revision())),
            ("planner", spec.planner.algorithm.0.revision()),
            ("fitness", spec.fitness.as_ref().map_or(1, FitnessSpec::revision)),
            ("optimiser", spec.optimiser.as_ref().map_or(1, OptimiserSpec::revision)),
            ("procedure", kinds::of(&spec).map_or(1, |kind| kind.revision())),
        ];
        let revisions = used.into_iter().filter(|(_, revision)| *revision > 1).collect();
        Digest::of("evogait job 1", &Identity { spec: &spec, engine, revisions })
    }
}
